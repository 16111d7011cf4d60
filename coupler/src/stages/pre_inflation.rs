//! Pre-inflation: the structure alone under a constant pressure (paper, section 5.1).

use case::Role;
use channel::{LOAD_WIDTH, Window, structure_stats};
use checks::AT_REST;
use coupling::convergence::Judge;
use coupling::error::{Place, RunError};
use coupling::partners::{LoadOverWindow, Partners};
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};

use super::{StageContext, Stepper, require_finite};

pub(super) struct PreInflation {
    place: Place,
    judge: Judge,
    /// Answer of the structure that is not accepted yet.
    displacement: Vec<f64>,
    load: Vec<f64>,
    settled_energy_ratio: Option<f64>,
    /// A later stage computes the flow around the shape that this one ends with.
    flow_follows: bool,
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
        Ok(Self {
            place: context.place(),
            judge: context.judge(),
            displacement: state.displacement.clone(),
            load,
            settled_energy_ratio: stage.settled_energy_ratio,
            flow_follows: context.scene.stages[context.stage + 1..]
                .iter()
                .any(|s| s.kind.roles().contains(&Role::Flow)),
            state,
        })
    }
}

/// Kinetic and strain energy at the end of a window, J.
fn energies(report: &WindowReport) -> (f64, f64) {
    let values = &report.stats[Role::Structure as usize].values;
    (values[structure_stats::KINETIC_ENERGY], values[structure_stats::STRAIN_ENERGY])
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
        report.add(Role::Structure, partners.structure(&w, load, &mut self.displacement)?);
        require_finite(Role::Structure, &self.place, &w, &self.displacement)?;
        self.judge.require(&w, &report)?;
        partners.accept(&w)?;
        self.state.displacement.copy_from_slice(&self.displacement);
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

    fn warning_at_end(&self, report: &WindowReport) -> Option<String> {
        let (kinetic, strain) = energies(report);
        (self.flow_follows && kinetic > AT_REST * strain).then(|| {
            format!(
                "the canopy is not at rest: {kinetic:.3e} J of kinetic energy beside {strain:.3e} J of strain energy; the flow grid \
                 is built around a shape in motion: set `mass_damping_per_s` or a longer `duration_s` for this stage, or \
                 `solve = \"static\"` [stages.at-rest]"
            )
        })
    }

    fn settled(&self, report: &WindowReport) -> Option<String> {
        let (kinetic, strain) = energies(report);
        let limit = self.settled_energy_ratio?;
        (strain > 0.0 && kinetic < limit * strain)
            .then(|| format!("settled: kinetic energy below {limit:.0e} of the strain energy"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hundredth of the strain energy before a flow, and the ratio of the scene.
    #[test]
    fn a_canopy_that_swings_before_a_flow_is_named() {
        let stage = |flow_follows| PreInflation {
            place: Place { stage: "inflate".into(), window: None },
            judge: Judge { stage: "inflate".into(), accept_unconverged: false },
            displacement: Vec::new(),
            load: Vec::new(),
            settled_energy_ratio: Some(1e-4),
            flow_follows,
            state: InterfaceState::default(),
        };
        let ended = |kinetic: f64| {
            let mut report = WindowReport::default();
            let values = &mut report.stats[Role::Structure as usize].values;
            (values[structure_stats::KINETIC_ENERGY], values[structure_stats::STRAIN_ENERGY]) =
                (2.0 * kinetic, 2.0);
            report
        };
        assert_eq!(stage(true).warning_at_end(&ended(0.0099)), None);
        let text = stage(true).warning_at_end(&ended(0.0101)).expect("in motion");
        assert!(text.contains("2.020e-2 J") && text.contains("[stages.at-rest]"), "{text}");
        assert_eq!(stage(false).warning_at_end(&ended(0.5)), None);
        assert!(stage(true).settled(&ended(0.9e-4)).is_some_and(|t| t.contains("below 1e-4")));
        assert_eq!(stage(true).settled(&ended(1.1e-4)), None);
    }
}
