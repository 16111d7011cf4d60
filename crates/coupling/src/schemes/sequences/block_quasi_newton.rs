//! Interface block quasi-Newton.

use case::Coupling;

use super::extrapolate::MAX_ORDER;
use super::gauss_seidel::{AppliedLoad, GaussSeidel, flow_around_iterate, respond_to_flow};
use super::inner_solve::{FlowSolve, InnerSolve};
use super::predictor::Predictor;
use crate::error::RunError;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::least_squares::norm;
use crate::schemes::window::scheme::{CouplingScheme, FromSurrogate, SchemeSettings, Surrogate};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::WindowState;

/// Changes of the surrogate's load below this fraction of the load add no column; the tolerance is the limit where it
/// is smaller, since the flow is then solved more accurately.
const LEAST_STEP: f64 = 1e-3;

/// Tolerance of the structure's solution against the surrogate, relative to the residual of the window.
const INNER_TOLERANCE: f64 = 0.02;
/// The same around an immersed canopy, to whose flow the surrogate is less near: an iteration leaves a third of the
/// residual. ATPS after 110 s of descent, 100 windows: 613, 613, 627 iterations and 5.2, 4.8, 4.2 s of the structure
/// with 0.02, 0.05, 0.1.
const INNER_TOLERANCE_IMMERSED: f64 = 0.05;

/// Interface block quasi-Newton (IBQN-LS; Vierendeels et al. 2007) with the structure itself instead of its Jacobian:
/// a flow solve at the iterate, then structure and descent solved against the flow's last response, the surrogate's
/// added-mass load and the secants of the flow. The flow's Jacobian varies slowly from window to window, unlike that
/// of a wrinkling structure, so its secants remain valid for many windows.
pub struct BlockQuasiNewton {
    inner: InnerSolve,
    motions: Predictor,
    defects: Predictor,
    defect: Vec<f64>,
    /// The last sweep in this window.
    last: Option<LastSweep>,
    has_history: bool,
    /// A closed volume was found in this sweep: its iterate is far off, and the next solve starts again from that of the window.
    restart: bool,
    applied: AppliedLoad,
}

/// What the surrogate had, and lacked, at a flow solve.
struct LastSweep {
    /// Its added-mass load.
    added_mass_load: Vec<f64>,
    /// Swept volume, m3.
    swept_volume: f64,
    defect: Vec<f64>,
}

impl FromSurrogate for BlockQuasiNewton {
    type Fallback = GaussSeidel;

    fn from_surrogate(settings: SchemeSettings<'_>, surrogate: Surrogate) -> Self {
        let defect = vec![0.0; surrogate.model.response_len()];
        let load = settings.coupling.load_shape();
        Self {
            inner: InnerSolve::new(surrogate, load, &settings.unknowns),
            motions: Predictor::from_start(MAX_ORDER, &settings.start()),
            defects: Predictor::new(MAX_ORDER),
            defect,
            last: None,
            has_history: false,
            restart: false,
            applied: AppliedLoad::new(load),
        }
    }

    fn describe(_coupling: &Coupling) -> String {
        "block quasi-Newton with an added-mass surrogate and secants of the flow".into()
    }
}

impl BlockQuasiNewton {
    /// Adds the secant of the last two sweeps of this window to the surrogate.
    fn add_secant(&mut self, state: &WindowState, solvers: &Solvers<'_>) {
        let swept_volume = self.inner.model.swept_volume(&state.x);
        if let Some(last) = self.last.take() {
            let before = &last.added_mass_load;
            let step: Vec<f64> = self.inner.response.iter().zip(before).map(|(a, b)| a - b).collect();
            let change = self.defect.iter().zip(&last.defect).map(|(a, b)| a - b).collect();
            let least = LEAST_STEP.min(solvers.criterion.tolerance);
            let (volume, load) = (swept_volume - last.swept_volume, norm(&state.end.load));
            self.restart = self.inner.model.add_column(step, volume, change, least, load);
            if self.restart {
                self.inner.reset_acceleration();
            }
        }
        let added_mass_load = self.inner.response.clone();
        self.last = Some(LastSweep { added_mass_load, swept_volume, defect: self.defect.clone() });
    }
}

impl CouplingScheme for BlockQuasiNewton {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        let dt = state.window.dt;
        (self.last, self.restart) = (None, false);
        if let Some(defects) = self.inner.update_surrogate(dt) {
            self.defects = Predictor::new(MAX_ORDER);
            defects.iter().for_each(|(defect, dt)| self.defects.accept(defect, *dt));
        }
        self.motions.predict(dt, &mut state.x);
        if self.has_history {
            self.defects.predict(dt, &mut self.inner.defect);
            let tolerance = (0.1 * solvers.criterion.tolerance).max(1e-3);
            self.inner.x.copy_from_slice(&state.x);
            self.inner.solve(state, solvers, None, tolerance)?;
            state.x.copy_from_slice(&self.inner.x);
        }
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        flow_around_iterate(state, solvers)?;
        self.inner.measure_defect(state, &state.x, &mut self.defect);
        self.add_secant(state, solvers);
        respond_to_flow(state, solvers, &mut self.applied)
    }

    fn improve(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<bool, RunError> {
        let outer = state.report.residual.unwrap_or(1.0);
        let share =
            if self.inner.model.is_first_order() { INNER_TOLERANCE_IMMERSED } else { INNER_TOLERANCE };
        let tolerance = (0.2 * solvers.criterion.tolerance).max(share * outer.min(1.0));
        let restart = std::mem::take(&mut self.restart);
        self.inner.x.copy_from_slice(if restart { &state.start } else { &state.x });
        self.inner.defect.copy_from_slice(&self.defect);
        let about = self.last.as_ref().map(|last| FlowSolve {
            added_mass_load: &last.added_mass_load,
            swept_volume: last.swept_volume,
        });
        let reached = self.inner.solve(state, solvers, about, tolerance)?;
        state.next.copy_from_slice(&self.inner.x);
        Ok(reached < 0.5 * outer)
    }

    fn reset(&mut self, rejected: bool) {
        self.inner.reset_acceleration();
        if rejected {
            self.inner.model.reset();
            self.inner.model.open_volume();
        }
    }

    fn accept(&mut self, state: &WindowState) {
        let dt = state.window.dt;
        self.has_history = true;
        self.defects.accept(&self.defect, dt);
        if let Some(start) = &state.interface.load_before {
            self.inner.model.compare_volume(&state.x, start, &state.end.load);
        }
        // The grid is at the iterate.
        self.inner.accept(&state.x, &self.defect, dt);
        self.motions.accept(&state.x_tilde, dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(&self.motions, &self.defects, self.has_history, self.inner.save_state()))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let inner: Vec<u8>;
        (self.motions, self.defects, self.has_history, inner) = unpack(saved)?;
        self.inner.restore_state(&inner)
    }
}
