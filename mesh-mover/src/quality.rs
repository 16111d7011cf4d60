//! Quality of cells: scaled Jacobian at every corner, optimised for moving grids.

use std::ops::Range;

use mesh::geometry::Vec3;
use mesh::lanes::{LANES, Lanes, Real, gather};
use mesh::quality::CORNER_EDGES;
use nalgebra::Vector3;

/// Scaled Jacobian of one corner: determinant of its three edges over the
/// product of their lengths. 1 is a right-angled corner, 0 a flat one, negative
/// an inverted one; NaN for NaN or for edges without length.
#[inline]
pub fn corner_quality(p: Vec3, a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let (a, b, c) = (a - p, b - p, c - p);
    a.dot(&b.cross(&c)) / (a.dot(&a) * b.dot(&b) * c.dot(&c)).sqrt()
}

#[inline]
fn quality_of(quad: &[u32; 4], x: &[f64]) -> f64 {
    let at = |n: u32| -> Vec3 {
        let n = 3 * n as usize;
        Vec3::new(x[n], x[n + 1], x[n + 2])
    };
    corner_quality(at(quad[0]), at(quad[1]), at(quad[2]), at(quad[3]))
}

/// Scaled Jacobian of a hexahedron with eight distinct corners `p`: the minimum over them. Each of its twelve edges
/// is computed once. NaN counts as minus infinity.
#[inline(always)]
fn regular_quality<T: Real>(p: &[Vector3<T>; 8]) -> T {
    // Edges along the three parent axes, by the corner at their lower end.
    let edge = |a: usize, b: usize| p[b] - p[a];
    let x = [edge(0, 1), edge(3, 2), edge(4, 5), edge(7, 6)];
    let y = [edge(0, 3), edge(1, 2), edge(4, 7), edge(5, 6)];
    let z = [edge(0, 4), edge(1, 5), edge(2, 6), edge(3, 7)];
    let (x2, y2, z2) = (x.map(|e| e.dot(&e)), y.map(|e| e.dot(&e)), z.map(|e| e.dot(&e)));
    let mut worst = T::splat(f64::INFINITY);
    for [i, j, k] in EDGES_AT {
        let det = x[i].dot(&y[j].cross(&z[k]));
        let square = det * det.simd_abs() / (x2[i] * y2[j] * z2[k]);
        let number = square.simd_eq(square);
        let square = square.select(number, T::splat(f64::NEG_INFINITY));
        worst = worst.select(square.simd_ge(worst), square);
    }
    worst.simd_abs().simd_sqrt().simd_copysign(worst)
}

/// Volume of a (possibly collapsed) hexahedron with bilinear faces: the value of [`mesh::quality::volume`] from three
/// determinants (J. Grandy, UCRL-ID-128886, 1997).
#[inline(always)]
pub fn volume<T: Real>(p: &[Vector3<T>; 8]) -> T {
    let (a, b) = (p[6] - p[1], p[7] - p[0]);
    let (c, d) = (p[6] - p[3], p[2] - p[0]);
    let (e, f) = (p[5] - p[0], p[6] - p[4]);
    let sum = (a + b).dot(&c.cross(&d)) + b.dot(&(c + e).cross(&f)) + a.dot(&e.cross(&(f + d)));
    sum / T::splat(12.0)
}

/// Edges (along x, y, z, as numbered in [`regular_quality`]) that meet in each corner.
const EDGES_AT: [[usize; 3]; 8] =
    [[0, 0, 0], [0, 1, 1], [1, 1, 2], [1, 0, 3], [2, 2, 0], [2, 3, 1], [3, 3, 2], [3, 2, 3]];

/// The minimum; NaN counts as minus infinity.
#[inline]
pub(crate) fn lower(worst: f64, s: f64) -> f64 {
    if s >= worst {
        worst
    } else if s.is_nan() {
        f64::NEG_INFINITY
    } else {
        s
    }
}

/// Cells with data for a fast evaluation of their quality: hexahedra with eight distinct corners need none, the
/// corners of collapsed ones are listed as node quadruples.
#[derive(Clone, Debug, Default)]
pub struct Corners {
    /// Cells with a collapsed edge, ascending.
    collapsed: Vec<u32>,
    /// Corner node and its three neighbours.
    quads: Vec<[u32; 4]>,
    /// Factor of each corner's scaled Jacobian.
    scale: Vec<f32>,
    /// First corner of each collapsed cell, and the end.
    first: Vec<u32>,
}

impl Corners {
    /// Corners of `cells`, with start positions `x` (flat, m). A collapsed edge is replaced by the next edge behind
    /// it; a corner with fewer than three distinct edges is a copy of another one and is omitted.
    ///
    /// The sharp corners of wedges are intended (a slit ends there), so corners at a collapsed edge are measured
    /// relative to their start: 1 there, 0 when flat.
    pub fn new(cells: &[[u32; 8]], x: &[f64]) -> Self {
        let mut all = Self { first: vec![0], ..Self::default() };
        for (c, cell) in cells.iter().enumerate() {
            if (0..8).all(|i| !cell[..i].contains(&cell[i])) {
                continue;
            }
            let start = all.quads.len();
            for i in 0..8 {
                let Some(quad) = corner(cell, i).filter(|q| !same_corner(&all.quads[start..], q)) else {
                    continue;
                };
                let regular = CORNER_EDGES[i].iter().zip(&quad[1..]).all(|(&j, &a)| cell[j] == a);
                let at_start = quality_of(&quad, x);
                let counts_from_start = !regular && at_start > 0.0;
                all.scale.push(if counts_from_start { (1.0 / at_start) as f32 } else { 1.0 });
                all.quads.push(quad);
            }
            all.collapsed.push(c as u32);
            all.first.push(all.quads.len() as u32);
        }
        all
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        20 * self.quads.len() + 8 * self.collapsed.len()
    }

    /// Smallest scaled Jacobian of cell `c` of `cells` (those of [`Corners::new`]) at node positions `x` (flat, m).
    /// NaN counts as minus infinity.
    pub fn quality(&self, cells: &[[u32; 8]], c: usize, x: &[f64]) -> f64 {
        match self.collapsed.binary_search(&(c as u32)) {
            Ok(k) => self.collapsed_quality(k, x),
            Err(_) => regular_quality(&corners_at(&cells[c], x)),
        }
    }

    /// Calls `f` with each of `cells`, its quality and its volume (m3), in ascending order.
    #[inline]
    pub fn each(&self, cells: &[[u32; 8]], x: &[f64], mut f: impl FnMut(usize, f64, f64)) {
        let mut start = 0;
        for (k, &c) in self.collapsed.iter().enumerate() {
            let c = c as usize;
            each_regular(cells, start..c, x, &mut f);
            f(c, self.collapsed_quality(k, x), volume(&corners_at(&cells[c], x)));
            start = c + 1;
        }
        each_regular(cells, start..cells.len(), x, &mut f);
    }

    fn collapsed_quality(&self, k: usize, x: &[f64]) -> f64 {
        let range = self.first[k] as usize..self.first[k + 1] as usize;
        let mut worst = f64::INFINITY;
        for (q, scale) in self.quads[range.clone()].iter().zip(&self.scale[range]) {
            worst = lower(worst, f64::from(*scale) * quality_of(q, x));
        }
        worst
    }
}

/// [`Corners::each`] for the cells of a `run` that have eight corners, [`LANES`] at a time.
#[inline(always)]
fn each_regular(cells: &[[u32; 8]], run: Range<usize>, x: &[f64], f: &mut impl FnMut(usize, f64, f64)) {
    let nodes = x.as_chunks::<3>().0;
    for start in run.clone().step_by(LANES) {
        let last = run.end - 1;
        let batch: [&[u32; 8]; LANES] = std::array::from_fn(|l| &cells[(start + l).min(last)]);
        let mut p = [Vector3::<Lanes>::zeros(); 8];
        for (k, p) in p.iter_mut().enumerate() {
            *p = gather(nodes, &[batch[0][k], batch[1][k], batch[2][k], batch[3][k]]);
        }
        let (quality, volume) = (regular_quality(&p).into_arr(), volume(&p).into_arr());
        for l in 0..LANES.min(run.end - start) {
            f(start + l, quality[l], volume[l]);
        }
    }
}

/// Corner positions of a cell.
#[inline]
pub fn corners_at(cell: &[u32; 8], x: &[f64]) -> [Vec3; 8] {
    cell.map(|a| {
        let a = 3 * a as usize;
        Vec3::new(x[a], x[a + 1], x[a + 2])
    })
}

fn corner(cell: &[u32; 8], i: usize) -> Option<[u32; 4]> {
    let mut quad = [cell[i], 0, 0, 0];
    let mut taken = 1;
    // Edges that are not collapsed come first: a replacement must differ from them.
    let direct = CORNER_EDGES[i].map(|j| cell[j]);
    for (slot, &j) in CORNER_EDGES[i].iter().enumerate() {
        let node = if cell[j] != cell[i] {
            Some(cell[j])
        } else {
            CORNER_EDGES[j].iter().map(|&k| cell[k]).find(|&n| n != cell[i] && !direct.contains(&n))
        }?;
        if quad[1..taken].contains(&node) {
            return None;
        }
        quad[slot + 1] = node;
        taken = slot + 2;
    }
    Some(quad)
}

fn same_corner(known: &[[u32; 4]], q: &[u32; 4]) -> bool {
    let sorted = |q: &[u32; 4]| {
        let mut s = [q[1], q[2], q[3]];
        s.sort_unstable();
        s
    };
    known.iter().any(|k| k[0] == q[0] && sorted(k) == sorted(q))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> [Vec3; 8] {
        [
            [0., 0., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 0., 1.],
            [1., 1., 1.],
            [0., 1., 1.],
        ]
        .map(Vec3::from)
    }

    fn flat(x: &[Vec3]) -> Vec<f64> {
        x.iter().flat_map(|p| <[f64; 3]>::from(*p)).collect()
    }

    #[test]
    fn right_angles_have_quality_one_and_collapsed_cells_known_values() {
        let x = flat(&cube());
        // Start positions at which collapsed corners are not scaled: all flat.
        let q = |cell: [u32; 8]| {
            let c = Corners::new(&[cell], &[0.0; 24]);
            (c.quads.len(), c.quality(&[cell], 0, &x))
        };
        assert_eq!(q([0, 1, 2, 3, 4, 5, 6, 7]), (0, 1.0), "no corners are stored");
        let (n, s) = q([0, 1, 2, 2, 4, 5, 6, 6]);
        assert_eq!(n, 6);
        assert!((s - 0.5f64.sqrt()).abs() < 1e-14, "sharp corner of the prism, 45 degrees: {s}");
        let (n, s) = q([0, 1, 2, 3, 4, 4, 4, 4]);
        assert_eq!(n, 8, "four at the base, the apex with each three of its four edges");
        assert!(s > 0.25 && s < 0.8, "{s}");
        let (n, s) = q([0, 1, 2, 2, 4, 4, 4, 4]);
        assert_eq!(n, 4);
        assert!(s > 0.25 && s < 0.8, "{s}");
        // Every other collapsed edge: each edge of the cube in turn.
        for (a, list) in CORNER_EDGES.iter().enumerate() {
            for &b in list {
                let mut cell = [0, 1, 2, 3, 4, 5, 6, 7];
                cell[b] = a as u32;
                let (n, s) = q(cell);
                assert!(n >= 7 && s > 0.3, "edge {a}-{b}: {n} corners, {s}");
            }
        }
    }

    #[test]
    fn sharp_wedge_starts_at_one_and_ends_at_zero() {
        let thin = |w: f64| {
            let mut x = cube();
            for a in [1, 5] {
                x[a][1] = 1.0 - w;
            }
            flat(&x)
        };
        // The tip is edge 0-4; 1-5 moves towards the line from it to 2-6.
        let wedge = [[0, 1, 2, 0, 4, 5, 6, 4]];
        let c = Corners::new(&wedge, &thin(0.05));
        let known = |w: f64| c.quality(&wedge, 0, &thin(w));
        assert!(
            (known(0.05) - mesh::quality::scaled_jacobian(thin(0.05).as_chunks().0, &wedge[0])).abs() < 1e-6
        );
        assert!(known(0.01) < 0.25 && known(0.01) > 0.1, "a fifth of its angle: {}", known(0.01));
        // The sine of the sharp angle over that at the start.
        let sine = |w: f64| w / (2.0 * (1.0 + (1.0 - w).powi(2))).sqrt();
        assert!(
            (known(0.01) - sine(0.01) / sine(0.05)).abs() < 1e-6,
            "{} {}",
            known(0.01),
            sine(0.01) / sine(0.05)
        );
        assert!(known(-0.01) < 0.0);
    }

    #[test]
    fn volumes_match_the_mesh_crate() {
        let mut x = cube();
        for (a, p) in x.iter_mut().enumerate() {
            (0..3).for_each(|i| p[i] += 0.2 * ((3 * a + i) as f64 * 1.7).sin());
        }
        for cell in [[0, 1, 2, 3, 4, 5, 6, 7], [0, 1, 2, 2, 4, 5, 6, 6], [0, 1, 2, 0, 4, 5, 6, 4]] {
            let p = cell.map(|a: usize| x[a]);
            let (a, b) = (volume(&p), mesh::quality::volume(&p));
            assert!((a - b).abs() < 1e-14, "{cell:?}: {a} {b}");
        }
    }

    /// Cells in lanes have the digits of single ones, whatever their number and between which collapsed cells they lie; NaN stays in its cell.
    #[test]
    fn lanes_have_the_quality_and_volume_of_single_cells() {
        let layers = 11;
        let mut x: Vec<Vec3> = Vec::new();
        for layer in 0..=layers {
            for p in &cube()[..4] {
                let k = x.len() as f64;
                x.push(p + Vec3::new(0.1 * (1.7 * k).sin(), 0.2 * (0.9 * k).cos(), layer as f64));
            }
        }
        let hexahedron = |layer: u32| std::array::from_fn(|k| 4 * layer + k as u32);
        for collapsed in [vec![], vec![0], vec![4, 10], vec![2, 3, 8]] {
            let cells: Vec<[u32; 8]> = (0..layers)
                .map(|layer| {
                    let mut cell: [u32; 8] = hexahedron(layer);
                    if collapsed.contains(&layer) {
                        (cell[3], cell[7]) = (cell[2], cell[6]);
                    }
                    cell
                })
                .collect();
            for broken in [None, Some(22)] {
                let mut x = flat(&x);
                let shapes = Corners::new(&cells, &x);
                if let Some(node) = broken {
                    x[3 * node] = f64::NAN;
                }
                let mut next = 0;
                shapes.each(&cells, &x, |c, quality, volume| {
                    assert_eq!(c, next);
                    assert_eq!(quality, shapes.quality(&cells, c, &x), "{collapsed:?}, cell {c}");
                    assert_eq!(quality == f64::NEG_INFINITY, broken.is_some() && (c == 4 || c == 5));
                    let single: f64 = super::volume(&corners_at(&cells[c], &x));
                    assert!(volume == single || (volume.is_nan() && single.is_nan()), "{volume} {single}");
                    next += 1;
                });
                assert_eq!(next, cells.len());
            }
        }
    }

    #[test]
    fn inverted_corners_and_nan_are_detected() {
        for a in 0..8 {
            let mut x = cube();
            for (p, other) in [(0, 1.0), (1, 1.0), (2, 1.0)] {
                x[a][p] += if x[a][p] > 0.5 { -other } else { other } * 0.7;
            }
            let cell = [[0, 1, 2, 3, 4, 5, 6, 7]];
            let c = Corners::new(&cell, &flat(&cube()));
            let q = c.quality(&cell, 0, &flat(&x));
            let other = mesh::quality::scaled_jacobian(flat(&x).as_chunks().0, &cell[0]);
            assert!(q < 0.0 && (q - other).abs() < 1e-12, "corner {a} pushed through: {q} {other}");
            x[a][1] = f64::NAN;
            assert_eq!(c.quality(&cell, 0, &flat(&x)), f64::NEG_INFINITY);
        }
    }
}
