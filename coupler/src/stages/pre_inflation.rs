//! Pre-inflation: the structure alone under a constant pressure (paper, section 5.1).

use case::Role;
use channel::{LOAD_WIDTH, structure_stats};
use checks::AT_REST;
use coupling::error::RunError;
use coupling::partners::LoadOverWindow;
use coupling::schemes::{InterfaceState, WindowReport};

use super::single::{WindowSolve, WindowSolver};
use super::{StageContext, require_finite};

pub(super) struct PreInflation {
    /// Displacement of the current window, `[nodes][3]`, m; not accepted yet.
    displacement: Vec<f64>,
    /// Constant pressure, `[faces][LOAD_WIDTH]`.
    load: Vec<f64>,
    settled_energy_ratio: Option<f64>,
    /// A later stage computes the flow around the final shape of this stage.
    flow_follows: bool,
}

impl PreInflation {
    pub(super) fn new(context: &StageContext<'_>, state: &InterfaceState) -> Result<Self, RunError> {
        let stage = context.description();
        // A structure of cables has no pressure: it has no face.
        let pressure = stage.pressure_pa.unwrap_or(0.0);
        let load = [pressure, 0.0, 0.0, 0.0].repeat(context.interface.faces.len());
        debug_assert_eq!(load.len(), context.interface.faces.len() * LOAD_WIDTH);
        Ok(Self {
            displacement: state.displacement.clone(),
            load,
            settled_energy_ratio: stage.settled_energy_ratio,
            flow_follows: context.scene.stages[context.stage + 1..]
                .iter()
                .any(|s| s.kind.roles().contains(&Role::Flow)),
        })
    }
}

/// Kinetic and strain energy at the end of a window, J.
fn energies(report: &WindowReport) -> (f64, f64) {
    let values = &report.stats[Role::Structure as usize].values;
    (values[structure_stats::KINETIC_ENERGY], values[structure_stats::STRAIN_ENERGY])
}

impl WindowSolver for PreInflation {
    fn solve(&mut self, solve: &mut WindowSolve<'_>) -> Result<(), RunError> {
        let w = solve.window;
        let load = LoadOverWindow { start: &self.load, end: &self.load };
        let response = solve.partners.structure(w, load, &mut self.displacement)?;
        solve.report.add(Role::Structure, response);
        require_finite(Role::Structure, solve.place, w, &self.displacement)
    }

    fn accepted(&mut self, state: &mut InterfaceState) {
        state.displacement.copy_from_slice(&self.displacement);
    }

    fn warning_at_end(&self, report: &WindowReport) -> Option<String> {
        let (kinetic, strain) = energies(report);
        (self.flow_follows && kinetic > AT_REST * strain).then(|| {
            format!(
                "the canopy is not at rest: kinetic energy {kinetic:.3e} J, strain energy {strain:.3e} J; the flow grid \
                 is built around a moving shape: set `mass_damping_per_s` or a longer `duration_s` for this stage, or \
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

    /// The limit before a flow is 1 % of the strain energy; `settled_energy_ratio` is the scene's own.
    #[test]
    fn kinetic_energy_before_a_flow_stage_gives_a_warning() {
        let stage = |flow_follows| PreInflation {
            displacement: Vec::new(),
            load: Vec::new(),
            settled_energy_ratio: Some(1e-4),
            flow_follows,
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
