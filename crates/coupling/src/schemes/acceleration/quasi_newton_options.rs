//! Settings of the interface quasi-Newton iteration.

use case::Coupling;

/// Settings of [`super::quasi_newton::QuasiNewton`] and its Jacobian.
#[derive(Clone, Copy, Debug)]
pub struct QuasiNewtonOptions {
    /// First factor of the Aitken relaxation that poor columns fall back to.
    pub relaxation: f64,
    /// Windows whose columns are kept besides the present one's.
    pub reused_windows: u32,
    /// A column is dropped when less than this share of it is new compared with
    /// the more recent ones.
    pub filter: f64,
    /// Differences of residuals below this share of the window's largest residual
    /// are noise of the solvers' own tolerances and are no columns.
    pub noise: f64,
    /// Columns at most (IQN-ILS).
    pub max_columns: usize,
    /// A step longer than this many residuals is not believed: for added mass a
    /// true step is shorter than the residual.
    pub max_step: f64,
}

impl QuasiNewtonOptions {
    /// Those of a scene, for vectors of `unknowns` numbers.
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
