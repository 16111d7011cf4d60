//! The loop over the coupling iterations of one window.

use case::Coupling;
use channel::{Stats, UNCONVERGED_LIMIT, Window, flow_stats};

use super::sequence::{End, Modelled, Sequence, Visit, finite, sequence};
use super::staggered::packed;
use super::{Accelerator, Criterion, Relaxation, Unknowns};
use crate::convergence::Judge;
use crate::descent::{DescentModel, WindowForces};
use crate::descent_limits::Limits;
use crate::error::{Place, RunError};
use crate::partners::{Answer, Partners};

/// Whatever the tolerance, no window is accepted that ends its iterations above this measure.
const MOST_ACCEPTABLE: f64 = 0.1;

/// A window that ends its iterations above the tolerance but below this measure is accepted and counted as
/// not converged; above it the run ends.
fn acceptable(tolerance: f64) -> f64 {
    (UNCONVERGED_LIMIT * tolerance).min(MOST_ACCEPTABLE).max(tolerance)
}

/// Iterations without progress after which an acceptable window is accepted: it
/// has come to the noise of the solvers' own tolerances.
const PATIENCE: usize = 6;

/// Whether the last [`PATIENCE`] measures are all acceptable and no better than
/// the best one before them.
fn stalled(history: &[f64], acceptable: f64) -> bool {
    let Some(split) = history.len().checked_sub(PATIENCE).filter(|&s| s > 0) else { return false };
    let best = |m: &[f64]| m.iter().copied().fold(f64::INFINITY, f64::min);
    let recent = &history[split..];
    recent.iter().all(|&m| m <= acceptable) && best(recent) > 0.9 * best(&history[..split])
}

/// Iterations without progress after which a window that is not acceptable is given back, where it can be.
const HOPELESS: usize = 12;

/// Whether the last [`HOPELESS`] measures are no better than the best one before them, and none acceptable.
fn hopeless(history: &[f64], acceptable: f64) -> bool {
    let Some(split) = history.len().checked_sub(HOPELESS).filter(|&s| s > 0) else { return false };
    let best = |m: &[f64]| m.iter().copied().fold(f64::INFINITY, f64::min);
    let recent = best(&history[split..]);
    recent > acceptable && recent > 0.9 * best(&history[..split])
}

/// Values on the interface at the end of the last accepted window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct InterfaceState {
    /// Displacement of the canopy from the unstressed shape, `[nodes][3]`, m.
    pub displacement: Vec<f64>,
    /// Load of the flow, `[faces][LOAD_WIDTH]`, Pa; `None` before the first flow step.
    pub load: Option<Vec<f64>>,
    /// The same one window earlier.
    #[serde(default)]
    pub load_before: Option<Vec<f64>>,
    /// Vertical velocity of the frame, m/s, positive up.
    pub velocity: f64,
    /// Mean vertical acceleration of the frame over the window, m/s2.
    pub acceleration: f64,
}

/// What happened in a window.
#[derive(Clone, Debug, Default)]
pub struct WindowReport {
    /// Coupling iterations.
    pub iterations: u32,
    /// Measure of the last iteration ([`Criterion::measure`]); `None` where
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
        let structure = &self.stats[case::Role::Structure as usize];
        WindowForces { canopy: self.force[2], structure, frame_acceleration: acceleration }
    }

    /// Adds the answer of the program of `role`.
    pub fn add(&mut self, role: case::Role, answer: Answer) {
        let at = role as usize;
        self.stats[at] = answer.stats;
        self.calls[at] += 1;
        self.sums[at].iter_mut().zip(&answer.stats.values).for_each(|(sum, value)| *sum += value);
        self.busy_s[at] += answer.stats.busy_s;
        self.wall_s[at] += answer.wall_s;
        if role == case::Role::Flow {
            self.flow_iterations += answer.stats.values[flow_stats::ITERATIONS];
            self.force.copy_from_slice(&answer.stats.values[flow_stats::FORCE..flow_stats::FORCE + 3]);
        }
    }
}

/// Couples structure, mesh, flow and descent, window by window, with a [`Sequence`] of
/// visits to the programs and an [`Accelerator`] where visits are repeated.
///
/// Where no load is known at the start (no flow-only stage came before), the
/// first flow answer of the first window stands for it.
pub struct WindowLoop {
    stage: String,
    pub(super) sequence: Box<dyn Sequence>,
    max_iterations: u32,
    judge: Judge,
    unknowns: Unknowns,
    criterion: Criterion,
    pub(super) accelerator: Box<dyn Accelerator>,
    descent: Option<DescentModel>,
    pub(super) state: InterfaceState,
    pub(super) end: End,
    pub(super) x: Vec<f64>,
    pub(super) x_tilde: Vec<f64>,
    pub(super) next: Vec<f64>,
    pub(super) start: Vec<f64>,
    /// Length of the last accepted window, s; 0 before it.
    pub(super) last_dt: f64,
    /// The canopy was held until the first window begins ([`super::FlowLoads`]).
    held_before: bool,
    /// Length that the criterion and what is learnt belong to, s.
    pub(super) tuned_dt: f64,
    /// Iterations and answers of the structure in attempts at the present window, and what they cost.
    tried: (u64, u64),
    spent: WindowReport,
}

impl WindowLoop {
    /// From `state`, on an interface of `faces` faces. `accept_unconverged` accepts
    /// windows that do not converge as long as they are finite.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        stage: &str,
        coupling: &Coupling,
        unknowns: Unknowns,
        criterion: Criterion,
        faces: usize,
        descent: Option<DescentModel>,
        state: InterfaceState,
        rest: Box<dyn Relaxation>,
        modelled: Option<Modelled>,
        accept_unconverged: bool,
    ) -> Self {
        let start = packed(&unknowns, &state);
        Self {
            stage: stage.to_owned(),
            sequence: sequence(coupling, unknowns, &state, modelled),
            max_iterations: coupling.max_iterations.max(1),
            judge: Judge { stage: stage.to_owned(), accept_unconverged },
            criterion,
            accelerator: super::accelerator(coupling, unknowns.len(), rest),
            descent,
            end: End {
                displacement: state.displacement.clone(),
                load: vec![0.0; faces * channel::LOAD_WIDTH],
                velocity: state.velocity,
            },
            x: start.clone(),
            x_tilde: start.clone(),
            next: start.clone(),
            start,
            state,
            last_dt: 0.0,
            held_before: false,
            tuned_dt: unknowns.window_s(),
            tried: (0, 0),
            spent: WindowReport::default(),
            unknowns,
        }
    }

    /// The same for a canopy that was held until the first window begins: that window releases it.
    pub fn from_held(self) -> Self {
        Self { held_before: true, ..self }
    }

    /// Whether the next window releases the canopy.
    pub fn released(&self) -> bool {
        self.held_before && self.last_dt == 0.0
    }

    /// Values at the end of the last accepted window.
    pub fn state(&self) -> &InterfaceState {
        &self.state
    }

    /// The undisturbed air moves at `wind` (m/s) at the end of the next window.
    pub fn set_wind(&mut self, wind: [f64; 3]) {
        if let Some(drag) = self.descent.as_mut().and_then(|d| d.payload_drag.as_mut()) {
            drag.wind_m_s = wind;
        }
    }

    /// Computes and accepts the window that `window` opens (index, time, dt,
    /// substeps are given; frame motion and iteration are filled here). `shorter`: the window may be tried
    /// again with half its length, so that one which runs out of iterations is not accepted.
    ///
    /// # Errors
    /// Those of the partners; a window that does not converge; numbers that are not finite. The last
    /// accepted window then still stands, and the same one may be tried again, also with another length.
    pub fn run(
        &mut self,
        partners: &mut dyn Partners,
        window: Window,
        shorter: bool,
    ) -> Result<WindowReport, RunError> {
        let known = self.state.load.is_some();
        let mut w = Window { iteration: self.tried.0, ..window };
        let mut answers = self.tried.1;
        let mut report = std::mem::take(&mut self.spent);
        self.tune(w.dt);
        match self.iterate(partners, &mut w, &mut answers, &mut report, shorter) {
            Ok(()) => {
                self.tried = (0, 0);
                Ok(report)
            }
            Err(error) => {
                self.tried = (w.iteration + 1, answers);
                let WindowReport { calls, flow_iterations, busy_s, wall_s, .. } = report;
                self.spent =
                    WindowReport { calls, flow_iterations, busy_s, wall_s, ..WindowReport::default() };
                if !known {
                    self.state.load = None;
                }
                self.accelerator.forget();
                self.sequence.forget(true);
                Err(error)
            }
        }
    }

    /// Makes ready for windows of length `dt`.
    pub(super) fn tune(&mut self, dt: f64) {
        if dt != self.tuned_dt {
            self.criterion.rescale(dt / self.tuned_dt);
            self.accelerator.forget();
            self.sequence.forget(false);
            self.tuned_dt = dt;
        }
    }

    fn iterate(
        &mut self,
        partners: &mut dyn Partners,
        w: &mut Window,
        answers: &mut u64,
        report: &mut WindowReport,
        shorter: bool,
    ) -> Result<(), RunError> {
        let mut history = Vec::new();
        let released = self.released();
        let ratio = if self.last_dt > 0.0 { w.dt / self.last_dt } else { 1.0 };
        macro_rules! visit {
            () => {
                &mut Visit {
                    partners: &mut *partners,
                    window: &mut *w,
                    state: &mut self.state,
                    end: &mut self.end,
                    report: &mut *report,
                    unknowns: &self.unknowns,
                    descent: self.descent.as_ref(),
                    criterion: &self.criterion,
                    start: &self.start,
                    ratio,
                    released,
                    answers: &mut *answers,
                    stage: &self.stage,
                }
            };
        }
        self.accelerator.begin_window();
        self.x.copy_from_slice(&self.start);
        self.sequence.predict(visit!(), &mut self.x)?;
        loop {
            self.sequence.visit(visit!(), &self.x, &mut self.x_tilde)?;
            report.iterations += 1;
            if !self.sequence.iterates() {
                report.converged = true;
                break;
            }
            let measure = self.criterion.measure(&self.x, &self.x_tilde, &self.start);
            history.push(measure);
            report.residual = Some(measure);
            report.converged = self.criterion.met(measure);
            let most = acceptable(self.criterion.tolerance);
            let given_up = shorter && (!measure.is_finite() || hopeless(&history, most));
            let stalled = stalled(&history, most);
            let over = report.iterations == self.max_iterations || stalled || given_up;
            if report.converged || over {
                let exhausted = shorter && !stalled;
                let bearable = measure <= most || (self.judge.accept_unconverged && measure.is_finite());
                if !report.converged && (!bearable || exhausted) {
                    return Err(self.diverged(w, &history));
                }
                self.accelerator.end_window(&self.x, &self.x_tilde);
                break;
            }
            if !self.sequence.improve(visit!(), &self.x, &mut self.next)? {
                self.accelerator.next(&self.x, &self.x_tilde, &mut self.next);
            }
            std::mem::swap(&mut self.x, &mut self.next);
            finite(&self.stage, "iterate of the acceleration", w, &self.x)?;
            w.iteration += 1;
        }
        report.residuals = history;
        self.judge.require(w, report)?;
        self.refuse_fall(w, report)?;
        self.accept(partners, w)
    }

    /// An error where the frame falls faster than the measured forces pull it.
    fn refuse_fall(&self, w: &Window, report: &WindowReport) -> Result<(), RunError> {
        let Some(model) = &self.descent else { return Ok(()) };
        let acceleration = (self.end.velocity - self.state.velocity) / w.dt;
        let limits =
            Limits::of(model, acceleration, self.end.velocity, &report.forces(w.frame_acceleration[2]));
        match limits.downward() {
            None => Ok(()),
            Some(message) => Err(RunError::Unphysical { place: self.place(w), message }),
        }
    }

    fn place(&self, w: &Window) -> Place {
        Place { stage: self.stage.clone(), window: Some((w.index, w.iteration)) }
    }

    fn accept(&mut self, partners: &mut dyn Partners, w: &Window) -> Result<(), RunError> {
        partners.accept(w)?;
        let released = self.released();
        self.last_dt = w.dt;
        let (state, end) = (&mut self.state, &self.end);
        state.acceleration = (end.velocity - state.velocity) / w.dt;
        state.velocity = end.velocity;
        state.displacement.copy_from_slice(&end.displacement);
        std::mem::swap(&mut state.load, &mut state.load_before);
        let load = state.load.get_or_insert_default();
        load.clear();
        load.extend_from_slice(&end.load);
        if released {
            // The load of the held canopy is not one that the free fabric felt.
            state.load_before = None;
        }
        self.start.copy_from_slice(&self.x_tilde);
        self.sequence.accept(end, &self.x, &self.x_tilde, w.dt);
        Ok(())
    }

    fn diverged(&self, w: &Window, history: &[f64]) -> RunError {
        let shown: Vec<String> = history.iter().map(|m| format!("{m:.1e}")).collect();
        RunError::Coupling {
            place: self.place(w),
            message: format!(
                "interface and descent still change by {:.1e} of their change over the window after {} \
                 iterations (tolerance {:.1e}; a window is not accepted above {:.1e}). Residuals: {}. \
                 Remedies: acceleration \"iqn-ils\", a smaller relaxation, more iterations, a shorter window_s, \
                 a tighter flow.solver.residual_drop; --accept-unconverged accepts it",
                history.last().copied().unwrap_or(f64::NAN),
                history.len(),
                self.criterion.tolerance,
                acceptable(self.criterion.tolerance),
                shown.join(" ")
            ),
        }
    }
}
