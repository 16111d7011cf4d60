//! The staggered scheme with an implicit added mass.

use case::Coupling;

use super::extrapolate::{MOST_ORDER, Past};
use super::inner_solve::InnerSolve;
use super::predictor::Predictor;
use super::staggered::StructureFirst;
use crate::error::RunError;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::window::scheme::{CouplingScheme, FromSurrogate, Modelled, SchemeSettings};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::{Configuration, WindowState};

/// Staggered, but with the added mass implicit: the structure's substeps under the surrogate's load,
/// whose defect is extrapolated with order $k$, then mesh and flow around the result. One flow solve
/// in a window, of second order for $k \ge 1$.
///
/// Linear analysis (one mode, added mass 1e-3 to 300 times the fabric's, frequency of the dry
/// fabric times window 0 to 40, ten substeps, load shape `mean`, $k = 1$): no mode grows where the surrogate's
/// added mass is between 0.9 and 1.3 of the flow's; largest growth a window 1.9 at 0.7, 1.09 at 1.5.
/// The ATPS canopy on its grid is outside of that in some of its motions: there it blows up, and
/// [`super::block_quasi_newton::BlockQuasiNewton`], which learns them, is the cheapest that stands.
pub struct AddedMassStaggered {
    order: usize,
    inner: InnerSolve,
    motions: Predictor,
    defects: Past,
    defect: Vec<f64>,
}

/// The surrogate's density over the air's in [`AddedMassStaggered`]: the middle of what is stable.
pub const SAFE_DENSITY: f64 = 1.1;

impl FromSurrogate for AddedMassStaggered {
    type Fallback = StructureFirst;

    fn from_surrogate(settings: SchemeSettings<'_>, surrogate: Modelled) -> Self {
        let defect = vec![0.0; surrogate.model.answers()];
        let motions = Predictor::from_start(MOST_ORDER, &settings.start());
        let inner = InnerSolve::new(surrogate, settings.coupling.load_interpolation, &settings.unknowns);
        Self { order: settings.predictor(), inner, motions, defects: Past::default(), defect }
    }

    fn describe(coupling: &Coupling) -> String {
        let order = coupling.staggered.predictor;
        format!("structure first with added mass implicit, the rest extrapolated with order {order}")
    }
}

impl AddedMassStaggered {
    /// The first defect, from the flow around the canopy at rest.
    fn measure_first_defect(
        &mut self,
        state: &mut WindowState,
        solvers: &mut Solvers<'_>,
    ) -> Result<(), RunError> {
        state.set_frame_velocity(state.interface.velocity);
        solvers.flow_around(state, Configuration::Start)?;
        state.window.iteration += 1;
        self.inner.measure_defect(state, &state.x, &mut self.defect);
        self.defects.push(&self.defect, state.window.dt);
        state.know_start_load();
        Ok(())
    }
}

impl CouplingScheme for AddedMassStaggered {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        if self.defects.is_empty() {
            self.measure_first_defect(state, solvers)?;
        }
        if let Some(defects) = self.inner.follow(state.window.dt) {
            let mut past = Past::default();
            defects.iter().for_each(|(defect, dt)| past.push(defect, *dt));
            self.defects = past;
        }
        self.motions.predict(state.window.dt, &mut state.x);
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        self.inner.x.copy_from_slice(&state.x);
        self.defects.extrapolate(self.order, state.window.dt, &mut self.inner.defect);
        let measure = self.inner.solve(state, solvers, None, solvers.criterion.tolerance)?;
        state.report.residual = Some(measure);
        state.set_frame_velocity(state.end.velocity);
        solvers.flow_around(state, Configuration::End)?;
        state.pack_response(solvers.unknowns);
        self.inner.measure_defect(state, &state.x_tilde, &mut self.defect);
        Ok(())
    }

    fn reset(&mut self, _rejected: bool) {
        self.inner.reset_acceleration();
    }

    fn accept(&mut self, state: &WindowState) {
        let dt = state.window.dt;
        self.defects.push(&self.defect, dt);
        self.inner.accept(&state.x_tilde, &self.defect, dt);
        self.motions.accept(&state.x_tilde, dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(&self.motions, &self.defects, self.inner.save_state()))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let inner: Vec<u8>;
        (self.motions, self.defects, inner) = unpack(saved)?;
        self.inner.restore_state(&inner)
    }
}
