//! What is done with the part of a residual that no column spans.

use crate::schemes::flow_model::lattice::Lattice;

/// Turns a residual into a step that the next iterate can bear.
pub trait Relaxation {
    /// Step for `residual` into `step`.
    fn apply(&self, residual: &[f64], step: &mut [f64]);

    /// The canopy has another shape, or windows another length, than before.
    fn reshape(&mut self, lattice: &Lattice) {
        let _ = lattice;
    }
}

/// The same factor for every unknown.
pub struct Uniform(pub f64);

impl Relaxation for Uniform {
    fn apply(&self, residual: &[f64], step: &mut [f64]) {
        step.iter_mut().zip(residual).for_each(|(s, r)| *s = self.0 * r);
    }
}
