//! Multifrontal LU factorisation of a block matrix with a symmetric pattern.
//!
//! Values may be nonsymmetric. Rows are eliminated in a fill-reducing order (AMD on
//! the graph of block rows); pivoting stays inside the diagonal block of a supernode,
//! so the plan of the factorisation never changes. For matrices of elasticity and mass
//! type that is stable; as a preconditioner what little it loses costs GMRES an iteration.
//!
//! A supernode eliminates rows 1 and updates rows 2 of its dense front
//! $`F = \begin{pmatrix} F_{11} & F_{12} \\ F_{21} & F_{22} \end{pmatrix}`$. Kept are
//! $`R = (W,\ -W F_{12})`$ by rows and $`H = F_{21} W`$ by columns, with $`W = F_{11}^{-1}`$:
//! both sweeps of a solve are then plain products, $`b_2 \leftarrow b_2 - H b_1`$ upwards and
//! $`x_1 = R\,(b_1; x_2)`$ downwards.
//!
//! Of a symmetric matrix $`H = (W F_{12})^T`$ is not kept: the sweep upwards reads the rows of
//! $`R`$ as columns. Fronts then hold their upper triangle alone, which halves most of the work.
//!
//! The last rows may be kept: what the others leave in them is a Schur complement, which the caller solves with.

use std::cell::RefCell;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::lu::partial_pivoting as pivoted;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};

use super::pivot;
use super::sweep::{add_columns, flush, flush_finite, largest, padded, rows_dot};
use super::symbolic::{Front, Run, Symbolic};
use crate::block::Real;

/// The matrix cannot be factorised.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FactorError {
    /// A pivot block of this rank has no inverse.
    #[error(
        "the matrix is singular or not finite near local row {row}: is the node attached to an \
         element, and does it have mass or support?"
    )]
    Singular {
        /// A local block row in the part of the matrix that fails.
        row: usize,
    },
    /// This rank's part is fine but another's is not.
    #[error("the part of the matrix on another rank is singular or not finite")]
    OtherRank,
}

/// What a factor is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// The matrix.
    Whole,
    /// Half the sum of the matrix and its transpose.
    Symmetric,
}

/// Where the factor of one front lies in the common storage. Rows and columns are filled
/// up with zeros to whole vector registers.
struct FrontLocation {
    n1: usize,
    n2: usize,
    symmetric: bool,
    /// Its rows are kept, not eliminated.
    kept: bool,
    /// `R`, `n1 x (n1 + n2)` by rows. Of a symmetric matrix `-W F_12` comes first in a row, and both
    /// parts of it are filled up.
    r: std::ops::Range<usize>,
    /// `H`, `n2 x n1` by columns; empty for a symmetric matrix.
    h: std::ops::Range<usize>,
}

impl FrontLocation {
    /// Length of a row of `R`.
    fn row(&self) -> usize {
        if self.symmetric { padded(self.n2) + padded(self.n1) } else { padded(self.n1 + self.n2) }
    }
    /// Where `W` and `-W F_12` begin in a row of `R`.
    fn parts(&self) -> [usize; 2] {
        if self.symmetric { [padded(self.n2), 0] } else { [0, self.n1] }
    }
    /// What fills up a row of `R`.
    fn gaps(&self) -> [std::ops::Range<usize>; 2] {
        let [w, g] = self.parts();
        if self.symmetric { [self.n2..w, w + self.n1..self.row()] } else { [0..0, g + self.n2..self.row()] }
    }
    /// Length of a column of `H`.
    fn column(&self) -> usize {
        padded(self.n2)
    }
    /// Rows that are eliminated.
    fn eliminated(&self) -> usize {
        if self.kept { 0 } else { self.n1 }
    }
    /// Numbers in `R` and `H`.
    fn r_len(&self) -> usize {
        self.eliminated() * self.row()
    }
    fn h_len(&self) -> usize {
        if self.symmetric { 0 } else { self.eliminated() * self.column() }
    }
    /// Multiplications, see [`BlockLu::flops`].
    fn flops(&self) -> usize {
        let update = self.n2 * self.n2 / if self.symmetric { 2 } else { 1 };
        self.eliminated() * (self.n1 * self.n1 / 3 + self.n1 * self.n2 + update)
    }
}

/// LU factor of a matrix of `B x B` blocks, stored in precision `T`.
pub(crate) struct BlockLu<const B: usize, T: Real> {
    plan: Symbolic,
    places: Vec<FrontLocation>,
    /// Block rows that are eliminated, the first in the order.
    n_eliminated: usize,
    /// `R` of all fronts and `H` of all fronts, each in the order in which a solve reads them.
    r: Vec<T>,
    h: Vec<T>,
    /// Dense parts of the current front and the updates that wait for their parent.
    work: Work<T>,
    /// The factor is that of the matrix times this.
    scale: f64,
    scratch: RefCell<Scratch<T>>,
}

struct Work<T> {
    f11: Vec<T>,
    f12: Vec<T>,
    f21: Vec<T>,
    updates: Vec<Vec<T>>,
    /// Buffers of updates that have been used up.
    pool: Vec<Vec<T>>,
    pivots: Vec<usize>,
    pivots_inverse: Vec<usize>,
    stack: MemBuffer,
}

impl<T: Real> Work<T> {
    /// Fills the parts of a front with zeros; returns that of its update.
    fn cleared_front(&mut self, place: &FrontLocation) -> Vec<T> {
        let (n1, n2) = (place.n1, place.n2);
        let mut update = self.pool.pop().unwrap_or_default();
        for (part, n) in [
            (&mut self.f11, n1 * n1),
            (&mut self.f12, n1 * n2),
            (&mut self.f21, if place.symmetric { 0 } else { n1 * n2 }),
            (&mut update, n2 * n2),
        ] {
            part.resize(n.max(part.len()), T::default());
            part[..n].fill(T::default());
        }
        update
    }

    /// Eliminates rows 1 of the assembled front: fills `r` and `h` of the factor and leaves the Schur complement
    /// in `update`. False where the factor is not finite.
    fn eliminate(&mut self, place: &FrontLocation, r: &mut [T], h: &mut [T], update: &mut [T]) -> bool {
        let (n1, n2) = (place.n1, place.n2);
        // By rows: the transpose by columns.
        let by_rows = MatMut::from_column_major_slice_with_stride_mut(&mut *r, n1 + n2, n1, place.row());
        let (mut w, mut minus_g) = by_rows.transpose_mut().split_at_col_mut(n1);
        self.invert_pivots(n1, w.as_mut());
        let mut f21_w = MatMut::from_column_major_slice_with_stride_mut(&mut *h, n2, n1, place.column());
        let f12 = MatRef::from_column_major_slice(&self.f12[..n1 * n2], n1, n2);
        let f21 = MatRef::from_column_major_slice(&self.f21[..n1 * n2], n2, n1);
        let f22 = MatMut::from_column_major_slice_mut(&mut update[..n2 * n2], n2, n2);
        let one = T::from_f64(1.0);
        let minus = T::from_f64(-1.0);
        matmul(minus_g.as_mut(), Accum::Replace, w.as_ref(), f12, minus, Par::Seq);
        matmul(f21_w.as_mut(), Accum::Replace, f21, w.as_ref(), one, Par::Seq);
        matmul(f22, Accum::Add, f21_w.as_ref(), f12, minus, Par::Seq);
        flush(h);
        flush_finite(r)
    }

    /// As [`Work::eliminate`] for a symmetric matrix, of which the front and `update` are the upper triangle.
    fn eliminate_symmetric(&mut self, place: &FrontLocation, r: &mut [T], update: &mut [T]) -> bool {
        let (n1, n2, row) = (place.n1, place.n2, place.row());
        for c in 1..n1 {
            for i in 0..c {
                self.f11[i * n1 + c] = self.f11[c * n1 + i];
            }
        }
        let by_rows = MatMut::from_column_major_slice_with_stride_mut(&mut *r, row, n1, row);
        let (minus_g, w) = by_rows.transpose_mut().split_at_col_mut(place.parts()[0]);
        let (mut minus_g, mut w) = (minus_g.subcols_mut(0, n2), w.subcols_mut(0, n1));
        self.invert_pivots(n1, w.as_mut());
        let f12 = MatRef::from_column_major_slice(&self.f12[..n1 * n2], n1, n2);
        let f22 = MatMut::from_column_major_slice_mut(&mut update[..n2 * n2], n2, n2);
        let (one, minus) = (T::from_f64(1.0), T::from_f64(-1.0));
        matmul(minus_g.as_mut(), Accum::Replace, w.as_ref(), f12, minus, Par::Seq);
        let (upper, all) = (BlockStructure::TriangularUpper, BlockStructure::Rectangular);
        let (g, f21) = (minus_g.as_ref(), f12.transpose());
        triangular::matmul(f22, upper, Accum::Add, f21, all, g, all, one, Par::Seq);
        flush_finite(r)
    }

    /// `w` is the inverse of the pivot block `f11`, of size `n1`, which is used up.
    fn invert_pivots(&mut self, n1: usize, mut w: MatMut<'_, T>) {
        if n1 <= pivot::SMALL {
            pivot::invert(&mut self.f11, n1, &mut self.pivots);
            w.copy_from(MatRef::from_column_major_slice(&self.f11[..n1 * n1], n1, n1));
            return;
        }
        let stack = MemStack::new(&mut self.stack);
        let mut f11 = MatMut::from_column_major_slice_mut(&mut self.f11[..n1 * n1], n1, n1);
        let (_, pivots) = pivoted::factor::lu_in_place(
            f11.as_mut(),
            &mut self.pivots[..n1],
            &mut self.pivots_inverse[..n1],
            Par::Seq,
            stack,
            Default::default(),
        );
        pivoted::inverse::inverse(w, f11.as_ref(), f11.as_ref(), pivots, Par::Seq, stack);
    }
}

struct Scratch<T> {
    x: Vec<T>,
    front: Vec<T>,
    /// Right side and solution of the kept rows.
    kept: Vec<f64>,
}

impl<const B: usize, T: Real> BlockLu<B, T> {
    /// Plans the factorisation of matrices with this pattern (`row_ptr`, `cols`).
    pub fn new(row_ptr: &[usize], cols: &[u32]) -> Self {
        Self::of_plan(Symbolic::new(row_ptr, cols, 0), 0, Part::Whole)
    }

    /// Plans the factorisation of the square part in `rows` of matrices with this pattern,
    /// whose whole values [`BlockLu::factor_scaled`] takes. Columns beyond the rows of the
    /// pattern are left out.
    pub fn of_rows(row_ptr: &[usize], cols: &[u32], rows: &[u32], part: Part) -> Self {
        Self::condensed(row_ptr, cols, rows, 0, |_, _| true, part)
    }

    /// As [`BlockLu::of_rows`] with the entries that `counts` by row and column of the pattern. The last `n_kept` of `rows` are not eliminated:
    /// the caller solves for them, see [`BlockLu::schur_complement`].
    pub fn condensed(
        row_ptr: &[usize],
        cols: &[u32],
        rows: &[u32],
        n_kept: usize,
        counts: impl Fn(u32, u32) -> bool,
        part: Part,
    ) -> Self {
        let mut index = vec![u32::MAX; row_ptr.len() - 1];
        rows.iter().enumerate().for_each(|(k, &i)| index[i as usize] = k as u32);
        let (mut part_ptr, mut part_cols, mut slots) = (vec![0], Vec::new(), Vec::new());
        for &i in rows {
            for s in row_ptr[i as usize]..row_ptr[i as usize + 1] {
                let known = index.get(cols[s] as usize).filter(|j| **j != u32::MAX);
                if let Some(&j) = known.filter(|_| counts(i, cols[s])) {
                    part_cols.push(j);
                    slots.push(s as u32);
                }
            }
            part_ptr.push(part_cols.len());
        }
        let mut plan = Symbolic::new(&part_ptr, &part_cols, n_kept);
        for entry in plan.fronts.iter_mut().flat_map(|f| &mut f.entries) {
            entry[0] = slots[entry[0] as usize];
        }
        Self::of_plan(plan, n_kept, part)
    }

    /// Lays out the factor and its work space.
    fn of_plan(plan: Symbolic, n_kept: usize, part: Part) -> Self {
        let symmetric = part == Part::Symmetric;
        let n_eliminated = plan.order.len() - n_kept;
        let place = |f: &Front| {
            let (n1, n2) = (f.n_pivot * B, f.pattern.len() * B);
            FrontLocation { n1, n2, symmetric, kept: f.start >= n_eliminated, r: 0..0, h: 0..0 }
        };
        let mut places: Vec<FrontLocation> = plan.fronts.iter().map(place).collect();
        let (h, mut at) = whole_lines(places.iter().map(FrontLocation::h_len).sum());
        for p in &mut places {
            p.h = at..at + p.h_len();
            at = p.h.end;
        }
        let (r, mut at) = whole_lines(places.iter().map(FrontLocation::r_len).sum());
        for p in places.iter_mut().rev() {
            p.r = at..at + p.r_len();
            at = p.r.end;
        }
        let most = |f: fn(&FrontLocation) -> usize| places.iter().map(f).max().unwrap_or(0);
        let n1 = most(|p| p.n1);
        let stack = StackReq::or(
            pivoted::factor::lu_in_place_scratch::<usize, T>(n1, n1, Par::Seq, Default::default()),
            pivoted::inverse::inverse_scratch::<usize, T>(n1, Par::Seq),
        );
        let work = Work {
            f11: vec![T::default(); n1 * n1],
            f12: vec![T::default(); most(|p| p.n1 * p.n2)],
            f21: vec![T::default(); most(|p| p.n1 * p.n2)],
            updates: plan.fronts.iter().map(|_| Vec::new()).collect(),
            pool: Vec::new(),
            pivots: vec![0; n1],
            pivots_inverse: vec![0; n1],
            stack: MemBuffer::new(stack),
        };
        let scratch = Scratch {
            x: vec![T::default(); plan.order.len() * B],
            front: vec![T::default(); most(|p| p.n1 + p.row())],
            kept: vec![0.0; n_kept * B],
        };
        Self { plan, places, n_eliminated, r, h, work, scale: 1.0, scratch: RefCell::new(scratch) }
    }

    /// Bytes of the factor that a solve reads, those that it reads twice counted twice.
    pub fn bytes(&self) -> usize {
        let again = |p: &FrontLocation| if p.symmetric { p.eliminated() * p.column() } else { 0 };
        (self.r.len() + self.h.len() + self.places.iter().map(again).sum::<usize>()) * size_of::<T>()
    }

    /// Multiplications (each with an addition) of a factorisation that stores no inverse.
    pub fn flops(&self) -> u64 {
        self.places.iter().map(|p| p.flops() as u64).sum()
    }

    /// Factorises the matrix whose blocks, in the order of the pattern, are `values`.
    pub fn factor(&mut self, values: &[[[f64; B]; B]]) -> Result<(), FactorError> {
        self.factor_scaled(values, largest(values.as_flattened().as_flattened()))
    }

    /// As [`BlockLu::factor`], with the largest magnitude among `values`.
    pub fn factor_scaled(&mut self, values: &[[[f64; B]; B]], largest: f64) -> Result<(), FactorError> {
        let work = &mut self.work;
        self.scale = if largest > 0.0 && largest.is_finite() { 1.0 / largest } else { 1.0 };
        // What a failed attempt left.
        for update in &mut work.updates {
            if update.capacity() > 0 {
                work.pool.push(std::mem::take(update));
            }
        }
        for (s, (front, place)) in self.plan.fronts.iter().zip(&self.places).enumerate() {
            let mut update = work.cleared_front(place);
            let mut parts = Parts {
                n1: place.n1,
                n2: place.n2,
                f11: &mut work.f11,
                f12: &mut work.f12,
                f21: &mut work.f21,
                f22: &mut update,
            };
            if place.symmetric {
                parts.assemble_symmetric(front, values, self.scale);
            } else {
                parts.assemble(front, values, self.scale);
            }
            for &child in &front.children {
                let below = &self.plan.fronts[child as usize];
                let from = std::mem::take(&mut work.updates[child as usize]);
                let n = below.pattern.len() * B;
                if place.symmetric {
                    parts.extend_add::<B, true>(&below.to_parent, n, &from);
                } else {
                    parts.extend_add::<B, false>(&below.to_parent, n, &from);
                }
                work.pool.push(from);
            }
            if place.kept {
                work.pool.push(update);
                break;
            }
            let (r, h) = (&mut self.r[place.r.clone()], &mut self.h[place.h.clone()]);
            let good = if place.symmetric {
                work.eliminate_symmetric(place, r, &mut update)
            } else {
                work.eliminate(place, r, h, &mut update)
            };
            if !good {
                return Err(FactorError::Singular { row: self.plan.order[front.start] as usize });
            }
            work.updates[s] = update;
        }
        Ok(())
    }

    /// What elimination left in the kept rows of the matrix times [`BlockLu::scale`]: columns of `n` numbers, as many, of a symmetric matrix their
    /// upper triangle.
    pub fn schur_complement(&self) -> (usize, &[T]) {
        let n = (self.plan.order.len() - self.n_eliminated) * B;
        (n, &self.work.f11[..n * n])
    }

    /// What the values were multiplied with.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// `x = A^-1 x` for the first rows of `x`, as many as the matrix has.
    pub fn solve(&self, x: &mut [f64]) {
        self.solve_around(x, |_| ());
    }

    /// As [`BlockLu::solve`]; `kept` turns what elimination left of the right side in the kept rows into their solution.
    pub fn solve_around(&self, x: &mut [f64], kept: impl FnOnce(&mut [f64])) {
        let Scratch { x: y, front: gathered, kept: values } = &mut *self.scratch.borrow_mut();
        let x = &mut x.as_chunks_mut::<B>().0[..self.plan.order.len()];
        // Numbers around one, whatever the units.
        let largest = largest(x.as_flattened());
        let unit = if largest > 0.0 && largest.is_finite() { 1.0 / largest } else { 1.0 };
        let blocks = y.as_chunks_mut::<B>().0;
        for (y, &i) in blocks.iter_mut().zip(&self.plan.order) {
            *y = x[i as usize].map(|v| T::from_f64(v * unit));
        }
        let back = self.scale / unit;
        let fronts = self.plan.fronts.iter().zip(&self.places).filter(|(_, place)| !place.kept);
        for (front, place) in fronts.clone() {
            let (n1, n2) = (place.n1, place.n2);
            let (b1, sum) = gathered.split_at_mut(n1);
            let sum = &mut sum[..place.column()];
            let first = front.start * B;
            flush(&mut y[first..first + n1]);
            b1.copy_from_slice(&y[first..first + n1]);
            sum.fill(T::default());
            if place.symmetric {
                // The rows are those of `-H^T`.
                b1.iter_mut().for_each(|b| *b = -*b);
                add_columns(&self.r[place.r.clone()], place.row(), b1, sum);
            } else {
                add_columns(&self.h[place.h.clone()], place.column(), b1, sum);
            }
            let blocks = y.as_chunks_mut::<B>().0;
            for (s, &i) in sum[..n2].as_chunks::<B>().0.iter().zip(&front.pattern) {
                let block = &mut blocks[i as usize];
                for c in 0..B {
                    block[c] -= s[c];
                }
            }
        }
        let last = &mut y[self.n_eliminated * B..];
        values.iter_mut().zip(&*last).for_each(|(v, y)| *v = y.to_f64() / unit);
        kept(values);
        last.iter_mut().zip(&*values).for_each(|(y, v)| *y = T::from_f64(v / back));
        for (front, place) in fronts.rev() {
            let (n1, n2) = (place.n1, place.n2);
            let gathered = &mut gathered[..place.row()];
            let first = front.start * B;
            let [w, g] = place.parts();
            gathered[w..w + n1].copy_from_slice(&y[first..first + n1]);
            let blocks = y.as_chunks::<B>().0;
            let rest = gathered[g..g + n2].as_chunks_mut::<B>().0;
            for (g, &i) in rest.iter_mut().zip(&front.pattern) {
                *g = blocks[i as usize];
            }
            place.gaps().into_iter().for_each(|gap| gathered[gap].fill(T::default()));
            let solution = &mut y[first..first + n1];
            rows_dot(&self.r[place.r.clone()], gathered, solution);
            flush(solution);
        }
        let blocks = y.as_chunks::<B>().0;
        for (y, &i) in blocks.iter().zip(&self.plan.order) {
            x[i as usize] = y.map(|v| v.to_f64() * back);
        }
    }
}

/// Zeros for `n` numbers that start at a cache line (a register's load then touches one
/// line, not two), and where they start.
fn whole_lines<T: Real>(n: usize) -> (Vec<T>, usize) {
    let mut values = vec![T::default(); n + 64];
    let skip = values.as_ptr().align_offset(64).min(64);
    values.truncate(n + skip);
    (values, skip)
}

/// The four parts of a front, column-major.
struct Parts<'a, T> {
    n1: usize,
    n2: usize,
    f11: &'a mut [T],
    f12: &'a mut [T],
    f21: &'a mut [T],
    f22: &'a mut [T],
}

impl<T: Real> Parts<'_, T> {
    /// The column of the front above and below the pivot rows.
    fn column(&mut self, c: usize) -> (&mut [T], &mut [T]) {
        let (n1, n2) = (self.n1, self.n2);
        if c < n1 {
            (&mut self.f11[c * n1..][..n1], &mut self.f21[c * n2..][..n2])
        } else {
            let c = c - n1;
            (&mut self.f12[c * n1..][..n1], &mut self.f22[c * n2..][..n2])
        }
    }

    fn assemble<const B: usize>(&mut self, front: &Front, values: &[[[f64; B]; B]], scale: f64) {
        let n1 = self.n1;
        for &[slot, row, col] in &front.entries {
            let a = &values[slot as usize];
            let (row, col) = (row as usize * B, col as usize * B);
            for c in 0..B {
                let (top, bottom) = self.column(col + c);
                let part =
                    if row < n1 { &mut top[row..row + B] } else { &mut bottom[row - n1..row - n1 + B] };
                for r in 0..B {
                    part[r] += T::from_f64(a[r][c] * scale);
                }
            }
        }
    }

    /// As [`Parts::assemble`], the upper triangle of the symmetric part.
    fn assemble_symmetric<const B: usize>(&mut self, front: &Front, values: &[[[f64; B]; B]], scale: f64) {
        let half = 0.5 * scale;
        for &[slot, row, col] in &front.entries {
            let a = &values[slot as usize];
            let (i, j) = (row as usize * B, col as usize * B);
            for c in 0..B {
                if row <= col {
                    let (top, _) = self.column(j + c);
                    (0..B).for_each(|r| top[i + r] += T::from_f64(a[r][c] * half));
                }
                if row >= col {
                    let (top, _) = self.column(i + c);
                    (0..B).for_each(|r| top[j + r] += T::from_f64(a[c][r] * half));
                }
            }
        }
    }

    /// Adds a child's update of `n` rows, or its `UPPER` triangle; `runs` are the targets of its block rows.
    fn extend_add<const B: usize, const UPPER: bool>(&mut self, runs: &[Run], n: usize, update: &[T]) {
        let n1 = self.n1;
        for (last, columns) in runs.iter().enumerate() {
            let rows_of = if UPPER { &runs[..=last] } else { runs };
            for k in 0..columns.len * B {
                let column = columns.from * B + k;
                let from = &update[column * n..][..if UPPER { column + 1 } else { n }];
                let (top, bottom) = self.column(columns.to * B + k);
                for rows in rows_of {
                    let from = &from[rows.from * B..];
                    let from = &from[..from.len().min(rows.len * B)];
                    let at = rows.to * B;
                    let to = if at < n1 { &mut top[at..] } else { &mut bottom[at - n1..] };
                    for (to, u) in to[..from.len()].iter_mut().zip(from) {
                        *to += u.flushed();
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::Solve;
    use proptest::prelude::*;

    use super::*;

    /// A random symmetric pattern with nonsymmetric, diagonally dominant values.
    fn matrix(n: usize, edges: &[(usize, usize)]) -> (Vec<usize>, Vec<u32>, Vec<[[f64; 3]; 3]>) {
        let mut lists: Vec<Vec<u32>> = (0..n as u32).map(|i| vec![i]).collect();
        for &(i, j) in edges {
            lists[i % n].push((j % n) as u32);
            lists[j % n].push((i % n) as u32);
        }
        let (mut row_ptr, mut cols, mut values) = (vec![0], Vec::new(), Vec::new());
        let mut state = 12345u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / f64::from(u32::MAX >> 1) - 0.5
        };
        for (i, list) in lists.iter_mut().enumerate() {
            list.sort_unstable();
            list.dedup();
            for &j in list.iter() {
                let mut a = [[0.0; 3]; 3];
                a.iter_mut().flatten().for_each(|v| *v = random());
                if j as usize == i {
                    // A zero diagonal entry: the block pivots.
                    a = [[0.0, 9.0, 0.3], [9.0 + list.len() as f64, 0.1, 0.0], [0.2, 0.4, 9.0]];
                }
                cols.push(j);
                values.push(a);
            }
            row_ptr.push(cols.len());
        }
        (row_ptr, cols, values)
    }

    fn multiply(row_ptr: &[usize], cols: &[u32], values: &[[[f64; 3]; 3]], x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for i in 0..row_ptr.len() - 1 {
            for s in row_ptr[i]..row_ptr[i + 1] {
                for r in 0..3 {
                    for c in 0..3 {
                        y[3 * i + r] += values[s][r][c] * x[3 * cols[s] as usize + c];
                    }
                }
            }
        }
        y
    }

    /// The symmetric part of [`matrix`], whose pattern is symmetric.
    fn symmetric(row_ptr: &[usize], cols: &[u32], values: &[[[f64; 3]; 3]]) -> Vec<[[f64; 3]; 3]> {
        let mut part = values.to_vec();
        for i in 0..row_ptr.len() - 1 {
            for s in row_ptr[i]..row_ptr[i + 1] {
                let j = cols[s] as usize;
                let row = &cols[row_ptr[j]..row_ptr[j + 1]];
                let t = row_ptr[j] + row.binary_search(&(i as u32)).unwrap();
                part[s] = std::array::from_fn(|r| {
                    std::array::from_fn(|c| 0.5 * (values[s][r][c] + values[t][c][r]))
                });
            }
        }
        part
    }

    fn error<T: Real>(n: usize, edges: &[(usize, usize)], part: Part) -> f64 {
        let (row_ptr, cols, mut values) = matrix(n, edges);
        let rows: Vec<u32> = (0..n as u32).collect();
        let mut lu = BlockLu::<3, T>::of_rows(&row_ptr, &cols, &rows, part);
        let given = values.clone();
        if part == Part::Symmetric {
            values = symmetric(&row_ptr, &cols, &values);
        }
        let exact: Vec<f64> = (0..3 * n).map(|i| (i as f64 * 0.7).cos()).collect();
        let b = multiply(&row_ptr, &cols, &values, &exact);
        let mut worst = 0.0f64;
        // The second factorisation reuses the storage of the first.
        for _ in 0..2 {
            lu.factor(&given).unwrap();
            let mut x = b.clone();
            lu.solve(&mut x);
            worst = x.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        }
        worst
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn solves_random_systems(n in 1usize..60, edges in prop::collection::vec((0usize..60, 0usize..60), 0..150)) {
            prop_assert!(error::<f64>(n, &edges, Part::Whole) < 1e-10);
            prop_assert!(error::<f32>(n, &edges, Part::Whole) < 1e-3);
        }

        #[test]
        fn solves_with_the_symmetric_part(n in 1usize..60, edges in prop::collection::vec((0usize..60, 0usize..60), 0..150)) {
            prop_assert!(error::<f64>(n, &edges, Part::Symmetric) < 1e-10);
            prop_assert!(error::<f32>(n, &edges, Part::Symmetric) < 1e-3);
        }
    }

    /// Elimination of all rows but the last, which a dense factor of what is left then solves.
    fn error_of_condensed<T: Real>(n: usize, n_kept: usize, edges: &[(usize, usize)], part: Part) -> f64 {
        let (row_ptr, cols, mut values) = matrix(n, edges);
        let rows: Vec<u32> = (0..n as u32).collect();
        let mut lu = BlockLu::<3, T>::condensed(&row_ptr, &cols, &rows, n_kept, |_, _| true, part);
        lu.factor(&values).unwrap();
        if part == Part::Symmetric {
            values = symmetric(&row_ptr, &cols, &values);
        }
        let exact: Vec<f64> = (0..3 * n).map(|i| (i as f64 * 0.7).cos()).collect();
        let mut x = multiply(&row_ptr, &cols, &values, &exact);
        let (size, left) = lu.schur_complement();
        assert_eq!(size, 3 * n_kept);
        let entry = |i: usize, j: usize| left[j * size + i].to_f64() / lu.scale();
        let schur = faer::Mat::from_fn(size, size, |i, j| match part {
            Part::Symmetric => entry(i.min(j), i.max(j)),
            Part::Whole => entry(i, j),
        });
        lu.solve_around(&mut x, |kept| {
            schur.partial_piv_lu().solve_in_place(MatMut::from_column_major_slice_mut(kept, size, 1));
        });
        x.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn solves_around_kept_rows(n in 1usize..60, share in 0.0..1.0, edges in prop::collection::vec((0usize..60, 0usize..60), 0..150)) {
            let n_kept = 1 + (share * n as f64) as usize;
            let n_kept = n_kept.min(n);
            for part in [Part::Whole, Part::Symmetric] {
                prop_assert!(error_of_condensed::<f64>(n, n_kept, &edges, part) < 1e-10);
                prop_assert!(error_of_condensed::<f32>(n, n_kept, &edges, part) < 1e-3);
            }
        }
    }

    #[test]
    fn a_singular_matrix_names_a_row() {
        let (row_ptr, cols, mut values) = matrix(5, &[(0, 1), (2, 3)]);
        values.last_mut().unwrap()[2] = [0.0; 3];
        let error = BlockLu::<3, f64>::new(&row_ptr, &cols).factor(&values).unwrap_err();
        assert_eq!(error, FactorError::Singular { row: 4 });
    }
}
