//! Pre-inflation: the structure alone under a constant pressure (paper, section 5.1).

use case::Role;
use channel::{LOAD_WIDTH, Window, structure_stats};

use super::{StageContext, Stepper, require_finite};
use crate::error::{Place, RunError};
use crate::partners::{LoadOverWindow, Partners};
use crate::schemes::{InterfaceState, WindowReport, pack, unpack};

pub(super) struct PreInflation {
    place: Place,
    load: Vec<f64>,
    settled_energy_ratio: Option<f64>,
    state: InterfaceState,
}

impl PreInflation {
    pub(super) fn new(context: &StageContext<'_>, state: InterfaceState) -> Result<Self, RunError> {
        let stage = context.description();
        let pressure = stage.pressure_pa.ok_or_else(|| {
            RunError::Input(format!("stage `{}` is a pre-inflation: give it `pressure_pa`", stage.name))
        })?;
        let load = [pressure, 0.0, 0.0, 0.0].repeat(context.interface.faces.len());
        debug_assert_eq!(load.len(), context.interface.faces.len() * LOAD_WIDTH);
        Ok(Self { place: context.place(), load, settled_energy_ratio: stage.settled_energy_ratio, state })
    }
}

impl Stepper for PreInflation {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        mut w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        // The payload falls at a constant speed: its frame does not accelerate.
        w.frame_velocity = [0.0, 0.0, self.state.velocity];
        let load = LoadOverWindow { start: &self.load, end: &self.load };
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        report.add(Role::Structure, partners.structure(&w, load, &mut self.state.displacement)?);
        require_finite(Role::Structure, &self.place, &w, &self.state.displacement)?;
        partners.accept(&w)?;
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

    fn settled(&self, report: &WindowReport) -> Option<String> {
        let values = &report.stats[Role::Structure as usize].values;
        let (kinetic, strain) =
            (values[structure_stats::KINETIC_ENERGY], values[structure_stats::STRAIN_ENERGY]);
        let limit = self.settled_energy_ratio?;
        (strain > 0.0 && kinetic < limit * strain)
            .then(|| format!("settled: kinetic energy below {limit:.0e} of the strain energy"))
    }
}
