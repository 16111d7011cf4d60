//! Shape of cells: scaled Jacobian at every corner, fast for a grid that moves.

use mesh::Vec3;

use crate::element::{cross, dot, sub};

use mesh::quality::CORNER_EDGES as BESIDE;

/// Scaled Jacobian of one corner: determinant of its three edges over the
/// product of their lengths. 1 is a right-angled corner, 0 a flat one, negative
/// an inverted one; NaN for NaN or for edges without length.
#[inline]
pub fn corner_quality(p: Vec3, a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let (a, b, c) = (sub(a, p), sub(b, p), sub(c, p));
    dot(a, cross(b, c)) / (dot(a, a) * dot(b, b) * dot(c, c)).sqrt()
}

#[inline]
fn quality_of(quad: &[u32; 4], x: &[f64]) -> f64 {
    let at = |n: u32| -> Vec3 {
        let n = 3 * n as usize;
        [x[n], x[n + 1], x[n + 2]]
    };
    corner_quality(at(quad[0]), at(quad[1]), at(quad[2]), at(quad[3]))
}

/// The corners of a list of cells as flat node quadruples, so that the quality
/// of moving cells of any shape is one loop without decisions.
#[derive(Clone, Debug, Default)]
pub struct Corners {
    /// Corner node and the three nodes beside it.
    quads: Vec<[u32; 4]>,
    /// Factor of each corner's scaled Jacobian.
    scale: Vec<f32>,
    /// First corner of each cell, and the end.
    first: Vec<u32>,
}

impl Corners {
    /// Corners of `cells`, which start at `x` (flat, m). A collapsed edge is replaced by the
    /// next edge behind it; a corner that has fewer than three distinct edges is a
    /// copy of another one and is left out.
    ///
    /// The sharp corners of wedges are sharp by intention (a slit ends there), so corners
    /// at a collapsed edge count relative to their start: 1 there, 0 when flat.
    pub fn new(cells: &[[u32; 8]], x: &[f64]) -> Self {
        let mut all = Self {
            quads: Vec::with_capacity(8 * cells.len()),
            scale: Vec::with_capacity(8 * cells.len()),
            first: Vec::with_capacity(cells.len() + 1),
        };
        for cell in cells {
            let start = all.quads.len();
            all.first.push(start as u32);
            for i in 0..8 {
                let Some(quad) = corner(cell, i).filter(|q| !same_corner(&all.quads[start..], q)) else {
                    continue;
                };
                let regular = BESIDE[i].iter().zip(&quad[1..]).all(|(&j, &a)| cell[j] == a);
                let at_start = quality_of(&quad, x);
                let counts_from_start = !regular && at_start > 0.0;
                all.scale.push(if counts_from_start { (1.0 / at_start) as f32 } else { 1.0 });
                all.quads.push(quad);
            }
        }
        all.first.push(all.quads.len() as u32);
        all
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        20 * self.quads.len() + 4 * self.first.len()
    }

    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.first.len() - 1
    }

    /// Smallest scaled Jacobian of cell `c` at node positions `x` (flat, m), see [`Corners::new`].
    /// NaN counts as minus infinity.
    #[inline]
    pub fn quality(&self, c: usize, x: &[f64]) -> f64 {
        let mut worst = f64::INFINITY;
        let range = self.first[c] as usize..self.first[c + 1] as usize;
        for (q, scale) in self.quads[range.clone()].iter().zip(&self.scale[range]) {
            let s = f64::from(*scale) * quality_of(q, x);
            worst = if s >= worst {
                worst
            } else if s.is_nan() {
                f64::NEG_INFINITY
            } else {
                s
            };
        }
        worst
    }

    /// The worst cell and its quality; `None` without cells.
    pub fn worst(&self, x: &[f64]) -> Option<(usize, f64)> {
        let all = (0..self.n_cells()).map(|c| (c, self.quality(c, x)));
        all.reduce(|a, b| if b.1 < a.1 { b } else { a })
    }
}

fn corner(cell: &[u32; 8], i: usize) -> Option<[u32; 4]> {
    let mut quad = [cell[i], 0, 0, 0];
    let mut taken = 1;
    // Edges that did not collapse come first: a replacement must differ from them.
    let direct = BESIDE[i].map(|j| cell[j]);
    for (slot, &j) in BESIDE[i].iter().enumerate() {
        let node = if cell[j] != cell[i] {
            Some(cell[j])
        } else {
            BESIDE[j].iter().map(|&k| cell[k]).find(|&n| n != cell[i] && !direct.contains(&n))
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
    }

    fn flat(x: &[Vec3]) -> Vec<f64> {
        x.iter().flatten().copied().collect()
    }

    #[test]
    fn every_shape_is_right_angled_or_known() {
        let x = flat(&cube());
        // Positions where collapsed corners count as they are: all flat at the start.
        let q = |cell: [u32; 8]| {
            let c = Corners::new(&[cell], &[0.0; 24]);
            (c.quads.len(), c.quality(0, &x))
        };
        assert_eq!(q([0, 1, 2, 3, 4, 5, 6, 7]), (8, 1.0));
        let (n, s) = q([0, 1, 2, 2, 4, 5, 6, 6]);
        assert_eq!(n, 6);
        assert!((s - 0.5f64.sqrt()).abs() < 1e-14, "sharp corner of the prism, 45 degrees: {s}");
        let (n, s) = q([0, 1, 2, 3, 4, 4, 4, 4]);
        assert_eq!(n, 8, "four at the base, the apex with each three of its four edges");
        assert!(s > 0.25 && s < 0.8, "{s}");
        let (n, s) = q([0, 1, 2, 2, 4, 4, 4, 4]);
        assert_eq!(n, 4);
        assert!(s > 0.25 && s < 0.8, "{s}");
        // Any other collapsed edge: every edge of the cube in turn.
        for (a, list) in BESIDE.iter().enumerate() {
            for &b in list {
                let mut cell = [0, 1, 2, 3, 4, 5, 6, 7];
                cell[b] = a as u32;
                let (n, s) = q(cell);
                assert!(n >= 7 && s > 0.3, "edge {a}-{b}: {n} corners, {s}");
            }
        }
    }

    #[test]
    fn a_sharp_wedge_starts_at_its_right_angles_and_ends_at_zero() {
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
        let known = |w: f64| c.quality(0, &thin(w));
        assert!((known(0.05) - mesh::quality::scaled_jacobian(&points(&thin(0.05)), &wedge[0])).abs() < 1e-6);
        assert!(known(0.01) < 0.25 && known(0.01) > 0.1, "a fifth of its angle: {}", known(0.01));
        assert!(known(-0.01) < 0.0);
    }

    fn points(x: &[f64]) -> Vec<Vec3> {
        x.as_chunks::<3>().0.to_vec()
    }

    #[test]
    fn a_pushed_corner_and_nan_are_seen() {
        for a in 0..8 {
            let mut x = cube();
            for (p, other) in [(0, 1.0), (1, 1.0), (2, 1.0)] {
                x[a][p] += if x[a][p] > 0.5 { -other } else { other } * 0.7;
            }
            let c = Corners::new(&[[0, 1, 2, 3, 4, 5, 6, 7]], &flat(&cube()));
            assert!(c.quality(0, &flat(&x)) < 0.0, "corner {a} pushed through");
            x[a][1] = f64::NAN;
            assert_eq!(c.quality(0, &flat(&x)), f64::NEG_INFINITY);
        }
    }
}
