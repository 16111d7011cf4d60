//! Symmetric distributed matrices of dense blocks, half of which is stored.

use std::rc::Rc;

use comm::Halo;

use crate::block::{Real, accumulate};
use crate::prefetch::prefetch;
use crate::{BlockCsr, Operator};

/// A symmetric matrix by the blocks left of the diagonal, the diagonal ones, and those of
/// columns that other ranks own.
///
/// A product reads a block once and uses it for its row and, transposed, for its column:
/// memory that is read decides the time of large products, and a grid of hexahedra takes 14 in
/// place of 27 blocks a row. Entries are stored in precision `T`; products are summed in `f64`.
pub struct SymmetricCsr<const B: usize, T: Real = f64> {
    halo: Rc<Halo>,
    /// Slots of a row: left of the diagonal, the diagonal at `diagonal[i]`, ghosts behind it.
    row_ptr: Vec<usize>,
    diagonal: Vec<usize>,
    cols: Vec<u32>,
    values: Vec<[[T; B]; B]>,
    /// Rows with ghosts.
    boundary: Vec<u32>,
}

/// Rows that products and sweeps ask the cache for in advance.
pub(crate) const AHEAD: usize = 4;

impl<const B: usize, T: Real> SymmetricCsr<B, T> {
    /// Keeps the half of `a` that decides: what stands right of the diagonal is taken to be the
    /// transpose of what stands left of it. Works in place.
    pub fn of(a: BlockCsr<B, T>) -> Self {
        let n = a.n_rows();
        let (halo, diagonals) = (a.halo().clone(), (0..n).map(|i| a.diagonal_slot(i)).collect::<Vec<_>>());
        let (old_ptr, mut cols, mut values) = a.into_parts();
        let mut row_ptr = Vec::with_capacity(n + 1);
        let mut diagonal = Vec::with_capacity(n);
        let mut boundary = Vec::new();
        row_ptr.push(0);
        let mut to = 0;
        for i in 0..n {
            for s in old_ptr[i]..old_ptr[i + 1] {
                if s == diagonals[i] {
                    diagonal.push(to);
                } else if s > diagonals[i] && (cols[s] as usize) < n {
                    continue;
                }
                (cols[to], values[to]) = (cols[s], values[s]);
                to += 1;
            }
            if to > diagonal[i] + 1 {
                boundary.push(i as u32);
            }
            row_ptr.push(to);
        }
        cols.truncate(to);
        cols.shrink_to_fit();
        values.truncate(to);
        values.shrink_to_fit();
        Self { halo, row_ptr, diagonal, cols, values, boundary }
    }

    /// Owned block rows.
    pub fn n_rows(&self) -> usize {
        self.diagonal.len()
    }

    /// The halo that vectors of this matrix use.
    pub fn halo(&self) -> &Rc<Halo> {
        &self.halo
    }

    /// Bytes that one product reads of the matrix.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.values[..])
            + size_of_val(&self.cols[..])
            + size_of_val(&self.row_ptr[..])
            + size_of_val(&self.diagonal[..])
            + size_of_val(&self.boundary[..])
    }

    /// Columns and blocks of row `i` left of the diagonal.
    #[inline(always)]
    pub(crate) fn lower(&self, i: usize) -> (&[u32], &[[[T; B]; B]]) {
        let slots = self.row_ptr[i]..self.diagonal[i];
        (&self.cols[slots.clone()], &self.values[slots])
    }

    /// Asks the cache for the blocks left of the diagonal of a row.
    #[inline(always)]
    pub(crate) fn prefetch(&self, row: usize) {
        if row < self.n_rows() {
            let slots = self.row_ptr[row]..self.diagonal[row];
            prefetch(&self.cols[slots.clone()]);
            prefetch(&self.values[slots]);
        }
    }

    /// Rows with ghosts: row, columns, blocks.
    #[allow(clippy::type_complexity)]
    pub(crate) fn ghosts(&self) -> impl Iterator<Item = (usize, &[u32], &[[[T; B]; B]])> {
        self.boundary.iter().map(|&i| {
            let slots = self.diagonal[i as usize] + 1..self.row_ptr[i as usize + 1];
            (i as usize, &self.cols[slots.clone()], &self.values[slots])
        })
    }

    /// The product with owned columns.
    fn multiply_owned(&self, x: &[[f64; B]], y: &mut [[f64; B]]) {
        for i in 0..self.n_rows() {
            self.prefetch(i + AHEAD);
            let (cols, values) = self.lower(i);
            let mut sum = [[0.0; B]; B];
            let xi = x[i];
            for (&j, a) in cols.iter().zip(values) {
                accumulate(&mut sum, a, &x[j as usize]);
                add_transposed(&mut y[j as usize], a, &xi);
            }
            accumulate(&mut sum, &self.values[self.diagonal[i]], &xi);
            // Rows above have added nothing here yet.
            y[i] = sum.map(|s| s.iter().sum());
        }
    }
}

/// `y += A^T x`.
#[inline(always)]
fn add_transposed<const B: usize, T: Real>(y: &mut [f64; B], a: &[[T; B]; B], x: &[f64; B]) {
    for r in 0..B {
        for c in 0..B {
            y[c] = a[r][c].to_f64().fused(x[r], y[c]);
        }
    }
}

impl<const B: usize, T: Real> Operator for SymmetricCsr<B, T> {
    fn n_owned(&self) -> usize {
        self.halo.n_owned() * B
    }

    fn n_local(&self) -> usize {
        self.halo.n_local() * B
    }

    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        let y = y.as_chunks_mut::<B>().0;
        self.halo.overlap(x, B, |x| self.multiply_owned(x.as_chunks().0, y));
        let x = x.as_chunks::<B>().0;
        for (i, cols, values) in self.ghosts() {
            let mut sum = [[0.0; B]; B];
            for (&j, a) in cols.iter().zip(values) {
                accumulate(&mut sum, a, &x[j as usize]);
            }
            for r in 0..B {
                y[i][r] += sum[r].iter().sum::<f64>();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_symmetric_matrix_is_the_whole() {
        let n = 40;
        let neighbours: Vec<Vec<u32>> = (0..n)
            .map(|i: usize| (0..n).filter(|j| i != *j && (i * j) % 7 < 3).map(|j| j as u32).collect())
            .collect();
        let mut a = BlockCsr::<3, f32>::from_adjacency(Rc::new(Halo::solo(n)), &neighbours);
        for i in 0..n {
            for s in a.row(i) {
                let j = a.cols()[s] as usize;
                for r in 0..3 {
                    for c in 0..3 {
                        let (p, q) = (3 * i + r, 3 * j + c);
                        a.values[s][r][c] = ((p.min(q) * 31 + p.max(q) * 17) as f32 * 0.37).sin();
                    }
                }
            }
        }
        let mut x: Vec<f64> = (0..3 * n).map(|i| (1.3 * i as f64).cos()).collect();
        let (mut y, mut z) = (vec![0.0; 3 * n], vec![f64::NAN; 3 * n]);
        a.apply(&mut x, &mut y);
        let whole = a.bytes();
        let half = SymmetricCsr::of(a);
        half.apply(&mut x, &mut z);
        let apart = y.iter().zip(&z).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-12, "{apart}");
        assert!(half.bytes() < 6 * whole / 10, "{} {whole}", half.bytes());
    }
}
