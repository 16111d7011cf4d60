//! One level of the hierarchy: matrix, smoother, transfer.

use std::cell::{RefCell, RefMut};

use comm::Comm;

use super::coarsen::Step;
use super::prolongation::Prolongation;
use super::{AmgError, AmgParams, MODES, coarsen};
use crate::block::{Real, invert};
use crate::jacobi::SingularBlock;
use crate::symmetric::AHEAD;
use crate::{BlockCsr, SymmetricCsr};

pub(super) struct Level<const F: usize, T: Real> {
    a: SymmetricCsr<F, T>,
    /// Inverse of the smoother's diagonal blocks.
    inverse: Vec<[[T; F]; F]>,
    /// What the smoother adds to the diagonal: half the couplings to other ranks, so that
    /// Jacobi between ranks converges.
    extra: Vec<[T; F]>,
    p: Prolongation<F, T>,
    /// Right-hand side and solution of this level, for whoever calls `cycle`.
    buffers: RefCell<(Vec<T>, Vec<T>)>,
    work: RefCell<Work<T>>,
}

struct Work<T> {
    residual: Vec<T>,
    coarse_rhs: Vec<T>,
    coarse_x: Vec<T>,
}

impl<const F: usize, T: Real> Level<F, T> {
    /// Sets up the level of `a` and makes the next coarser problem; gives `a` back where coarsening
    /// leaves more than the share `most` of its nodes. Collective.
    #[allow(clippy::type_complexity)]
    pub fn new<S: Real>(
        a: BlockCsr<F, S>,
        modes: &[[[f64; MODES]; F]],
        params: &AmgParams,
        level: usize,
        most: f64,
    ) -> Result<Result<(Self, Step), BlockCsr<F, S>>, AmgError> {
        let n = a.n_rows();
        let mut singular = None;
        let mut inverse = Vec::with_capacity(n);
        let mut extra = vec![[T::default(); F]; n];
        let mut jacobi = Vec::with_capacity(n);
        for i in 0..n {
            let slot = a.diagonal_slot(i);
            let mut d = a.values[slot].map(|row| row.map(S::to_f64));
            jacobi.push(invert(&d).unwrap_or([[0.0; F]; F]));
            for s in slot + 1..a.row(i).end {
                if a.cols()[s] as usize >= n {
                    for r in 0..F {
                        let l1: f64 = a.values[s][r].iter().map(|v| v.to_f64().abs()).sum();
                        extra[i][r] += T::from_f64(0.5 * l1);
                    }
                }
            }
            (0..F).for_each(|r| d[r][r] += extra[i][r].to_f64());
            match invert(&d) {
                Some(d) => inverse.push(d.map(|r| r.map(T::from_f64))),
                None => {
                    singular = singular.or(Some(SingularBlock { row: i }));
                    inverse.push([[T::default(); F]; F]);
                }
            }
        }
        if !a.halo().comm().all(singular.is_none()) {
            return Err(match singular {
                Some(source) => AmgError::Singular { level, source },
                None => AmgError::OtherRank { level },
            });
        }
        let (step, p) = coarsen(&a, &jacobi, modes, params);
        drop(jacobi);
        let mut nodes = [n as f64, step.a.n_rows() as f64];
        a.halo().comm().sum_slice(&mut nodes);
        if nodes[1] > most * nodes[0] {
            return Ok(Err(a));
        }
        let level = Self {
            a: SymmetricCsr::of(a.into_precision()),
            inverse,
            extra,
            p: p.cast(),
            buffers: RefCell::default(),
            work: RefCell::new(Work { residual: Vec::new(), coarse_rhs: Vec::new(), coarse_x: Vec::new() }),
        };
        Ok(Ok((level, step)))
    }

    /// Allocates the vectors of the cycle.
    pub fn reserve(&mut self) {
        let n = self.a.n_rows() * F;
        let local = self.a.halo().n_local() * F;
        let coarse = self.p.coarse.n_local() * MODES;
        *self.buffers.get_mut() = (vec![T::default(); n], vec![T::default(); local]);
        *self.work.get_mut() = Work {
            residual: vec![T::default(); n],
            coarse_rhs: vec![T::default(); coarse],
            coarse_x: vec![T::default(); coarse],
        };
    }

    pub fn n_rows(&self) -> usize {
        self.a.n_rows()
    }

    pub fn matrix(&self) -> &SymmetricCsr<F, T> {
        &self.a
    }

    pub fn inverse(&self) -> &[[[T; F]; F]] {
        &self.inverse
    }

    pub fn comm(&self) -> &Comm {
        self.a.halo().comm()
    }

    pub fn buffers(&self) -> RefMut<'_, (Vec<T>, Vec<T>)> {
        self.buffers.borrow_mut()
    }

    pub fn bytes(&self) -> usize {
        let (buffers, work) = (self.buffers.borrow(), self.work.borrow());
        let numbers = buffers.0.len()
            + buffers.1.len()
            + work.residual.len()
            + work.coarse_rhs.len()
            + work.coarse_x.len()
            + self.extra.len() * F
            + self.inverse.len() * F * F;
        self.a.bytes() + numbers * size_of::<T>() + self.p.bytes()
    }

    /// `x = M^-1 r`: smooth, correct by `coarse`, smooth in reverse. `x` has local length.
    ///
    /// Each sweep reads the half of the matrix that is stored, once: a block serves its row, and
    /// transposed, by what is left for the rows above, its column.
    pub fn cycle(&self, r: &[T], x: &mut [T], coarse: impl FnOnce(&[T], &mut [T])) {
        let Work { residual, coarse_rhs, coarse_x } = &mut *self.work.borrow_mut();
        self.forward_from_zero(r, x, residual);
        self.a.halo().exchange(x, F);
        self.subtract_ghosts(x, residual);
        self.p.restrict(residual, coarse_rhs);
        coarse(coarse_rhs, coarse_x);
        self.p.prolong_add(coarse_x, x);
        self.a.halo().exchange(x, F);
        let rest = residual;
        // On coarse levels `r` is as long as its ghosts ask for.
        let n = rest.len();
        rest.copy_from_slice(&r[..n]);
        self.subtract_ghosts(x, rest);
        self.backward(rest, x);
    }

    /// A forward Gauss-Seidel sweep from `x = 0`, and the residual that it leaves, but for ghosts:
    /// what the sweep solved cancels, so that only columns behind the diagonal count.
    fn forward_from_zero(&self, r: &[T], x: &mut [T], residual: &mut [T]) {
        let (r, x) = (r.as_chunks::<F>().0, x.as_chunks_mut::<F>().0);
        let residual = residual.as_chunks_mut::<F>().0;
        for i in 0..self.a.n_rows() {
            self.a.prefetch(i + AHEAD);
            let (cols, values) = self.a.lower(i);
            let mut s = r[i];
            subtract(&mut s, cols, values, x);
            let xi = multiply(&self.inverse[i], &s);
            x[i] = xi;
            for (&j, a) in cols.iter().zip(values) {
                subtract_transposed(&mut residual[j as usize], a, &xi);
            }
            (0..F).for_each(|c| residual[i][c] = self.extra[i][c] * xi[c]);
        }
    }

    /// Subtracts the products of ghosts.
    fn subtract_ghosts(&self, x: &[T], rest: &mut [T]) {
        let (x, rest) = (x.as_chunks::<F>().0, rest.as_chunks_mut::<F>().0);
        for (i, cols, values) in self.a.ghosts() {
            subtract(&mut rest[i], cols, values, x);
        }
    }

    /// A backward Gauss-Seidel sweep; `rest` is the right-hand side without the ghosts' part, and is used up.
    fn backward(&self, rest: &mut [T], x: &mut [T]) {
        let (rest, x) = (rest.as_chunks_mut::<F>().0, x.as_chunks_mut::<F>().0);
        for i in (0..self.a.n_rows()).rev() {
            self.a.prefetch(i.wrapping_sub(AHEAD));
            let (cols, values) = self.a.lower(i);
            let mut s = rest[i];
            (0..F).for_each(|c| s[c] += self.extra[i][c] * x[i][c]);
            subtract(&mut s, cols, values, x);
            let xi = multiply(&self.inverse[i], &s);
            x[i] = xi;
            for (&j, a) in cols.iter().zip(values) {
                subtract_transposed(&mut rest[j as usize], a, &xi);
            }
        }
    }
}

/// Subtracts a run of a row's products from `s`. The products of an entry go to a sum of
/// its own: without dependence between neighbours the compiler fills vector registers.
#[inline(always)]
fn subtract<const F: usize, T: Real>(s: &mut [T; F], cols: &[u32], values: &[[[T; F]; F]], x: &[[T; F]]) {
    let mut sums = [[T::default(); F]; F];
    for (&j, a) in cols.iter().zip(values) {
        let x = &x[j as usize];
        for r in 0..F {
            for c in 0..F {
                sums[r][c] = a[r][c].fused(x[c], sums[r][c]);
            }
        }
    }
    for r in 0..F {
        let mut sum = sums[r][0];
        for c in 1..F {
            sum += sums[r][c];
        }
        s[r] -= sum;
    }
}

/// `y -= A^T x`.
#[inline(always)]
fn subtract_transposed<const F: usize, T: Real>(y: &mut [T; F], a: &[[T; F]; F], x: &[T; F]) {
    for r in 0..F {
        let minus = -x[r];
        for c in 0..F {
            y[c] = a[r][c].fused(minus, y[c]);
        }
    }
}

#[inline(always)]
fn multiply<const F: usize, T: Real>(a: &[[T; F]; F], x: &[T; F]) -> [T; F] {
    let mut y = [T::default(); F];
    for r in 0..F {
        for c in 0..F {
            y[r] = a[r][c].fused(x[c], y[r]);
        }
    }
    y
}
