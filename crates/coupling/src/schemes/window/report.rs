//! What a window cost and how it ended.

use case::Role;
use channel::{Stats, flow_stats};

use crate::descent::WindowForces;
use crate::partners::Answer;

/// What happened in a window.
#[derive(Clone, Debug, Default)]
pub struct WindowReport {
    /// Coupling iterations.
    pub iterations: u32,
    /// Measure of the last iteration ([`super::criterion::Criterion::measure`]); `None` where
    /// nothing is iterated.
    pub residual: Option<f64>,
    /// Measures of all iterations.
    pub residuals: Vec<f64>,
    /// The tolerance was met (always so without iteration).
    pub converged: bool,
    /// Force of the air on the canopy at the end of the window, N.
    pub force: [f64; 3],
    /// Last statistics of structure, flow, mesh.
    pub stats: [Stats; 3],
    /// Calls of structure, flow, mesh.
    pub calls: [u64; 3],
    /// Pseudo-time iterations of the flow over all its calls.
    pub flow_iterations: f64,
    /// Sums of the statistics of structure, flow, mesh over all their calls: of use for counts.
    pub sums: [[f64; channel::STATS]; 3],
    /// Seconds that structure, flow, mesh computed, over all iterations.
    pub busy_s: [f64; 3],
    /// Seconds from question to answer, likewise.
    pub wall_s: [f64; 3],
}

impl WindowReport {
    /// Vertical forces that the descent equation takes, with the `acceleration` (m/s2) of the frame in the structure's
    /// last solve.
    pub fn forces(&self, acceleration: f64) -> WindowForces<'_> {
        let structure = &self.stats[Role::Structure as usize];
        WindowForces { canopy: self.force[2], structure, frame_acceleration: acceleration }
    }

    /// Adds the answer of the program of `role`.
    pub fn add(&mut self, role: Role, answer: Answer) {
        let at = role as usize;
        self.stats[at] = answer.stats;
        self.calls[at] += 1;
        self.sums[at].iter_mut().zip(&answer.stats.values).for_each(|(sum, value)| *sum += value);
        self.busy_s[at] += answer.stats.busy_s;
        self.wall_s[at] += answer.wall_s;
        if role == Role::Flow {
            self.flow_iterations += answer.stats.values[flow_stats::ITERATIONS];
            self.force.copy_from_slice(&answer.stats.values[flow_stats::FORCE..flow_stats::FORCE + 3]);
        }
    }
}
