//! Block incomplete factorisation without fill.

use std::cell::RefCell;

use crate::block::{Real, invert};
use crate::{BlockCsr, Preconditioner, SingularBlock};

/// Numbers of a register that holds a column of a block.
const LANES: usize = 4;

/// A block by columns, each filled up with zeros: a product with a vector is one operation
/// on whole registers for each column.
type Columns<const B: usize, T> = [[T; LANES]; B];

/// ILU(0) of the rank's own rows and columns, by blocks, stored in precision `T`.
///
/// The factor has the pattern of the matrix. Between ranks it is block Jacobi. For a
/// symmetric matrix the factor is symmetric, but nothing ensures that it is positive:
/// prefer GMRES where the matrix is far from an M-matrix.
pub(crate) struct BlockIlu0<const B: usize, T: Real = f64> {
    row_ptr: Vec<usize>,
    cols: Vec<u32>,
    diagonal: Vec<usize>,
    /// Slot of the matrix behind each entry.
    source: Vec<usize>,
    /// Unit lower factor, inverse diagonal, upper factor.
    values: Vec<Columns<B, T>>,
    place: Vec<u32>,
    x: RefCell<Vec<[T; LANES]>>,
}

impl<const B: usize, T: Real> BlockIlu0<B, T> {
    /// Of no matrix yet.
    pub fn empty() -> Self {
        Self {
            row_ptr: Vec::new(),
            cols: Vec::new(),
            diagonal: Vec::new(),
            source: Vec::new(),
            values: Vec::new(),
            place: Vec::new(),
            x: RefCell::new(Vec::new()),
        }
    }

    /// Factorises the square part of `a` in `rows`; `index` numbers them, and is
    /// `u32::MAX` or missing for other columns. Keeps its memory.
    pub fn refit(&mut self, a: &BlockCsr<B>, rows: &[u32], index: &[u32]) -> Result<(), SingularBlock> {
        self.row_ptr.clear();
        self.row_ptr.push(0);
        self.cols.clear();
        self.source.clear();
        self.diagonal.clear();
        for &i in rows {
            let i = i as usize;
            for s in a.row(i) {
                let Some(&j) = index.get(a.cols()[s] as usize).filter(|j| **j != u32::MAX) else { continue };
                if s == a.diagonal_slot(i) {
                    self.diagonal.push(self.cols.len());
                }
                self.cols.push(j);
                self.source.push(s);
            }
            self.row_ptr.push(self.cols.len());
        }
        const { assert!(B <= LANES) };
        self.values.resize(self.cols.len(), [[T::default(); LANES]; B]);
        self.place.clear();
        self.place.resize(rows.len(), u32::MAX);
        self.x.borrow_mut().resize(rows.len(), [T::default(); LANES]);
        self.refactor(a)
    }

    /// Factorises the values of `a` on the pattern at hand.
    fn refactor(&mut self, a: &BlockCsr<B>) -> Result<(), SingularBlock> {
        for (v, &s) in self.values.iter_mut().zip(&self.source) {
            *v = columns(&a.values[s]);
        }
        for i in 0..self.diagonal.len() {
            let row = self.row_ptr[i]..self.row_ptr[i + 1];
            for s in row.clone() {
                self.place[self.cols[s] as usize] = s as u32;
            }
            for s in row.start..self.diagonal[i] {
                let k = self.cols[s] as usize;
                let l = product(&self.values[s], &self.values[self.diagonal[k]]);
                self.values[s] = l;
                for u in self.diagonal[k] + 1..self.row_ptr[k + 1] {
                    let at = self.place[self.cols[u] as usize];
                    if at != u32::MAX {
                        let upper = self.values[u];
                        subtract_product(&mut self.values[at as usize], &l, &upper);
                    }
                }
            }
            for s in row {
                self.place[self.cols[s] as usize] = u32::MAX;
            }
            let d = &mut self.values[self.diagonal[i]];
            *d = columns(&invert(&rows_of(d)).ok_or(SingularBlock { row: i })?);
        }
        Ok(())
    }
}

impl<const B: usize, T: Real> Preconditioner for BlockIlu0<B, T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let mut x = self.x.borrow_mut();
        let (r, z) = (r.as_chunks::<B>().0, z.as_chunks_mut::<B>().0);
        let n = x.len();
        for i in 0..n {
            let mut s = [T::default(); LANES];
            (0..B).for_each(|c| s[c] = T::from_f64(r[i][c]));
            self.subtract(&mut s, self.row_ptr[i]..self.diagonal[i], &x);
            x[i] = s;
        }
        for i in (0..n).rev() {
            let mut s = x[i];
            self.subtract(&mut s, self.diagonal[i] + 1..self.row_ptr[i + 1], &x);
            let mut solution = [T::default(); LANES];
            for (column, s) in self.values[self.diagonal[i]].iter().zip(s) {
                add_scaled(&mut solution, column, s);
            }
            x[i] = solution;
            (0..B).for_each(|c| z[i][c] = solution[c].to_f64());
        }
    }
}

impl<const B: usize, T: Real> BlockIlu0<B, T> {
    #[inline(always)]
    fn subtract(&self, s: &mut [T; LANES], slots: std::ops::Range<usize>, x: &[[T; LANES]]) {
        // A sum for each column: short chains of dependent operations.
        let mut sums = [[T::default(); LANES]; B];
        for (&j, a) in self.cols[slots.clone()].iter().zip(&self.values[slots]) {
            let x = &x[j as usize];
            (0..B).for_each(|c| add_scaled(&mut sums[c], &a[c], x[c]));
        }
        for sum in &sums {
            (0..LANES).for_each(|l| s[l] -= sum[l]);
        }
    }
}

/// `s += a x`, lane by lane.
#[inline(always)]
fn add_scaled<T: Real>(s: &mut [T; LANES], a: &[T; LANES], x: T) {
    for l in 0..LANES {
        s[l] = a[l].fused(x, s[l]);
    }
}

/// A block `[row][column]` by columns in precision `T`.
#[inline(always)]
fn columns<const B: usize, T: Real>(a: &[[f64; B]; B]) -> Columns<B, T> {
    let mut by_columns = [[T::default(); LANES]; B];
    for r in 0..B {
        for c in 0..B {
            by_columns[c][r] = T::from_f64(a[r][c]);
        }
    }
    by_columns
}

/// The way back from [`columns`].
fn rows_of<const B: usize, T: Real>(a: &Columns<B, T>) -> [[f64; B]; B] {
    std::array::from_fn(|r| std::array::from_fn(|c| a[c][r].to_f64()))
}

/// `a b`.
#[inline(always)]
fn product<const B: usize, T: Real>(a: &Columns<B, T>, b: &Columns<B, T>) -> Columns<B, T> {
    let mut p = [[T::default(); LANES]; B];
    for (p, b) in p.iter_mut().zip(b) {
        (0..B).for_each(|k| add_scaled(p, &a[k], b[k]));
    }
    p
}

/// `target -= a b`.
#[inline(always)]
fn subtract_product<const B: usize, T: Real>(
    target: &mut Columns<B, T>,
    a: &Columns<B, T>,
    b: &Columns<B, T>,
) {
    for (t, b) in target.iter_mut().zip(b) {
        (0..B).for_each(|k| add_scaled(t, &a[k], -b[k]));
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::Operator;
    use comm::Halo;

    fn factor<T: Real>(a: &BlockCsr<2>) -> BlockIlu0<2, T> {
        let mut ilu = BlockIlu0::empty();
        let rows: Vec<u32> = (0..a.n_rows() as u32).collect();
        ilu.refit(a, &rows, &rows).unwrap();
        ilu
    }

    /// A chain has no fill: ILU(0) is its exact factor.
    #[test]
    fn exact_on_a_chain() {
        let n = 30;
        let lists: Vec<Vec<u32>> =
            (0..n as u32).map(|i| [i.saturating_sub(1), (i + 1).min(n as u32 - 1)].to_vec()).collect();
        let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
        for i in 0..n {
            for s in a.row(i) {
                let w = (s as f64).sin();
                a.values[s] = match a.cols()[s] as usize == i {
                    true => [[4.0, w], [0.5, 5.0]],
                    false => [[-1.0, 0.3 * w], [w, -1.5]],
                };
            }
        }
        let mut x: Vec<f64> = (0..2 * n).map(|i| (i as f64).cos()).collect();
        let mut b = vec![0.0; 2 * n];
        a.apply(&mut x, &mut b);
        let mut z = vec![0.0; 2 * n];
        factor::<f64>(&a).apply(&b, &mut z);
        assert!(z.iter().zip(&x).all(|(z, x)| (z - x).abs() < 1e-12));
        factor::<f32>(&a).apply(&b, &mut z);
        assert!(z.iter().zip(&x).all(|(z, x)| (z - x).abs() < 1e-5));
    }
}
