//! The pressure equation: one unknown in each cell, symmetric, nearly elliptic.

use comm::Halo;

use super::multigrid::{Matrix, MergedCells, Multigrid};
use crate::residual::Domain;
use crate::topology::Adjacency;

/// The pressure matrix, single precision (it only ever preconditions), with the
/// vectors its solver needs.
#[derive(Debug)]
pub struct PressureSystem {
    /// Storage, boundaries and couplings.
    pub matrix: Matrix,
    multigrid: Option<Multigrid>,
    residual: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
    relaxed: Vec<f32>,
}

/// Report of a linear solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveReport {
    /// Iterations.
    pub iterations: usize,
    /// Residual at the end relative to the right-hand side.
    pub drop: f64,
}

impl PressureSystem {
    /// For the rows of `rows` with `n_local` unknowns.
    pub fn new(rows: &Adjacency, n_local: usize) -> Self {
        let n = rows.start.len() - 1;
        Self {
            matrix: Matrix::new(rows),
            multigrid: None,
            residual: vec![0.0; n],
            direction: vec![0.0; n_local],
            image: vec![0.0; n],
            relaxed: vec![0.0; n_local],
        }
    }

    /// Call once after the matrix has been filled. The first call merges the cells
    /// of the coarse levels, which later ones keep. Collective.
    pub fn prepare(&mut self, on: &Domain<'_>) {
        let rows = &on.topology.adjacency;
        let m = &mut self.matrix;
        m.complete(rows);
        self.multigrid
            .get_or_insert_with(|| Multigrid::new(rows, on.halo, m, &on.metrics.centre, &on.metrics.volume))
            .assemble(rows, m);
    }

    /// Coarse cells, once they were merged.
    pub fn merged(&self) -> Option<MergedCells> {
        self.multigrid.as_ref().map(Multigrid::merged)
    }

    /// Takes up [`PressureSystem::merged`] of the same cells, in `rows`. Collective.
    ///
    /// # Errors
    /// On every rank, what does not fit on one of them.
    pub fn restore_state(
        &mut self,
        merged: MergedCells,
        rows: &Adjacency,
        halo: &Halo,
    ) -> Result<(), String> {
        self.multigrid = Some(Multigrid::of_merged(merged, rows, halo)?);
        Ok(())
    }

    /// Where the right-hand side of [`PressureSystem::solve`] is to be written, one value for
    /// each owned row.
    pub fn source(&mut self) -> &mut [f32] {
        &mut self.residual
    }

    /// Conjugate gradients for what was written to [`PressureSystem::source`], preconditioned by one multigrid cycle. `x` (with ghosts,
    /// refreshed at the end) starts from zero.
    ///
    /// # Panics
    /// Before [`PressureSystem::prepare`].
    pub fn solve(
        &mut self,
        rows: &Adjacency,
        halo: &Halo,
        x: &mut [f32],
        tolerance: f64,
        max: usize,
    ) -> SolveReport {
        let _part = timing::part("pressure");
        let n = self.matrix.own.len();
        let multigrid = self.multigrid.as_mut().expect("prepared");
        let matrix = &self.matrix;
        let (direction, image) = (&mut self.direction, &mut self.image);
        x.fill(0.0);
        let comm = halo.comm();
        let source_norm2 = comm.sum(dot(&self.residual, &self.residual));
        let mut report = SolveReport { iterations: 0, drop: 0.0 };
        if source_norm2 == 0.0 {
            return report;
        }
        report.drop = 1.0;
        let mut rz = 0.0;
        // The residual is known before the cycle that would follow it, so that none is computed in vain.
        while report.iterations < max && report.drop > tolerance {
            multigrid.cycle(rows, halo, matrix, &self.residual, &mut self.relaxed);
            let rz_before = std::mem::replace(&mut rz, comm.sum(dot(&self.residual, &self.relaxed[..n])));
            if report.iterations == 0 {
                direction[..n].copy_from_slice(&self.relaxed[..n]);
            } else {
                let beta = (rz / rz_before) as f32;
                direction[..n].iter_mut().zip(&self.relaxed).for_each(|(d, z)| *d = z + beta * *d);
            }
            halo.exchange(direction, 1);
            let pap = comm.sum(product(rows, &matrix.off, &matrix.diagonal, direction, image));
            let alpha = (rz / pap) as f32;
            for (x, d) in x[..n].iter_mut().zip(&direction[..n]) {
                *x += alpha * d;
            }
            for (r, image) in self.residual.iter_mut().zip(&*image) {
                *r -= alpha * image;
            }
            report.iterations += 1;
            report.drop = (comm.sum(dot(&self.residual, &self.residual)) / source_norm2).sqrt();
        }
        halo.exchange(x, 1);
        report
    }
}

/// `y = A x`; returns this rank's share of `x . y`.
fn product(rows: &Adjacency, off: &[f32], diagonal: &[f32], x: &[f32], y: &mut [f32]) -> f64 {
    let mut sum = 0.0;
    for i in 0..diagonal.len() {
        let row = rows.start[i] as usize..rows.start[i + 1] as usize;
        let mut s = diagonal[i] * x[i];
        for (k, &j) in off[row.clone()].iter().zip(&rows.cell[row]) {
            s -= k * x[j as usize];
        }
        y[i] = s;
        sum += f64::from(s) * f64::from(x[i]);
    }
    sum
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    // Partial sums in single precision over short runs, then double: fast and exact enough.
    a.chunks(256)
        .zip(b.chunks(256))
        .map(|(a, b)| {
            let mut lanes = [0.0f32; 16];
            let (ca, cb) = (a.chunks_exact(16), b.chunks_exact(16));
            let rest: f32 = ca.remainder().iter().zip(cb.remainder()).map(|(a, b)| a * b).sum();
            for (a, b) in ca.zip(cb) {
                for l in 0..16 {
                    lanes[l] += a[l] * b[l];
                }
            }
            f64::from(lanes.iter().sum::<f32>() + rest)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Adjacency;

    /// Runs of 256, sixteen lanes, and what is left over, in whole numbers that single precision holds.
    #[test]
    fn inner_products_are_exact_for_any_length() {
        for n in [0, 1, 15, 16, 17, 255, 256, 257, 300, 600] {
            let a: Vec<f32> = (0..n).map(|i| (i % 7) as f32 - 2.0).collect();
            let b: Vec<f32> = (0..n).map(|i| 3.0 - (i % 5) as f32).collect();
            let exact: i32 = (0..n).map(|i| (i % 7 - 2) * (3 - i % 5)).sum();
            assert_eq!(dot(&a, &b), f64::from(exact), "{n}");
        }
    }

    /// A ring of five cells against its dense matrix, in whole numbers.
    #[test]
    fn products_match_the_dense_matrix() {
        let cells: Vec<[u32; 2]> = (0..5).map(|i| [i, (i + 1) % 5]).collect();
        let rows = Adjacency::new(5, &cells);
        let mut off = vec![0.0; rows.cell.len() + 1];
        let mut dense = [[0.0f64; 5]; 5];
        for (f, &[i, j]) in cells.iter().enumerate() {
            for (slot, r, c) in [(rows.slot[f][0], i, j), (rows.slot[f][1], j, i)] {
                off[slot as usize] = 1.0 + f as f32;
                dense[r as usize][c as usize] = -1.0 - f as f64;
            }
        }
        let diagonal = [12.0f32, 9.0, 14.0, 11.0, 20.0];
        let x = [1.0f32, -2.0, 3.0, 0.5, 4.0];
        let mut y = [0.0f32; 5];
        let found = product(&rows, &off, &diagonal, &x, &mut y);
        let mut sum = 0.0;
        for i in 0..5 {
            dense[i][i] = f64::from(diagonal[i]);
            let exact: f64 = (0..5).map(|j| dense[i][j] * f64::from(x[j])).sum();
            assert_eq!(f64::from(y[i]), exact);
            sum += exact * f64::from(x[i]);
        }
        assert_eq!(found, sum);
    }
}
