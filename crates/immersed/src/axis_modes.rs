//! Eigenvectors of the pressure differences along an axis, and the transforms to and from them.
//!
//! Where an axis is its own mirror image, each eigenvector is even or odd about its middle,
//! ```math
//! v_{n-1-i} = \pm v_i .
//! ```
//! A transform then folds its values about the middle, into sums for the even modes and differences for the odd ones, and multiplies by two matrices of
//! half the size: half the multiplications (Solomonoff, J. Comput. Phys. 98, 1992).

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};

use crate::grid::{End, Ends, Grid};

/// Relative difference of two widths that is round-off.
const ROUND_OFF: f64 = 1e-14;

/// Differences of one axis: diagonal and coupling of cells i - 1 and i (that of the ends of a periodic axis last).
pub(crate) fn differences(grid: &Grid, d: usize) -> (Vec<f64>, Vec<f64>) {
    let n = grid.axes[d].len();
    let mut coupling: Vec<f64> = (0..=n).map(|i| 1.0 / grid.centre_distance(d, i)).collect();
    let mut diagonal = vec![0.0; n];
    for i in 0..n {
        diagonal[i] = coupling[i] + coupling[i + 1];
    }
    if let Ends::Open([low, high]) = grid.ends[d] {
        // No flux through a boundary that sets the velocity; zero pressure at an outflow stays in the diagonal.
        if low != End::Outflow {
            diagonal[0] -= coupling[0];
        }
        if high != End::Outflow {
            diagonal[n - 1] -= coupling[n];
        }
        (coupling[0], coupling[n]) = (0.0, 0.0);
    }
    (diagonal, coupling)
}

/// The symmetric matrix $`M^{-1/2} K M^{-1/2}`$ of an axis; `root`: $`M^{1/2}`$.
fn scaled_differences(grid: &Grid, d: usize, root: &[f64]) -> Mat<f64> {
    let n = root.len();
    let (diagonal, coupling) = differences(grid, d);
    let mut matrix = Mat::zeros(n, n);
    for i in 0..n {
        matrix[(i, i)] += diagonal[i] / (root[i] * root[i]);
        let before = if i == 0 { n - 1 } else { i - 1 };
        let value = coupling[i] / (root[i] * root[before]);
        matrix[(i, before)] -= value;
        matrix[(before, i)] -= value;
    }
    matrix
}

/// Whether widths and ends of the axis `d` are their own mirror image.
fn is_mirror_image(grid: &Grid, d: usize) -> bool {
    let widths = &grid.axes[d].widths;
    let ends = match grid.ends[d] {
        Ends::Periodic => true,
        Ends::Open([low, high]) => (low == End::Outflow) == (high == End::Outflow),
    };
    ends && widths.iter().zip(widths.iter().rev()).all(|(a, b)| (a - b).abs() <= ROUND_OFF * a)
}

/// Eigenvectors of one parity, or all of them.
#[derive(Clone, Debug)]
struct Part {
    /// +1: even about the middle, -1: odd.
    sign: f64,
    /// Cells of a vector: those up to the middle, or all.
    cells: usize,
    modes: Range<usize>,
    vectors: Vec<f64>,
    eigenvalues: Vec<f64>,
}

impl Part {
    /// Of a symmetric `matrix`, with modes numbered from `first`; the rows of its eigenvectors are divided by `root`.
    fn new(sign: f64, first: usize, matrix: &Mat<f64>, root: impl Fn(usize) -> f64) -> Self {
        let cells = matrix.nrows();
        let found = matrix.self_adjoint_eigen(Side::Lower).expect("a symmetric matrix of finite numbers");
        let mut vectors = Vec::with_capacity(cells * cells);
        for j in 0..cells {
            vectors.extend((0..cells).map(|i| found.U()[(i, j)] / root(i)));
        }
        // Round-off must not make the constant mode negative.
        let eigenvalues = (0..cells).map(|j| found.S().column_vector()[j].max(0.0)).collect();
        Self { sign, cells, modes: first..first + cells, vectors, eigenvalues }
    }

    /// Those of `modes` that it has, and the position of the first one among them.
    fn own(&self, modes: &Range<usize>) -> (Range<usize>, usize) {
        let own = modes.start.max(self.modes.start)..modes.end.min(self.modes.end);
        if own.is_empty() {
            (self.modes.start..self.modes.start, 0)
        } else {
            (own.clone(), own.start - modes.start)
        }
    }

    /// Vectors of its `modes` at `cells`.
    fn at(&self, cells: &Range<usize>, modes: &Range<usize>) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.vectors, self.cells, self.modes.len()).submatrix(
            cells.start,
            modes.start - self.modes.start,
            cells.len(),
            modes.len(),
        )
    }
}

/// Eigenvectors $`v`$ of $`K v = \lambda M v`$ along an axis, with $`V^T M V = I`$.
#[derive(Clone, Debug)]
pub(crate) struct AxisModes {
    /// Number of cells, and of modes.
    n: usize,
    /// Even and odd modes of an axis that is its own mirror image; else all modes.
    parts: Vec<Part>,
}

impl AxisModes {
    /// Of the axis `d` of `grid`.
    pub(crate) fn new(grid: &Grid, d: usize) -> Self {
        let root: Vec<f64> = grid.axes[d].widths.iter().map(|w| w.sqrt()).collect();
        let matrix = scaled_differences(grid, d, &root);
        let n = root.len();
        if !is_mirror_image(grid, d) {
            return Self { n, parts: vec![Part::new(1.0, 0, &matrix, |i| root[i])] };
        }
        // The basis of sums and differences of a cell and its image, of norm 1; a cell in the middle has no image.
        let norm = |i: usize| if 2 * i + 1 == n { std::f64::consts::FRAC_1_SQRT_2 } else { 1.0 };
        let folded = |sign: f64, cells: usize| {
            Mat::from_fn(cells, cells, |i, j| {
                norm(i) * norm(j) * (matrix[(i, j)] + sign * matrix[(i, n - 1 - j)])
            })
        };
        let root = |i: usize| root[i] * norm(i) * std::f64::consts::SQRT_2;
        let even = Part::new(1.0, 0, &folded(1.0, n.div_ceil(2)), root);
        let odd = Part::new(-1.0, even.cells, &folded(-1.0, n / 2), root);
        Self { n, parts: vec![even, odd] }
    }

    /// Whether it is its own mirror image.
    #[cfg(test)]
    pub(crate) fn is_folded(&self) -> bool {
        self.parts.len() == 2
    }

    /// Eigenvalues, 1/m2.
    pub(crate) fn eigenvalues(&self) -> Vec<f64> {
        self.parts.iter().flat_map(|part| part.eigenvalues.iter().copied()).collect()
    }

    /// The eigenvectors at all cells, columns.
    pub(crate) fn vectors(&self) -> Vec<f64> {
        let n = self.n;
        let mut vectors = vec![0.0; n * n];
        for part in &self.parts {
            for (mode, column) in part.modes.clone().zip(part.vectors.chunks_exact(part.cells)) {
                let all = &mut vectors[mode * n..][..n];
                all.iter_mut().rev().zip(column).for_each(|(v, of_image)| *v = part.sign * of_image);
                all[..part.cells].copy_from_slice(column);
            }
        }
        vectors
    }

    /// The smallest range with `cells` whose values can be transformed: its own mirror image where the axis is.
    pub(crate) fn covering(&self, cells: &Range<usize>) -> Range<usize> {
        if self.parts.len() == 1 {
            return cells.clone();
        }
        let first = cells.start.min(self.n - cells.end);
        first..self.n - first
    }

    /// $`V^T s`$: columns of values at `cells` ([`Self::covering`]) to columns of all modes.
    pub(crate) fn columns_to_modes(
        &self,
        cells: &Range<usize>,
        s: &[f64],
        modes: &mut [f64],
        half: &mut Vec<f64>,
    ) {
        let columns = s.len() / cells.len();
        let mut modes = MatMut::from_column_major_slice_mut(modes, self.n, columns);
        for part in &self.parts {
            let own = self.of_part(part, cells);
            let source = self.folded(s, cells.len(), 1, part.sign, half);
            let source = MatRef::from_column_major_slice(source, own.len(), columns);
            let of_part = modes.rb_mut().subrows_mut(part.modes.start, part.modes.len());
            matmul(of_part, Accum::Replace, part.at(&own, &part.modes).transpose(), source, 1.0, Par::Seq);
        }
    }

    /// $`V m`$: columns of all modes to columns of values at `cells`.
    pub(crate) fn modes_to_columns(
        &self,
        cells: &Range<usize>,
        modes: &[f64],
        s: &mut [f64],
        half: &mut Vec<f64>,
    ) {
        let columns = s.len() / cells.len();
        let modes = MatRef::from_column_major_slice(modes, self.n, columns);
        for part in &self.parts {
            let own = self.of_part(part, cells);
            let of_part = modes.subrows(part.modes.start, part.modes.len());
            self.unfolded(s, [cells.len(), own.len(), 1], part.sign, half, |values| {
                let values = MatMut::from_column_major_slice_mut(values, own.len(), columns);
                matmul(values, Accum::Replace, part.at(&own, &part.modes), of_part, 1.0, Par::Seq);
            });
        }
    }

    /// $`s V`$: rows of values at `cells` to rows of the modes `of`.
    pub(crate) fn rows_to_modes(
        &self,
        cells: &Range<usize>,
        of: &Range<usize>,
        s: &[f64],
        modes: &mut [f64],
        half: &mut Vec<f64>,
    ) {
        let rows = s.len() / cells.len();
        let mut modes = MatMut::from_column_major_slice_mut(modes, rows, of.len());
        for part in &self.parts {
            let (own, (of_part, first)) = (self.of_part(part, cells), part.own(of));
            let source = self.folded(s, cells.len(), rows, part.sign, half);
            let source = MatRef::from_column_major_slice(source, rows, own.len());
            let modes = modes.rb_mut().subcols_mut(first, of_part.len());
            matmul(modes, Accum::Replace, source, part.at(&own, &of_part), 1.0, Par::Seq);
        }
    }

    /// $`m V^T`$: rows of the modes `of` to rows of their share of the values at `cells`.
    pub(crate) fn modes_to_rows(
        &self,
        cells: &Range<usize>,
        of: &Range<usize>,
        modes: &[f64],
        s: &mut [f64],
        half: &mut Vec<f64>,
    ) {
        let rows = s.len() / cells.len();
        let modes = MatRef::from_column_major_slice(modes, rows, of.len());
        for part in &self.parts {
            let (own, (of_part, first)) = (self.of_part(part, cells), part.own(of));
            let modes = modes.subcols(first, of_part.len());
            self.unfolded(s, [cells.len(), own.len(), rows], part.sign, half, |values| {
                let values = MatMut::from_column_major_slice_mut(values, rows, own.len());
                let v = part.at(&own, &of_part).transpose();
                matmul(values, Accum::Replace, modes, v, 1.0, Par::Seq);
            });
        }
    }

    /// Cells of the vectors of `part` for `cells`.
    fn of_part(&self, part: &Part, cells: &Range<usize>) -> Range<usize> {
        cells.start..cells.end.min(part.cells)
    }

    /// Values `s` of `count` cells, blocks of `block` numbers each, folded to one parity; as they are on an axis that is no mirror image.
    fn folded<'a>(
        &self,
        s: &'a [f64],
        count: usize,
        block: usize,
        sign: f64,
        half: &'a mut Vec<f64>,
    ) -> &'a [f64] {
        if self.parts.len() == 1 {
            return s;
        }
        // An odd count has a middle cell, which belongs to the even modes.
        let middle = usize::from(count % 2 == 1 && sign > 0.0);
        let cells = count / 2 + middle;
        let length = s.len() / count * cells;
        half.resize(length.max(half.len()), 0.0);
        let half = &mut half[..length];
        for (s, half) in s.chunks_exact(count * block).zip(half.chunks_exact_mut((cells * block).max(1))) {
            fold(s, block, sign, half);
            let at = count / 2 * block;
            half[at..].copy_from_slice(&s[at..at + middle * block]);
        }
        half
    }

    /// Adds the values of one parity, which `set` sets up to the middle, to `s`; those of the first parity replace it.
    fn unfolded(
        &self,
        s: &mut [f64],
        [count, cells, block]: [usize; 3],
        sign: f64,
        half: &mut Vec<f64>,
        set: impl FnOnce(&mut [f64]),
    ) {
        if self.parts.len() == 1 {
            return set(s);
        }
        let length = s.len() / count * cells;
        half.resize(length.max(half.len()), 0.0);
        let half = &mut half[..length];
        set(half);
        for (s, half) in s.chunks_exact_mut(count * block).zip(half.chunks_exact((cells * block).max(1))) {
            if sign > 0.0 {
                unfold(half, block, s, |half, value, image| (*value, *image) = (half, half));
                let at = count / 2 * block;
                s[at..at + half.len() - at].copy_from_slice(&half[at..]);
            } else {
                unfold(half, block, s, |half, value, image| {
                    *value += half;
                    *image -= half;
                });
            }
        }
    }
}

/// Sums (`sign` 1) or differences (-1) of the cells up to the middle of `s` and their images, blocks of `block` numbers each.
fn fold(s: &[f64], block: usize, sign: f64, half: &mut [f64]) {
    let pairs = s.len() / block / 2;
    if block == 1 {
        for ((half, value), image) in half.iter_mut().zip(&s[..pairs]).zip(s.iter().rev()) {
            *half = value + sign * image;
        }
        return;
    }
    let (values, images) = (s.chunks_exact(block).take(pairs), s.chunks_exact(block).rev());
    for ((half, values), images) in half.chunks_exact_mut(block).zip(values).zip(images) {
        for ((half, value), image) in half.iter_mut().zip(values).zip(images) {
            *half = value + sign * image;
        }
    }
}

/// `set(half, value, image)` for the cells of `s` up to the middle and their images, blocks of `block` numbers each.
#[inline(always)]
fn unfold(half: &[f64], block: usize, s: &mut [f64], set: impl Fn(f64, &mut f64, &mut f64)) {
    let pairs = s.len() / block / 2;
    let (values, images) = s.split_at_mut(s.len() - pairs * block);
    let values = &mut values[..pairs * block];
    if block == 1 {
        for ((half, value), image) in half.iter().zip(values).zip(images.iter_mut().rev()) {
            set(*half, value, image);
        }
        return;
    }
    let blocks = values.chunks_exact_mut(block).zip(images.chunks_exact_mut(block).rev());
    for (half, (values, images)) in half.chunks_exact(block).zip(blocks) {
        for ((half, value), image) in half.iter().zip(values).zip(images) {
            set(*half, value, image);
        }
    }
}
