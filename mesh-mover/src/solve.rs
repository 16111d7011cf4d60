//! Conjugate gradients with a stopping criterion on the error of node positions.

use comm::Comm;
use linalg::{Amg, Operator, Preconditioner};

use crate::error_estimate::CheapErrorEstimate;
use crate::position_error::PositionErrorNorm;

/// Work space of [`correct`]; vectors of owned numbers unless noted.
pub struct Scratch {
    /// Residual; on input of the guess, on output the remaining one.
    pub r: Vec<f64>,
    /// Correction by conjugate gradients: A d has been subtracted from `r`.
    pub d: Vec<f64>,
    /// Correction by one more multigrid cycle.
    pub z: Vec<f64>,
    /// Search direction (local numbers).
    pub p: Vec<f64>,
    q: Vec<f64>,
}

impl Scratch {
    /// For an operator with `n_owned` and `n_local` numbers.
    pub fn new(n_owned: usize, n_local: usize) -> Self {
        let zero = || vec![0.0; n_owned];
        Self { r: zero(), d: zero(), z: zero(), p: vec![0.0; n_local], q: zero() }
    }
}

/// Result of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveResult {
    /// Number of iterations.
    pub iterations: usize,
    /// Largest estimated error, relative to an edge (see [`PositionErrorNorm`]).
    pub error: f64,
}

/// Stopping criterion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoppingCriterion {
    /// Accepted error, relative to an edge.
    pub tolerance: f64,
    /// Largest number of iterations; the caller checks the error.
    pub max_iterations: usize,
}

/// The correction of the last cycle is applied. For an error that the cycle estimates as z and reduces by 1 - l (l in
/// 0 to 1), the error is z/l and z (1 - l)/l remains: an estimate of twice the tolerance is accepted where l is at
/// least one half, as for all but the smoothest errors.
const FINAL_CYCLE_FACTOR: f64 = 2.0;

/// Solves A d = r, where A is the matrix of `amg`, until the preconditioned residual, which estimates the error, is
/// within the tolerance in the norm `position_error`. `error_estimate` saves applications of the preconditioner where
/// it suffices. Collective.
///
/// Measuring the error in lengths of the grid, instead of relative to the right-hand side, makes solves cheap: a
/// motion below the tolerance needs no iteration.
pub fn correct(
    amg: &Amg<f32>,
    error_estimate: &mut CheapErrorEstimate,
    comm: &Comm,
    position_error: &PositionErrorNorm,
    goal: StoppingCriterion,
    s: &mut Scratch,
) -> SolveResult {
    let a = amg.matrix();
    let n = a.n_owned();
    s.d.fill(0.0);
    let mut rho = 1.0;
    for iterations in 0.. {
        let jacobi_error =
            CheapErrorEstimate::block_jacobi_error(comm, amg.inverse_blocks(), &s.r, &position_error.sizes);
        let error = error_estimate.error(jacobi_error);
        if error <= goal.tolerance {
            s.z.fill(0.0);
            return SolveResult { iterations, error };
        }
        amg.apply(&s.r, &mut s.z);
        let error = comm.max(position_error.largest(&s.z));
        error_estimate.add_comparison(jacobi_error, error);
        if error <= FINAL_CYCLE_FACTOR * goal.tolerance
            || iterations == goal.max_iterations
            || !error.is_finite()
        {
            return SolveResult { iterations, error: error / FINAL_CYCLE_FACTOR };
        }
        let new = comm.sum(dot(&s.r, &s.z));
        let beta = new / rho;
        rho = new;
        if iterations == 0 {
            s.p[..n].copy_from_slice(&s.z);
        } else {
            for (p, z) in s.p[..n].iter_mut().zip(&s.z) {
                *p = z + beta * *p;
            }
        }
        a.apply(&mut s.p, &mut s.q);
        let curvature = comm.sum(dot(&s.p[..n], &s.q));
        if curvature.is_nan() || curvature <= 0.0 {
            // Round-off has consumed the direction, or the preconditioner is not definite: the caller checks the
            // error.
            return SolveResult { iterations, error: error / FINAL_CYCLE_FACTOR };
        }
        let alpha = rho / curvature;
        for i in 0..n {
            s.d[i] += alpha * s.p[i];
            s.r[i] -= alpha * s.q[i];
        }
    }
    unreachable!("the loop ends at the last iteration")
}

/// The maximum; NaN counts as infinity.
#[inline]
pub(crate) fn larger(most: f64, e: f64) -> f64 {
    if e <= most {
        most
    } else if e.is_nan() {
        f64::INFINITY
    } else {
        e
    }
}

/// Rank-local dot product in a fixed order of summation.
fn dot(x: &[f64], y: &[f64]) -> f64 {
    const L: usize = 8;
    let (xs, xr) = x.as_chunks::<L>();
    let (ys, yr) = y.as_chunks::<L>();
    let mut acc = [0.0; L];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..L {
            acc[l] += x[l] * y[l];
        }
    }
    acc.iter().sum::<f64>() + xr.iter().zip(yr).map(|(x, y)| x * y).sum::<f64>()
}
