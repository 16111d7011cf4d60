//! The loop over the coupling iterations of one window.

use channel::Window;
use timing::timed;

use super::criterion::Criterion;
use super::report::WindowReport;
use super::scheme::CouplingScheme;
use super::solvers::{Solvers, finite};
use super::state::WindowState;
use super::stopping::{Decision, StoppingCriterion, acceptable};
use super::values::InterfaceState;
use crate::convergence::AcceptanceCheck;
use crate::descent::DescentModel;
use crate::descent_limits::Limits;
use crate::error::{Location, RunError};
use crate::partners::Partners;
use crate::schemes::acceleration::accelerator::Accelerator;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::unknowns::Unknowns;

/// Components of a [`WindowLoop`].
pub struct WindowLoopParts {
    /// Stage, for messages.
    pub stage: String,
    /// The coupling scheme.
    pub scheme: Box<dyn CouplingScheme>,
    /// Acceleration of its iteration.
    pub accelerator: Box<dyn Accelerator>,
    /// Layout of the unknowns.
    pub unknowns: Unknowns,
    /// Convergence criterion.
    pub criterion: Criterion,
    /// The descent equation.
    pub descent: Option<DescentModel>,
    /// Largest number of iterations of a window.
    pub max_iterations: u32,
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

/// Couples structure, mesh, flow and descent, window by window, with a [`CouplingScheme`] and, where it iterates, an
/// [`Accelerator`].
///
/// Where no load is known at the start (no flow-only stage came before), it is replaced by the first response of the
/// flow in the first window.
pub struct WindowLoop {
    scheme: Box<dyn CouplingScheme>,
    accelerator: Box<dyn Accelerator>,
    problem: Problem,
    stopping: StoppingCriterion,
    judge: AcceptanceCheck,
    pub(crate) state: WindowState,
    /// Length of the last accepted window, s; 0 before it.
    last_dt: f64,
    /// The canopy was held until the first window begins ([`super::load_shape::FlowLoads`]).
    held_before: bool,
    /// Window length of the criterion and of the columns, s.
    tuned_length: f64,
    rejected: RejectedAttempts,
}

/// The coupled problem.
struct Problem {
    stage: String,
    unknowns: Unknowns,
    criterion: Criterion,
    descent: Option<DescentModel>,
}

/// Cost of rejected attempts at the open window.
#[derive(Default)]
struct RejectedAttempts {
    iterations: u64,
    structure_solves: u64,
    cost: WindowReport,
}

impl Problem {
    fn solvers<'a>(&'a self, partners: &'a mut dyn Partners) -> Solvers<'a> {
        Solvers {
            partners,
            unknowns: &self.unknowns,
            descent: self.descent.as_ref(),
            criterion: &self.criterion,
            stage: &self.stage,
        }
    }

    fn place(&self, w: &Window) -> Location {
        Location { stage: self.stage.clone(), window: Some((w.index, w.iteration)) }
    }

    /// An error where the frame accelerates downwards beyond the measured forces.
    fn check_descent(&self, state: &WindowState) -> Result<(), RunError> {
        let Some(model) = &self.descent else { return Ok(()) };
        let (w, velocity) = (&state.window, state.end.velocity);
        let acceleration = state.frame_acceleration(velocity);
        let limits = Limits::of(model, acceleration, velocity, &state.report.forces(w.frame_acceleration));
        match limits.downward() {
            None => Ok(()),
            Some(message) => Err(RunError::Unphysical { place: self.place(w), message }),
        }
    }

    fn diverged(&self, w: &Window, history: &[f64]) -> RunError {
        let shown: Vec<String> = history.iter().map(|m| format!("{m:.1e}")).collect();
        RunError::Coupling {
            place: self.place(w),
            message: format!(
                "interface and descent still change by {:.1e} of their change over the window after {} \
                 iterations (tolerance {:.1e}, limit of acceptance {:.1e}). Residuals: {}. \
                 Remedies: acceleration = \"iqn-ils\", a smaller relaxation, more max_iterations, a shorter window_s, \
                 a smaller flow.solver.residual_drop; --accept-unconverged accepts the window",
                history.last().copied().unwrap_or(f64::NAN),
                history.len(),
                self.criterion.tolerance,
                acceptable(self.criterion.tolerance),
                shown.join(" ")
            ),
        }
    }
}

impl WindowLoop {
    /// From `interface`, with `faces` faces.
    pub fn new(parts: WindowLoopParts, interface: InterfaceState, faces: usize) -> Self {
        let WindowLoopParts { stage, scheme, accelerator, unknowns, criterion, descent, .. } = parts;
        let accept_unconverged = parts.accept_unconverged;
        Self {
            scheme,
            accelerator,
            stopping: StoppingCriterion { max_iterations: parts.max_iterations.max(1), accept_unconverged },
            judge: AcceptanceCheck { stage: stage.clone(), accept_unconverged },
            state: WindowState::new(interface, &unknowns, faces),
            last_dt: 0.0,
            held_before: false,
            tuned_length: unknowns.window_s(),
            rejected: RejectedAttempts::default(),
            problem: Problem { stage, unknowns, criterion, descent },
        }
    }

    /// The same for a canopy that is held until the first window begins, which releases it.
    pub fn from_held(self) -> Self {
        Self { held_before: true, ..self }
    }

    /// Whether the next window releases the canopy.
    pub fn released(&self) -> bool {
        self.held_before && self.last_dt == 0.0
    }

    /// Values at the end of the last accepted window.
    pub fn state(&self) -> &InterfaceState {
        &self.state.interface
    }

    /// Sets the velocity `wind` (m/s) of the undisturbed air at the end of the next window.
    pub fn set_wind(&mut self, wind: [f64; 3]) {
        if let Some(drag) = self.problem.descent.as_mut().and_then(|d| d.payload_drag.as_mut()) {
            drag.wind_m_s = wind;
        }
    }

    /// Computes and accepts `window` (index, time, dt, substeps are given; frame motion and iteration are set here).
    /// `shorter`: the window may be repeated with half its length, so one that reaches the iteration limit is not
    /// accepted.
    ///
    /// # Errors
    /// Errors of the programs; a window that does not converge; values that are not finite. The state is then that of
    /// the last accepted window, and the rejected one may be repeated, also with another length.
    pub fn run(
        &mut self,
        partners: &mut dyn Partners,
        window: Window,
        shorter: bool,
    ) -> Result<WindowReport, RunError> {
        let load_known = self.state.interface.load.is_some();
        self.open(window);
        let outcome = self.iterate(partners, shorter).and_then(|()| self.accept(partners));
        let report = std::mem::take(&mut self.state.report);
        match outcome {
            Ok(()) => Ok(report),
            Err(error) => {
                self.reject(report, load_known);
                Err(error)
            }
        }
    }

    /// Opens `window`, with the counts of its rejected attempts.
    fn open(&mut self, window: Window) {
        let RejectedAttempts { iterations, structure_solves, cost } = std::mem::take(&mut self.rejected);
        self.set_window_length(window.dt);
        self.state.window = Window { iteration: iterations, ..window };
        self.state.structure_solves = structure_solves;
        self.state.report = cost;
        self.state.ratio = if self.last_dt > 0.0 { window.dt / self.last_dt } else { 1.0 };
        self.state.released = self.released();
    }

    /// Prepares criterion and acceleration for windows of length `dt`.
    fn set_window_length(&mut self, dt: f64) {
        if dt != self.tuned_length {
            self.problem.criterion.rescale(dt / self.tuned_length);
            self.accelerator.reset();
            self.scheme.reset(false);
            self.tuned_length = dt;
        }
    }

    /// The coupling iteration (paper, section 4): from the predicted unknowns $`x`$, sweeps through the solvers give
    /// the response $`\tilde x`$, until both agree; otherwise the acceleration or the scheme gives the next iterate.
    fn iterate(&mut self, partners: &mut dyn Partners, shorter: bool) -> Result<(), RunError> {
        let Self { scheme, accelerator, problem, stopping, state, .. } = self;
        let solvers = &mut problem.solvers(partners);
        let mut history = Vec::new();
        accelerator.begin_window();
        state.x.copy_from_slice(&state.start);
        timed("prediction", || scheme.predict(state, solvers))?;
        loop {
            timed("sweep", || scheme.sweep(state, solvers))?;
            state.report.iterations += 1;
            if !scheme.iterates() {
                state.report.converged = true;
                break;
            }
            let residual = solvers.criterion.relative_residual(&state.x, &state.x_tilde, &state.start);
            history.push(residual);
            state.report.residual = Some(residual);
            state.report.converged = solvers.criterion.met(residual);
            match stopping.decide(&history, solvers.criterion.tolerance, shorter) {
                Decision::Continue => {}
                Decision::Accept => {
                    accelerator.end_window(&state.x, &state.x_tilde);
                    break;
                }
                Decision::Reject => return Err(problem.diverged(&state.window, &history)),
            }
            timed("next iterate", || {
                if !scheme.improve(state, solvers)? {
                    accelerator.next(&state.x, &state.x_tilde, &mut state.next);
                }
                Ok::<_, RunError>(())
            })?;
            std::mem::swap(&mut state.x, &mut state.next);
            finite(solvers.stage, "iterate of the acceleration", &state.window, &state.x)?;
            state.window.iteration += 1;
        }
        state.report.residuals = history;
        Ok(())
    }

    /// Accepts the window if all solvers reached their targets and the frame follows the forces on it.
    fn accept(&mut self, partners: &mut dyn Partners) -> Result<(), RunError> {
        let state = &mut self.state;
        self.judge.require(&state.window, &state.report)?;
        self.problem.check_descent(state)?;
        state.report.add_acceptance(partners.accept(&state.window)?);
        state.accept();
        timed("scheme update", || self.scheme.accept(state));
        self.last_dt = state.window.dt;
        Ok(())
    }

    /// Returns to the last accepted window; the cost of the attempt is added to the next one.
    fn reject(&mut self, report: WindowReport, load_known: bool) {
        let WindowReport { solves: calls, flow_iterations, busy_s, wall_s, .. } = report;
        self.rejected = RejectedAttempts {
            iterations: self.state.window.iteration + 1,
            structure_solves: self.state.structure_solves,
            cost: WindowReport { solves: calls, flow_iterations, busy_s, wall_s, ..WindowReport::default() },
        };
        if !load_known {
            self.state.interface.load = None;
        }
        self.accelerator.reset();
        self.scheme.reset(true);
    }

    /// State that later windows depend on.
    pub fn save_state(&self) -> Vec<u8> {
        let lengths = [self.last_dt, self.tuned_length];
        let (interface, start) = (&self.state.interface, &self.state.start);
        pack(&(interface, start, lengths, self.scheme.save_state(), self.accelerator.save_state()))
    }

    /// Restores a [`WindowLoop::save_state`] of the same scheme and acceleration.
    ///
    /// # Errors
    /// A state of others.
    pub fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        type Saved = (InterfaceState, Vec<f64>, [f64; 2], Vec<u8>, Vec<u8>);
        let (interface, start, [last_dt, tuned_length], scheme, accelerator): Saved = unpack(saved)?;
        self.state.restore(interface, start);
        self.set_window_length(tuned_length);
        self.last_dt = last_dt;
        self.scheme.restore_state(&scheme)?;
        self.accelerator.restore_state(&accelerator)
    }
}
