//! Settings of the interface quasi-Newton iteration.

use case::Coupling;

/// Settings of [`super::quasi_newton::QuasiNewton`] and its Jacobian.
#[derive(Clone, Copy, Debug)]
pub struct QuasiNewtonOptions {
    /// First factor of the Aitken relaxation, the fallback where columns give no usable step.
    pub relaxation: f64,
    /// Number of past windows whose columns are reused.
    pub reused_windows: u32,
    /// A column is filtered out when its part orthogonal to more recent ones is below this fraction.
    pub filter: f64,
    /// Differences of residuals below this fraction of the window's largest residual are noise of the solvers'
    /// tolerances and add no column.
    pub noise: f64,
    /// Largest number of columns (IQN-ILS).
    pub max_columns: usize,
    /// A step longer than this many residuals is rejected: with added mass a correct step is shorter than the
    /// residual.
    pub max_step: f64,
}

impl QuasiNewtonOptions {
    /// Options of a scene, for vectors of `unknowns` numbers.
    pub fn for_unknowns(coupling: &Coupling, unknowns: usize) -> Self {
        Self {
            relaxation: coupling.relaxation,
            reused_windows: coupling.reused_windows,
            filter: 1e-2,
            noise: 0.1 * coupling.tolerance,
            max_columns: unknowns.clamp(1, 100),
            max_step: 3.0,
        }
    }
}
