//! Errors of failed requests, with their cause.

use std::sync::atomic::Ordering;
use std::time::Duration;

use case::Role;
use channel::{HubError, RankId, mesh_stats};
use coupling::error::RunError;

use super::HubPartners;
use crate::launch::ProcessFailure;

/// Time limit for the exit status of a launcher after the death of one of its ranks, which has the signal: OpenMPI exits within 0.1 s, as the
/// programs are launched; by default 1.0 s after a rank of several, 2.0 s after its only one.
const EXIT_STATUS_WAIT: Duration = Duration::from_millis(2500);

impl HubPartners<'_> {
    /// Converts an error of the hub to an error of the run, with the process failure that caused it.
    pub(super) fn run_error(&mut self, error: HubError, failure: Option<ProcessFailure>) -> RunError {
        let place = self.place.clone();
        // A system call interrupted by the signal is not a separate error.
        let immediate = self.now.as_ref().is_none_or(|now| now.load(Ordering::Relaxed));
        if self.stop.load(Ordering::Relaxed) && immediate {
            return RunError::Interrupted(place);
        }
        // The launcher knows which rank failed first: it ends the other ranks itself.
        let died = |failure: ProcessFailure, rank: Option<u64>| RunError::Died {
            role: failure.role,
            program: failure.name,
            rank: failure.rank.or(rank),
            how: failure.how,
            place: place.clone(),
            tail: failure.tail,
        };
        match error {
            HubError::Aborted(_) => match failure {
                Some(failure) => died(failure, None),
                None => RunError::Interrupted(place),
            },
            HubError::Fault { who: RankId { role, rank }, fault, .. } => RunError::Fault {
                role,
                program: self.supervisor.name(role),
                rank: Some(rank as u64),
                place,
                message: fault.message,
            },
            HubError::Died { who: RankId { role, rank }, .. } => {
                let failure =
                    self.supervisor.await_exit(role, EXIT_STATUS_WAIT).unwrap_or_else(|| ProcessFailure {
                        role,
                        name: self.supervisor.name(role),
                        rank: None,
                        how: "killed or crashed".into(),
                        tail: String::new(),
                    });
                died(failure, Some(rank as u64))
            }
            HubError::Deadline { who, seconds, state, .. } => RunError::Stalled {
                role: who.role,
                program: format!("{} rank {}", self.supervisor.name(who.role), who.rank),
                seconds,
                state,
                place,
            },
            other => RunError::Channel { place, message: other.to_string() },
        }
    }

    /// The error of a solver that found no solution; the window may be retried.
    pub(super) fn solve_failed(&self, role: Role, what: &str, remedies: &str) -> RunError {
        let program = self.supervisor.name(role);
        let output = self
            .supervisor
            .last_line(role)
            .map_or_else(String::new, |line| format!("; last output line: `{line}`"));
        let message = format!(
            "{what}{output}. Remedies: shorter windows (window_s, coupling.adaptive.halvings), {remedies}"
        );
        RunError::SolveFailed { role, program, place: self.place.clone(), message, saved: None }
    }
}

/// The message of a failed grid motion: cell, quality, region of the canopy, remedies.
pub(super) fn grid_motion_failure(values: &[f64; channel::STATS], panels: &[u32]) -> String {
    let cell = match values[mesh_stats::WORST_CELL] {
        cell if cell >= 0.0 => {
            format!("cell {cell} has a scaled Jacobian of {:.3e} at best", values[mesh_stats::MIN_QUALITY])
        }
        _ => "the solver of the grid motion did not converge".into(),
    };
    let region = match values[mesh_stats::NEAREST_NODE] {
        node if node >= 0.0 => {
            let panel = panels.get(node as usize).map(|p| format!(" (panel {p})")).unwrap_or_default();
            format!("; nearest canopy node {node}{panel}")
        }
        _ => String::new(),
    };
    format!(
        "{cell}{region}; see the log of the mesh-mover. Remedies: an initial grid around a shape closer to the \
         current one, shorter windows, a higher mesh.regrid.quality_threshold, a lower mesh.min_quality"
    )
}
