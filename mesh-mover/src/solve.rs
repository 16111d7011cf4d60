//! Conjugate gradients that stop when no node can be felt to be wrong.

use comm::Comm;
use linalg::{Operator, Preconditioner};

use crate::glance::Glance;

/// Work space of [`correct`]; vectors of owned numbers unless said otherwise.
pub struct Scratch {
    /// Residual; in: of the guess, out: what is left.
    pub r: Vec<f64>,
    /// Correction found.
    pub d: Vec<f64>,
    /// Preconditioned residual: an estimate of the error.
    pub z: Vec<f64>,
    /// Search direction (local numbers).
    p: Vec<f64>,
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
    /// Largest estimated error of a node, in shares of its size.
    pub error: f64,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Error of a node, in shares of its size.
    pub tolerance: f64,
    /// Iterations at most; the caller sees from the error if they did not suffice.
    pub max_iterations: usize,
}

/// Once iterations are made, they go on to this share of the tolerance: the calls
/// that follow in the same window then find their guess good enough.
const MARGIN: f64 = 0.5;

/// Solves A d = r for three numbers a node until the preconditioned residual, which
/// estimates the error, is below the tolerance times `sizes` at every node. `glance` saves
/// applications of the preconditioner where it is sure enough. Collective.
///
/// Measuring the error in lengths of the grid, not relative to the right-hand
/// side, is what makes calls cheap: a motion that no cell can feel costs nothing.
pub fn correct<A: Operator + ?Sized, P: Preconditioner + ?Sized>(
    a: &A,
    preconditioner: &P,
    glance: &mut Glance,
    comm: &Comm,
    sizes: &[f64],
    goal: Goal,
    s: &mut Scratch,
) -> Ending {
    let n = a.n_owned();
    s.d.fill(0.0);
    s.p.fill(0.0);
    let mut rho = 0.0;
    let mut enough = goal.tolerance;
    for iterations in 0.. {
        let seen = glance.look(comm, &s.r, sizes, &mut s.z);
        let error = glance.error(seen);
        if error <= enough {
            return Ending { iterations, error };
        }
        preconditioner.apply(&s.r, &mut s.z);
        let error = comm.max(largest(&s.z, sizes));
        glance.learn(seen, error);
        if error <= enough || iterations == goal.max_iterations || !error.is_finite() {
            return Ending { iterations, error };
        }
        enough = MARGIN * goal.tolerance;
        let new = comm.sum(dot(&s.r, &s.z));
        let beta = if iterations == 0 { 0.0 } else { new / rho };
        rho = new;
        for (p, z) in s.p[..n].iter_mut().zip(&s.z) {
            *p = z + beta * *p;
        }
        a.apply(&mut s.p, &mut s.q);
        let curvature = comm.sum(dot(&s.p[..n], &s.q));
        if curvature.is_nan() || curvature <= 0.0 {
            // Rounding has eaten the direction, or the preconditioner is not
            // definite: the caller judges by the error.
            return Ending { iterations, error };
        }
        let alpha = rho / curvature;
        for i in 0..n {
            s.d[i] += alpha * s.p[i];
            s.r[i] -= alpha * s.q[i];
        }
    }
    unreachable!("the loop ends at the last iteration")
}

/// Largest length of a row of `z` over its size; NaN becomes infinity.
pub(crate) fn largest(z: &[f64], sizes: &[f64]) -> f64 {
    let mut most = 0.0f64;
    for (z, h) in z.as_chunks::<3>().0.iter().zip(sizes) {
        let e = (z[0] * z[0] + z[1] * z[1] + z[2] * z[2]) / (h * h);
        most = if e <= most {
            most
        } else if e.is_nan() {
            f64::INFINITY
        } else {
            e
        };
    }
    most.sqrt()
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
