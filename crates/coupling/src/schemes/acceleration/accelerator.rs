//! Acceleration of the coupling iteration: `(x, x_tilde) -> x`.

use case::Coupling;

use super::relaxation::Relaxation;
use crate::error::RunError;
use crate::schemes::surrogate::vortex_lattice::VortexLattice;

/// Turns an iterate and its response into the next iterate.
pub trait Accelerator {
    /// A new window begins; columns may be kept.
    fn begin_window(&mut self);

    /// Next iterate into `next`, from the iterate `x` and the response `x_tilde` to it.
    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]);

    /// The window is accepted with this last iterate and response.
    fn end_window(&mut self, x: &[f64], x_tilde: &[f64]);

    /// State that later windows depend on, once a window has ended.
    fn save_state(&self) -> Vec<u8>;

    /// Restores an [`Accelerator::save_state`] of the same acceleration.
    ///
    /// # Errors
    /// A state of another one.
    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError>;

    /// Drops all columns: windows have another length, or one was rejected.
    fn reset(&mut self);

    /// See [`super::relaxation::Relaxation::reshape`].
    fn reshape(&mut self, lattice: &VortexLattice) {
        let _ = lattice;
    }
}

/// An acceleration that a scene can select.
pub trait FromCoupling: Accelerator + Sized + 'static {
    /// For vectors of length `unknowns`; `rest` relaxes the part of the residual that no column spans.
    fn from_coupling(coupling: &Coupling, unknowns: usize, rest: Box<dyn Relaxation>) -> Self;

    /// The acceleration in a few words, for the log.
    fn describe(coupling: &Coupling) -> String;
}
