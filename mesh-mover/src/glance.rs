//! A cheap first look at a residual: most calls of a coupled window need no more.

use comm::Comm;
use linalg::{BlockJacobi, Preconditioner};

use crate::solve::largest;

/// Estimates the error that a residual stands for by block Jacobi, times the factor by
/// which multigrid, which also sees smooth errors, found earlier ones larger.
pub struct Glance {
    jacobi: BlockJacobi<3, f32>,
    /// Largest recent ratio of multigrid's estimate to block Jacobi's.
    gain: f64,
    looks: u32,
}

/// Comparisons before a glance counts.
const APPRENTICESHIP: u32 = 4;
/// Distrust of the gain seen so far. (On the ATPS grid, a single gain lies between
/// 0.6 and 1.8: once a motion is known, what is left is local.)
const SAFETY: f64 = 1.25;
/// The gain of one look fades by this with each later one.
const FADING: f64 = 0.9;

impl Glance {
    /// Knows the diagonal blocks, but no gain yet.
    pub fn new(jacobi: BlockJacobi<3, f32>) -> Self {
        Self { jacobi, gain: 0.0, looks: 0 }
    }

    /// Block Jacobi's largest error of a node, in shares of its size; `z` is scratch.
    /// Collective.
    pub fn look(&self, comm: &Comm, r: &[f64], sizes: &[f64], z: &mut [f64]) -> f64 {
        self.jacobi.apply(r, z);
        comm.max(largest(z, sizes))
    }

    /// The error that `seen` may stand for; infinite while nothing is known.
    pub fn error(&self, seen: f64) -> f64 {
        if self.looks < APPRENTICESHIP { f64::INFINITY } else { SAFETY * self.gain * seen }
    }

    /// Multigrid found `error` where a glance had `seen`.
    pub fn learn(&mut self, seen: f64, error: f64) {
        if seen > 0.0 && error > 0.0 && error.is_finite() {
            self.gain = (FADING * self.gain).max(error / seen);
            self.looks = self.looks.saturating_add(1);
        }
    }
}
