//! Whether windows are accepted converged: the coupling beside its tolerance, residuals of the programs
//! beside the targets that they state.
//!
//! What is accepted is the last answer of each program in a window; it alone decides. Earlier
//! solves of the coupling iterations may be loose, for the next one repeats them; they are only counted. An accepted
//! answer above its target by less than [`UNCONVERGED_LIMIT`] is counted, reported at its first occurrence and at the
//! end of the stage; one beyond it is an error, unless `--accept-unconverged` is given.

use case::Role;
use channel::{STATS, UNCONVERGED_LIMIT, Window, excess, flow_stats, residual_and_target, structure_stats};
use serde::{Deserialize, Serialize};

use crate::error::{Place, RunError};
use crate::schemes::window::report::WindowReport;

/// What can end above its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
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
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Coupling, Self::Structure, Self::Flow, Self::Mesh, Self::Turbulence];

    /// In messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coupling => "coupling",
            Self::Structure => "structure",
            Self::Flow => "flow",
            Self::Mesh => "grid motion",
            Self::Turbulence => "turbulence equation",
        }
    }

    /// What helps.
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
        }
    }

    fn role(self) -> Option<Role> {
        match self {
            Self::Structure => Some(Role::Structure),
            Self::Flow => Some(Role::Flow),
            Self::Mesh => Some(Role::Mesh),
            Self::Coupling | Self::Turbulence => None,
        }
    }
}

/// Windows that were accepted above a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    /// How many.
    pub windows: u64,
    /// Largest residual over its target among them.
    pub worst: f64,
    /// Window of it.
    pub worst_window: u64,
}

/// What a stage accepted above its targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// The coupling iterations.
    pub coupling: Tally,
    /// The structure.
    pub structure: Tally,
    /// The flow.
    pub flow: Tally,
    /// The grid motion.
    pub mesh: Tally,
    /// The turbulence equation.
    pub turbulence: Tally,
    /// Time steps of the structure above their own target, those of answers included that were repeated.
    pub structure_solves: u64,
    /// Solves of the flow above their own target, likewise.
    pub flow_solves: u64,
}

impl Convergence {
    fn tally(&self, part: Part) -> &Tally {
        match part {
            Part::Coupling => &self.coupling,
            Part::Structure => &self.structure,
            Part::Flow => &self.flow,
            Part::Mesh => &self.mesh,
            Part::Turbulence => &self.turbulence,
        }
    }

    fn tally_mut(&mut self, part: Part) -> &mut Tally {
        match part {
            Part::Coupling => &mut self.coupling,
            Part::Structure => &mut self.structure,
            Part::Flow => &mut self.flow,
            Part::Mesh => &mut self.mesh,
            Part::Turbulence => &mut self.turbulence,
        }
    }

    /// Windows above any target.
    pub fn windows(&self) -> u64 {
        Part::ALL.iter().map(|part| self.tally(*part).windows).sum()
    }

    /// What is above its target, in a line for the summary; `None` where all is converged.
    pub fn line(&self) -> Option<String> {
        let of = |part: &Part| {
            let t = self.tally(*part);
            (t.windows > 0)
                .then(|| format!("{} in {} windows ({:.1} times)", part.name(), t.windows, t.worst))
        };
        let parts: Vec<String> = Part::ALL.iter().filter_map(of).collect();
        (!parts.is_empty()).then(|| format!("accepted above the target: {}", parts.join(", ")))
    }

    /// Takes an accepted window into account; what is to be said of it: each part at its first occurrence.
    /// `tolerance` is that of the coupling.
    pub fn add(&mut self, place: &Place, report: &WindowReport, tolerance: f64) -> Vec<String> {
        let index = place.window.map_or(0, |(index, _)| index);
        let sum = |role: Role, at: usize| report.sums[role as usize][at] as u64;
        self.structure_solves += sum(Role::Structure, structure_stats::UNCONVERGED);
        self.flow_solves += sum(Role::Flow, flow_stats::UNCONVERGED);
        let mut said = Vec::new();
        for part in Part::ALL {
            let Some(excess) = excess_of(part, report, tolerance).filter(|e| *e > 1.0) else { continue };
            let tally = self.tally_mut(part);
            tally.windows += 1;
            if excess > tally.worst {
                (tally.worst, tally.worst_window) = (excess, index);
            }
            if tally.windows == 1 {
                said.push(format!(
                    "{place}: the {} is accepted unconverged: {}. Remedies: {}. Later windows are only counted",
                    part.name(),
                    figures(part, report, tolerance),
                    part.remedies()
                ));
            }
        }
        said
    }

    /// What is to be said at the end of a stage of `windows` windows.
    pub fn closing(&self, stage: &str, windows: u64) -> Vec<String> {
        let of = |part: &Part| {
            let t = self.tally(*part);
            let solves = match part {
                Part::Structure => self.structure_solves,
                Part::Flow => self.flow_solves,
                _ => 0,
            };
            let solves = if solves > t.windows {
                format!("; {solves} solves ended above their own target, repeated ones included")
            } else {
                String::new()
            };
            (t.windows > 1).then(|| {
                format!(
                    "stage `{stage}`: the {} of {} of {windows} windows is above its target, {:.1} times it at most \
                     (window {}){solves}. Remedies: {}",
                    part.name(),
                    t.windows,
                    t.worst,
                    t.worst_window,
                    part.remedies()
                )
            })
        };
        Part::ALL.iter().filter_map(of).collect()
    }
}

/// Residual of an accepted window over its target; `None` where it is not judged.
fn excess_of(part: Part, report: &WindowReport, tolerance: f64) -> Option<f64> {
    match part {
        Part::Coupling => report.residual.map(|r| r / tolerance),
        Part::Turbulence => {
            let value = report.stats[Role::Flow as usize].values[flow_stats::TURBULENCE_RESIDUAL];
            (value > 0.0).then_some(value)
        }
        _ => part.role().and_then(|role| excess(role, &report.stats[role as usize].values)),
    }
}

/// Residual, target and what was spent, in words.
fn figures(part: Part, report: &WindowReport, tolerance: f64) -> String {
    let of = |role: Role| &report.stats[role as usize].values;
    let (residual, target, spent) = match part {
        Part::Coupling => {
            (report.residual.unwrap_or(f64::NAN), tolerance, format!("{} iterations", report.iterations))
        }
        Part::Turbulence => {
            let over = of(Role::Flow)[flow_stats::TURBULENCE_RESIDUAL];
            return format!("its residual in the step before ended at {over:.1} times its target");
        }
        _ => {
            let role = part.role().unwrap_or(Role::Flow);
            let (residual, target) = residual_and_target(role, of(role)).unwrap_or_default();
            (residual, target, spent(role, of(role)))
        }
    };
    format!(
        "its residual ended at {residual:.2e}, {:.1} times its target of {target:.2e}, after {spent}",
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

/// Refuses windows whose last answers lie too far above their targets.
#[derive(Clone, Debug, Default)]
pub struct Judge {
    /// Stage, for messages.
    pub stage: String,
    /// Accepts them all the same.
    pub accept_unconverged: bool,
}

impl Judge {
    /// Whether the last answers in `report` may be accepted as the end of `w`.
    ///
    /// # Errors
    /// [`RunError::Unconverged`] for the first part that lies above [`UNCONVERGED_LIMIT`] times its target.
    /// The coupling is judged where its iterations end.
    pub fn require(&self, w: &Window, report: &WindowReport) -> Result<(), RunError> {
        if self.accept_unconverged {
            return Ok(());
        }
        let beyond = |part: &&Part| {
            let excess = excess_of(**part, report, f64::INFINITY);
            **part != Part::Coupling && excess.is_some_and(|e| e.is_nan() || e > UNCONVERGED_LIMIT)
        };
        match Part::ALL.iter().find(beyond) {
            None => Ok(()),
            Some(part) => Err(RunError::Unconverged {
                what: part.name(),
                place: Place { stage: self.stage.clone(), window: Some((w.index, w.iteration)) },
                message: format!(
                    "t = {:.4} s, {}; a window is not accepted beyond {UNCONVERGED_LIMIT} times. Remedies: {}; \
                     --accept-unconverged accepts it",
                    w.time,
                    figures(*part, report, f64::INFINITY),
                    part.remedies()
                ),
                // The turbulence is that of the step before, which a shorter window does not change.
                shorter: *part != Part::Turbulence,
                saved: None,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window whose flow ended at `flow` and whose coupling at `coupling` times the target.
    fn window(flow: f64, coupling: f64) -> WindowReport {
        let mut report =
            WindowReport { iterations: 7, residual: Some(1e-3 * coupling), ..Default::default() };
        let values = &mut report.stats[Role::Flow as usize].values;
        values[flow_stats::RESIDUAL_END] = 2e-4 * flow;
        values[flow_stats::RESIDUAL_TARGET] = 2e-4;
        values[flow_stats::ITERATIONS] = 60.0;
        report.sums[Role::Flow as usize][flow_stats::UNCONVERGED] = 3.0;
        report
    }

    fn at(index: u64) -> Place {
        Place { stage: "descent".into(), window: Some((index, 6)) }
    }

    #[test]
    fn each_part_is_said_once_and_counted_at_the_end() {
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
        let closing = c.closing("descent", 4);
        assert_eq!(closing.len(), 2);
        assert!(closing[0].contains("coupling of 2 of 4 windows") && closing[0].contains("3.0 times"));
        assert!(closing[1].contains("flow of 3 of 4") && closing[1].contains("(window 2); 12 solves"));
        assert_eq!((c.flow_solves, c.windows()), (12, 5));
        assert!(Convergence::default().closing("descent", 4).is_empty());
    }

    #[test]
    fn ten_times_the_target_is_an_error_unless_accepted() {
        let w = Window { index: 12, iteration: 3, time: 0.06, ..Window::default() };
        let judge = Judge { stage: "descent".into(), accept_unconverged: false };
        assert!(judge.require(&w, &window(9.9, 50.0)).is_ok(), "the coupling is judged elsewhere");
        let error = judge.require(&w, &window(10.1, 1.0)).expect_err("too far");
        assert!(error.may_pass(), "a shorter window may converge");
        let text = error.to_string();
        for word in
            ["flow is not converged", "`descent`, window 12", "0.0600", "2.02e-3", "10.1 times", "gmres"]
        {
            assert!(text.contains(word), "{word}: {text}");
        }
        assert!(judge.require(&w, &window(f64::NAN, 1.0)).is_err());
        assert!(Judge { accept_unconverged: true, ..judge.clone() }.require(&w, &window(1e3, 1.0)).is_ok());
        // Nothing stated, nothing judged.
        assert!(judge.require(&w, &WindowReport::default()).is_ok());
        let mut turbulent = window(0.5, 1.0);
        turbulent.stats[Role::Flow as usize].values[flow_stats::TURBULENCE_RESIDUAL] = 40.0;
        let error = judge.require(&w, &turbulent).expect_err("too far");
        assert!(!error.may_pass() && error.to_string().contains("turbulence equation"), "{error}");
    }
}
