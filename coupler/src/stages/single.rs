//! Windows that are solved once, for no program waits for what another makes of its answer.

use case::Role;
use channel::{LOAD_WIDTH, Window};
use coupling::convergence::AcceptanceCheck;
use coupling::error::{Location, RunError};
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};

use super::{StageContext, Stepper, require_finite};

/// What the programs of a stage are asked, each once in a window.
pub(super) trait Questions {
    /// Asks them and enters their answers.
    fn ask(&mut self, attempt: &mut Attempt<'_>) -> Result<(), RunError>;

    /// The window is accepted, which ends with `state`.
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

/// An attempt at a window.
pub(super) struct Attempt<'a> {
    pub partners: &'a mut dyn Partners,
    pub window: &'a Window,
    pub state: &'a mut InterfaceState,
    pub report: &'a mut WindowReport,
    pub place: &'a Location,
}

impl Attempt<'_> {
    /// Asks the flow for the load.
    pub fn flow(&mut self) -> Result<(), RunError> {
        let load = self.state.load.get_or_insert_default();
        self.report.add(Role::Flow, self.partners.flow(self.window, load)?);
        require_finite(Role::Flow, self.place, self.window, load)
    }
}

/// A stage of such windows.
pub(super) struct SingleSolve<Q> {
    questions: Q,
    place: Location,
    judge: AcceptanceCheck,
    state: InterfaceState,
    /// Attempts at the present window.
    tried: u64,
}

impl<Q: Questions> SingleSolve<Q> {
    pub fn new(context: &StageContext<'_>, state: InterfaceState, questions: Q) -> Self {
        Self { questions, place: context.place(), judge: context.judge(), state, tried: 0 }
    }

    /// Of a stage with flow around a canopy whose frame does not accelerate.
    pub fn in_flow(context: &StageContext<'_>, mut state: InterfaceState, questions: Q) -> Self {
        state.acceleration = 0.0;
        state.load.get_or_insert_default().resize(context.interface.faces.len() * LOAD_WIDTH, 0.0);
        Self::new(context, state, questions)
    }
}

impl<Q: Questions> Stepper for SingleSolve<Q> {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        mut w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        (w.iteration, self.tried) = (self.tried, self.tried + 1);
        // The frame does not accelerate.
        w.frame_velocity = [0.0, 0.0, self.state.velocity];
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        let (state, place) = (&mut self.state, &self.place);
        self.questions.ask(&mut Attempt { partners, window: &w, state, report: &mut report, place })?;
        self.judge.require(&w, &report)?;
        partners.accept(&w)?;
        self.tried = 0;
        self.questions.accepted(&mut self.state);
        Ok(report)
    }

    fn state(&self) -> &InterfaceState {
        &self.state
    }

    fn settled(&self, report: &WindowReport) -> Option<String> {
        self.questions.settled(report)
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&self.state)
    }

    fn restore_state(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.state = unpack(memory)?;
        Ok(())
    }

    fn warning_at_end(&self, report: &WindowReport) -> Option<String> {
        self.questions.warning_at_end(report)
    }
}
