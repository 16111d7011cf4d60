//! Flexible GMRES.

use comm::Comm;

use super::gram_schmidt::{add_combination, orthonormalise};
use super::{History, KrylovError, KrylovInfo, KrylovParams};
use crate::vector::{dot, residual};
use crate::{Operator, Preconditioner};

/// Right-preconditioned flexible GMRES(m) (Saad 1993): it minimises the true residual,
/// and the preconditioner may change between iterations. Orthogonalisation is
/// classical Gram-Schmidt, done twice where the first pass cancels much: an iteration has
/// one or two reductions whatever the basis size. Owns its workspace.
///
/// # Examples
///
/// ```
/// use std::rc::Rc;
///
/// use comm::{Comm, Halo};
/// use linalg::{BlockCsr, BlockJacobi, Gmres, KrylovParams};
///
/// // Two unknowns per row: block rows are dense 2 x 2 blocks.
/// let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(2)), &[vec![1], vec![0]]);
/// for row in 0..2 {
///     for slot in a.row(row) {
///         let diagonal = a.cols()[slot] as usize == row;
///         a.values[slot] = if diagonal { [[4.0, 1.0], [0.0, 4.0]] } else { [[-1.0, 0.0], [0.5, -1.0]] };
///     }
/// }
/// let b = [4.0, 3.5, 4.0, 3.5];
/// let mut x = vec![0.0; 4];
/// let jacobi = BlockJacobi::<2>::new(&a)?;
/// let info = Gmres::new(&Comm::solo()).solve(&a, &jacobi, &b, &mut x, KrylovParams::default())?;
/// assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-7), "{x:?}");
/// assert!(info.final_residual <= 1e-8 * info.rhs_norm);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Gmres {
    comm: Comm,
    /// Orthonormal basis, `m + 1` vectors.
    v: Vec<Vec<f64>>,
    /// Preconditioned basis, `m` vectors (with ghosts, since the operator reads them).
    z: Vec<Vec<f64>>,
    /// Columns of the triangular factor of the Hessenberg matrix, `[m][m + 1]`.
    h: Vec<Vec<f64>>,
    rotations: Vec<[f64; 2]>,
    /// Right-hand side of the least-squares problem.
    g: Vec<f64>,
    sums: Vec<f64>,
    history: Vec<f64>,
}

/// What a solve is to reach, and when it ends without that.
struct Aim {
    /// Residual norms: wanted, and of the initial guess.
    target: f64,
    initial: f64,
    /// See [`KrylovParams`].
    most: usize,
    patience: usize,
}

impl Aim {
    /// Whether at the pace so far `most` iterations would not be enough.
    fn is_out_of_reach(&self, iterations: usize, residual: f64) -> bool {
        iterations >= self.patience
            && iterations as f64 * (self.target / self.initial).ln()
                < self.most as f64 * (residual / self.initial).ln()
    }
}

impl Gmres {
    /// A solver for vectors distributed over `comm`.
    pub fn new(comm: &Comm) -> Self {
        Self {
            comm: comm.clone(),
            v: Vec::new(),
            z: Vec::new(),
            h: Vec::new(),
            rotations: Vec::new(),
            g: Vec::new(),
            sums: Vec::new(),
            history: Vec::new(),
        }
    }

    /// Residual norm of the guess and after each iteration of the last solve.
    pub fn history(&self) -> &[f64] {
        &self.history
    }

    /// Solves `A x = b` from the guess in `x`. `b` has `n_owned` numbers (longer is
    /// allowed), `x` `n_local`; the ghosts of `x` are not current on return.
    /// The final residual in the info is the true one.
    pub fn solve(
        &mut self,
        op: &dyn Operator,
        pre: &dyn Preconditioner,
        b: &[f64],
        x: &mut [f64],
        params: KrylovParams,
    ) -> Result<KrylovInfo, KrylovError> {
        let n = op.n_owned();
        let b = &b[..n];
        self.reserve(0, n, op.n_local());
        self.history.clear();

        let mut sums = [dot(b, b), f64::from(u8::from(x[..n].iter().any(|&v| v != 0.0)))];
        self.comm.sum_slice(&mut sums);
        let rhs_norm = sums[0].sqrt();
        let target = (params.rel_tol * rhs_norm).max(params.abs_tol);
        let mut norm = rhs_norm;
        if sums[1] == 0.0 {
            self.v[0].copy_from_slice(b);
        } else {
            norm = self.true_residual(op, b, x);
        }
        let mut info = KrylovInfo { iterations: 0, initial_residual: norm, final_residual: norm, rhs_norm };
        self.history.push(norm);
        let KrylovParams { max_iterations: most, patience, .. } = params;
        let aim = Aim { target, initial: norm, most, patience };
        loop {
            if !norm.is_finite() || !rhs_norm.is_finite() {
                return Err(self.not_finite("the residual", info.iterations));
            }
            info.final_residual = norm;
            if norm <= target {
                return Ok(info);
            }
            if info.iterations >= most || aim.is_out_of_reach(info.iterations, norm) {
                let (iterations, residual) = (info.iterations, norm);
                let history = History(self.history.clone());
                return Err(KrylovError::NotConverged { iterations, residual, target, history });
            }
            let budget = params.restart.max(1).min(most - info.iterations);
            let (k, estimate) = self.cycle(op, pre, norm, &aim, budget, info.iterations)?;
            self.correct(k, x);
            info.iterations += k;
            let before = norm;
            norm = self.true_residual(op, b, x);
            if norm <= target * 1.000_001 {
                // The recursion and the true residual agree but for rounding.
                norm = norm.min(target);
            } else if norm > 10.0 * estimate && norm > 0.5 * before {
                // The cycle promised far more than it delivered.
                return Err(KrylovError::Stalled {
                    residual: norm,
                    target,
                    history: History(self.history.clone()),
                });
            }
        }
    }

    /// `v[0] = b - A x`; returns its norm.
    fn true_residual(&mut self, op: &dyn Operator, b: &[f64], x: &mut [f64]) -> f64 {
        let r = &mut self.v[0];
        op.apply(x, r);
        residual(b, r);
        self.comm.sum(dot(r, r)).sqrt()
    }

    /// Builds a basis from `v[0]` until the residual meets its target or that is out of reach, or the
    /// basis has `m` vectors. Returns the basis size and the residual norm it promises.
    fn cycle(
        &mut self,
        op: &dyn Operator,
        pre: &dyn Preconditioner,
        norm: f64,
        aim: &Aim,
        m: usize,
        done: usize,
    ) -> Result<(usize, f64), KrylovError> {
        let n = op.n_owned();
        let scale = 1.0 / norm;
        self.v[0].iter_mut().for_each(|v| *v *= scale);
        self.g[0] = norm;
        let mut expected = 0.0;
        for k in 0..m {
            self.reserve(k + 1, n, op.n_local());
            pre.apply(&self.v[k], &mut self.z[k]);
            let (basis, rest) = self.v.split_at_mut(k + 1);
            let w = &mut rest[0];
            op.apply(&mut self.z[k], w);
            let h = &mut self.h[k][..=k];
            let next = orthonormalise(&self.comm, basis, w, expected, h, &mut self.sums);
            expected = h[k];
            if !next.is_finite() {
                return Err(self.not_finite("the preconditioner or the operator", done + k + 1));
            }
            let residual = self.rotate(k, next);
            self.history.push(residual);
            // A zero `next` means that the basis holds the exact solution.
            if residual <= aim.target
                || next <= f64::EPSILON * self.h[k][k].abs()
                || aim.is_out_of_reach(done + k + 1, residual)
            {
                return Ok((k + 1, residual));
            }
        }
        Ok((m, self.g[m].abs()))
    }

    /// Givens rotations make the new Hessenberg column triangular. Returns the residual norm.
    fn rotate(&mut self, k: usize, next: f64) -> f64 {
        let h = &mut self.h[k];
        for (i, &[c, s]) in self.rotations[..k].iter().enumerate() {
            (h[i], h[i + 1]) = (c * h[i] + s * h[i + 1], c * h[i + 1] - s * h[i]);
        }
        let d = h[k].hypot(next);
        let [c, s] = if d > 0.0 { [h[k] / d, next / d] } else { [1.0, 0.0] };
        h[k] = d;
        self.rotations[k] = [c, s];
        self.g[k + 1] = -s * self.g[k];
        self.g[k] *= c;
        self.g[k + 1].abs()
    }

    /// `x += Z y` with the triangular solve for `y`.
    fn correct(&mut self, k: usize, x: &mut [f64]) {
        for i in (0..k).rev() {
            let mut s = self.g[i];
            for j in i + 1..k {
                s -= self.h[j][i] * self.g[j];
            }
            // A zero pivot only follows an operator that maps a direction to zero:
            // that direction cannot lower the residual.
            self.g[i] = if self.h[i][i] != 0.0 { s / self.h[i][i] } else { 0.0 };
        }
        let n = self.v[0].len();
        add_combination(&self.z[..k], &mut self.g[..k], &mut x[..n]);
    }

    /// Room for a basis of `k` vectors; allocates only when it grows.
    fn reserve(&mut self, k: usize, n: usize, n_local: usize) {
        if self.v.first().is_some_and(|v| v.len() != n) || self.z.first().is_some_and(|z| z.len() != n_local)
        {
            self.v.clear();
            self.z.clear();
        }
        self.v.resize_with(self.v.len().max(k + 1), || vec![0.0; n]);
        self.z.resize_with(self.z.len().max(k), || vec![0.0; n_local]);
        self.h.resize_with(self.h.len().max(k), || vec![0.0; k + 1]);
        self.rotations.resize(self.rotations.len().max(k + 1), [0.0; 2]);
        self.g.resize(self.g.len().max(k + 2), 0.0);
        self.sums.resize(self.sums.len().max(k + 2), 0.0);
    }

    fn not_finite(&self, what: &'static str, iteration: usize) -> KrylovError {
        KrylovError::NotFinite { what, iteration, history: History(self.history.clone()) }
    }
}
