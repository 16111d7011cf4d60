//! Conjugate gradients that stop when no node can be felt to be wrong.

use comm::Comm;
use linalg::{Amg, Operator, Preconditioner};

use crate::felt::Felt;
use crate::glance::Glance;

/// Work space of [`correct`]; vectors of owned numbers unless said otherwise.
pub struct Scratch {
    /// Residual; in: of the guess, out: what is left.
    pub r: Vec<f64>,
    /// Correction found by conjugate gradients: A d is what they took from `r`.
    pub d: Vec<f64>,
    /// What one more cycle adds to it.
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

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ending {
    /// Iterations made.
    pub iterations: usize,
    /// Largest estimated error, in shares of an edge (see [`Felt`]).
    pub error: f64,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Error that is accepted, in shares of an edge.
    pub tolerance: f64,
    /// Iterations at most; the caller sees from the error if they did not suffice.
    pub max_iterations: usize,
}

/// The last cycle's correction is taken too. Of an error that the cycle sees as z and reduces
/// by 1 - l (l in 0 to 1), z/l was there and z (1 - l)/l is left: up to twice the tolerance
/// may be seen where l is at least one half, as it is for all but the smoothest errors.
const TAKEN: f64 = 2.0;

/// Solves A d = r, A being the matrix of `amg`, until the preconditioned residual, which
/// estimates the error, is `felt` nowhere by more than the tolerance. `glance` saves
/// applications of the preconditioner where it is sure enough. Collective.
///
/// Measuring the error in lengths of the grid, not relative to the right-hand
/// side, is what makes calls cheap: a motion that no cell can feel costs nothing.
pub fn correct(
    amg: &Amg<f32>,
    glance: &mut Glance,
    comm: &Comm,
    felt: &Felt,
    goal: Goal,
    s: &mut Scratch,
) -> Ending {
    let a = amg.matrix();
    let n = a.n_owned();
    s.d.fill(0.0);
    let mut rho = 1.0;
    for iterations in 0.. {
        let seen = Glance::look(comm, amg.inverse_blocks(), &s.r, &felt.sizes);
        let error = glance.error(seen);
        if error <= goal.tolerance {
            s.z.fill(0.0);
            return Ending { iterations, error };
        }
        amg.apply(&s.r, &mut s.z);
        let error = comm.max(felt.largest(&s.z));
        glance.learn(seen, error);
        if error <= TAKEN * goal.tolerance || iterations == goal.max_iterations || !error.is_finite() {
            return Ending { iterations, error: error / TAKEN };
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
            // Rounding has eaten the direction, or the preconditioner is not
            // definite: the caller judges by the error.
            return Ending { iterations, error: error / TAKEN };
        }
        let alpha = rho / curvature;
        for i in 0..n {
            s.d[i] += alpha * s.p[i];
            s.r[i] -= alpha * s.q[i];
        }
    }
    unreachable!("the loop ends at the last iteration")
}

/// The larger one; NaN counts as infinity.
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
