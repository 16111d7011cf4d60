//! The solvers of a window: one method for each step of the coupling iteration.

use case::Role;
use channel::Window;

use super::criterion::Criterion;
use super::state::{Configuration, WindowState};
use crate::descent::{DescentModel, WindowForces};
use crate::error::{Location, RunError};
use crate::partners::{LoadOverWindow, Partners};
use crate::schemes::unknowns::Unknowns;

/// Solvers and data of a window for a coupling scheme.
pub struct Solvers<'a> {
    /// Structure, mesh and flow.
    pub partners: &'a mut dyn Partners,
    /// Layout of the unknowns.
    pub unknowns: &'a Unknowns,
    /// The descent equation.
    pub descent: Option<&'a DescentModel>,
    /// Convergence criterion.
    pub criterion: &'a Criterion,
    /// Stage, for messages.
    pub stage: &'a str,
}

impl Solvers<'_> {
    /// Moves the grid to a configuration of the canopy and solves the flow around it: its load is stored in
    /// [`WindowState::end`].
    ///
    /// # Errors
    /// Errors of the programs; a load that is not finite.
    pub fn flow_around(
        &mut self,
        state: &mut WindowState,
        configuration: Configuration,
    ) -> Result<(), RunError> {
        let w = state.window;
        self.flow_in(&w, state, configuration)
    }

    /// The same in a window `w` of the flow.
    ///
    /// # Errors
    /// As above.
    pub fn flow_in(
        &mut self,
        w: &Window,
        state: &mut WindowState,
        configuration: Configuration,
    ) -> Result<(), RunError> {
        let displacement = match configuration {
            Configuration::Start => &state.interface.displacement,
            Configuration::Iterate => self.unknowns.displacement(&state.x),
            Configuration::End => &state.end.displacement,
        };
        let response = self.partners.mesh(w, displacement)?;
        state.report.add(Role::Mesh, response);
        let response = self.partners.flow(w, &mut state.end.load)?;
        state.report.add(Role::Flow, response);
        finite(self.stage, "flow response", w, &state.end.load)
    }

    /// Solves the structure under `load`: its displacement is stored in [`WindowState::end`].
    ///
    /// # Errors
    /// Errors of the program; a displacement that is not finite.
    pub fn structure_under(
        &mut self,
        state: &mut WindowState,
        load: LoadOverWindow<'_>,
    ) -> Result<(), RunError> {
        let w = Window { iteration: state.structure_solves, ..state.window };
        state.structure_solves += 1;
        let response = self.partners.structure(&w, load, &mut state.end.displacement)?;
        state.report.add(Role::Structure, response);
        finite(self.stage, "response of the structure", &w, &state.end.displacement)
    }

    /// Solves the descent equation after flow and structure: the frame's velocity is stored in [`WindowState::end`].
    pub fn descend(&self, state: &mut WindowState) {
        self.descend_under(state, state.report.force);
    }

    /// The same with another force of the air on the canopy at the end of the window, N.
    pub fn descend_under(&self, state: &mut WindowState, force: [f64; 3]) {
        state.end.velocity = match self.descent {
            Some(model) => {
                let measured = state.report.forces(state.window.frame_acceleration);
                let forces = WindowForces { canopy: force.into(), ..measured };
                model.end_velocity(state.interface.velocity, &forces, state.window.dt)
            }
            None => state.interface.velocity,
        };
    }

    /// The load at the start of the window, `[faces][LOAD_WIDTH]`, Pa. An unknown one is obtained by a flow solve
    /// around the canopy there, at the present frame velocity, which counts as an iteration.
    ///
    /// # Errors
    /// Errors of the programs.
    pub fn start_load(&mut self, state: &mut WindowState) -> Result<Vec<f64>, RunError> {
        if let Some(load) = &state.interface.load {
            return Ok(load.clone());
        }
        self.flow_around(state, Configuration::Start)?;
        state.window.iteration += 1;
        state.set_unknown_start_load();
        Ok(state.end.load.clone())
    }
}

/// An error where a value is not finite.
pub(crate) fn finite(stage: &str, who: &str, w: &Window, values: &[f64]) -> Result<(), RunError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(RunError::Coupling {
            place: Location { stage: stage.to_owned(), window: Some((w.index, w.iteration)) },
            message: format!("the {who} holds {} at position {at}", values[at]),
        }),
    }
}
