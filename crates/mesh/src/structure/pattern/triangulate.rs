//! Triangles of a flat panel: a hexagonal lattice inside of its divided outline, smoothed, with constrained Delaunay triangulation.

use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use super::outline::{Flat, cross, distance, minus};

/// Least distance of a lattice point from the outline, in element sizes: midway between a row on the outline and one at the height of a triangle.
const CLEARANCE: f64 = 0.6;

/// Rounds of triangulation, and of smoothing in each.
const ROUNDS: [usize; 2] = [4, 4];

/// A triangulated panel.
#[derive(Clone, Debug)]
pub(super) struct FlatMesh {
    /// Nodes, m: first those of the outline in its order.
    pub points: Vec<Flat>,
    /// Counter-clockwise triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// Quality of a triangle $`4 \sqrt{3} A / \sum l^2`$: 1 where it is equilateral, 0 without area.
pub(super) fn quality([a, b, c]: [Flat; 3]) -> f64 {
    let squares = [minus(b, a), minus(c, b), minus(a, c)].map(|e| e[0] * e[0] + e[1] * e[1]);
    2.0 * 3_f64.sqrt() * cross(minus(b, a), minus(c, a)) / squares.iter().sum::<f64>()
}

impl FlatMesh {
    /// Of a closed outline that runs counter-clockwise and does not cross itself, with triangles of the edge length `size` (m). `None` where spade finds no
    /// triangulation.
    pub fn new(outline: &[Flat], size: f64) -> Option<Self> {
        let mut points = outline.to_vec();
        points.extend(lattice(outline, size));
        let mut triangles = delaunay(&points, outline)?;
        for _ in 0..ROUNDS[0] {
            smooth(&mut points, outline.len(), &triangles);
            triangles = delaunay(&points, outline)?;
        }
        Some(Self { points, triangles })
    }

    /// Worst quality of a triangle, and where it is.
    pub fn worst(&self) -> (f64, Flat) {
        let corners = self.triangles.iter().map(|t| t.map(|n| self.points[n as usize]));
        let mut worst = (1.0, [0.0; 2]);
        for x in corners {
            let q = quality(x);
            if q < worst.0 {
                worst = (q, [0, 1].map(|i| (x[0][i] + x[1][i] + x[2][i]) / 3.0));
            }
        }
        worst
    }
}

/// Points of a hexagonal lattice inside of the outline, symmetric about the middle of its bounding box.
fn lattice(outline: &[Flat], size: f64) -> Vec<Flat> {
    let bounds = |i: usize| {
        outline.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x[i]), h.max(x[i])])
    };
    let [x, y] = [bounds(0), bounds(1)];
    let middle = [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])];
    let row = size * 0.75_f64.sqrt();
    let [columns, rows] = [(x[1] - x[0]) / size, (y[1] - y[0]) / row].map(|n| (0.5 * n).ceil() as i64 + 1);
    let mut all = Vec::new();
    for j in -rows..=rows {
        let shift = if j % 2 == 0 { 0.0 } else { 0.5 };
        for i in -columns..=columns {
            let p = [middle[0] + (i as f64 + shift) * size, middle[1] + j as f64 * row];
            if is_inside(p, outline) && clearance(p, outline) >= CLEARANCE * size {
                all.push(p);
            }
        }
    }
    all
}

/// Whether a point lies in a closed polygon, by the parity of crossings.
fn is_inside(p: Flat, outline: &[Flat]) -> bool {
    let next = outline.iter().cycle().skip(1);
    let crosses = |(a, b): &(&Flat, &Flat)| {
        (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    };
    outline.iter().zip(next).filter(crosses).count() % 2 == 1
}

/// Distance of a point from a closed polygon.
fn clearance(p: Flat, outline: &[Flat]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    let from = |(a, b): (&Flat, &Flat)| {
        let (u, w) = (minus(*b, *a), minus(p, *a));
        let t = ((u[0] * w[0] + u[1] * w[1]) / (u[0] * u[0] + u[1] * u[1])).clamp(0.0, 1.0);
        distance(p, [a[0] + t * u[0], a[1] + t * u[1]])
    };
    outline.iter().zip(next).map(from).fold(f64::INFINITY, f64::min)
}

/// Delaunay triangles inside of the outline, whose sides are kept.
fn delaunay(points: &[Flat], outline: &[Flat]) -> Option<Vec<[u32; 3]>> {
    let n = outline.len();
    let vertices = points.iter().map(|p| Point2::new(p[0], p[1])).collect();
    let sides = (0..n).map(|i| [i, (i + 1) % n]).collect();
    let mut conflict = false;
    let found = ConstrainedDelaunayTriangulation::<Point2<f64>>::try_bulk_load_cdt(vertices, sides, |_| {
        conflict = true
    });
    let found = found.ok().filter(|t| !conflict && t.num_vertices() == points.len())?;
    let triangles = found.inner_faces().map(|f| f.vertices().map(|v| v.index() as u32));
    let middle = |t: &[u32; 3]| {
        let x = t.map(|i| points[i as usize]);
        [0, 1].map(|i| (x[0][i] + x[1][i] + x[2][i]) / 3.0)
    };
    // Where points of a straight edge lie inside of the hull by round-off, the triangle between them and the hull is no part of the panel.
    let proper = |t: &[u32; 3]| quality(t.map(|i| points[i as usize])) > 1e-9;
    let mut all: Vec<_> = triangles.filter(|t| proper(t) && is_inside(middle(t), outline)).collect();
    all.sort_unstable();
    // Euler's formula for a polygon without holes.
    (all.len() + n + 2 == 2 * points.len()).then_some(all)
}

/// Moves the nodes inside to the middle of their neighbours, several times.
fn smooth(points: &mut [Flat], fixed: usize, triangles: &[[u32; 3]]) {
    let mut sums = vec![([0.0; 2], 0.0); points.len()];
    for _ in 0..ROUNDS[1] {
        sums.fill(([0.0; 2], 0.0));
        for t in triangles {
            for i in 0..3 {
                let (a, b) = (t[i] as usize, t[(i + 1) % 3] as usize);
                for (to, from) in [(a, b), (b, a)] {
                    let (sum, count) = &mut sums[to];
                    (0..2).for_each(|c| sum[c] += points[from][c]);
                    *count += 1.0;
                }
            }
        }
        for (x, (sum, count)) in points.iter_mut().zip(&sums).skip(fixed) {
            if *count > 0.0 {
                *x = sum.map(|s| s / count);
            }
        }
    }
}
