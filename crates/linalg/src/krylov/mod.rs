//! Krylov solvers.

mod cg;
mod gmres;
mod gram_schmidt;

pub use cg::Cg;
pub use gmres::Gmres;

/// When a Krylov solver stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KrylovParams {
    /// Converged when the residual norm is at most this fraction of the norm of the
    /// right-hand side ...
    pub rel_tol: f64,
    /// ... or at most this value.
    pub abs_tol: f64,
    /// Operator applications after which the solver gives up.
    pub max_iterations: usize,
    /// Basis size of GMRES before it restarts (CG does not read it).
    pub restart: usize,
    /// Iterations after which GMRES gives up where at its mean pace so far `max_iterations`
    /// would not be enough (CG does not read it).
    pub patience: usize,
}

impl Default for KrylovParams {
    fn default() -> Self {
        Self { rel_tol: 1e-8, abs_tol: 1e-300, max_iterations: 500, restart: 30, patience: usize::MAX }
    }
}

/// How a solve went. The residual norm after each iteration is in the solver's `history`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KrylovInfo {
    /// Iterations, each with one operator and one preconditioner application.
    pub iterations: usize,
    /// Residual norm of the initial guess.
    pub initial_residual: f64,
    /// Residual norm at the end.
    pub final_residual: f64,
    /// Norm of the right-hand side, to which the relative tolerance refers.
    pub rhs_norm: f64,
}

/// Residual norms, of the initial guess and after each iteration.
#[derive(Clone, PartialEq)]
pub struct History(pub Vec<f64>);

impl std::ops::Deref for History {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        &self.0
    }
}

/// Only the ends: a failed solve may have made thousands of iterations.
impl std::fmt::Debug for History {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let n = self.len();
        if n <= 6 {
            return self.0.fmt(f);
        }
        write!(f, "{:?} ({} more) {:?}", &self[..3], n - 6, &self[n - 3..])
    }
}

/// Why a solve failed. The best iterate so far is left in `x`, unless it holds NaN.
#[derive(Clone, Debug, thiserror::Error)]
pub enum KrylovError {
    /// Too many iterations.
    #[error(
        "no convergence in {iterations} iterations: residual {residual:.3e}, target {target:.3e} \
         (raise the iteration limit, loosen the tolerance or use a stronger preconditioner)"
    )]
    NotConverged {
        /// Iterations done.
        iterations: usize,
        /// Last residual norm.
        residual: f64,
        /// Residual norm that was asked for.
        target: f64,
        /// Residual norm of the initial guess and after each iteration.
        history: History,
    },
    /// NaN or infinity in the operator, the preconditioner or the data.
    #[error(
        "{what} became NaN or infinite at iteration {iteration}: check the matrix, the right-hand side and the guess"
    )]
    NotFinite {
        /// Which quantity.
        what: &'static str,
        /// Iteration at which it was seen.
        iteration: usize,
        /// Residual norms until then.
        history: History,
    },
    /// Rounding keeps the true residual above the target.
    #[error(
        "the residual stagnates at {residual:.3e}, above the target {target:.3e}: the tolerance is below the rounding error"
    )]
    Stalled {
        /// True residual norm.
        residual: f64,
        /// Residual norm that was asked for.
        target: f64,
        /// Residual norms.
        history: History,
    },
    /// CG met a direction of non-positive energy.
    #[error(
        "{what} is not symmetric positive definite: energy {energy:.3e} at iteration {iteration} (use GMRES)"
    )]
    NotPositiveDefinite {
        /// The operator or the preconditioner.
        what: &'static str,
        /// The energy, `p.Ap` or `r.z`.
        energy: f64,
        /// Iteration at which it was seen.
        iteration: usize,
        /// Residual norms until then.
        history: History,
    },
}
