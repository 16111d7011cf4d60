//! The Gauss-Seidel sweep, and the implicit scheme that repeats it.

use case::{Coupling, LoadShape};

use super::predictor::Predictor;
use crate::error::RunError;
use crate::partners::LoadOverWindow;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::window::load_shape::shape_load;
use crate::schemes::window::scheme::{CouplingScheme, FromScene, SchemeSettings};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::{Configuration, WindowState};

/// The load on the structure over the substeps of a window, each `[faces][LOAD_WIDTH]`, Pa.
pub struct AppliedLoad {
    shape: LoadShape,
    start: Vec<f64>,
    end: Vec<f64>,
}

impl AppliedLoad {
    /// With this interpolation over the substeps.
    pub fn new(shape: LoadShape) -> Self {
        Self { shape, start: Vec::new(), end: Vec::new() }
    }

    /// For the flow's load `end` at the end of the window.
    pub fn over_window(&mut self, state: &WindowState, end: &[f64]) -> LoadOverWindow<'_> {
        self.start.resize(end.len(), 0.0);
        self.end.resize(end.len(), 0.0);
        shape_load(self.shape, state.loads(end), &mut self.start, &mut self.end);
        LoadOverWindow { start: &self.start, end: &self.end }
    }
}

/// One Gauss-Seidel sweep (paper, section 4): mesh and flow around the iterate, structure under the flow's load,
/// descent under its force.
///
/// # Errors
/// Errors of the solvers.
pub fn gauss_seidel_sweep(
    state: &mut WindowState,
    solvers: &mut Solvers<'_>,
    applied: &mut AppliedLoad,
) -> Result<(), RunError> {
    flow_around_iterate(state, solvers)?;
    respond_to_flow(state, solvers, applied)
}

/// The sweep's first half: mesh and flow around the iterate, in a frame with its velocity.
///
/// # Errors
/// Errors of the solvers.
pub fn flow_around_iterate(state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
    state.set_frame_to_iterate(solvers.unknowns);
    solvers.flow_around(state, Configuration::Iterate)
}

/// The sweep's second half: structure and descent under the flow's last load, which also replaces an unknown load at
/// the start of the window.
///
/// # Errors
/// Errors of the solvers.
pub fn respond_to_flow(
    state: &mut WindowState,
    solvers: &mut Solvers<'_>,
    applied: &mut AppliedLoad,
) -> Result<(), RunError> {
    state.set_unknown_start_load();
    let load = applied.over_window(state, &state.end.load);
    solvers.structure_under(state, load)?;
    solvers.descend(state);
    state.pack_response(solvers.unknowns);
    Ok(())
}

/// Implicit Gauss-Seidel coupling. The unknowns are displacement and descent speed.
pub struct GaussSeidel {
    applied: AppliedLoad,
    predictor: Predictor,
}

impl FromScene for GaussSeidel {
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        Self {
            applied: AppliedLoad::new(settings.coupling.load_shape()),
            predictor: Predictor::from_start(2, &settings.start()),
        }
    }

    fn describe(_coupling: &Coupling) -> String {
        "implicit".into()
    }
}

impl CouplingScheme for GaussSeidel {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        self.predictor.predict(state.window.dt, &mut state.x);
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        gauss_seidel_sweep(state, solvers, &mut self.applied)
    }

    fn accept(&mut self, state: &WindowState) {
        self.predictor.accept(&state.x_tilde, state.window.dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&self.predictor)
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        self.predictor = unpack(saved)?;
        Ok(())
    }
}
