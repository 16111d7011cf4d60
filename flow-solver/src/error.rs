//! What can go wrong in a step, agreed on by all ranks.

use comm::Comm;

use crate::geometry::vec3::Vec3;

/// A step that cannot be computed. Every rank returns the same error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlowError {
    /// A cell of the moved grid has no positive volume.
    #[error(
        "flow grid: cell {cell} at ({:.4}, {:.4}, {:.4}) m on rank {rank} has volume {volume:.3e} m3 \
         after the grid motion; smaller windows, a coarser first layer or a stiffer grid motion may help",
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
        "flow grid: node {node} was given a position or velocity that is not a finite number (rank {rank})"
    )]
    BadNode {
        /// Global node.
        node: u64,
        /// Rank that read it.
        rank: usize,
    },
    /// The state has left what is physical and smaller steps did not help.
    #[error(
        "flow: in cell {cell} at ({:.4}, {:.4}, {:.4}) m on rank {rank} the density became {density:.4e} kg/m3; \
         a smaller window or a larger first_layer_m may help",
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
    /// A march found no steady state.
    #[error(
        "flow: not steady after {steps} steps: the residual has fallen to {drop:.1e} of its largest, the force \
         changed by {change:.1e} of itself over the last ten steps, {unsolved} steps ran out of iterations \
         (flow.solver.max_iterations); more max_steps, a looser residual_drop or \
         force_change may help, or the flow sheds vortices: give the stage a duration instead"
    )]
    Unsteady {
        /// Steps taken.
        steps: usize,
        /// Residual at the end over its largest.
        drop: f64,
        /// Change of the force as a share of it.
        change: f64,
        /// Steps whose iterations ran out.
        unsolved: usize,
    },
    /// The transported turbulence is no longer a number.
    #[error("flow: the equation of turbulence diverged in the last step; a smaller window may help")]
    Turbulence,
    /// The iterations grew instead of falling.
    #[error(
        "flow: the iterations of the time step diverged: residual {end:.3e} after {iterations} iterations \
         from {start:.3e}; a smaller window may help"
    )]
    Diverged {
        /// Residual at the start.
        start: f64,
        /// Residual at the end.
        end: f64,
        /// Iterations done.
        iterations: usize,
    },
    /// The iterations ran out with most of the residual left.
    #[error(
        "flow: the time step is not solved: residual {end:.3e} N after {iterations} iterations from {start:.3e} N, \
         {target:.3e} N is asked; raise flow.solver.max_iterations, use flow.solver.method = \"gmres\", or shorten \
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

/// What a rank has found wrong: entity, place, value.
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
