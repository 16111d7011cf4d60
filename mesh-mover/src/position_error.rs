//! Norm of errors of node positions, relative to the sizes of cells.

use mesh::geometry::Vec3;

use crate::local::{EDGES, Kind, LocalGrid};
use crate::solve::larger;

/// Lengths that scale position errors.
///
/// A cell deforms by the relative motion of its nodes. An error common to all nodes of thin, mutually stiff cells
/// does not deform them, and an iteration removes it last. So a node's own error is scaled by the longest edge around
/// it, and the difference of two nodes by the edge between them.
pub struct PositionErrorNorm {
    /// For each owned free node: the longest edge around it, or a shorter one to a node that does not move with the
    /// solution, m.
    pub sizes: Vec<f64>,
    /// Shorter edges: the owned free nodes at their ends, and the inverse length (1/m).
    edges: Vec<(u32, u32, f32)>,
}

/// Edges longer than this fraction of both ends' sizes are covered by the ends.
const SHORT: f64 = 0.5;

impl PositionErrorNorm {
    /// For the grid at `x` (all local nodes, flat, m).
    pub fn new(grid: &LocalGrid, x: &[f64]) -> Self {
        let n = grid.n_free;
        let owned = |kind: Kind| match kind {
            Kind::Free(i) if (i as usize) < n => Some(i),
            _ => None,
        };
        let (mut longest, mut least) = (vec![0.0f64; n], vec![f64::INFINITY; n]);
        let each = |visit: &mut dyn FnMut(Kind, Kind, f64)| {
            for (c, cell) in grid.cells.iter().enumerate() {
                let p = grid.corners(c, x);
                for (i, j) in EDGES {
                    if cell[i] != cell[j] {
                        let d = p[i] - p[j];
                        visit(grid.kind[cell[i] as usize], grid.kind[cell[j] as usize], d.norm());
                    }
                }
            }
        };
        each(&mut |a, b, length| {
            for (one, other) in [(a, b), (b, a)] {
                if let Some(i) = owned(one) {
                    longest[i as usize] = longest[i as usize].max(length);
                    if !matches!(other, Kind::Free(_)) {
                        least[i as usize] = least[i as usize].min(length);
                    }
                }
            }
        });
        let sizes: Vec<f64> = longest.iter().zip(least).map(|(a, b)| a.min(b)).collect();
        let mut edges = Vec::new();
        each(&mut |a, b, length| {
            let (Some(a), Some(b)) = (owned(a), owned(b)) else { return };
            if length < SHORT * sizes[a as usize].min(sizes[b as usize]) {
                edges.push((a.min(b), a.max(b), (1.0 / length) as f32));
            }
        });
        edges.sort_unstable_by_key(|e| (e.0, e.1));
        edges.dedup_by_key(|e| (e.0, e.1));
        edges.shrink_to_fit();
        Self { sizes, edges }
    }

    /// The largest error `z` (of owned free nodes, m) relative to an edge; NaN becomes infinity.
    pub fn largest(&self, z: &[f64]) -> f64 {
        let z = z.as_chunks::<3>().0;
        let mut most = 0.0f64;
        for (z, h) in z.iter().zip(&self.sizes) {
            most = larger(most, Vec3::from(*z).norm_squared() / (h * h));
        }
        for &(a, b, inverse) in &self.edges {
            let d = Vec3::from(z[a as usize]) - Vec3::from(z[b as usize]);
            most = larger(most, d.norm_squared() * f64::from(inverse * inverse));
        }
        most.sqrt()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.sizes[..]) + size_of_val(&self.edges[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example_grid::plate_in_box;

    #[test]
    fn common_displacement_has_a_smaller_norm_than_relative_displacement() {
        // Layers at the plate are a tenth as high as cells are wide.
        let grid = plate_in_box(16, 0.0, 0.7, false);
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &comm::Comm::solo());
        let x = local.gather(&grid.coords);
        let position_error = PositionErrorNorm::new(&local, &x);
        let z_of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            local.free_node.iter().flat_map(|&a| [0.0, 0.0, f(x[3 * a as usize + 2])]).collect()
        };
        let width = 2.0 / 16.0;
        let thin = 0.3 * 0.7f64.powi(7) / (1.0 - 0.7f64.powi(8));
        // Common displacement: relative to the distance to the fixed nodes.
        let common = position_error.largest(&z_of(&|_| 1e-3));
        assert!((common - 1e-3 / thin).abs() < 1e-9, "{common} {}", 1e-3 / thin);
        // Away from the plate: the longest edge, and the strain of the short ones.
        let strain = position_error.largest(&z_of(&|z| 1e-3 * z));
        let own = local.free_node.iter().zip(&position_error.sizes);
        let most = own.map(|(&a, h)| 1e-3 * x[3 * a as usize + 2].abs() / h).fold(0.0, f64::max);
        assert!((strain - most.max(1e-3)).abs() < 1e-9, "{strain} {most}");
        assert!(position_error.sizes.iter().all(|h| *h <= 3.0 * width) && !position_error.edges.is_empty());
        let bad = position_error.largest(&z_of(&|z| if z > 0.5 { f64::NAN } else { 0.0 }));
        assert_eq!(bad, f64::INFINITY);
    }
}
