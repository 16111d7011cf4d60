//! Interpolation by radial basis functions on selected boundary nodes: a meshless mover, for comparison.

use crate::inverse_distance::boundary;
use crate::local::LocalGrid;
use crate::mover::{Effort, Mover, MoverError};
use crate::near_wall_following;

/// Largest number of centres: the cost of a solve is proportional to it times the number of free nodes.
const CENTRES: usize = 400;

/// Interpolation of the boundary's displacement by Wendland's C2 functions of compact support (de Boer, van der
/// Schoot, Bijl, Comput. Struct. 85, 2007), on nodes of canopy and outer boundary selected greedily where the power
/// function is largest (independent of the motion, so that the mover is linear; the reduction of Rendall and Allen,
/// J. Comput. Phys. 228, 2009, depends on it). The interpolation error on the canopy is applied to the nearest rings.
#[derive(Default)]
pub struct RadialBasis {
    per_radius: f64,
    centres: Vec<Centre>,
    /// Lower triangular factor of the centres' matrix, by rows.
    factor: Vec<Vec<f64>>,
    canopy: Vec<[f64; 3]>,
    /// Owned free nodes.
    free: Vec<[f64; 3]>,
    weights: Vec<[f64; 3]>,
    missing: Vec<f64>,
}

/// Position and interface node (`None`: fixed).
type Centre = ([f64; 3], Option<u32>);

impl RadialBasis {
    /// The displacement at `p`.
    fn at(&self, p: &[f64; 3]) -> [f64; 3] {
        combine(&self.centres, &self.weights, self.per_radius, p)
    }
}

fn combine(centres: &[Centre], weights: &[[f64; 3]], per_radius: f64, p: &[f64; 3]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for ((q, _), w) in centres.iter().zip(weights) {
        let v = value(p, q, per_radius);
        (0..3).for_each(|i| sum[i] += v * w[i]);
    }
    sum
}

fn value(p: &[f64; 3], q: &[f64; 3], per_radius: f64) -> f64 {
    let d2: f64 = (0..3).map(|i| (p[i] - q[i]).powi(2)).sum();
    wendland(d2.sqrt() * per_radius)
}

/// Wendland's function of order C2 in three dimensions; zero from 1 on.
fn wendland(r: f64) -> f64 {
    let s = (1.0 - r).max(0.0);
    s * s * s * s * (4.0 * r + 1.0)
}

impl Mover for RadialBasis {
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError> {
        let (canopy, outer) = boundary(grid, x);
        let moving = canopy.iter().zip(0..).map(|(p, k)| (*p, Some(k)));
        let nodes: Vec<_> = moving.chain(outer.iter().map(|p| (*p, None))).collect();
        let span = |i: usize| {
            let all = nodes.iter().map(|(p, _)| p[i]);
            all.clone().fold(f64::NEG_INFINITY, f64::max) - all.fold(f64::INFINITY, f64::min)
        };
        // A support of half the domain's width lets both boundaries contribute everywhere.
        let radius = 0.5 * (0..3).map(span).fold(0.0, f64::max);
        self.per_radius = if radius > 0.0 { 1.0 / radius } else { 1.0 };
        // Pivoted Cholesky factorisation: the next centre is where the power function, the remaining diagonal, is
        // largest.
        let mut rest = vec![1.0f64; nodes.len()];
        let mut columns: Vec<Vec<f64>> = Vec::new();
        let mut chosen: Vec<usize> = Vec::new();
        while chosen.len() < CENTRES.min(nodes.len()) {
            // Canopy first for equal values.
            let next = (0..nodes.len()).rev().max_by(|&a, &b| rest[a].total_cmp(&rest[b]));
            let Some(next) = next.filter(|&a| rest[a] > 1e-8) else { break };
            let pivot = rest[next].sqrt();
            let column: Vec<f64> = (0..nodes.len())
                .map(|a| {
                    let known: f64 = columns.iter().map(|c| c[a] * c[next]).sum();
                    (value(&nodes[a].0, &nodes[next].0, self.per_radius) - known) / pivot
                })
                .collect();
            rest.iter_mut().zip(&column).for_each(|(r, c)| *r = (*r - c * c).max(0.0));
            rest[next] = 0.0;
            columns.push(column);
            chosen.push(next);
        }
        self.factor =
            chosen.iter().enumerate().map(|(i, &a)| columns[..=i].iter().map(|c| c[a]).collect()).collect();
        self.centres = chosen.iter().map(|&a| nodes[a]).collect();
        self.canopy = canopy;
        let node = |a: &u32| [0, 1, 2].map(|i| x[3 * *a as usize + i]);
        self.free = grid.free_node[..grid.n_free].iter().map(node).collect();
        self.weights = vec![[0.0; 3]; self.centres.len()];
        self.missing = vec![0.0; 3 * grid.n_canopy];
        Ok(())
    }

    fn bytes(&self) -> usize {
        let factor: usize = self.factor.iter().map(|row| 8 * row.len()).sum();
        factor + 24 * (self.free.len() + 2 * self.canopy.len()) + 64 * self.centres.len()
    }

    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError> {
        for (w, (_, k)) in self.weights.iter_mut().zip(&self.centres) {
            *w = k.map_or([0.0; 3], |k| [0, 1, 2].map(|i| canopy[3 * k as usize + i]));
        }
        for i in 0..self.factor.len() {
            let (done, rest) = self.weights.split_at_mut(i);
            for (l, w) in self.factor[i].iter().zip(done) {
                (0..3).for_each(|c| rest[0][c] -= l * w[c]);
            }
            (0..3).for_each(|c| rest[0][c] /= self.factor[i][i]);
        }
        for i in (0..self.factor.len()).rev() {
            let (before, rest) = self.weights.split_at_mut(i);
            (0..3).for_each(|c| rest[0][c] /= self.factor[i][i]);
            for (l, w) in self.factor[i].iter().zip(before) {
                (0..3).for_each(|c| w[c] -= l * rest[0][c]);
            }
        }
        for ((m, d), p) in
            self.missing.as_chunks_mut::<3>().0.iter_mut().zip(canopy.as_chunks::<3>().0).zip(&self.canopy)
        {
            let at = combine(&self.centres, &self.weights, self.per_radius, p);
            *m = [d[0] - at[0], d[1] - at[1], d[2] - at[2]];
        }
        for (p, u) in self.free.iter().zip(u.as_chunks_mut::<3>().0) {
            *u = self.at(p);
        }
        near_wall_following::follow(grid, &self.missing, u);
        grid.free_halo.exchange(u, 3);
        Ok(Effort::default())
    }

    fn extend(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
        // Linear, and without an iteration: it never fails.
        let _ = self.displace(grid, canopy, u);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use comm::Comm;

    #[test]
    fn centres_are_interpolated_and_the_far_boundary_is_fixed() {
        let grid = crate::example_grid::plate_in_box(8, 0.1, 0.8, false);
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
        let x = local.gather(&grid.coords);
        let mut mover = RadialBasis::default();
        mover.rebase(&local, &x).unwrap();
        let displacement: Vec<f64> = (0..3 * local.n_canopy).map(|i| 0.1 + 0.05 * (i as f64).sin()).collect();
        let mut u = vec![0.0; 3 * local.free_node.len()];
        mover.displace(&local, &displacement, &mut u).unwrap();
        // More centres than canopy nodes: the canopy is interpolated, the outer boundary at rest.
        let (canopy, outer) = boundary(&local, &x);
        for (p, d) in canopy.iter().zip(displacement.as_chunks::<3>().0) {
            let at = mover.at(p);
            (0..3).for_each(|i| assert!((at[i] - d[i]).abs() < 2e-3, "{at:?} {d:?}"));
        }
        let far = outer.iter().flat_map(|p| mover.at(p)).fold(0.0f64, |m, v| m.max(v.abs()));
        assert!(far < 1e-2, "{far}");
        assert!(u.iter().any(|v| v.abs() > 0.05));
    }
}
