//! The structure solved against a surrogate of the flow, between two solves of the flow itself.
//!
//! The structure costs a hundredth of the flow here, and what couples them so tightly is the added mass
//! of the air, which [`FlowModel`] knows. So the structure is solved against the surrogate as often
//! as it takes, with all of its wrinkles; the flow is asked about the result.

use std::collections::VecDeque;

use case::LoadShape;
use serde::{Deserialize, Serialize};

use super::extrapolate::MOST_ORDER;
use super::gauss_seidel::AppliedLoad;
use crate::error::RunError;
use crate::schemes::acceleration::accelerator::Accelerator;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::flow_model::surrogate::FlowModel;
use crate::schemes::unknowns::Unknowns;
use crate::schemes::window::scheme::Modelled;
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::WindowState;

/// Structure solves against the surrogate at most between two solves of the flow.
const MOST_SOLVES: usize = 25;

/// Windows whose ends are kept: what the highest order of extrapolation takes, and one to choose the order by.
const ENDS: usize = MOST_ORDER + 2;

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
    pub model: FlowModel,
    /// Newest first.
    ends: VecDeque<WindowEnd>,
    applied: AppliedLoad,
    accelerator: Box<dyn Accelerator>,
    /// The surrogate's inertia, and with the defect its response: `[faces][LOAD_WIDTH]` (Pa), then the vertical
    /// force (N).
    pub response: Vec<f64>,
    /// What the surrogate's inertia is added to, likewise.
    pub defect: Vec<f64>,
    /// The iterate, and after a solve the unknowns that came closest to equilibrium.
    pub x: Vec<f64>,
    x_tilde: Vec<f64>,
    next: Vec<f64>,
    best: Vec<f64>,
}

impl InnerSolve {
    /// Against `surrogate`, with this shape of the load over the substeps.
    pub fn new(surrogate: Modelled, load: LoadShape, unknowns: &Unknowns) -> Self {
        let Modelled { model, accelerator } = surrogate;
        let (n, m) = (unknowns.len(), model.answers());
        Self {
            model,
            ends: VecDeque::new(),
            applied: AppliedLoad::new(load),
            accelerator,
            response: vec![0.0; m],
            defect: vec![0.0; m],
            x: vec![0.0; n],
            x_tilde: vec![0.0; n],
            next: vec![0.0; n],
            best: vec![0.0; n],
        }
    }

    /// Solves structure and descent against the defect, which the secants change with the inertia
    /// from `about` on where given, from [`InnerSolve::x`] on, to `tolerance`. Returns the measure that was reached.
    ///
    /// # Errors
    /// Those of the structure.
    pub fn solve(
        &mut self,
        state: &mut WindowState,
        solvers: &mut Solvers<'_>,
        about: Option<&[f64]>,
        tolerance: f64,
    ) -> Result<f64, RunError> {
        let _part = timing::part("inner solve");
        self.accelerator.begin_window();
        let mut best = f64::INFINITY;
        for count in 1..=MOST_SOLVES {
            self.predict_response(state.window.dt, about);
            self.solve_structure(state, solvers)?;
            let measure = solvers.criterion.measure(&self.x, &self.x_tilde, &state.start);
            if measure < best {
                best = measure;
                self.best.copy_from_slice(&self.x);
            }
            if measure <= tolerance || count == MOST_SOLVES || !measure.is_finite() {
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

    /// The surrogate's response to the iterate at the end of a window of length `dt`.
    fn predict_response(&mut self, dt: f64, about: Option<&[f64]>) {
        self.model.inertia(&self.x, dt, &mut self.response);
        if let Some(about) = about {
            let change: Vec<f64> = self.response.iter().zip(about).map(|(x, a)| x - a).collect();
            self.model.correct(&change, &mut self.response);
        }
        self.response.iter_mut().zip(&self.defect).for_each(|(a, r)| *a += r);
    }

    /// Structure and descent under the surrogate's response.
    fn solve_structure(
        &mut self,
        state: &mut WindowState,
        solvers: &mut Solvers<'_>,
    ) -> Result<(), RunError> {
        let (loads, force) = self.response.split_at(self.response.len() - 1);
        state.set_frame_velocity(solvers.unknowns.velocity(&self.x, state.interface.velocity));
        let load = self.applied.over_window(state, loads);
        solvers.structure_under(state, load)?;
        solvers.descend_under(state, force[0]);
        solvers.unknowns.pack(&state.end.displacement, state.end.velocity, &mut self.x_tilde);
        Ok(())
    }

    /// The defect of the surrogate in the flow's response of this window, with the grid at the unknowns `x`.
    pub fn measure_defect(&mut self, state: &WindowState, x: &[f64], defect: &mut [f64]) {
        self.model.inertia(x, state.window.dt, &mut self.response);
        let force = state.report.force[2];
        let truth = state.end.load.iter().chain(std::iter::once(&force));
        for ((r, truth), inertia) in defect.iter_mut().zip(truth).zip(&self.response) {
            *r = truth - inertia;
        }
    }

    /// Lets the surrogate follow the canopy before a window of length `dt`. Where its lattice is reassembled: its
    /// defects in past windows, oldest first, with their lengths.
    pub fn follow(&mut self, dt: f64) -> Option<Vec<(Vec<f64>, f64)>> {
        let lattice = self.model.follow(dt)?;
        self.accelerator.reshape(&lattice);
        let mut inertia = vec![0.0; self.response.len()];
        let defects = self.ends.iter().rev().map(|end| {
            self.model.inertia_of(&end.acceleration, &mut inertia);
            (end.response.iter().zip(&inertia).map(|(response, i)| response - i).collect(), end.dt)
        });
        Some(defects.collect())
    }

    /// A window of length `dt` ended with the grid at the unknowns `x` and this defect.
    pub fn accept(&mut self, x: &[f64], defect: &[f64], dt: f64) {
        let acceleration = self.model.acceleration(x, dt);
        self.model.inertia_of(&acceleration, &mut self.response);
        let response = self.response.iter().zip(defect).map(|(i, r)| i + r).collect();
        self.ends.push_front(WindowEnd { response, acceleration, dt });
        self.ends.truncate(ENDS);
        self.model.accept(x, dt);
    }

    /// Resets the columns of the acceleration.
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
        if let Some(lattice) = self.model.restore_state(&model)? {
            self.accelerator.reshape(&lattice);
        }
        self.ends = ends;
        self.accelerator.restore_state(&accelerator)
    }
}
