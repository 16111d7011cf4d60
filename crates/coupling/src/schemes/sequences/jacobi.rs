//! The implicit scheme in Jacobi order.

use case::Coupling;

use super::gauss_seidel::{AppliedLoad, flow_around_iterate};
use super::predictor::Predictor;
use crate::error::RunError;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::window::scheme::{CouplingScheme, FromScene, SchemeSettings};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::WindowState;

/// Jacobi: flow at the displacement of the iterate, structure under its load, each independent of the other's
/// response. The unknowns are displacement, descent speed and load.
pub struct Jacobi {
    applied: AppliedLoad,
    predictor: Predictor,
    /// Load of the iterate, `[faces][LOAD_WIDTH]`, Pa.
    iterate: Vec<f64>,
}

impl FromScene for Jacobi {
    /// The unknowns of the `settings` include loads.
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        let predictor = if settings.interface.load.is_some() {
            Predictor::from_start(2, &settings.start())
        } else {
            Predictor::new(2)
        };
        let iterate = vec![0.0; settings.unknowns.loads()];
        Self { applied: AppliedLoad::new(settings.coupling.load_shape()), predictor, iterate }
    }

    fn describe(_coupling: &Coupling) -> String {
        "implicit in Jacobi order".into()
    }
}

impl CouplingScheme for Jacobi {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        self.predictor.predict(state.window.dt, &mut state.x);
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        let known = state.interface.load.is_some();
        flow_around_iterate(state, solvers)?;
        if known {
            solvers.unknowns.load(&state.x, &mut self.iterate);
        } else {
            // No load to iterate from: in this sweep the structure follows the flow.
            self.iterate.clone_from(&state.end.load);
        }
        state.set_unknown_start_load();
        let load = self.applied.over_window(state, &self.iterate);
        solvers.structure_under(state, load)?;
        solvers.descend(state);
        state.pack_response(solvers.unknowns);
        solvers.unknowns.pack_load(&state.end.load, &mut state.x_tilde);
        Ok(())
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
