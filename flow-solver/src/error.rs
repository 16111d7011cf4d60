//! Errors of a time step. All ranks return the same one.

use comm::Comm;

use crate::boundary_values::BoundaryValueError;
use crate::geometry::vec3::Vec3;

/// A step that cannot be computed. Every rank returns the same error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlowError {
    /// A cell of the moved grid has no positive volume.
    #[error(
        "flow grid: cell {cell} at ({:.4}, {:.4}, {:.4}) m on rank {rank} has the volume {volume:.3e} m3 \
         after the grid motion, but volumes must be positive; shorten window_s, raise first_layer_m, or use a stiffer grid motion",
        at[0], at[1], at[2]
    )]
    InvertedCell {
        /// Global cell.
        cell: u64,
        /// Its centre, m.
        at: Vec3,
        /// Rank that owns it.
        rank: usize,
        /// Its volume, m3.
        volume: f64,
    },
    /// A node position or velocity is not a number.
    #[error(
        "flow grid: node {node} (rank {rank}) received a position or velocity that is not a finite number"
    )]
    BadNode {
        /// Global node.
        node: u64,
        /// Rank that read it.
        rank: usize,
    },
    /// The state is not physical, and smaller corrections did not help.
    #[error(
        "flow: in cell {cell} at ({:.4}, {:.4}, {:.4}) m on rank {rank} the density is {density:.4e} kg/m3, but it must be positive and finite; \
         shorten window_s or raise first_layer_m",
        at[0], at[1], at[2]
    )]
    BadState {
        /// Global cell.
        cell: u64,
        /// Its centre, m.
        at: Vec3,
        /// Rank that owns it.
        rank: usize,
        /// Its density, kg/m3.
        density: f64,
    },
    /// A march to a steady state ended without one.
    #[error(
        "flow: not steady after {steps} steps: the residual is {drop:.1e} of its maximum, the relative \
         change of the force over the last ten steps is {change:.1e}, {unsolved} steps reached \
         flow.solver.max_iterations; raise max_steps, residual_drop or force_change. \
         If the flow sheds vortices, it has no steady state: give the stage a duration instead"
    )]
    Unsteady {
        /// Steps taken.
        steps: usize,
        /// Residual at the end over its largest.
        drop: f64,
        /// Relative change of the force over the last ten steps.
        change: f64,
        /// Steps whose iterations ran out.
        unsolved: usize,
    },
    /// Data of a boundary patch cannot be used.
    #[error("flow: {0}")]
    BoundaryValue(#[from] BoundaryValueError),
    /// The turbulence variable is not a finite number.
    #[error("flow: the turbulence equation diverged in the last step; shorten window_s")]
    Turbulence,
    /// The residual grew during the iterations.
    #[error(
        "flow: the iterations of the time step diverged: residual {end:.3e} N after {iterations} iterations, \
         {start:.3e} N at the start; shorten window_s"
    )]
    Diverged {
        /// Residual at the start.
        start: f64,
        /// Residual at the end.
        end: f64,
        /// Iterations done.
        iterations: usize,
    },
    /// The iterations reached their limit before the residual reached its target.
    #[error(
        "flow: the time step is not converged: residual {end:.3e} N after {iterations} iterations, {start:.3e} N at the \
         start, tolerance {target:.3e} N; raise flow.solver.max_iterations, use flow.solver.method = \"gmres\", or shorten \
         window_s"
    )]
    Unsolved {
        /// Residual of the last accepted state, N.
        start: f64,
        /// Residual at the end, N.
        end: f64,
        /// Residual that counts as converged, N.
        target: f64,
        /// Iterations done.
        iterations: usize,
    },
}

/// A failure found by a rank: entity, location, value.
pub(crate) type Finding = (u64, Vec3, f64);

/// The finding of the lowest rank that has one, the same on every rank.
pub(crate) fn agree(comm: &Comm, finding: Option<Finding>) -> Option<(usize, Finding)> {
    if comm.all(finding.is_none()) {
        return None;
    }
    let mine: Vec<f64> =
        finding.map_or(Vec::new(), |(i, x, v)| vec![comm.rank() as f64, i as f64, x[0], x[1], x[2], v]);
    let all = comm.all_gather_var(&mine);
    all.chunks_exact(6).next().map(|f| (f[0] as usize, (f[1] as u64, Vec3::new(f[2], f[3], f[4]), f[5])))
}
