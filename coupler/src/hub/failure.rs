//! Errors of requests without a valid reply, with their cause.

use std::sync::atomic::Ordering;
use std::time::Duration;

use case::Role;
use channel::{HubError, RankId, mesh_stats};
use coupling::error::RunError;

use super::HubPartners;
use crate::launch::ProcessFailure;

/// How long a dead rank's launcher may take to say what happened.
const FATE: Duration = Duration::from_millis(1500);

impl HubPartners<'_> {
    /// The error of a run that an error of the hub is.
    pub(super) fn explain(&mut self, error: HubError, failure: Option<ProcessFailure>) -> RunError {
        let place = self.place.clone();
        // The signal may also have cut a system call short: that is no error of its own.
        let at_once = self.now.as_ref().is_none_or(|now| now.load(Ordering::Relaxed));
        if self.stop.load(Ordering::Relaxed) && at_once {
            return RunError::Interrupted(place);
        }
        // The launcher knows best who was first: it ends the other ranks itself.
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
                let failure = self.supervisor.await_exit(role, FATE).unwrap_or_else(|| ProcessFailure {
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

    /// The error of a solver that found no solution but can retry.
    pub(super) fn no_answer(&self, role: Role, what: &str, remedies: &str) -> RunError {
        let program = self.supervisor.name(role);
        let said =
            self.supervisor.last_line(role).map_or_else(String::new, |line| format!("; it wrote `{line}`"));
        let message = format!(
            "{what}{said}. Remedies: shorter windows (window_s, coupling.adaptive.halvings), {remedies}"
        );
        RunError::SolveFailed { role, program, place: self.place.clone(), message, saved: None }
    }
}

/// What a grid that cannot follow says: cell, quality, canopy region.
pub(super) fn stuck(values: &[f64; channel::STATS], panels: &[u32]) -> String {
    let cell = match values[mesh_stats::WORST_CELL] {
        cell if cell >= 0.0 => {
            format!(
                "cell {cell} has scaled Jacobian {:.3e} in the best attempt",
                values[mesh_stats::MIN_QUALITY]
            )
        }
        _ => "its solver found no answer".into(),
    };
    let region = match values[mesh_stats::NEAREST_NODE] {
        node if node >= 0.0 => {
            let panel = panels.get(node as usize).map(|p| format!(" (panel {p})")).unwrap_or_default();
            format!("; nearest canopy node {node}{panel}")
        }
        _ => String::new(),
    };
    format!(
        "{cell}{region}; the log of the mesh-mover says more. Remedies: a start grid around a shape nearer to \
         this one, mesh.regrid, shorter windows, a lower mesh.min_quality"
    )
}
