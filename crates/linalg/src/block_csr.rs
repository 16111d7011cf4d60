//! Distributed matrices of dense blocks, compressed by rows.

use std::rc::Rc;

use comm::Halo;

use crate::Operator;
use crate::block::{Real, accumulate};

/// Block rows of a distributed square matrix.
///
/// This rank stores the rows it owns; columns are local indices of `halo`, so they
/// may be ghosts. The pattern is fixed at construction, each row sorted by column
/// and holding its diagonal. Values are `values[slot]`, blocks `[row][column]`;
/// [`BlockCsr::slot`] gives the slots that an assembly loop keeps.
///
/// Entries are stored in precision `T`; products are summed in `f64`.
///
/// # Examples
///
/// The Laplacian of three nodes on a line, and its product with a linear function:
///
/// ```
/// use std::rc::Rc;
///
/// use comm::Halo;
/// use linalg::{BlockCsr, Operator};
///
/// let neighbours = [vec![1], vec![0, 2], vec![1]];
/// let mut a = BlockCsr::<1>::from_adjacency(Rc::new(Halo::solo(3)), &neighbours);
/// for row in 0..3 {
///     for slot in a.row(row) {
///         a.values[slot] = if a.cols()[slot] as usize == row { [[2.0]] } else { [[-1.0]] };
///     }
/// }
/// let mut x = vec![1.0, 2.0, 3.0];
/// let mut product = vec![0.0; 3];
/// a.apply(&mut x, &mut product);
/// assert_eq!(product, [0.0, 0.0, 4.0]);
/// ```
#[derive(Clone, Debug)]
pub struct BlockCsr<const B: usize, T: Real = f64> {
    halo: Rc<Halo>,
    row_ptr: Rc<Vec<usize>>,
    cols: Rc<Vec<u32>>,
    diagonal: Rc<Vec<usize>>,
    /// Runs of rows that read no ghost: worked on while ghosts travel.
    interior: Vec<std::ops::Range<usize>>,
    boundary: Vec<std::ops::Range<usize>>,
    /// Blocks, in the order of the pattern.
    pub values: Vec<[[T; B]; B]>,
}

impl<const B: usize, T: Real> BlockCsr<B, T> {
    /// A zero matrix on a given pattern: row `i` has the columns
    /// `cols[row_ptr[i]..row_ptr[i + 1]]`, strictly ascending local indices that
    /// include `i`. There is one row for each owned entity of `halo`.
    pub fn new(halo: Rc<Halo>, row_ptr: Vec<usize>, cols: Vec<u32>) -> Self {
        let n = halo.n_owned();
        assert_eq!(row_ptr.len(), n + 1, "one row for each owned entity");
        assert_eq!(row_ptr[n], cols.len(), "row pointers end at the number of columns");
        let (mut interior, mut boundary) = (Vec::new(), Vec::new());
        let mut diagonal = Vec::with_capacity(n);
        for i in 0..n {
            let row = &cols[row_ptr[i]..row_ptr[i + 1]];
            assert!(row.windows(2).all(|w| w[0] < w[1]), "columns of a row ascend");
            let last = row.last().expect("a row holds its diagonal");
            assert!((*last as usize) < halo.n_local(), "columns are local indices");
            let at = row.binary_search(&(i as u32)).expect("a row holds its diagonal");
            diagonal.push(row_ptr[i] + at);
            let runs = if (*last as usize) < n { &mut interior } else { &mut boundary };
            push_run(runs, i);
        }
        let values = vec![[[T::default(); B]; B]; cols.len()];
        let (row_ptr, cols, diagonal) = (Rc::new(row_ptr), Rc::new(cols), Rc::new(diagonal));
        Self { halo, row_ptr, cols, diagonal, interior, boundary, values }
    }

    /// A zero matrix whose row `i` couples to `neighbours[i]` (local indices, any
    /// order, repeats allowed) and to itself.
    pub fn from_adjacency(halo: Rc<Halo>, neighbours: &[Vec<u32>]) -> Self {
        let mut row_ptr = vec![0];
        let mut cols = Vec::new();
        let mut row = Vec::new();
        for (i, list) in neighbours.iter().enumerate() {
            row.clear();
            row.extend_from_slice(list);
            row.push(i as u32);
            row.sort_unstable();
            row.dedup();
            cols.extend_from_slice(&row);
            row_ptr.push(cols.len());
        }
        Self::new(halo, row_ptr, cols)
    }

    /// A zero matrix that couples all nodes of an element to each other. `elements`
    /// hold local indices; every element that touches an owned node must be here.
    pub fn from_elements<'a, E>(halo: Rc<Halo>, elements: E) -> Self
    where
        E: Iterator<Item = &'a [u32]> + Clone,
    {
        let n = halo.n_owned();
        // Elements of each owned node, by counting.
        let mut start = vec![0usize; n + 1];
        for &a in elements.clone().flatten() {
            if (a as usize) < n {
                start[a as usize + 1] += 1;
            }
        }
        for i in 0..n {
            start[i + 1] += start[i];
        }
        let mut at = start.clone();
        let mut of_node: Vec<&[u32]> = vec![&[]; start[n]];
        for e in elements {
            for &a in e {
                if (a as usize) < n {
                    of_node[at[a as usize]] = e;
                    at[a as usize] += 1;
                }
            }
        }
        let mut row_ptr = Vec::with_capacity(n + 1);
        row_ptr.push(0);
        let mut cols: Vec<u32> = Vec::new();
        let mut seen = vec![u32::MAX; halo.n_local()];
        for i in 0..n {
            let first = cols.len();
            seen[i] = i as u32;
            cols.push(i as u32);
            for &b in of_node[start[i]..start[i + 1]].iter().copied().flatten() {
                if seen[b as usize] != i as u32 {
                    seen[b as usize] = i as u32;
                    cols.push(b);
                }
            }
            cols[first..].sort_unstable();
            row_ptr.push(cols.len());
        }
        Self::new(halo, row_ptr, cols)
    }

    /// Sets every block to zero.
    pub fn zero(&mut self) {
        self.values.fill([[T::default(); B]; B]);
    }

    /// Position in `values` of the block at owned row `row`, local column `col`.
    pub fn slot(&self, row: usize, col: usize) -> Option<usize> {
        let range = self.row_ptr[row]..self.row_ptr[row + 1];
        self.cols[range.clone()].binary_search(&(col as u32)).ok().map(|k| range.start + k)
    }

    /// Position in `values` of the diagonal block of `row`.
    pub fn diagonal_slot(&self, row: usize) -> usize {
        self.diagonal[row]
    }

    /// Slots of one row.
    pub fn row(&self, row: usize) -> std::ops::Range<usize> {
        self.row_ptr[row]..self.row_ptr[row + 1]
    }

    /// Row pointers, `n_rows + 1`.
    pub fn row_ptr(&self) -> &[usize] {
        &self.row_ptr
    }

    /// Local column index of each slot.
    pub fn cols(&self) -> &[u32] {
        &self.cols
    }

    /// Owned block rows.
    pub fn n_rows(&self) -> usize {
        self.halo.n_owned()
    }

    /// The halo that vectors of this matrix use.
    pub fn halo(&self) -> &Rc<Halo> {
        &self.halo
    }

    /// Bytes that one product reads of the matrix.
    pub fn bytes(&self) -> usize {
        self.values.len() * (size_of::<[[T; B]; B]>() + 4) + self.row_ptr.len() * size_of::<usize>()
    }

    /// The same matrix stored in another precision.
    pub fn cast<S: Real>(&self) -> BlockCsr<B, S> {
        self.map(|v| S::from_f64(v.to_f64()))
    }

    /// The matrix itself in another precision; where that is its own, nothing is copied.
    pub(crate) fn into_precision<S: Real>(self) -> BlockCsr<B, S> {
        let mut itself = Some(self);
        match (&mut itself as &mut dyn std::any::Any).downcast_mut::<Option<BlockCsr<B, S>>>() {
            Some(same) => same.take().expect("just put there"),
            None => itself.expect("of another type: not taken").cast(),
        }
    }

    /// The matrix of `f` of each entry.
    pub(crate) fn map<S: Real>(&self, f: impl Fn(T) -> S) -> BlockCsr<B, S> {
        BlockCsr {
            halo: self.halo.clone(),
            row_ptr: self.row_ptr.clone(),
            cols: self.cols.clone(),
            diagonal: self.diagonal.clone(),
            interior: self.interior.clone(),
            boundary: self.boundary.clone(),
            values: self.values.iter().map(|a| a.map(|row| row.map(&f))).collect(),
        }
    }

    /// Row pointers, columns and blocks; the pattern is copied where others share it.
    #[allow(clippy::type_complexity)]
    pub(crate) fn into_parts(self) -> (Rc<Vec<usize>>, Vec<u32>, Vec<[[T; B]; B]>) {
        let cols = Rc::try_unwrap(self.cols).unwrap_or_else(|shared| shared.to_vec());
        (self.row_ptr, cols, self.values)
    }

    fn multiply(&self, runs: &[std::ops::Range<usize>], x: &[[f64; B]], y: &mut [[f64; B]]) {
        for run in runs {
            for i in run.clone() {
                let row = self.row_ptr[i]..self.row_ptr[i + 1];
                let mut sum = [[0.0; B]; B];
                for (&j, a) in self.cols[row.clone()].iter().zip(&self.values[row]) {
                    accumulate(&mut sum, a, &x[j as usize]);
                }
                for r in 0..B {
                    y[i][r] = sum[r].iter().sum();
                }
            }
        }
    }
}

impl<const B: usize, T: Real> Operator for BlockCsr<B, T> {
    fn n_owned(&self) -> usize {
        self.halo.n_owned() * B
    }

    fn n_local(&self) -> usize {
        self.halo.n_local() * B
    }

    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        let y = y.as_chunks_mut::<B>().0;
        self.halo.overlap(x, B, |x| self.multiply(&self.interior, x.as_chunks().0, y));
        self.multiply(&self.boundary, x.as_chunks().0, y);
    }
}

fn push_run(runs: &mut Vec<std::ops::Range<usize>>, i: usize) {
    match runs.last_mut() {
        Some(run) if run.end == i => run.end = i + 1,
        _ => runs.push(i..i + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The product agrees with the dense matrix that the slots describe.
        #[test]
        fn product_agrees_with_dense(
            n in 1usize..12,
            edges in prop::collection::vec((0usize..12, 0usize..12), 0..40),
            seed in prop::collection::vec(-1.0f64..1.0, 64),
        ) {
            let mut adjacency = vec![Vec::new(); n];
            for (i, j) in edges {
                adjacency[i % n].push((j % n) as u32);
            }
            let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(n)), &adjacency);
            let mut dense = vec![vec![0.0; 2 * n]; 2 * n];
            for i in 0..n {
                for j in 0..n {
                    if let Some(s) = a.slot(i, j) {
                        for (r, c) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                            let v = seed[(s * 4 + r * 2 + c) % 64];
                            a.values[s][r][c] = v;
                            dense[2 * i + r][2 * j + c] = v;
                        }
                    }
                }
            }
            let mut x: Vec<f64> = (0..2 * n).map(|i| seed[i % 64] + i as f64).collect();
            let mut y = vec![0.0; 2 * n];
            a.apply(&mut x, &mut y);
            for i in 0..2 * n {
                let want: f64 = (0..2 * n).map(|j| dense[i][j] * x[j]).sum();
                prop_assert!((y[i] - want).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn elements_and_adjacency_make_the_same_pattern() {
        let elements = [[0u32, 1, 2], [2, 1, 3], [3, 4, 2]];
        let halo = Rc::new(Halo::solo(5));
        let a = BlockCsr::<1>::from_elements(halo.clone(), elements.iter().map(|e| &e[..]));
        let lists = [vec![1, 2], vec![0, 2, 3], vec![0, 1, 3, 4], vec![1, 2, 4], vec![2, 3]];
        let b = BlockCsr::<1>::from_adjacency(halo, &lists);
        assert_eq!((a.row_ptr(), a.cols()), (b.row_ptr(), b.cols()));
    }
}
