//! The coarsest level, solved exactly, with identical results on every rank.

use comm::Halo;

use super::Matrix;
use crate::topology::Adjacency;

/// Cells of the coarsest level at most, on all ranks together.
pub(super) fn limit(ranks: usize) -> usize {
    48.max(2 * ranks)
}

/// Cholesky factor of the whole coarsest matrix. Empty: there is none.
#[derive(Debug, Default)]
pub(super) struct Coarsest {
    n: usize,
    offset: usize,
    /// Number among all ranks of each local cell.
    number: Vec<usize>,
    /// Lower triangle, row by row of `n`.
    factor: Vec<f64>,
    x: Vec<f64>,
}

impl Coarsest {
    /// Collective.
    pub fn new(halo: &Halo) -> Self {
        let comm = halo.comm();
        let sizes = comm.all_gather_u64(halo.n_owned() as u64);
        let offset: u64 = sizes[..comm.rank()].iter().sum();
        let n = sizes.iter().sum::<u64>() as usize;
        let mut number: Vec<f64> = (0..halo.n_local()).map(|i| (offset + i as u64) as f64).collect();
        halo.exchange(&mut number, 1);
        Self {
            n,
            offset: offset as usize,
            number: number.into_iter().map(|x| x as usize).collect(),
            factor: vec![0.0; n * n],
            x: vec![0.0; n],
        }
    }

    /// Collective.
    pub fn factor(&mut self, halo: &Halo, rows: &Adjacency, matrix: &Matrix) {
        let (n, a) = (self.n, &mut self.factor);
        if n == 0 {
            return;
        }
        a.fill(0.0);
        for i in 0..matrix.own.len() {
            let row = self.offset + i;
            a[row * n + row] = f64::from(matrix.own[i]);
            for k in rows.start[i] as usize..rows.start[i + 1] as usize {
                let c = f64::from(matrix.off[k]);
                a[row * n + row] += c;
                a[row * n + self.number[rows.cell[k] as usize]] = -c;
            }
        }
        halo.comm().sum_slice(a);
        for i in 0..n {
            for j in 0..=i {
                let mut s = a[i * n + j];
                for k in 0..j {
                    s -= a[i * n + k] * a[j * n + k];
                }
                if i == j {
                    // Closed boxes without compressibility have a constant null space.
                    let floor = 1e-9 * a[i * n + i].abs().max(f64::MIN_POSITIVE);
                    a[i * n + i] = s.max(floor).sqrt();
                } else {
                    a[i * n + j] = s / a[j * n + j];
                }
            }
        }
    }

    /// Solves for the owned cells; false where there is no factor. Collective.
    pub fn solve(&mut self, halo: &Halo, b: &[f32], x: &mut [f32]) -> bool {
        let (n, a, y) = (self.n, &self.factor, &mut self.x);
        if n == 0 {
            return false;
        }
        y.fill(0.0);
        for (y, b) in y[self.offset..].iter_mut().zip(b) {
            *y = f64::from(*b);
        }
        halo.comm().sum_slice(y);
        for i in 0..n {
            let s: f64 = (0..i).map(|k| a[i * n + k] * y[k]).sum();
            y[i] = (y[i] - s) / a[i * n + i];
        }
        for i in (0..n).rev() {
            let s: f64 = (i + 1..n).map(|k| a[k * n + i] * y[k]).sum();
            y[i] = (y[i] - s) / a[i * n + i];
        }
        for (x, y) in x.iter_mut().zip(&y[self.offset..self.offset + b.len()]) {
            *x = *y as f32;
        }
        true
    }
}
