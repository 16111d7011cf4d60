//! Conjugate gradients.

use comm::Comm;

use super::{History, KrylovError, KrylovInfo, KrylovParams};
use crate::vector::{axpy, dot, residual, xpby};
use crate::{Operator, Preconditioner};

/// Preconditioned conjugate gradients with the Polak-Ribiere formula, which tolerates
/// a preconditioner that is symmetric only to rounding (Notay 2000).
/// Three reductions an iteration. Owns its workspace. Residual norms are those of the
/// recursion; they follow the true ones down to rounding of the largest iterate.
pub struct Cg {
    comm: Comm,
    r: Vec<f64>,
    z: Vec<f64>,
    p: Vec<f64>,
    q: Vec<f64>,
    history: Vec<f64>,
}

impl Cg {
    /// A solver for vectors distributed over `comm`.
    pub fn new(comm: &Comm) -> Self {
        let empty = Vec::new;
        Self { comm: comm.clone(), r: empty(), z: empty(), p: empty(), q: empty(), history: empty() }
    }

    /// Residual norm of the guess and after each iteration of the last solve.
    pub fn history(&self) -> &[f64] {
        &self.history
    }

    /// Solves `A x = b` from the guess in `x`. `b` has `n_owned` numbers (longer is
    /// allowed), `x` `n_local`; the ghosts of `x` are not current on return.
    pub fn solve(
        &mut self,
        op: &dyn Operator,
        pre: &dyn Preconditioner,
        b: &[f64],
        x: &mut [f64],
        params: KrylovParams,
    ) -> Result<KrylovInfo, KrylovError> {
        let (n, n_local) = (op.n_owned(), op.n_local());
        let b = &b[..n];
        for v in [&mut self.r, &mut self.z, &mut self.p, &mut self.q] {
            v.resize(n_local, 0.0);
        }
        self.history.clear();

        let mut sums = [dot(b, b), f64::from(u8::from(x[..n].iter().any(|&v| v != 0.0)))];
        self.comm.sum_slice(&mut sums);
        let rhs_norm = sums[0].sqrt();
        let target = (params.rel_tol * rhs_norm).max(params.abs_tol);
        if sums[1] == 0.0 {
            self.r[..n].copy_from_slice(b);
        } else {
            op.apply(x, &mut self.r);
            residual(b, &mut self.r[..n]);
        }
        let initial = self.comm.sum(dot(&self.r[..n], &self.r[..n])).sqrt();
        let mut info =
            KrylovInfo { iterations: 0, initial_residual: initial, final_residual: initial, rhs_norm };
        self.history.push(initial);
        let mut energy_before = 0.0;
        let mut step = 0.0;
        loop {
            let norm = info.final_residual;
            if !norm.is_finite() || !rhs_norm.is_finite() {
                return Err(self.not_finite("the residual", info.iterations));
            }
            if norm <= target {
                return Ok(info);
            }
            if info.iterations == params.max_iterations {
                return Err(KrylovError::NotConverged {
                    iterations: info.iterations,
                    residual: norm,
                    target,
                    history: History(self.history.clone()),
                });
            }

            pre.apply(&self.r, &mut self.z);
            let mut sums = [dot(&self.r[..n], &self.z[..n]), dot(&self.q[..n], &self.z[..n])];
            self.comm.sum_slice(&mut sums);
            let energy = sums[0];
            self.positive("the preconditioner", energy, info.iterations)?;
            if info.iterations == 0 {
                self.p[..n].copy_from_slice(&self.z[..n]);
            } else {
                // z.(r - r_before) = -step z.q
                let beta = (-step * sums[1] / energy_before).max(0.0);
                xpby(&self.z[..n], beta, &mut self.p[..n]);
            }
            energy_before = energy;

            op.apply(&mut self.p, &mut self.q);
            let curvature = self.comm.sum(dot(&self.p[..n], &self.q[..n]));
            self.positive("the matrix", curvature, info.iterations)?;
            // With Polak-Ribiere directions p.r = z.r up to rounding of a
            // fixed preconditioner.
            step = energy / curvature;
            axpy(step, &self.p[..n], &mut x[..n]);
            axpy(-step, &self.q[..n], &mut self.r[..n]);
            info.iterations += 1;
            info.final_residual = self.comm.sum(dot(&self.r[..n], &self.r[..n])).sqrt();
            self.history.push(info.final_residual);
        }
    }

    fn not_finite(&self, what: &'static str, iteration: usize) -> KrylovError {
        KrylovError::NotFinite { what, iteration, history: History(self.history.clone()) }
    }

    fn positive(&self, what: &'static str, energy: f64, iteration: usize) -> Result<(), KrylovError> {
        if energy > 0.0 && energy.is_finite() {
            Ok(())
        } else if energy.is_finite() {
            Err(KrylovError::NotPositiveDefinite {
                what,
                energy,
                iteration,
                history: History(self.history.clone()),
            })
        } else {
            Err(self.not_finite(what, iteration))
        }
    }
}
