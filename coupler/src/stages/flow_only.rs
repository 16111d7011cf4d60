//! The flow alone around the canopy held still, at the speed the run has so far.

use case::Role;
use channel::{LOAD_WIDTH, Window};
use coupling::convergence::Judge;
use coupling::error::{Place, RunError};
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};

use super::{StageContext, Stepper, force, require_finite};

pub(super) struct FlowOnly {
    place: Place,
    judge: Judge,
    state: InterfaceState,
    /// Attempts at the present window.
    tried: u64,
}

impl FlowOnly {
    pub(super) fn new(context: &StageContext<'_>, mut state: InterfaceState) -> Self {
        state.acceleration = 0.0;
        state.load.get_or_insert_default().resize(context.interface.faces.len() * LOAD_WIDTH, 0.0);
        Self { place: context.place(), judge: context.judge(), state, tried: 0 }
    }
}

impl Stepper for FlowOnly {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        mut w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        (w.iteration, self.tried) = (self.tried, self.tried + 1);
        w.frame_velocity = [0.0, 0.0, self.state.velocity];
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        let load = self.state.load.get_or_insert_default();
        let answer = partners.flow(&w, load)?;
        require_finite(Role::Flow, &self.place, &w, load)?;
        report.add(Role::Flow, answer);
        debug_assert_eq!(report.force, force(&answer.stats));
        self.judge.require(&w, &report)?;
        partners.accept(&w)?;
        self.tried = 0;
        Ok(report)
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.state)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.state = unpack(memory)?;
        Ok(())
    }

    fn state(&self) -> &InterfaceState {
        &self.state
    }
}
