//! A cheap error estimate from the residual: most solves of a coupled window need no other.

use comm::Comm;

use crate::solve::larger;

/// Estimates the error of a residual by block Jacobi, times the largest recent ratio of the multigrid estimate, which
/// also contains smooth errors, to it.
#[derive(Default)]
pub struct CheapErrorEstimate {
    /// Largest recent ratio of multigrid's estimate to block Jacobi's.
    gain: f64,
    samples: u32,
}

/// Number of comparisons before the estimate is used.
const MIN_SAMPLES: u32 = 4;
/// Safety factor on the recent gain. (On the ATPS grid a single gain is between 0.6 and 1.8: once a motion is in the
/// history, the remaining error is local.)
const SAFETY: f64 = 1.25;
/// Decay of the gain of a comparison with each later one.
const DECAY: f64 = 0.9;

impl CheapErrorEstimate {
    /// Largest error of a node by block Jacobi for the residual `r`, relative to the node's size; `inverse` are the
    /// inverses of the diagonal blocks. Collective.
    pub fn block_jacobi_error(comm: &Comm, inverse: &[[[f32; 3]; 3]], r: &[f64], sizes: &[f64]) -> f64 {
        let mut most = 0.0f64;
        for ((d, r), h) in inverse.iter().zip(r.as_chunks::<3>().0).zip(sizes) {
            let mut e = 0.0;
            for row in d {
                let z = f64::from(row[0]) * r[0] + f64::from(row[1]) * r[1] + f64::from(row[2]) * r[2];
                e += z * z;
            }
            most = larger(most, e / (h * h));
        }
        comm.max(most.sqrt())
    }

    /// Upper estimate of the error for the block-Jacobi value `jacobi_error`; infinite before enough comparisons.
    pub fn error(&self, jacobi_error: f64) -> f64 {
        if self.samples < MIN_SAMPLES { f64::INFINITY } else { SAFETY * self.gain * jacobi_error }
    }

    /// Gain and number of comparisons.
    pub fn save_state(&self) -> [f64; 2] {
        [self.gain, f64::from(self.samples)]
    }

    /// Restores a [`CheapErrorEstimate::save_state`].
    pub fn restore_state(&mut self, [gain, samples]: [f64; 2]) {
        (self.gain, self.samples) = (gain, samples as u32);
    }

    /// Adds a comparison: multigrid estimated `error` where block Jacobi gave `jacobi_error`.
    pub fn add_comparison(&mut self, jacobi_error: f64, error: f64) {
        if jacobi_error > 0.0 && error > 0.0 && error.is_finite() {
            self.gain = (DECAY * self.gain).max(error / jacobi_error);
            self.samples = self.samples.saturating_add(1);
        }
    }
}
