//! Relaxation of the part of a residual that no column spans.

use crate::schemes::surrogate::orientation::Orientation;
use crate::schemes::surrogate::vortex_lattice::VortexLattice;

/// Maps a residual to a stable step.
pub trait Relaxation {
    /// Step for `residual` into `step`.
    fn apply(&self, residual: &[f64], step: &mut [f64]);

    /// The canopy has another shape, or windows have another length, than before.
    fn reshape(&mut self, lattice: &VortexLattice) {
        let _ = lattice;
    }

    /// In windows of length `dt` (s) the air of a closed volume under the canopy has this stiffness, Pa/m3; 0: none is closed.
    fn stiffen(&mut self, volume_stiffness: f64, dt: f64) {
        let _ = (volume_stiffness, dt);
    }

    /// The canopy has rotated as a whole.
    fn turn(&mut self, orientation: &Orientation) {
        let _ = orientation;
    }
}

/// One factor for all unknowns.
pub struct Uniform(pub f64);

impl Relaxation for Uniform {
    fn apply(&self, residual: &[f64], step: &mut [f64]) {
        step.iter_mut().zip(residual).for_each(|(s, r)| *s = self.0 * r);
    }
}
