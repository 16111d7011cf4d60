//! Schemes that solve the structure against a model of the flow between two calls of it.
//!
//! The structure costs a hundredth of the flow here, and what couples them so tightly is the added mass
//! of the air, which [`FlowModel`] knows. So the structure is solved against the model as often
//! as it takes, with all of its wrinkles; the flow is asked about the result.

use std::collections::VecDeque;

use case::LoadShape;
use serde::{Deserialize, Serialize};

use super::extrapolate::{MOST_ORDER, Past};
use super::flow_model::FlowModel;
use super::least_squares::norm;
use super::load_shape::shape_load;
use super::memory::{pack, unpack};
use super::predictor::Predictor;
use super::sequence::{End, Sequence, Visit};
use super::staggered::{packed, structure_under_flow};
use super::{Accelerator, InterfaceState, Unknowns};
use crate::error::RunError;
use crate::partners::LoadOverWindow;

/// Structure solves against the model at most between two calls of the flow.
const MOST_SOLVES: usize = 25;

/// Changes of the model's load below this share of the load teach nothing, or below the tolerance where that is
/// smaller: the flow then solves more closely.
const LEAST_STEP: f64 = 1e-3;

/// Windows whose ends are kept: what the highest order of extrapolation takes, and one to choose the order by.
const ENDS: usize = MOST_ORDER + 2;

/// The flow's answer at the end of a window.
#[derive(Serialize, Deserialize)]
struct WindowEnd {
    answer: Vec<f64>,
    /// Acceleration of the canopy, `[nodes][3]`, m/s2.
    acceleration: Vec<f64>,
    dt: f64,
}

/// The structure in equilibrium with the model.
struct Balance {
    model: FlowModel,
    /// Newest first.
    ends: VecDeque<WindowEnd>,
    load: LoadShape,
    unknowns: Unknowns,
    accelerator: Box<dyn Accelerator>,
    felt: [Vec<f64>; 2],
    answer: Vec<f64>,
    /// What the model's inertia is added to.
    remainder: Vec<f64>,
    x_tilde: Vec<f64>,
    next: Vec<f64>,
    best: Vec<f64>,
}

impl Balance {
    fn new(model: FlowModel, load: LoadShape, unknowns: Unknowns, accelerator: Box<dyn Accelerator>) -> Self {
        let (n, m) = (unknowns.len(), model.answers());
        let faces = vec![0.0; m - 1];
        Self {
            model,
            ends: VecDeque::new(),
            load,
            unknowns,
            accelerator,
            felt: [faces.clone(), faces],
            answer: vec![0.0; m],
            remainder: vec![0.0; m],
            x_tilde: vec![0.0; n],
            next: vec![0.0; n],
            best: vec![0.0; n],
        }
    }

    /// Solves structure and descent against `remainder`, which the secants change with the inertia
    /// from `about` on where given, from `x` on into `x`, to `tolerance`. Returns the measure that
    /// was reached.
    fn solve(
        &mut self,
        visit: &mut Visit<'_>,
        about: Option<&[f64]>,
        tolerance: f64,
        x: &mut Vec<f64>,
    ) -> Result<f64, RunError> {
        self.accelerator.begin_window();
        let mut best = f64::INFINITY;
        let dt = visit.window.dt;
        for count in 1..=MOST_SOLVES {
            self.model.inertia(x, dt, &mut self.answer);
            if let Some(about) = about {
                let change: Vec<f64> = self.answer.iter().zip(about).map(|(x, a)| x - a).collect();
                self.model.correct(&change, &mut self.answer);
            }
            self.answer.iter_mut().zip(&self.remainder).for_each(|(a, r)| *a += r);
            let (loads, force) = self.answer.split_at(self.answer.len() - 1);
            let [felt_start, felt_end] = &mut self.felt;
            shape_load(self.load, visit.loads(loads), felt_start, felt_end);
            visit.fall(self.unknowns.velocity(x, visit.state.velocity));
            visit.structure_under(LoadOverWindow { start: felt_start, end: felt_end })?;
            visit.descend_under(force[0]);
            self.unknowns.pack(&visit.end.displacement, visit.end.velocity, &mut self.x_tilde);
            let measure = visit.criterion.measure(x, &self.x_tilde, visit.start);
            if measure < best {
                best = measure;
                self.best.copy_from_slice(x);
            }
            if measure <= tolerance || count == MOST_SOLVES || !measure.is_finite() {
                break;
            }
            self.accelerator.next(x, &self.x_tilde, &mut self.next);
            std::mem::swap(x, &mut self.next);
            if !x.iter().all(|x| x.is_finite()) {
                break;
            }
        }
        self.accelerator.end_window(x, &self.x_tilde);
        if best.is_finite() {
            x.copy_from_slice(&self.best);
        }
        Ok(best)
    }

    /// The flow's answer of this visit, and what the model's inertia leaves of it.
    fn measured(&mut self, visit: &Visit<'_>, x: &[f64], remainder: &mut [f64]) {
        self.model.inertia(x, visit.window.dt, &mut self.answer);
        let force = visit.report.force[2];
        let truth = visit.end.load.iter().chain(std::iter::once(&force));
        for ((r, truth), inertia) in remainder.iter_mut().zip(truth).zip(&self.answer) {
            *r = truth - inertia;
        }
    }

    /// Lets the model follow the canopy before a window of length `dt`. Where its lattice is a new one, what it
    /// leaves of the flow's answers in past windows, oldest first, with their lengths.
    fn follow(&mut self, dt: f64) -> Option<Vec<(Vec<f64>, f64)>> {
        let lattice = self.model.follow(dt)?;
        self.accelerator.reshape(&lattice);
        let mut inertia = vec![0.0; self.answer.len()];
        let remainders = self.ends.iter().rev().map(|end| {
            self.model.inertia_of(&end.acceleration, &mut inertia);
            (end.answer.iter().zip(&inertia).map(|(answer, i)| answer - i).collect(), end.dt)
        });
        Some(remainders.collect())
    }

    /// A window of length `dt` ended with the grid at the unknowns `x` and this remainder.
    fn accept(&mut self, x: &[f64], remainder: &[f64], dt: f64) {
        let acceleration = self.model.acceleration(x, dt);
        self.model.inertia_of(&acceleration, &mut self.answer);
        let answer = self.answer.iter().zip(remainder).map(|(i, r)| i + r).collect();
        self.ends.push_front(WindowEnd { answer, acceleration, dt });
        self.ends.truncate(ENDS);
        self.model.accept(x, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(self.model.memory(), &self.ends, self.accelerator.memory()))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let (model, ends, accelerator): (Vec<u8>, _, Vec<u8>) = unpack(memory)?;
        if let Some(lattice) = self.model.recall(&model)? {
            self.accelerator.reshape(&lattice);
        }
        self.ends = ends;
        self.accelerator.recall(&accelerator)
    }
}

/// Staggered, but with the added mass implicit: the structure's substeps under the model's load,
/// whose remainder is extrapolated with order $k$, then mesh and flow around the answer. One call of the flow
/// in a window, of second order for $k \ge 1$.
///
/// Linear analysis (one mode, added mass 1e-3 to 300 times the fabric's, frequency of the dry
/// fabric times window 0 to 40, ten substeps, load shape `mean`, $k = 1$): no mode grows where the model's
/// added mass is between 0.9 and 1.3 of the flow's; largest growth a window 1.9 at 0.7, 1.09 at 1.5.
/// The ATPS canopy on its grid is outside of that in some of its motions: there it blows up, and
/// [`BlockQuasiNewton`], which learns them, is the cheapest that stands.
pub struct AddedMassStaggered {
    order: usize,
    balance: Balance,
    motions: Predictor,
    remainders: Past,
    remainder: Vec<f64>,
    x: Vec<f64>,
}

/// The model's density over the air's in [`AddedMassStaggered`]: the middle of what is stable.
pub const SAFE_DENSITY: f64 = 1.1;

impl AddedMassStaggered {
    /// With this order of extrapolation, starting from `state`.
    pub fn new(
        order: usize,
        load: LoadShape,
        unknowns: Unknowns,
        state: &InterfaceState,
        model: FlowModel,
        accelerator: Box<dyn Accelerator>,
    ) -> Self {
        let remainder = vec![0.0; model.answers()];
        let mut motions = Predictor::new(MOST_ORDER);
        motions.accept(&packed(&unknowns, state), 1.0);
        let balance = Balance::new(model, load, unknowns, accelerator);
        Self { order, balance, motions, remainders: Past::default(), remainder, x: Vec::new() }
    }
}

impl Sequence for AddedMassStaggered {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        if self.remainders.is_empty() {
            // The flow around the canopy at rest tells of the first remainder.
            let velocity = visit.state.velocity;
            visit.fall(velocity);
            let displacement = visit.state.displacement.clone();
            visit.flow_around(&displacement)?;
            visit.window.iteration += 1;
            self.balance.measured(visit, x, &mut self.remainder);
            self.remainders.push(&self.remainder, visit.window.dt);
            visit.state.load.get_or_insert_with(|| visit.end.load.clone());
        }
        if let Some(remainders) = self.balance.follow(visit.window.dt) {
            let mut past = Past::default();
            remainders.iter().for_each(|(remainder, dt)| past.push(remainder, *dt));
            self.remainders = past;
        }
        self.motions.predict(visit.window.dt, x);
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        self.x.clear();
        self.x.extend_from_slice(x);
        self.remainders.extrapolate(self.order, visit.window.dt, &mut self.balance.remainder);
        let measure = self.balance.solve(visit, None, visit.criterion.tolerance, &mut self.x)?;
        visit.report.residual = Some(measure);
        let velocity = visit.end.velocity;
        visit.fall(velocity);
        let displacement = std::mem::take(&mut visit.end.displacement);
        let answer = visit.flow_around(&displacement);
        visit.end.displacement = displacement;
        answer?;
        self.balance.unknowns.pack(&visit.end.displacement, velocity, x_tilde);
        self.balance.measured(visit, x_tilde, &mut self.remainder);
        Ok(())
    }

    fn forget(&mut self, _rejected: bool) {
        self.balance.accelerator.forget();
    }

    fn accept(&mut self, _end: &End, _x: &[f64], answer: &[f64], dt: f64) {
        self.remainders.push(&self.remainder, dt);
        self.balance.accept(answer, &self.remainder, dt);
        self.motions.accept(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(&self.motions, &self.remainders, self.balance.memory()))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let balance: Vec<u8>;
        (self.motions, self.remainders, balance) = unpack(memory)?;
        self.balance.recall(&balance)?;
        Ok(())
    }
}

/// Interface block quasi-Newton (IBQN-LS; Vierendeels et al. 2007) with the structure itself in the
/// place of its Jacobian: the flow at the iterate, then structure and descent solved against the
/// flow's last answer, the model's inertia and the flow's secants. The flow hardly changes its
/// ways from window to window, as a wrinkling structure does, so its secants serve for long.
pub struct BlockQuasiNewton {
    balance: Balance,
    motions: Predictor,
    remainders: Predictor,
    remainder: Vec<f64>,
    /// Inertia of the model and remainder at the last visit in this window.
    last: Option<(Vec<f64>, Vec<f64>)>,
    known: bool,
    felt: [Vec<f64>; 2],
}

impl BlockQuasiNewton {
    /// Starting from `state`.
    pub fn new(
        load: LoadShape,
        unknowns: Unknowns,
        state: &InterfaceState,
        model: FlowModel,
        accelerator: Box<dyn Accelerator>,
    ) -> Self {
        let remainder = vec![0.0; model.answers()];
        let mut motions = Predictor::new(MOST_ORDER);
        motions.accept(&packed(&unknowns, state), 1.0);
        Self {
            balance: Balance::new(model, load, unknowns, accelerator),
            motions,
            remainders: Predictor::new(MOST_ORDER),
            remainder,
            last: None,
            known: false,
            felt: Default::default(),
        }
    }
}

impl Sequence for BlockQuasiNewton {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        self.last = None;
        if let Some(remainders) = self.balance.follow(visit.window.dt) {
            self.remainders = Predictor::new(MOST_ORDER);
            remainders.iter().for_each(|(remainder, dt)| self.remainders.accept(remainder, *dt));
        }
        self.motions.predict(visit.window.dt, x);
        if self.known {
            self.remainders.predict(visit.window.dt, &mut self.balance.remainder);
            let tolerance = (0.1 * visit.criterion.tolerance).max(1e-3);
            self.balance.solve(visit, None, tolerance, x)?;
        }
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        visit.fall(self.balance.unknowns.velocity(x, visit.state.velocity));
        visit.flow_around(self.balance.unknowns.displacement(x))?;
        self.balance.measured(visit, x, &mut self.remainder);
        if let Some((inertia, before)) = self.last.take() {
            let step: Vec<f64> = self.balance.answer.iter().zip(&inertia).map(|(a, b)| a - b).collect();
            let change = self.remainder.iter().zip(&before).map(|(a, b)| a - b).collect();
            let least = LEAST_STEP.min(visit.criterion.tolerance);
            self.balance.model.learn(step, change, least, norm(&visit.end.load));
        }
        self.last = Some((self.balance.answer.clone(), self.remainder.clone()));
        structure_under_flow(visit, self.balance.load, &mut self.felt)?;
        visit.descend();
        self.balance.unknowns.pack(&visit.end.displacement, visit.end.velocity, x_tilde);
        Ok(())
    }

    fn improve(&mut self, visit: &mut Visit<'_>, x: &[f64], next: &mut Vec<f64>) -> Result<bool, RunError> {
        let outer = visit.report.residual.unwrap_or(1.0);
        next.clear();
        next.extend_from_slice(x);
        self.balance.remainder.copy_from_slice(&self.remainder);
        let tolerance = (0.2 * visit.criterion.tolerance).max(0.02 * outer.min(1.0));
        let about = self.last.as_ref().map(|(inertia, _)| inertia.as_slice());
        let reached = self.balance.solve(visit, about, tolerance, next)?;
        Ok(reached < 0.5 * outer)
    }

    fn forget(&mut self, rejected: bool) {
        self.balance.accelerator.forget();
        if rejected {
            self.balance.model.forget();
        }
    }

    fn accept(&mut self, _end: &End, x: &[f64], answer: &[f64], dt: f64) {
        self.known = true;
        self.remainders.accept(&self.remainder, dt);
        // The grid stands at the iterate.
        self.balance.accept(x, &self.remainder, dt);
        self.motions.accept(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(&self.motions, &self.remainders, self.known, self.balance.memory()))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let balance: Vec<u8>;
        (self.motions, self.remainders, self.known, balance) = unpack(memory)?;
        self.balance.recall(&balance)?;
        Ok(())
    }
}
