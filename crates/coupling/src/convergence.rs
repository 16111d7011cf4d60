//! Whether windows are accepted as converged: residual of the coupling against its tolerance, residuals of the
//! programs against the targets that they report.
//!
//! Only the last response of each program in a window is accepted, so only that one is judged. Earlier solves of the
//! coupling iteration may be inexact, since the next one repeats them; they are counted. A response that exceeds its
//! target by less than [`UNCONVERGED_LIMIT`] is accepted, reported at its first occurrence and summarised at the end
//! of the stage. One beyond the limit is an error, unless `--accept-unconverged` is given.

use case::Role;
use channel::{
    STATS, UNCONVERGED_LIMIT, Window, at_text, excess, flow_stats, reported_place, residual_and_target,
    structure_stats,
};
use serde::{Deserialize, Serialize};

use crate::error::{Location, RunError};
use crate::schemes::window::report::WindowReport;

/// A subproblem of a window, each with its own residual and target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subproblem {
    /// The coupling iterations of a window.
    Coupling,
    /// Newton's method of the structure.
    Structure,
    /// The iterations of the flow's time step.
    Flow,
    /// The linear solve for the grid's motion.
    Mesh,
    /// The transport equation of the turbulence.
    Turbulence,
    /// The flow in single cells, which the residual of all cells does not show.
    Cells,
}

impl Subproblem {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Coupling, Self::Structure, Self::Flow, Self::Mesh, Self::Turbulence, Self::Cells];

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coupling => "coupling",
            Self::Structure => "structure",
            Self::Flow => "flow",
            Self::Mesh => "grid motion",
            Self::Turbulence => "turbulence equation",
            Self::Cells => "flow in single cells",
        }
    }

    /// Remedies in messages.
    pub fn remedies(self) -> &'static str {
        match self {
            Self::Coupling => {
                "a smaller flow.solver.residual_drop, more coupling.max_iterations, a shorter window_s"
            }
            Self::Structure => {
                "more stage.substeps; where rounding allows no smaller residual, a larger \
                 structure.newton_tolerance (static stages: structure.static_tolerance)"
            }
            Self::Flow => {
                "a larger flow.solver.max_iterations, flow.solver.method = \"gmres\", a shorter window_s"
            }
            Self::Mesh => "a larger mesh.tolerance, a smaller mesh.stiffening_exponent",
            Self::Turbulence => "a shorter window_s, a larger flow.solver.residual_drop",
            Self::Cells => {
                "a grid without thin or skewed cells there (grid.txt; flow.grid.cells_across_vent = 1 at the ends of fine vents), a shorter \
                 window_s, a larger flow.solver.max_iterations"
            }
        }
    }

    fn role(self) -> Option<Role> {
        match self {
            Self::Structure => Some(Role::Structure),
            Self::Flow => Some(Role::Flow),
            Self::Mesh => Some(Role::Mesh),
            Self::Coupling | Self::Turbulence | Self::Cells => None,
        }
    }
}

/// Windows that were accepted above a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnconvergedCount {
    /// Number of windows.
    pub windows: u64,
    /// Largest residual relative to its target among them.
    pub worst: f64,
    /// Window in which that occurred.
    pub worst_window: u64,
}

/// Windows of a stage accepted above a target, by subproblem.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// The coupling iterations.
    pub coupling: UnconvergedCount,
    /// The structure.
    pub structure: UnconvergedCount,
    /// The flow.
    pub flow: UnconvergedCount,
    /// The grid motion.
    pub mesh: UnconvergedCount,
    /// The turbulence equation.
    pub turbulence: UnconvergedCount,
    /// The flow in single cells.
    #[serde(default)]
    pub cells: UnconvergedCount,
    /// Time steps of the structure above their own target, including those of repeated solves.
    pub structure_solves: u64,
    /// Flow solves above their own target, including repeated ones.
    pub flow_solves: u64,
}

impl Convergence {
    fn count(&self, part: Subproblem) -> &UnconvergedCount {
        match part {
            Subproblem::Coupling => &self.coupling,
            Subproblem::Structure => &self.structure,
            Subproblem::Flow => &self.flow,
            Subproblem::Mesh => &self.mesh,
            Subproblem::Turbulence => &self.turbulence,
            Subproblem::Cells => &self.cells,
        }
    }

    fn count_mut(&mut self, part: Subproblem) -> &mut UnconvergedCount {
        match part {
            Subproblem::Coupling => &mut self.coupling,
            Subproblem::Structure => &mut self.structure,
            Subproblem::Flow => &mut self.flow,
            Subproblem::Mesh => &mut self.mesh,
            Subproblem::Turbulence => &mut self.turbulence,
            Subproblem::Cells => &mut self.cells,
        }
    }

    /// Windows above any target.
    pub fn windows(&self) -> u64 {
        Subproblem::ALL.iter().map(|part| self.count(*part).windows).sum()
    }

    /// One line for the summary; `None` where every window converged.
    pub fn line(&self) -> Option<String> {
        let of = |part: &Subproblem| {
            let t = self.count(*part);
            (t.windows > 0)
                .then(|| format!("{} in {} windows ({:.1} times)", part.name(), t.windows, t.worst))
        };
        let parts: Vec<String> = Subproblem::ALL.iter().filter_map(of).collect();
        (!parts.is_empty()).then(|| format!("accepted above the target: {}", parts.join(", ")))
    }

    /// Adds an accepted window. Returns the warnings to print: one at the first occurrence of each subproblem.
    /// `tolerance` is that of the coupling.
    pub fn add(&mut self, place: &Location, report: &WindowReport, tolerance: f64) -> Vec<String> {
        let index = place.window.map_or(0, |(index, _)| index);
        let sum = |role: Role, at: usize| report.sums[role as usize].values[at] as u64;
        self.structure_solves += sum(Role::Structure, structure_stats::UNCONVERGED);
        self.flow_solves += sum(Role::Flow, flow_stats::UNCONVERGED);
        let mut warnings = Vec::new();
        for part in Subproblem::ALL {
            let Some(excess) = excess_of(part, report, tolerance).filter(|e| *e > 1.0) else { continue };
            let count = self.count_mut(part);
            count.windows += 1;
            if excess > count.worst {
                (count.worst, count.worst_window) = (excess, index);
            }
            if count.windows == 1 {
                warnings.push(format!(
                    "{place}: the {} is accepted unconverged: {}. Remedies: {}. Later occurrences are counted",
                    part.name(),
                    figures(part, report, tolerance),
                    part.remedies()
                ));
            }
        }
        warnings
    }

    /// Warnings at the end of a stage of `windows` windows.
    pub fn stage_warnings(&self, stage: &str, windows: u64) -> Vec<String> {
        let of = |part: &Subproblem| {
            let t = self.count(*part);
            let solves = match part {
                Subproblem::Structure => self.structure_solves,
                Subproblem::Flow => self.flow_solves,
                _ => 0,
            };
            let solves = if solves > t.windows {
                format!("; {solves} solves ended above their own target, including repeated ones")
            } else {
                String::new()
            };
            (t.windows > 1).then(|| {
                format!(
                    "stage `{stage}`: the {} exceeds its target in {} of {windows} windows, by a factor of at most {:.1} \
                     (window {}){solves}. Remedies: {}",
                    part.name(),
                    t.windows,
                    t.worst,
                    t.worst_window,
                    part.remedies()
                )
            })
        };
        Subproblem::ALL.iter().filter_map(of).collect()
    }
}

/// Residual of an accepted window relative to its target; `None` where it is not judged.
fn excess_of(part: Subproblem, report: &WindowReport, tolerance: f64) -> Option<f64> {
    match part {
        Subproblem::Coupling => report.residual.map(|r| r / tolerance),
        Subproblem::Turbulence => {
            let value = report.stats[Role::Flow as usize].values[flow_stats::TURBULENCE_RESIDUAL];
            (value > 0.0).then_some(value)
        }
        Subproblem::Cells => {
            let values = &report.stats[Role::Flow as usize].values;
            let (error, target) = (values[flow_stats::CELL_ERROR], values[flow_stats::CELL_ERROR_TARGET]);
            (target > 0.0).then(|| error / target)
        }
        _ => part.role().and_then(|role| excess(role, &report.stats[role as usize].values)),
    }
}

/// Residual, target and iterations, for messages.
fn figures(part: Subproblem, report: &WindowReport, tolerance: f64) -> String {
    let of = |role: Role| &report.stats[role as usize].values;
    let (residual, target, spent) = match part {
        Subproblem::Coupling => {
            (report.residual.unwrap_or(f64::NAN), tolerance, format!("{} iterations", report.iterations))
        }
        Subproblem::Turbulence => {
            let over = of(Role::Flow)[flow_stats::TURBULENCE_RESIDUAL];
            return format!("its residual in the step before is {over:.1} times its target");
        }
        Subproblem::Cells => {
            let values = of(Role::Flow);
            let (error, target) = (values[flow_stats::CELL_ERROR], values[flow_stats::CELL_ERROR_TARGET]);
            return format!(
                "the residual may still change the velocity of a cell{} by {:.2} % of the typical speed, {:.1} times its target of \
                 {:.2} %, after {}",
                at_text(reported_place(values, flow_stats::CELL_ERROR_AT)),
                100.0 * error,
                error / target,
                100.0 * target,
                spent(Role::Flow, values)
            );
        }
        _ => {
            let role = part.role().unwrap_or(Role::Flow);
            let (residual, target) = residual_and_target(role, of(role)).unwrap_or_default();
            (residual, target, spent(role, of(role)))
        }
    };
    format!(
        "its residual is {residual:.2e}, {:.1} times its target of {target:.2e}, after {spent}",
        residual / target
    )
}

fn spent(role: Role, values: &[f64; STATS]) -> String {
    match role {
        Role::Structure => format!("{} Newton steps", values[structure_stats::NEWTON_STEPS]),
        Role::Flow => format!("{} iterations", values[flow_stats::ITERATIONS]),
        Role::Mesh => format!("{} iterations", values[channel::mesh_stats::ITERATIONS]),
    }
}

/// Rejects windows whose last responses exceed their targets by too much.
#[derive(Clone, Debug, Default)]
pub struct AcceptanceCheck {
    /// Stage, for messages.
    pub stage: String,
    /// Accepts them nevertheless.
    pub accept_unconverged: bool,
}

impl AcceptanceCheck {
    /// Whether the last responses in `report` may be accepted as the end of `w`.
    ///
    /// # Errors
    /// [`RunError::Unconverged`] for the first subproblem above [`UNCONVERGED_LIMIT`] times its target. The coupling
    /// itself is judged where its iteration ends.
    pub fn require(&self, w: &Window, report: &WindowReport) -> Result<(), RunError> {
        if self.accept_unconverged {
            return Ok(());
        }
        let beyond = |part: &&Subproblem| {
            let excess = excess_of(**part, report, f64::INFINITY);
            **part != Subproblem::Coupling && excess.is_some_and(|e| e.is_nan() || e > UNCONVERGED_LIMIT)
        };
        match Subproblem::ALL.iter().find(beyond) {
            None => Ok(()),
            Some(part) => Err(RunError::Unconverged {
                what: part.name(),
                place: Location { stage: self.stage.clone(), window: Some((w.index, w.iteration)) },
                message: format!(
                    "t = {:.4} s, {}; the limit of acceptance is {UNCONVERGED_LIMIT} times. Remedies: {}; \
                     --accept-unconverged accepts the window",
                    w.time,
                    figures(*part, report, f64::INFINITY),
                    part.remedies()
                ),
                // The turbulence residual belongs to the step before, which a shorter window does not change.
                shorter: *part != Subproblem::Turbulence,
                saved: None,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window whose flow residual is `flow` times and whose coupling residual is `coupling` times the target.
    fn window(flow: f64, coupling: f64) -> WindowReport {
        let mut report =
            WindowReport { iterations: 7, residual: Some(1e-3 * coupling), ..Default::default() };
        let values = &mut report.stats[Role::Flow as usize].values;
        values[flow_stats::RESIDUAL_END] = 2e-4 * flow;
        values[flow_stats::RESIDUAL_TARGET] = 2e-4;
        values[flow_stats::ITERATIONS] = 60.0;
        report.sums[Role::Flow as usize].values[flow_stats::UNCONVERGED] = 3.0;
        report
    }

    fn at(index: u64) -> Location {
        Location { stage: "descent".into(), window: Some((index, 6)) }
    }

    #[test]
    fn each_subproblem_is_reported_once_and_summarised() {
        let mut c = Convergence::default();
        assert!(c.add(&at(0), &window(1.0, 0.5), 1e-3).is_empty());
        let first = c.add(&at(1), &window(4.0, 0.5), 1e-3);
        assert_eq!(first.len(), 1);
        for word in ["window 1", "flow", "8.00e-4", "4.0 times", "2.00e-4", "60 iterations", "max_iterations"]
        {
            assert!(first[0].contains(word), "{word}: {}", first[0]);
        }
        let coupling = c.add(&at(2), &window(5.0, 3.0), 1e-3);
        assert!(coupling.len() == 1 && coupling[0].contains("the coupling"), "{coupling:?}");
        assert!(c.add(&at(3), &window(2.0, 2.0), 1e-3).is_empty());
        let closing = c.stage_warnings("descent", 4);
        assert_eq!(closing.len(), 2);
        assert!(
            closing[0].contains("coupling exceeds its target in 2 of 4 windows")
                && closing[0].contains("most 3.0")
        );
        assert!(
            closing[1].contains("flow exceeds its target in 3 of 4")
                && closing[1].contains("(window 2); 12 solves")
        );
        assert_eq!((c.flow_solves, c.windows()), (12, 5));
        assert!(Convergence::default().stage_warnings("descent", 4).is_empty());
    }

    #[test]
    fn ten_times_the_target_is_an_error_unless_accepted() {
        let w = Window { index: 12, iteration: 3, time: 0.06, ..Window::default() };
        let judge = AcceptanceCheck { stage: "descent".into(), accept_unconverged: false };
        assert!(judge.require(&w, &window(9.9, 50.0)).is_ok(), "the coupling is judged elsewhere");
        let error = judge.require(&w, &window(10.1, 1.0)).expect_err("above the limit");
        assert!(error.is_retryable(), "a shorter window may converge");
        let text = error.to_string();
        for word in
            ["flow is not converged", "`descent`, window 12", "0.0600", "2.02e-3", "10.1 times", "gmres"]
        {
            assert!(text.contains(word), "{word}: {text}");
        }
        assert!(judge.require(&w, &window(f64::NAN, 1.0)).is_err());
        assert!(
            AcceptanceCheck { accept_unconverged: true, ..judge.clone() }
                .require(&w, &window(1e3, 1.0))
                .is_ok()
        );
        // No stated target: not judged.
        assert!(judge.require(&w, &WindowReport::default()).is_ok());
        let mut turbulent = window(0.5, 1.0);
        turbulent.stats[Role::Flow as usize].values[flow_stats::TURBULENCE_RESIDUAL] = 40.0;
        let error = judge.require(&w, &turbulent).expect_err("above the limit");
        assert!(!error.is_retryable() && error.to_string().contains("turbulence equation"), "{error}");
    }

    #[test]
    fn unconverged_cells_are_reported_with_their_place() {
        let with = |error: f64| {
            let mut report = window(0.5, 0.5);
            let values = &mut report.stats[Role::Flow as usize].values;
            values[flow_stats::CELL_ERROR] = error;
            values[flow_stats::CELL_ERROR_TARGET] = 0.1;
            values[flow_stats::CELL_ERROR_AT..][..3].copy_from_slice(&[1.7447, 1.7468, -2.0363]);
            report
        };
        let mut counts = Convergence::default();
        assert!(counts.add(&at(3), &with(0.099), 1e-3).is_empty() && counts.line().is_none());
        let text = counts.add(&at(4), &with(0.33), 1e-3).join("; ");
        assert!(
            text.contains("at (1.7447, 1.7468, -2.0363) m by 33.00 %")
                && text.contains("3.3 times its target of 10.00 %"),
            "{text}"
        );
        assert_eq!((counts.cells.windows, counts.cells.worst_window, counts.flow.windows), (1, 4, 0));
        let judge = AcceptanceCheck { stage: "descent".into(), accept_unconverged: false };
        let w = Window { index: 4, iteration: 1, time: 0.5, ..Default::default() };
        assert!(judge.require(&w, &with(0.99)).is_ok());
        let error = judge.require(&w, &with(1.01)).expect_err("beyond ten times").to_string();
        assert!(error.contains("flow in single cells") && error.contains("cells_across_vent"), "{error}");
    }
}
