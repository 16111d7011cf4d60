//! Staggered schemes: each solver once per window.

use case::{Coupling, DescentEquation};

use super::extrapolate::TimeHistory;
use super::gauss_seidel::{AppliedLoad, gauss_seidel_sweep};
use crate::error::RunError;
use crate::partners::LoadOverWindow;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::window::scheme::{CouplingScheme, FromScene, SchemeSettings};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::{Configuration, WindowState};

/// Serial staggered, structure first: the structure's substeps under a load extrapolated with order $`k`$, then mesh,
/// flow and descent. $`k = 0`$ is the paper's scheme, first order in time; for $`k \ge 1`$ it is second order (load and
/// frame velocity are then second order).
pub struct StructureFirstSerialStaggered {
    order: usize,
    loads: TimeHistory,
    velocities: TimeHistory,
    predicted: Vec<f64>,
}

impl FromScene for StructureFirstSerialStaggered {
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        // A load of an earlier stage belongs to windows of another length.
        let (loads, velocities) =
            (TimeHistory::default(), TimeHistory::from_start(&settings.interface.velocity));
        Self { order: settings.predictor(), loads, velocities, predicted: Vec::new() }
    }

    fn describe(coupling: &Coupling) -> String {
        match coupling.staggered.predictor {
            0 => "each program once per window, under the load of the last window".into(),
            order => format!("structure first, under loads extrapolated with order {order}"),
        }
    }
}

impl CouplingScheme for StructureFirstSerialStaggered {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, _state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        let mut velocity = state.interface.velocity;
        self.velocities.extrapolate(self.order, state.window.dt, &mut velocity);
        state.set_frame_velocity(velocity);
        let start = solvers.start_load(state)?;
        self.predicted.clone_from(&start);
        self.loads.extrapolate(self.order, state.window.dt, &mut self.predicted);
        solvers.structure_under(state, LoadOverWindow { start: &start, end: &self.predicted })?;
        solvers.flow_around(state, Configuration::End)?;
        solvers.descend(state);
        state.pack_response(solvers.unknowns);
        Ok(())
    }

    fn accept(&mut self, state: &WindowState) {
        self.loads.push(&state.end.load, state.window.dt);
        self.velocities.push(&state.end.velocity, state.window.dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(&self.loads, &self.velocities))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        (self.loads, self.velocities) = unpack(saved)?;
        Ok(())
    }
}

/// Conventional serial staggered (Farhat and Lesoinne 2000; Piperno's generalised form): one Gauss-Seidel sweep from
/// unknowns extrapolated with order $`k`$. Order in time $`k + 1`$, at most two.
pub struct ConventionalSerialStaggered {
    order: usize,
    applied: AppliedLoad,
    motions: TimeHistory,
}

impl FromScene for ConventionalSerialStaggered {
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        let applied = AppliedLoad::new(settings.coupling.load_shape());
        Self { order: settings.predictor(), applied, motions: TimeHistory::from_start(&settings.start()) }
    }

    fn describe(coupling: &Coupling) -> String {
        format!("flow first, around a canopy extrapolated with order {}", coupling.staggered.predictor)
    }
}

impl CouplingScheme for ConventionalSerialStaggered {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        self.motions.extrapolate(self.order, state.window.dt, &mut state.x);
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        gauss_seidel_sweep(state, solvers, &mut self.applied)
    }

    fn accept(&mut self, state: &WindowState) {
        self.motions.push(&state.x_tilde, state.window.dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&self.motions)
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        self.motions = unpack(saved)?;
        Ok(())
    }
}

/// Improved serial staggered (Lesoinne and Farhat 1998): the flow's windows end at the midpoints of the structure's.
/// The canopy is extrapolated to the midpoint with order $`k`$; the flow's response is the load of the structure's
/// whole window. Second order in time for $`k \ge 1`$.
///
/// The flow starts half a window before the structure, which has no effect where the flow is developed or at rest.
pub struct ImprovedSerialStaggered {
    order: usize,
    motions: TimeHistory,
    load: Vec<f64>,
}

impl FromScene for ImprovedSerialStaggered {
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        let motions = TimeHistory::from_start(&settings.start());
        Self { order: settings.predictor(), motions, load: Vec::new() }
    }

    fn describe(coupling: &Coupling) -> String {
        let order = coupling.staggered.predictor;
        format!("flow half a window ahead, around a canopy extrapolated with order {order}")
    }
}

impl CouplingScheme for ImprovedSerialStaggered {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        self.motions.extrapolate(self.order, 0.5 * state.window.dt, &mut state.x);
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        state.set_frame_to_iterate(solvers.unknowns);
        let mut half = state.window;
        half.time -= 0.5 * half.dt;
        solvers.flow_in(&half, state, Configuration::Iterate)?;
        state.set_unknown_start_load();
        self.load.clone_from(&state.end.load);
        let load = LoadOverWindow { start: &self.load, end: &self.load };
        if solvers.descent.is_some_and(|d| d.equation == DescentEquation::QuasiSteady) {
            // The frame's mean acceleration over the structure's window follows from the same force.
            solvers.descend(state);
            state.window.frame_acceleration = state.frame_acceleration(state.end.velocity);
            solvers.structure_under(state, load)?;
        } else {
            // It follows from the structure, whose own contribution is small: use that of the window before.
            state.window.frame_acceleration = state.interface.acceleration;
            solvers.structure_under(state, load)?;
            solvers.descend(state);
        }
        state.pack_response(solvers.unknowns);
        Ok(())
    }

    fn accept(&mut self, state: &WindowState) {
        self.motions.push(&state.x_tilde, state.window.dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&self.motions)
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        self.motions = unpack(saved)?;
        Ok(())
    }
}
