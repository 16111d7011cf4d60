//! A cheap first look at a residual: most calls of a coupled window need no more.

use comm::Comm;

use crate::solve::larger;

/// Estimates the error that a residual stands for by block Jacobi, times the factor by
/// which multigrid, which also sees smooth errors, found earlier ones larger.
#[derive(Default)]
pub struct Glance {
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
    /// Block Jacobi's largest error of a node that the residual `r` stands for, in shares of its
    /// size; `inverse` are the inverses of the diagonal blocks. Collective.
    pub fn look(comm: &Comm, inverse: &[[[f32; 3]; 3]], r: &[f64], sizes: &[f64]) -> f64 {
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

    /// The error that `seen` may stand for; infinite while nothing is known.
    pub fn error(&self, seen: f64) -> f64 {
        if self.looks < APPRENTICESHIP { f64::INFINITY } else { SAFETY * self.gain * seen }
    }

    /// Gain and looks.
    pub fn memory(&self) -> [f64; 2] {
        [self.gain, f64::from(self.looks)]
    }

    /// Takes up a [`Glance::memory`].
    pub fn recall(&mut self, [gain, looks]: [f64; 2]) {
        (self.gain, self.looks) = (gain, looks as u32);
    }

    /// Multigrid found `error` where a glance had `seen`.
    pub fn learn(&mut self, seen: f64, error: f64) {
        if seen > 0.0 && error > 0.0 && error.is_finite() {
            self.gain = (FADING * self.gain).max(error / seen);
            self.looks = self.looks.saturating_add(1);
        }
    }
}
