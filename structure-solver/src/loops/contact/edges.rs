//! Edges of the fabric near edges.
//!
//! Two edges without a common node repel along the line between the closest points of their lines, while both points lie on the
//! edges: elsewhere an end is closest, and nodes against triangles hold it. With the unit normal $`n`$ from the second edge to
//! the first, on the side on which they came near, the distance $`d`$ along it and the gap $`g = h - d`$ the energy is
//! $`\tfrac12 k\,\varphi\,g^2`$. The closest points divide the force among the ends. As the distance is stationary in them,
//! this is its gradient, and all forces of one pair lie on one line.
//!
//! **Parallel edges** have no crossing point and no normal. $`\varphi = c/\epsilon\,(2 - c/\epsilon)`$ of
//! $`c = \sin^2`$ of their angle fades the energy out below [`PARALLEL`] (Li et al., Incremental Potential Contact, ACM Transactions
//! on Graphics 39, 2020, section 5). There the ends of the shorter edge are closest.
//!
//! **Which edges.** An edge acts where it is a closest feature of the surface: a free edge, or a ridge whose both triangles
//! recede from the other edge by more than the thickness. Interior edges of flat layers cross edges of the next layer all over:
//! nodes against triangles hold those, and pairs of such edges would multiply the stiffness of a face by the density of the crossings.
//! A crease is no property of the mesh, so every edge is a candidate, and the rule is applied when a pair begins.

use super::friction::{self, Stick};
use super::hash::Map;
use super::touch::Touch;
use super::{BEYOND, TORN, index};
use crate::flat::at;
use mesh::geometry::Vec3;

/// Square of the sine of the angle below which the force of a pair fades out: 5.7 degrees. The derivative of the fade adds
/// about $`2 g^2/(\epsilon l^2)`$ of the pair's stiffness to it: less than the stiffness itself for gaps below 7 % of an edge.
const PARALLEL: f64 = 0.01;
/// The same below which there is no normal.
const NO_NORMAL: f64 = 1e-12;
/// Depth in thicknesses beyond which a pair that was pressed through is let go.
const DEEP: f64 = 4.0;
/// Numbers of a saved pair.
pub(super) const NUMBERS: usize = 6 + friction::NUMBERS;

/// An edge of the fabric.
struct Edge {
    nodes: [u32; 2],
    /// Third nodes of its triangles.
    apexes: Vec<u32>,
}

/// An edge near an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgePair {
    edges: [u32; 2],
    /// Unit normal at the last search, from the second edge to the first on the side on which they came near.
    normal: Vec3,
    /// Distance that is kept, m.
    thickness: f64,
    /// Where it sticks, with friction.
    stick: Option<Stick>,
}

impl EdgePair {
    /// As numbers.
    pub(super) fn row(&self) -> [f64; NUMBERS] {
        let [a, b] = self.edges.map(f64::from);
        let [f, g, h, i, j, k] = friction::row(self.stick);
        [a, b, self.normal[0], self.normal[1], self.normal[2], self.thickness, f, g, h, i, j, k]
    }
}

/// The closest points of two lines.
struct Crossing {
    /// The edges, m.
    along: [Vec3; 2],
    /// Cross product of the edges, m2; along the normal or against it.
    cross: Vec3,
    /// Unit normal, and the distance along it from the second to the first, m.
    normal: Vec3,
    distance: f64,
    /// Places of the points in shares of the edges.
    shares: [f64; 2],
    /// Square of the sine of the angle.
    sine2: f64,
}

impl Crossing {
    /// Of the lines through `a` and `b`; `None` where they are parallel.
    #[inline(always)]
    fn of(a: [Vec3; 2], b: [Vec3; 2]) -> Option<Self> {
        let along = [a[1] - a[0], b[1] - b[0]];
        let cross = along[0].cross(&along[1]);
        let square = cross.norm_squared();
        let sine2 = square / (along[0].norm_squared() * along[1].norm_squared());
        if sine2.is_nan() || sine2 <= NO_NORMAL {
            return None;
        }
        let r = b[0] - a[0];
        let shares = [1, 0].map(|i: usize| r.cross(&along[i]).dot(&cross) / square);
        let normal = cross * (1.0 / square.sqrt());
        Some(Self { along, cross, normal, distance: -r.dot(&normal), shares, sine2 })
    }

    /// With the normal on the side of `reference`.
    fn on_side_of(mut self, reference: Vec3) -> Self {
        if self.normal.dot(&reference) < 0.0 {
            self.normal = -self.normal;
            self.distance = -self.distance;
        }
        self
    }

    /// Whether the point on edge `i` lies on it, or a little beyond: a pair keeps its force until the next search passes it on.
    fn on_edge(&self, i: usize) -> bool {
        self.shares[i] > -BEYOND && self.shares[i] < 1.0 + BEYOND
    }

    fn on_both(&self) -> bool {
        self.on_edge(0) && self.on_edge(1)
    }

    /// The part of a vector along the surface.
    fn tangential(&self, e: Vec3) -> Vec3 {
        e - self.normal * self.normal.dot(&e)
    }

    /// Derivatives of the distance by the ends along the normal.
    fn weights(&self) -> [f64; 4] {
        let [s, t] = self.shares;
        [1.0 - s, s, t - 1.0, -t]
    }

    /// The sticking points at a tangential distance of `elastic` (m).
    fn stick(&self, elastic: Vec3) -> Stick {
        let [u, v] = self.along;
        let cross = self.cross / self.cross.norm_squared();
        let (s, t) = (elastic.cross(&v).dot(&cross), u.cross(&elastic).dot(&cross));
        let [a, b, c, d] = self.weights();
        Stick { weights: [a - s, b + s, c - t, d + t], elastic: elastic.norm() }
    }

    /// The factor of the energy, and its derivatives by both edges, 1/m.
    fn fade(&self) -> (f64, [Vec3; 2]) {
        let c = self.sine2 / PARALLEL;
        if c >= 1.0 {
            return (1.0, [Vec3::zeros(); 2]);
        }
        let slope = 2.0 / PARALLEL * (1.0 - c);
        let [u, v] = self.along;
        let [uu, vv] = [u.norm_squared(), v.norm_squared()];
        let by_u = v.cross(&self.cross) * (2.0 / (uu * vv)) - u * (2.0 * self.sine2 / uu);
        let by_v = self.cross.cross(&u) * (2.0 / (uu * vv)) - v * (2.0 * self.sine2 / vv);
        (c * (2.0 - c), [by_u * slope, by_v * slope])
    }
}

/// All edges of the fabric, and the pairs of them that are near each other.
pub(super) struct EdgePairs {
    edges: Vec<Edge>,
    /// Edges of each node: those of node `n` are `around[first[n]..first[n + 1]]`.
    first: Vec<u32>,
    around: Vec<u32>,
    pub(super) pairs: Vec<EdgePair>,
    /// Pairs at the search before; those among them whose edges were left under pressure.
    before: Vec<EdgePair>,
    left: Vec<EdgePair>,
    /// Places in `pairs`.
    known: Map<[u32; 2], u32>,
    /// Boxes around the edges with the reach, m, and the edges of each cell of the hash.
    boxes: Vec<[Vec3; 2]>,
    cells: Map<[i32; 3], Vec<u32>>,
    /// Boxes that the last search compared.
    pub(super) compared: usize,
}

/// Edges of triangles by their nodes, with their third nodes.
fn edges_of(triangles: &[[u32; 3]]) -> Vec<Edge> {
    let sides = |t: &[u32; 3]| {
        let t = *t;
        (0..3).map(move |i| (t[i], t[(i + 1) % 3], t[(i + 2) % 3]))
    };
    let mut all: Vec<[u32; 3]> =
        triangles.iter().flat_map(sides).map(|(a, b, apex)| [a.min(b), a.max(b), apex]).collect();
    all.sort_unstable();
    all.chunk_by(|a, b| a[..2] == b[..2])
        .map(|same| Edge { nodes: [same[0][0], same[0][1]], apexes: same.iter().map(|e| e[2]).collect() })
        .collect()
}

impl EdgePairs {
    /// Of the edges of `triangles` between `nodes` nodes.
    pub(super) fn new(triangles: &[[u32; 3]], nodes: usize) -> Self {
        let edges = edges_of(triangles);
        let mut first = vec![0u32; nodes + 1];
        edges.iter().flat_map(|e| e.nodes).for_each(|n| first[n as usize + 1] += 1);
        (0..nodes).for_each(|n| first[n + 1] += first[n]);
        let (mut around, mut next) = (vec![0; 2 * edges.len()], first.clone());
        for (k, e) in edges.iter().enumerate() {
            for n in e.nodes {
                around[next[n as usize] as usize] = k as u32;
                next[n as usize] += 1;
            }
        }
        Self {
            boxes: vec![[Vec3::zeros(); 2]; edges.len()],
            edges,
            first,
            around,
            pairs: Vec::new(),
            before: Vec::new(),
            left: Vec::new(),
            known: Map::default(),
            cells: Map::default(),
            compared: 0,
        }
    }

    fn ends(&self, edge: u32, x: &[f64]) -> [Vec3; 2] {
        self.edges[edge as usize].nodes.map(|n| at(x, n as usize))
    }

    fn crossing(&self, edges: [u32; 2], x: &[f64]) -> Option<Crossing> {
        Crossing::of(self.ends(edges[0], x), self.ends(edges[1], x))
    }

    /// Edges that end at a node.
    fn at_node(&self, node: u32) -> &[u32] {
        let n = node as usize;
        &self.around[self.first[n] as usize..self.first[n + 1] as usize]
    }

    /// Pairs in contact at positions `x` (m).
    pub(super) fn touches<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = Touch> + 'a {
        self.pairs.iter().filter_map(move |p| self.near(p, x).filter(|t| t.gap > 0.0))
    }

    /// A pair whose closest points lie on its edges.
    #[inline(always)]
    fn near(&self, p: &EdgePair, x: &[f64]) -> Option<Touch> {
        let c = self.crossing(p.edges, x).filter(Crossing::on_both)?.on_side_of(p.normal);
        let [[a0, a1], [b0, b1]] = p.edges.map(|e| self.edges[e as usize].nodes);
        let (weights, (fade, turn)) = (c.weights(), c.fade());
        let (nodes, gap) = ([a0, a1, b0, b1], p.thickness - c.distance);
        Some(Touch {
            nodes,
            weights,
            normal: c.normal,
            distance: c.distance,
            gap,
            fade,
            turn,
            stick: p.stick,
        })
    }

    /// Ends a step at `x` (m) with friction at a stiffness (N/m); the energy that slip took, J, and whether a pair has left its
    /// edges under pressure.
    pub(super) fn slip(&mut self, friction: f64, stiffness: f64, x: &[f64]) -> (f64, bool) {
        let (mut taken, mut left) = (0.0, false);
        for k in 0..self.pairs.len() {
            let Some(touch) = self.near(&self.pairs[k], x) else {
                left |= self.pairs[k].stick.is_some();
                continue;
            };
            let (stick, work) = touch.after_step(friction, stiffness, x);
            self.pairs[k].stick = stick;
            taken += work;
        }
        (taken, left)
    }

    /// Finds the pairs within twice the `thickness` (m) at positions `x` (m), in cells of `size` (m).
    pub(super) fn search(&mut self, x: &[f64], thickness: f64, size: f64, friction: Option<f64>) {
        self.review(x, thickness, size);
        self.hand_over(x, thickness, friction.unwrap_or(0.0));
        self.find(x, thickness, size);
    }

    /// Whether an edge is in contact with nothing: torn in a solve that fails.
    fn torn(&self, edge: u32, x: &[f64], size: f64) -> bool {
        let [a, b] = self.ends(edge, x);
        let extent = (b - a).amax();
        extent.is_nan() || extent > TORN * size
    }

    /// Keeps the pairs that are still near, also those that were pressed through; their distance grows up to the thickness.
    fn review(&mut self, x: &[f64], thickness: f64, size: f64) {
        std::mem::swap(&mut self.pairs, &mut self.before);
        self.pairs.clear();
        self.left.clear();
        self.known.clear();
        for k in 0..self.before.len() {
            let p = self.before[k];
            if p.edges.iter().any(|&e| self.torn(e, x, size)) {
                continue;
            }
            // Parallel now: they may turn on.
            let Some(c) = self.crossing(p.edges, x).map(|c| c.on_side_of(p.normal)) else {
                self.push(p);
                continue;
            };
            if !c.on_both() {
                if c.distance < p.thickness {
                    self.left.push(p);
                }
            } else if c.distance <= 2.0 * thickness && c.distance >= -DEEP * thickness {
                let kept = p.thickness.max(c.distance.min(thickness));
                self.push(EdgePair { normal: c.normal, thickness: kept, ..p });
            }
        }
    }

    fn push(&mut self, pair: EdgePair) {
        self.known.insert(pair.edges, self.pairs.len() as u32);
        self.pairs.push(pair);
    }

    /// Adds pairs that come near: boxes that overlap, each two compared in the first cell that both lie in.
    fn find(&mut self, x: &[f64], thickness: f64, size: f64) {
        let mut cells = std::mem::take(&mut self.cells);
        // Cells that the fabric has left are dropped.
        if cells.len() > 16 * self.edges.len() {
            cells.clear();
        }
        cells.values_mut().for_each(Vec::clear);
        self.compared = 0;
        let cell = |x: Vec3| -> [i32; 3] { x.map(|v| (v / size).floor() as i32).into() };
        let margin = Vec3::repeat(thickness + BEYOND * size);
        for e in 0..self.edges.len() as u32 {
            if self.torn(e, x, size) || !self.may_act(e, x, thickness) {
                continue;
            }
            let [a, b] = self.ends(e, x);
            let [low, high] = [a.inf(&b) - margin, a.sup(&b) + margin];
            self.boxes[e as usize] = [low, high];
            let (from, to) = (cell(low), cell(high));
            for i in from[0]..=to[0] {
                for j in from[1]..=to[1] {
                    for k in from[2]..=to[2] {
                        let here = [i, j, k];
                        let list = cells.entry(here).or_default();
                        self.compared += list.len();
                        for &other in list.iter() {
                            let [l, h] = self.boxes[other as usize];
                            let near = (0..3).all(|c| l[c] <= high[c] && h[c] >= low[c]);
                            if near && cell(low.sup(&l)) == here {
                                self.begin([other, e], x, thickness);
                            }
                        }
                        list.push(e);
                    }
                }
            }
        }
        self.cells = cells;
    }

    /// The closest points of two edges without a common node, where both lie strictly inside the edges.
    fn candidate(&self, edges: [u32; 2], x: &[f64]) -> Option<Crossing> {
        let [a, b] = edges.map(|e| self.edges[e as usize].nodes);
        if a.iter().any(|n| b.contains(n)) {
            return None;
        }
        self.crossing(edges, x).filter(|c| c.shares.iter().all(|s| *s > 0.0 && *s < 1.0))
    }

    /// Adds a pair that is near and of edges that act on each other; without force.
    fn begin(&mut self, edges: [u32; 2], x: &[f64], thickness: f64) {
        if self.known.contains_key(&edges) {
            return;
        }
        let Some(c) = self.candidate(edges, x).filter(|c| c.distance.abs() <= 2.0 * thickness) else {
            return;
        };
        let normal = c.normal * c.distance.signum();
        if self.act(edges, normal, x, thickness) {
            self.push(EdgePair { edges, normal, thickness: thickness.min(c.distance.abs()), stick: None });
        }
    }

    /// Whether there is a direction in which an edge can act ([`EdgePairs::act`]). The largest distance by which both triangles of an edge
    /// recede in one direction is the distance of the edge from the line between their third nodes, seen along the edge.
    fn may_act(&self, edge: u32, x: &[f64], thickness: f64) -> bool {
        let Edge { nodes, apexes } = &self.edges[edge as usize];
        let &[a, b] = apexes.as_slice() else { return true };
        let [from, to] = nodes.map(|n| at(x, n as usize));
        let along = to - from;
        let across = |n: u32| {
            let r = at(x, n as usize) - from;
            r - along * (r.dot(&along) / along.norm_squared())
        };
        let (p, q) = (across(a), across(b));
        let share = (p.dot(&(p - q)) / (p - q).norm_squared()).clamp(0.0, 1.0);
        let nearest = (p + (q - p) * share).norm_squared();
        // Not a number, where both nodes are in one place: it may.
        nearest.is_nan() || nearest > thickness * thickness
    }

    /// Whether two edges are what comes nearest along the normal, on their sides: a free edge whose triangle does not reach out
    /// further, or a ridge whose triangles recede by more than the thickness.
    fn act(&self, edges: [u32; 2], normal: Vec3, x: &[f64], thickness: f64) -> bool {
        edges.iter().zip([-normal, normal]).all(|(&e, towards)| {
            let Edge { nodes, apexes } = &self.edges[e as usize];
            let limit = if apexes.len() == 1 { thickness } else { -thickness };
            let point = at(x, nodes[0] as usize);
            apexes.iter().all(|&n| (at(x, n as usize) - point).dot(&towards) < limit)
        })
    }

    /// Tangential distance of the sticking points of a pair, m.
    fn elastic(&self, p: &EdgePair, c: &Crossing, stick: &Stick, x: &[f64]) -> Vec3 {
        let [a, b] = p.edges.map(|e| self.ends(e, x));
        let parts = [a[0], a[1], b[0], b[1]].into_iter().zip(stick.weights.iter().zip(c.weights()));
        parts.map(|(x, (stuck, now))| x * (stuck - now)).sum()
    }

    /// Passes the force of each pair whose edge was left under pressure to one pair of the next edge there: with the same side and the
    /// same energy, or less.
    fn hand_over(&mut self, x: &[f64], thickness: f64, friction: f64) {
        for k in 0..self.left.len() {
            let p = self.left[k];
            let Some(c) = self.crossing(p.edges, x).map(|c| c.on_side_of(p.normal)) else { continue };
            let energy = c.fade().0 * (p.thickness - c.distance).powi(2);
            let elastic = p.stick.map(|s| self.elastic(&p, &c, &s, x));
            let next = |i: usize| {
                let (edge, s) = (&self.edges[p.edges[i] as usize], c.shares[i]);
                if c.on_edge(i) {
                    std::slice::from_ref(&p.edges[i])
                } else {
                    self.at_node(edge.nodes[usize::from(s > 0.5)])
                }
            };
            let combined = next(0).iter().flat_map(|&a| next(1).iter().map(move |&b| [a, b]));
            let taken = combined.into_iter().find_map(|[a, b]| {
                let (edges, side) = if a < b { ([a, b], p.normal) } else { ([b, a], -p.normal) };
                let found = self.candidate(edges, x)?.on_side_of(side);
                // Each pair takes one force.
                let known = self.known.get(&edges).map(|k| self.pairs[*k as usize]);
                if known.is_some_and(|k| k.thickness > found.normal.dot(&k.normal).signum() * found.distance)
                {
                    return None;
                }
                let gap = (energy / found.fade().0).sqrt().min(p.thickness - c.distance);
                let kept = (found.distance + gap).min(thickness);
                let acts = kept >= 0.0 && self.act(edges, found.normal, x, thickness);
                let side = if a < b { 1.0 } else { -1.0 };
                let held =
                    |e: Vec3| friction::limited(found.tangential(e * side), friction * gap * found.fade().0);
                let stick = elastic.map(|e| found.stick(held(e)));
                acts.then_some(EdgePair { edges, normal: found.normal, thickness: kept, stick })
            });
            if let Some(pair) = taken {
                match self.known.get(&pair.edges) {
                    Some(&place) => self.pairs[place as usize] = pair,
                    None => self.push(pair),
                }
            }
        }
    }

    /// The pair of numbers that [`EdgePair::row`] gave; `None` where they are none of this fabric.
    pub(super) fn pair(&self, r: &[f64; NUMBERS], thickness: f64) -> Option<EdgePair> {
        let [a, b] = [index(r[0], self.edges.len())?, index(r[1], self.edges.len())?];
        let normal = Vec3::new(r[2], r[3], r[4]);
        let sound = a < b && (normal.norm() - 1.0).abs() < 1e-9 && (0.0..=thickness).contains(&r[5]);
        let stick = friction::of_row([r[6], r[7], r[8], r[9], r[10], r[11]])?;
        sound.then_some(EdgePair { edges: [a as u32, b as u32], normal, thickness: r[5], stick })
    }
}
