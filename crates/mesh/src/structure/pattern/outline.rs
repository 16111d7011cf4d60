//! Outlines of flat panels: edges, their checks, and their division into equal parts.

use case::pattern::{PatternEdge, PatternPanel, Side};

use super::error::PatternError;

/// A point or vector of a drawing, m.
pub(super) type Flat = [f64; 2];

pub(super) fn minus(a: Flat, b: Flat) -> Flat {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn cross(a: Flat, b: Flat) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(super) fn distance(a: Flat, b: Flat) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Point at the share `t` of the way from `a` to `b`.
fn between(a: Flat, b: Flat, t: f64) -> Flat {
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

/// Most points of an outline: each pair of its sides is tested for a crossing.
const MOST_POINTS: usize = 20_000;

/// An edge of a panel, as seen from outside.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub name: String,
    /// Polyline from the first to the last corner, m.
    points: Vec<Flat>,
    /// Length, m.
    pub length: f64,
}

impl Edge {
    fn new(name: String, points: Vec<Flat>) -> Self {
        let length = points.windows(2).map(|p| distance(p[0], p[1])).sum();
        Self { name, points, length }
    }

    /// The first of `cells` equal parts' ends: points at equal lengths along the edge, without its last corner.
    pub fn divided(&self, cells: usize) -> Vec<Flat> {
        let mut all = Vec::with_capacity(cells);
        let (mut k, mut done) = (0, 0.0);
        for i in 0..cells {
            let wanted = self.length * i as f64 / cells as f64;
            let mut part = distance(self.points[k], self.points[k + 1]);
            while done + part < wanted && k + 2 < self.points.len() {
                done += part;
                k += 1;
                part = distance(self.points[k], self.points[k + 1]);
            }
            all.push(between(self.points[k], self.points[k + 1], ((wanted - done) / part).clamp(0.0, 1.0)));
        }
        all
    }
}

/// The outline of a panel, as seen from outside, counter-clockwise.
#[derive(Clone, Debug)]
pub(super) struct Outline {
    pub panel: String,
    pub edges: Vec<Edge>,
    /// Side from which the drawing is seen.
    pub side: Side,
    /// Area, m2.
    pub area: f64,
}

impl Outline {
    /// Of a panel of the file.
    pub fn new(p: &PatternPanel) -> Result<Self, PatternError> {
        let wrong = |reason: &str| Err(PatternError::Panel { panel: p.name.clone(), reason: reason.into() });
        if p.name.is_empty() || p.name.contains('.') {
            return wrong("names of panels are not empty and have no dot");
        }
        if p.copies == 0 || p.copies > 1000 {
            return wrong("copies must be from 1 to 1000");
        }
        if !p.warp_deg.is_finite() {
            return wrong("warp_deg must be an angle in degrees");
        }
        if p.edges.is_empty() {
            return wrong("it has no [[panel.edge]]");
        }
        let mirror = p.seen_from.mirror();
        let mut edges = Vec::new();
        for (k, e) in p.edges.iter().enumerate() {
            check_edge(p, e, k)?;
            let next = &p.edges[(k + 1) % p.edges.len()];
            let corner = next.points_m.first().copied().unwrap_or_default();
            let points = e.points_m.iter().chain([&corner]).map(|x| [mirror * x[0], x[1]]);
            edges.push(Edge::new(e.name.clone(), points.collect()));
        }
        if p.seen_from == Side::Inside {
            // The mirrored outline runs clockwise.
            edges.reverse();
            edges.iter_mut().for_each(|e| e.points.reverse());
        }
        let mut outline = Self { panel: p.name.clone(), edges, side: p.seen_from, area: 0.0 };
        outline.area = outline.check()?;
        Ok(outline)
    }

    /// Refuses an outline that encloses no area in its sense; the area, m2.
    fn check(&self) -> Result<f64, PatternError> {
        for e in &self.edges {
            if e.points.windows(2).any(|p| distance(p[0], p[1]) <= 1e-9 * e.length) || e.length <= 0.0 {
                let reason = "two neighbouring points are in one place (an edge ends at the first point of the next one); remove one";
                return Err(PatternError::Edge {
                    panel: self.panel.clone(),
                    edge: e.name.clone(),
                    reason: reason.into(),
                });
            }
        }
        let points: Vec<Flat> =
            self.edges.iter().flat_map(|e| &e.points[..e.points.len() - 1]).copied().collect();
        if !(3..=MOST_POINTS).contains(&points.len()) {
            let reason = format!("its outline has {} points, and needs 3 to {MOST_POINTS}", points.len());
            return Err(PatternError::Panel { panel: self.panel.clone(), reason });
        }
        let counts: Vec<usize> = self.edges.iter().map(|e| e.points.len() - 1).collect();
        self.crossing(&points, &counts)?;
        let area = area(&points);
        if area < 0.0 {
            return Err(PatternError::Clockwise { panel: self.panel.clone(), area: -area });
        }
        Ok(area)
    }

    /// Refuses a closed polygon that crosses or touches itself, of which each edge has so many sides.
    pub fn crossing(&self, points: &[Flat], counts: &[usize]) -> Result<(), PatternError> {
        let n = points.len();
        let edge_of = |side: usize| {
            let mut last = 0;
            let at = counts.iter().position(|c| {
                last += c;
                side < last
            });
            self.edges[at.unwrap_or(0)].name.clone()
        };
        for i in 0..n {
            for j in i + 1..n {
                let [a, b, c, d] = [points[i], points[(i + 1) % n], points[j], points[(j + 1) % n]];
                let found = match (j == i + 1, (j + 1) % n == i) {
                    (true, true) => None,
                    // Neighbours touch in their corner, and must not fold back.
                    (true, false) => folded(a, b, d),
                    (false, true) => folded(c, a, b),
                    (false, false) => meet([a, b], [c, d]),
                };
                if let Some(at) = found {
                    let edges = [edge_of(i), edge_of(j)];
                    return Err(PatternError::Crossing { panel: self.panel.clone(), edges, at });
                }
            }
        }
        Ok(())
    }

    /// Place of an edge by its name.
    pub fn edge(&self, name: &str) -> Option<usize> {
        self.edges.iter().position(|e| e.name == name)
    }

    /// Share of the length of an edge as seen from outside, of one in the drawing.
    pub fn share(&self, at: f64) -> f64 {
        if self.side == Side::Inside { 1.0 - at } else { at }
    }
}

fn check_edge(p: &PatternPanel, e: &PatternEdge, k: usize) -> Result<(), PatternError> {
    let wrong = |reason: &str| {
        Err(PatternError::Edge { panel: p.name.clone(), edge: e.name.clone(), reason: reason.into() })
    };
    if e.name.is_empty() || e.name.contains('.') {
        return wrong("names of edges are not empty and have no dot");
    }
    if p.edges[..k].iter().any(|other| other.name == e.name) {
        return wrong("two edges of the panel have this name");
    }
    if e.points_m.is_empty() {
        return wrong("it has no points_m: give at least its first corner");
    }
    if e.points_m.iter().flatten().any(|x| !x.is_finite() || x.abs() > 1e4) {
        return wrong("its points must be finite lengths in m");
    }
    Ok(())
}

/// Area of a closed polygon, m2, positive where it runs counter-clockwise.
pub(super) fn area(points: &[Flat]) -> f64 {
    let next = points.iter().cycle().skip(1);
    0.5 * points.iter().zip(next).map(|(a, b)| cross(*a, *b)).sum::<f64>()
}

/// Where the sides from `a` over `b` to `c` lie on each other.
fn folded(a: Flat, b: Flat, c: Flat) -> Option<Flat> {
    let (u, v) = (minus(a, b), minus(c, b));
    let size = u[0].hypot(u[1]) * v[0].hypot(v[1]);
    (cross(u, v).abs() <= 1e-9 * size && u[0] * v[0] + u[1] * v[1] > 0.0).then_some(b)
}

/// Where two segments without a common end cross or touch.
fn meet([a, b]: [Flat; 2], [c, d]: [Flat; 2]) -> Option<Flat> {
    let (u, v, w) = (minus(b, a), minus(d, c), minus(c, a));
    let size = u[0].hypot(u[1]) * v[0].hypot(v[1]);
    let turn = cross(u, v);
    if turn.abs() <= 1e-12 * size {
        // Parallel: they touch where an end of one lies on the other.
        let on = |p: Flat, [a, b]: [Flat; 2]| {
            let (u, w) = (minus(b, a), minus(p, a));
            let length = u[0].hypot(u[1]);
            let along = (u[0] * w[0] + u[1] * w[1]) / length;
            (cross(u, w) / length).abs() <= 1e-9 * length && (0.0..=length).contains(&along)
        };
        return [c, d]
            .into_iter()
            .find(|p| on(*p, [a, b]))
            .or_else(|| [a, b].into_iter().find(|p| on(*p, [c, d])));
    }
    let (s, t) = (cross(w, v) / turn, cross(w, u) / turn);
    let inside = |x: f64| (-1e-9..=1.0 + 1e-9).contains(&x);
    (inside(s) && inside(t)).then(|| between(a, b, s))
}
