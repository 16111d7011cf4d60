//! Acceleration of the coupling iteration: `(x, x_tilde) -> x`.

use case::Coupling;

use super::relaxation::Relaxation;
use crate::error::RunError;
use crate::schemes::surrogate::orientation::Orientation;
use crate::schemes::surrogate::vortex_lattice::VortexLattice;

/// Turns an iterate and its response into the next iterate.
///
/// # Examples
///
/// Interface quasi-Newton (IQN-ILS) on a linear problem of two unknowns, whose plain iteration grows by up to 3 in each
/// step:
///
/// ```
/// use case::{Acceleration, Coupling};
/// use coupling::schemes::{Uniform, accelerator};
///
/// let response = |x: &[f64]| vec![4.0 - 3.0 * x[0], 1.0 + 0.5 * x[0] - 2.0 * x[1]];
/// let coupling = Coupling { acceleration: Acceleration::IqnIls, ..Coupling::default() };
/// let mut newton = accelerator(&coupling, 2, Box::new(Uniform(0.1)));
/// let (mut x, mut next) = (vec![0.0; 2], vec![0.0; 2]);
/// newton.begin_window();
/// for _ in 0..6 {
///     newton.next(&x, &response(&x), &mut next);
///     std::mem::swap(&mut x, &mut next);
/// }
/// // x = response(x)
/// assert!((x[0] - 1.0).abs() < 1e-9 && (x[1] - 0.5).abs() < 1e-9, "{x:?}");
/// ```
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

    /// See [`super::relaxation::Relaxation::stiffen`].
    fn stiffen(&mut self, volume_stiffness: f64, dt: f64) {
        let _ = (volume_stiffness, dt);
    }

    /// See [`super::relaxation::Relaxation::turn`].
    fn turn(&mut self, orientation: &Orientation) {
        let _ = orientation;
    }
}

/// An acceleration that a scene can select.
pub trait FromCoupling: Accelerator + Sized + 'static {
    /// For vectors of length `unknowns`; `rest` relaxes the part of the residual that no column spans.
    fn from_coupling(coupling: &Coupling, unknowns: usize, rest: Box<dyn Relaxation>) -> Self;

    /// The acceleration in a few words, for the log.
    fn describe(coupling: &Coupling) -> String;
}
