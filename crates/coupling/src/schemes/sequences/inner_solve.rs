//! Solution of the structure against the surrogate of the flow, between two flow solves.
//!
//! A structure solve costs a hundredth of a flow solve here, and the strong coupling is due to the added mass of the
//! air, which [`AddedMassSurrogate`] contains. The structure is therefore iterated against the surrogate, with its
//! full nonlinearity, before the next flow solve.

use std::collections::VecDeque;

use case::LoadShape;
use serde::{Deserialize, Serialize};

use super::extrapolate::MAX_ORDER;
use super::gauss_seidel::AppliedLoad;
use crate::error::RunError;
use crate::schemes::acceleration::accelerator::Accelerator;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::surrogate::added_mass_surrogate::{AddedMassSurrogate, SurrogateUpdate};
use crate::schemes::unknowns::Unknowns;
use crate::schemes::window::scheme::Surrogate;
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::WindowState;

/// Largest number of structure solves against the surrogate between two flow solves.
const MAX_SOLVES: usize = 25;

/// Largest pressure of the surrogate, relative to the largest one of the flow in the last window and this one.
const MOST_PRESSURE: f64 = 10.0;

/// Number of window ends in the history: the highest order of extrapolation, plus one to select the order.
const ENDS: usize = MAX_ORDER + 2;

/// The flow's response at the end of a window.
#[derive(Serialize, Deserialize)]
struct WindowEnd {
    response: Vec<f64>,
    /// Acceleration of the canopy, `[nodes][3]`, m/s2.
    acceleration: Vec<f64>,
    dt: f64,
}

/// The structure in equilibrium with the surrogate.
pub struct InnerSolve {
    /// The surrogate.
    pub model: AddedMassSurrogate,
    /// Newest first.
    ends: VecDeque<WindowEnd>,
    applied: AppliedLoad,
    accelerator: Box<dyn Accelerator>,
    /// Added-mass load of the surrogate, plus the defect where it is the response: `[faces][LOAD_WIDTH]` (Pa), then
    /// the vertical force (N).
    pub response: Vec<f64>,
    /// Defect of the surrogate in the same layout.
    pub defect: Vec<f64>,
    /// The iterate, and after a solve the unknowns closest to equilibrium.
    pub x: Vec<f64>,
    /// Added-mass load of the surrogate at `loaded_at`, in the layout of the response.
    added_mass_load: Vec<f64>,
    /// Unknowns, and length of the window (s): 0 where no load is known.
    loaded_at: (Vec<f64>, f64),
    x_tilde: Vec<f64>,
    next: Vec<f64>,
    best: Vec<f64>,
}

/// What the surrogate had at a flow solve, about which secants correct it.
#[derive(Clone, Copy)]
pub struct FlowSolve<'a> {
    /// Its added-mass load, in the layout of the response.
    pub added_mass_load: &'a [f64],
    /// Swept volume, m3.
    pub swept_volume: f64,
}

impl InnerSolve {
    /// Against `surrogate`, with this interpolation of the load over the substeps.
    pub fn new(surrogate: Surrogate, load: LoadShape, unknowns: &Unknowns) -> Self {
        let Surrogate { model, accelerator } = surrogate;
        let (n, m) = (unknowns.len(), model.response_len());
        Self {
            model,
            ends: VecDeque::new(),
            applied: AppliedLoad::new(load),
            accelerator,
            response: vec![0.0; m],
            defect: vec![0.0; m],
            x: vec![0.0; n],
            added_mass_load: vec![0.0; m],
            loaded_at: (vec![0.0; n], 0.0),
            x_tilde: vec![0.0; n],
            next: vec![0.0; n],
            best: vec![0.0; n],
        }
    }

    /// Solves structure and descent against the surrogate plus defect, starting from [`InnerSolve::x`], to
    /// `tolerance`. Secants correct the defect for the change of the added-mass load from the last flow solve `about` of the window, where there was one.
    /// Returns the relative residual.
    ///
    /// # Errors
    /// Errors of the structure.
    pub fn solve(
        &mut self,
        state: &mut WindowState,
        solvers: &mut Solvers<'_>,
        about: Option<FlowSolve<'_>>,
        tolerance: f64,
    ) -> Result<f64, RunError> {
        let _part = timing::part("inner solve");
        let known = self.known_volume(about);
        let stiffness = if known.is_some() { self.model.volume_stiffness() } else { 0.0 };
        self.accelerator.stiffen(stiffness, state.window.dt);
        self.accelerator.begin_window();
        let mut best = f64::INFINITY;
        for count in 1..=MAX_SOLVES {
            self.predict_response(state.window.dt, about);
            self.bound_response(state);
            self.solve_structure(state, solvers)?;
            let residual = solvers.criterion.relative_residual(&self.x, &self.x_tilde, &state.start);
            if residual < best {
                best = residual;
                self.best.copy_from_slice(&self.x);
            }
            if residual <= tolerance || count == MAX_SOLVES || !residual.is_finite() {
                break;
            }
            self.accelerator.next(&self.x, &self.x_tilde, &mut self.next);
            std::mem::swap(&mut self.x, &mut self.next);
            if !self.x.iter().all(|x| x.is_finite()) {
                break;
            }
        }
        self.accelerator.end_window(&self.x, &self.x_tilde);
        if best.is_finite() {
            self.x.copy_from_slice(&self.best);
        }
        Ok(best)
    }

    /// Swept volume (m3) whose pressure the defect contains: at the last flow solve `about` of the window; before it at the start of the window, if the volume
    /// stores the air. `None`: none is known.
    fn known_volume(&self, about: Option<FlowSolve<'_>>) -> Option<f64> {
        let start = || self.model.stores_volume().then(|| self.model.swept_volume_at_start());
        about.map(|about| about.swept_volume).or_else(start)
    }

    /// Computes the added-mass load at the unknowns `x` at the end of a window of length `dt`, unless it is known: a flow solve takes up the last
    /// iterate, and the next solution begins there.
    fn load_at(&mut self, x: &[f64], dt: f64) {
        if (self.loaded_at.0.as_slice(), self.loaded_at.1) != (x, dt) {
            self.model.added_mass_load(x, dt, &mut self.added_mass_load);
            self.loaded_at.0.copy_from_slice(x);
            self.loaded_at.1 = dt;
        }
    }

    /// The surrogate's response to the iterate at the end of a window of length `dt`.
    fn predict_response(&mut self, dt: f64, about: Option<FlowSolve<'_>>) {
        let x = std::mem::take(&mut self.x);
        self.load_at(&x, dt);
        self.x = x;
        self.response.copy_from_slice(&self.added_mass_load);
        if let Some(known) = self.known_volume(about) {
            self.model.add_volume_pressure(self.model.swept_volume(&self.x) - known, &mut self.response);
        }
        if let Some(FlowSolve { added_mass_load: about, .. }) = about {
            let change: Vec<f64> = self.added_mass_load.iter().zip(about).map(|(x, a)| x - a).collect();
            self.model.apply_correction(&change, &mut self.response);
        }
        self.response.iter_mut().zip(&self.defect).for_each(|(a, r)| *a += r);
    }

    /// Bounds the pressures by a multiple of the largest one that the flow gave: those of a surrogate far from its canopy would tear the structure.
    /// No window is accepted under them.
    fn bound_response(&mut self, state: &WindowState) {
        let known =
            state.interface.load.iter().chain((state.report.iterations > 0).then_some(&state.end.load));
        let largest = known.flatten().fold(0.0f64, |most, p| most.max(p.abs()));
        if largest > 0.0 {
            let most = MOST_PRESSURE * largest;
            let loads = self.model.loads_len();
            self.response[..loads].iter_mut().for_each(|p| *p = p.clamp(-most, most));
        }
    }

    /// Structure and descent under the surrogate's response.
    fn solve_structure(
        &mut self,
        state: &mut WindowState,
        solvers: &mut Solvers<'_>,
    ) -> Result<(), RunError> {
        let (loads, forces) = self.response.split_at(self.model.loads_len());
        let mut force = state.report.force;
        force[self.model.force_axes()].copy_from_slice(forces);
        state.set_frame_velocity(solvers.unknowns.velocity(&self.x, state.interface.velocity));
        let load = self.applied.over_window(state, loads);
        solvers.structure_under(state, load)?;
        solvers.descend_under(state, force);
        solvers.unknowns.pack(&state.end.displacement, state.end.velocity, &mut self.x_tilde);
        Ok(())
    }

    /// The defect of the surrogate in the flow's response of this window, with the grid at the unknowns `x`.
    pub fn measure_defect(&mut self, state: &WindowState, x: &[f64], defect: &mut [f64]) {
        self.load_at(x, state.window.dt);
        self.response.copy_from_slice(&self.added_mass_load);
        let truth = state.end.load.iter().chain(&state.report.force[self.model.force_axes()]);
        for ((r, truth), added_mass_load) in defect.iter_mut().zip(truth).zip(&self.response) {
            *r = truth - added_mass_load;
        }
    }

    /// Updates the surrogate for the present canopy before a window of length `dt`. Where that changes it: its defects
    /// in past windows, oldest first, with their lengths.
    pub fn update_surrogate(&mut self, dt: f64) -> Option<Vec<(Vec<f64>, f64)>> {
        let update = self.model.update(dt)?;
        self.follow(&update);
        let mut added_mass_load = vec![0.0; self.response.len()];
        let defects = self.ends.iter().rev().map(|end| {
            self.model.added_mass_load_of(&end.acceleration, &mut added_mass_load);
            (end.response.iter().zip(&added_mass_load).map(|(response, i)| response - i).collect(), end.dt)
        });
        Some(defects.collect())
    }

    /// The acceleration follows an update of the surrogate.
    fn follow(&mut self, update: &SurrogateUpdate) {
        self.loaded_at.1 = 0.0;
        match update {
            SurrogateUpdate::Reassembled(lattice) => self.accelerator.reshape(lattice),
            SurrogateUpdate::Turned(orientation) => self.accelerator.turn(orientation),
        }
    }

    /// A window of length `dt` ended with the grid at the unknowns `x` and this defect.
    pub fn accept(&mut self, x: &[f64], defect: &[f64], dt: f64) {
        let acceleration = self.model.acceleration(x, dt);
        self.model.added_mass_load_of(&acceleration, &mut self.response);
        let response = self.response.iter().zip(defect).map(|(i, r)| i + r).collect();
        self.ends.push_front(WindowEnd { response, acceleration, dt });
        self.ends.truncate(ENDS);
        self.model.accept(x, dt);
        self.loaded_at.1 = 0.0;
    }

    /// Drops the columns of the acceleration.
    pub fn reset_acceleration(&mut self) {
        self.accelerator.reset();
    }

    /// State that later windows depend on.
    pub fn save_state(&self) -> Vec<u8> {
        pack(&(self.model.save_state(), &self.ends, self.accelerator.save_state()))
    }

    /// Restores an [`InnerSolve::save_state`] of the same scheme.
    ///
    /// # Errors
    /// A state of another one.
    pub fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let (model, ends, accelerator): (Vec<u8>, _, Vec<u8>) = unpack(saved)?;
        self.model.restore_state(&model)?.iter().for_each(|update| self.follow(update));
        self.loaded_at.1 = 0.0;
        self.ends = ends;
        self.accelerator.restore_state(&accelerator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_axes::FrameAxes;
    use crate::schemes::acceleration::relaxation::Uniform;
    use crate::schemes::build::accelerator;
    use crate::schemes::surrogate::vortex_lattice::{Air, VortexLattice};
    use crate::schemes::test_support::plate;

    /// The load that is kept for an iterate is that of the surrogate, in another window, at another length of it and at other unknowns too.
    #[test]
    fn known_load_is_that_of_the_surrogate() {
        let (positions, faces) = plate(4);
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::None);
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let rest = vec![0.0; 3 * positions.len()];
        let air = Air::incompressible(1.2);
        let model = AddedMassSurrogate::new(unknowns, &lattice, &rest, [0.0; 3], &faces, air, usize::MAX)
            .expect("a plate");
        let iqn = accelerator(&case::Coupling::default(), unknowns.len(), Box::new(Uniform(0.5)));
        let mut inner = InnerSolve::new(Surrogate { model, accelerator: iqn }, LoadShape::Linear, &unknowns);
        let at = |by: f64| -> Vec<f64> { (0..unknowns.len()).map(|i| by * (0.3 * i as f64).sin()).collect() };
        let mut seen: Vec<Vec<f64>> = Vec::new();
        let mut load = |inner: &mut InnerSolve, x: &[f64], dt: f64| {
            let mut expected = vec![0.0; inner.model.response_len()];
            inner.model.added_mass_load(x, dt, &mut expected);
            for _ in 0..2 {
                inner.load_at(x, dt);
                assert_eq!(inner.added_mass_load, expected);
            }
            assert!(!seen.contains(&expected), "each motion has a load of its own");
            seen.push(expected);
        };
        load(&mut inner, &at(1.0), 0.1);
        load(&mut inner, &at(2.0), 0.1);
        load(&mut inner, &at(2.0), 0.2);
        let defect = vec![0.0; inner.response.len()];
        inner.accept(&at(2.0), &defect, 0.2);
        load(&mut inner, &at(2.0), 0.2);
    }
}
