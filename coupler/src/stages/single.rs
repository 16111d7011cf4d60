//! Stages without coupling iterations: each program solves a window once (one-way coupling).

use case::Role;
use channel::{LOAD_WIDTH, Window};
use coupling::convergence::AcceptanceCheck;
use coupling::error::{Location, RunError};
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};

use super::{StageContext, Stepper, require_finite};

/// The solves of one window of such a stage.
pub(super) trait WindowSolver {
    /// Runs the solves of a window and stores the results.
    fn solve(&mut self, solve: &mut WindowSolve<'_>) -> Result<(), RunError>;

    /// The window is accepted: updates the `state` at its end.
    fn accepted(&mut self, state: &mut InterfaceState) {
        let _ = state;
    }

    /// As [`Stepper::settled`].
    fn settled(&self, _report: &WindowReport) -> Option<String> {
        None
    }

    /// As [`Stepper::warning_at_end`].
    fn warning_at_end(&self, _report: &WindowReport) -> Option<String> {
        None
    }
}

/// A solve of one window: its programs, input and results.
pub(super) struct WindowSolve<'a> {
    pub partners: &'a mut dyn Partners,
    pub window: &'a Window,
    pub state: &'a mut InterfaceState,
    pub report: &'a mut WindowReport,
    pub place: &'a Location,
}

impl WindowSolve<'_> {
    /// Solves the flow for the load on the canopy.
    pub fn flow(&mut self) -> Result<(), RunError> {
        let load = self.state.load.get_or_insert_default();
        self.report.add(Role::Flow, self.partners.flow(self.window, load)?);
        require_finite(Role::Flow, self.place, self.window, load)
    }
}

/// A stage whose windows `S` solves.
pub(super) struct SingleSolve<S> {
    solver: S,
    place: Location,
    acceptance: AcceptanceCheck,
    state: InterfaceState,
    /// Solves of the current window so far.
    solves: u64,
}

impl<S: WindowSolver> SingleSolve<S> {
    pub fn new(context: &StageContext<'_>, state: InterfaceState, solver: S) -> Self {
        Self { solver, place: context.place(), acceptance: context.acceptance_check(), state, solves: 0 }
    }

    /// A stage with flow around a canopy whose frame does not accelerate.
    pub fn in_flow(context: &StageContext<'_>, mut state: InterfaceState, solver: S) -> Self {
        state.acceleration = [0.0; 3];
        state.load.get_or_insert_default().resize(context.interface.faces.len() * LOAD_WIDTH, 0.0);
        Self::new(context, state, solver)
    }
}

impl<S: WindowSolver> Stepper for SingleSolve<S> {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        mut w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        (w.iteration, self.solves) = (self.solves, self.solves + 1);
        // The frame does not accelerate.
        w.frame_velocity = self.state.velocity;
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        let (state, place) = (&mut self.state, &self.place);
        self.solver.solve(&mut WindowSolve { partners, window: &w, state, report: &mut report, place })?;
        self.acceptance.require(&w, &report)?;
        report.add_acceptance(partners.accept(&w)?);
        self.solves = 0;
        self.solver.accepted(&mut self.state);
        Ok(report)
    }

    fn state(&self) -> &InterfaceState {
        &self.state
    }

    fn settled(&self, report: &WindowReport) -> Option<String> {
        self.solver.settled(report)
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&self.state)
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        self.state = unpack(saved)?;
        Ok(())
    }

    fn warning_at_end(&self, report: &WindowReport) -> Option<String> {
        self.solver.warning_at_end(report)
    }
}
