//! The one table of checks, as data.

use super::facts::Facts;
use super::finding::{Judged, Severity};
use super::{
    bodies, boundaries, descent, disk, fabric, flow, lines, names, reactions, resources, run_time, tapes,
    time,
};

/// A check: what Ripstop compares with what.
pub struct Check {
    /// Identifier in messages, `group.name`.
    pub id: &'static str,
    /// What is checked, one line without full stop.
    pub what: &'static str,
    /// The estimate or measured quantity, with symbols that its text explains.
    pub estimate: &'static str,
    /// The range, and which severity lies beyond it.
    pub range: &'static str,
    /// Where the range comes from.
    pub source: &'static str,
    /// The worst that it says.
    pub severity: Severity,
    /// What the user does.
    pub remedy: &'static str,
    /// When it is done and by whom.
    pub when: When,
}

/// When a check is done.
pub enum When {
    /// Before the run, from the scene alone, by `ripstop check` and `ripstop run`.
    Before(fn(&Facts<'_>) -> Vec<Judged>),
    /// During the run, by these programs.
    During(&'static [&'static str]),
}

/// All checks, in the order of the document.
pub fn all() -> impl Iterator<Item = &'static Check> {
    [
        names::CHECKS,
        fabric::CHECKS,
        lines::CHECKS,
        tapes::CHECKS,
        descent::CHECKS,
        flow::CHECKS,
        time::CHECKS,
        boundaries::CHECKS,
        bodies::CHECKS,
        reactions::CHECKS,
        resources::CHECKS,
        disk::CHECKS,
        run_time::CHECKS,
    ]
    .into_iter()
    .flatten()
}
