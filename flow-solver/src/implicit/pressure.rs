//! The pressure equation: one unknown in each cell, symmetric, nearly elliptic.

use comm::Halo;

use crate::topology::Adjacency;

/// Matrix $d_i x_i - \sum_j k_{ij} x_j$ in the rows of [`Adjacency`], single
/// precision (it only ever preconditions), with the vectors its solver needs.
#[derive(Clone, Debug, Default)]
pub struct PressureSystem {
    /// Diagonal of each owned row.
    pub diagonal: Vec<f32>,
    /// $k_{ij}\ge 0$ of each entry, and one more that nobody reads.
    pub off: Vec<f32>,
    inverse: Vec<f32>,
    residual: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
    relaxed: Vec<f32>,
}

/// What a linear solve did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveReport {
    /// Iterations.
    pub iterations: usize,
    /// Residual at the end relative to the right-hand side.
    pub drop: f64,
}

impl PressureSystem {
    /// For `n_owned` rows, `n_local` unknowns and `entries` off-diagonals.
    pub fn new(n_owned: usize, n_local: usize, entries: usize) -> Self {
        Self {
            diagonal: vec![0.0; n_owned],
            off: vec![0.0; entries + 1],
            inverse: vec![0.0; n_owned],
            residual: vec![0.0; n_owned],
            direction: vec![0.0; n_local],
            image: vec![0.0; n_owned],
            relaxed: vec![0.0; n_owned],
        }
    }

    /// Call once after the matrix has been filled.
    pub fn prepare(&mut self) {
        for (i, d) in self.inverse.iter_mut().zip(&self.diagonal) {
            *i = 1.0 / d;
        }
    }

    /// Conjugate gradients preconditioned by symmetric Gauss-Seidel on each
    /// rank's own rows. `x` (with ghosts, refreshed at the end) starts from zero.
    pub fn solve(
        &mut self,
        rows: &Adjacency,
        halo: &Halo,
        b: &[f32],
        x: &mut [f32],
        tolerance: f64,
        max: usize,
    ) -> SolveReport {
        let n = self.diagonal.len();
        x.fill(0.0);
        self.residual.copy_from_slice(&b[..n]);
        gauss_seidel(rows, &self.off, &self.inverse, &self.diagonal, &self.residual, &mut self.relaxed);
        let mut sums = [dot(&self.residual, &self.relaxed), dot(&self.residual, &self.residual)];
        halo.comm().sum_slice(&mut sums);
        let [mut rz, bb] = sums;
        let mut report = SolveReport { iterations: 0, drop: 0.0 };
        if bb == 0.0 {
            return report;
        }
        self.direction[..n].copy_from_slice(&self.relaxed);
        report.drop = 1.0;
        while report.iterations < max && report.drop > tolerance {
            halo.exchange(&mut self.direction, 1);
            let pap =
                halo.comm().sum(product(rows, &self.off, &self.diagonal, &self.direction, &mut self.image));
            let alpha = (rz / pap) as f32;
            for i in 0..n {
                x[i] += alpha * self.direction[i];
                self.residual[i] -= alpha * self.image[i];
            }
            gauss_seidel(rows, &self.off, &self.inverse, &self.diagonal, &self.residual, &mut self.relaxed);
            sums = [dot(&self.residual, &self.relaxed), dot(&self.residual, &self.residual)];
            halo.comm().sum_slice(&mut sums);
            let beta = (sums[0] / rz) as f32;
            rz = sums[0];
            for i in 0..n {
                self.direction[i] = self.relaxed[i] + beta * self.direction[i];
            }
            report.iterations += 1;
            report.drop = (sums[1] / bb).sqrt();
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

/// One symmetric Gauss-Seidel sweep from zero: `z ~ A^-1 r`.
fn gauss_seidel(rows: &Adjacency, off: &[f32], inverse: &[f32], diagonal: &[f32], r: &[f32], z: &mut [f32]) {
    let n = diagonal.len();
    for i in 0..n {
        let row = rows.start[i] as usize..rows.upper[i] as usize;
        let mut s = r[i];
        for (k, &j) in off[row.clone()].iter().zip(&rows.cell[row]) {
            s += k * z[j as usize];
        }
        z[i] = s * inverse[i];
    }
    for i in (0..n).rev() {
        let row = rows.upper[i] as usize..rows.ghost[i] as usize;
        let mut s = 0.0;
        for (k, &j) in off[row.clone()].iter().zip(&rows.cell[row]) {
            s += k * z[j as usize];
        }
        z[i] += s * inverse[i];
    }
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
