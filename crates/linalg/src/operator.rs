//! The two ideas that every solver builds on.

/// A linear map on distributed vectors.
pub trait Operator {
    /// Length of the owned part of a vector.
    fn n_owned(&self) -> usize;
    /// Length of a local vector with its ghosts.
    fn n_local(&self) -> usize;
    /// `y[..n_owned] = A x`. Refreshes the ghosts of `x` first.
    fn apply(&self, x: &mut [f64], y: &mut [f64]);
}

/// An approximate inverse.
pub trait Preconditioner {
    /// `z[..n_owned] ~ A^-1 r[..n_owned]`. Ghosts of `z` need not be set.
    fn apply(&self, r: &[f64], z: &mut [f64]);
}

/// No preconditioning.
#[derive(Clone, Copy, Debug, Default)]
pub struct Identity;

impl Preconditioner for Identity {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let n = r.len().min(z.len());
        z[..n].copy_from_slice(&r[..n]);
    }
}
