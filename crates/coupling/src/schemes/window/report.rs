//! Cost and outcome of a window.

use case::Role;
use channel::{Stats, flow_stats};

use crate::descent::WindowForces;
use crate::partners::{AcceptCost, SolverResponse};

/// Report of one window.
#[derive(Clone, Debug, Default)]
pub struct WindowReport {
    /// Coupling iterations.
    pub iterations: u32,
    /// Relative residual of the last iteration ([`super::criterion::Criterion::relative_residual`]); `None` where
    /// nothing is iterated.
    pub residual: Option<f64>,
    /// Relative residuals of all iterations.
    pub residuals: Vec<f64>,
    /// Whether the tolerance was met (always true without iteration).
    pub converged: bool,
    /// Force of the air on the canopy at the end of the window, N.
    pub force: [f64; 3],
    /// Last statistics of structure, flow, mesh.
    pub stats: [Stats; 3],
    /// Solves of structure, flow, mesh.
    pub solves: [u64; 3],
    /// Pseudo-time iterations of the flow over all its solves.
    pub flow_iterations: f64,
    /// Sums of the statistics of structure, flow, mesh over all their solves; meaningful for counts.
    pub sums: [Stats; 3],
    /// Seconds that structure, flow, mesh computed, over all iterations and for the acceptance of the window.
    pub busy_s: [f64; 3],
    /// Seconds from request to response of structure, flow, mesh, over all iterations.
    pub wall_s: [f64; 3],
    /// Seconds until all programs had accepted the window.
    pub accept_wall_s: f64,
}

impl WindowReport {
    /// Forces of the descent equation, with the `acceleration` (m/s2) of the frame in the structure's last solve.
    pub fn forces(&self, acceleration: [f64; 3]) -> WindowForces<'_> {
        let structure = &self.stats[Role::Structure as usize];
        WindowForces { canopy: self.force.into(), structure, frame_acceleration: acceleration.into() }
    }

    /// Adds the response of the program of `role`.
    pub fn add(&mut self, role: Role, response: SolverResponse) {
        let at = role as usize;
        self.stats[at] = response.stats;
        self.solves[at] += 1;
        self.sums[at].values.iter_mut().zip(&response.stats.values).for_each(|(sum, value)| *sum += value);
        self.busy_s[at] += response.stats.busy_s;
        self.wall_s[at] += response.wall_s;
        if role == Role::Flow {
            self.flow_iterations += response.stats.values[flow_stats::ITERATIONS];
            self.force.copy_from_slice(&response.stats.values[flow_stats::FORCE..flow_stats::FORCE + 3]);
        }
    }

    /// Adds the acceptance of the window.
    pub fn add_acceptance(&mut self, cost: AcceptCost) {
        self.busy_s.iter_mut().zip(cost.busy_s).for_each(|(sum, busy)| *sum += busy);
        self.accept_wall_s += cost.wall_s;
    }
}
