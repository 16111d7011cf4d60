//! A coupling scheme: what one visit to the partners of a window is.

use case::{Acceleration, Coupling, CouplingOrder, Role, Scheme, StaggeredSequence};
use channel::Window;

use super::flow_model::FlowModel;
use super::implicit::{GaussSeidel, Jacobi};
use super::model_schemes::{AddedMassStaggered, BlockQuasiNewton};
use super::staggered::{FlowFirst, HalfStep, StructureFirst};
use super::{Accelerator, Criterion, FlowLoads, InterfaceState, Unknowns, WindowReport};
use crate::descent::{DescentModel, WindowForces};
use crate::error::{Place, RunError};
use crate::partners::{Answer, LoadOverWindow, Partners};

/// A coupling scheme as a map from the coupled unknowns to the answer of the programs.
///
/// One loop ([`super::WindowLoop`]) serves all: it predicts, visits, and either accepts
/// the first answer or iterates until iterate and answer agree.
pub trait Sequence {
    /// Whether visits are repeated until iterate and answer agree.
    fn iterates(&self) -> bool;

    /// First iterate of the window into `x`, which holds the unknowns at its start.
    ///
    /// # Errors
    /// Those of the partners, where they are asked.
    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError>;

    /// Visits the partners at the iterate `x`: fills [`Visit::end`] and the answer `x_tilde`.
    ///
    /// # Errors
    /// Those of the partners, and an answer that is not finite.
    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError>;

    /// Makes the next iterate from `x`, which was visited last, by means of its own; `false` where that is
    /// left to the [`super::Accelerator`].
    ///
    /// # Errors
    /// Those of the partners, where they are asked.
    fn improve(&mut self, visit: &mut Visit<'_>, x: &[f64], next: &mut Vec<f64>) -> Result<bool, RunError> {
        let _ = (visit, x, next);
        Ok(false)
    }

    /// What belongs to windows of the last length is of no use any more; with `rejected` also what the last
    /// window has taught, which was given back.
    fn forget(&mut self, rejected: bool) {
        let _ = rejected;
    }

    /// A window of length `dt` is accepted with these values; `x` is the iterate of the last visit
    /// and `answer` what it gave.
    fn accept(&mut self, end: &End, x: &[f64], answer: &[f64], dt: f64);

    /// What later windows depend on.
    fn memory(&self) -> Vec<u8>;

    /// Goes on from a [`Sequence::memory`] of the same scheme.
    ///
    /// # Errors
    /// A memory of another one.
    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError>;
}

/// Values on the interface at the end of a window, as the programs answered last.
#[derive(Clone, Debug, Default)]
pub struct End {
    /// Displacement from the unstressed shape, `[nodes][3]`, m.
    pub displacement: Vec<f64>,
    /// Load of the flow, `[faces][LOAD_WIDTH]`, Pa.
    pub load: Vec<f64>,
    /// Vertical velocity of the frame, m/s.
    pub velocity: f64,
}

/// One visit to the partners of a window.
pub struct Visit<'a> {
    /// The programs.
    pub partners: &'a mut dyn Partners,
    /// The window that is open.
    pub window: &'a mut Window,
    /// Values at its start.
    pub state: &'a mut InterfaceState,
    /// Values at its end.
    pub end: &'a mut End,
    /// What the window costs.
    pub report: &'a mut WindowReport,
    /// Layout of the unknowns.
    pub unknowns: &'a Unknowns,
    /// The falling mass.
    pub descent: Option<&'a DescentModel>,
    /// When iterate and answer agree.
    pub criterion: &'a Criterion,
    /// Unknowns at the start of the window.
    pub start: &'a [f64],
    /// Length of the window over that of the one before it.
    pub ratio: f64,
    /// The canopy was held until this window begins.
    pub released: bool,
    /// Answers of the structure in this window so far: it may be asked more often than the flow.
    pub answers: &'a mut u64,
    /// Stage, for messages.
    pub stage: &'a str,
}

impl Visit<'_> {
    /// The frame reaches `velocity` at the end of the window.
    pub fn fall(&mut self, velocity: f64) {
        let rate = (velocity - self.state.velocity) / self.window.dt;
        self.window.frame_velocity = [0.0, 0.0, velocity];
        self.window.frame_acceleration = [0.0, 0.0, rate];
    }

    /// Loads that this window knows, with `end` at its end.
    pub fn loads<'b>(&'b self, end: &'b [f64]) -> FlowLoads<'b> {
        FlowLoads::of(self.state, end, self.ratio, self.released)
    }

    /// Moves the grid to a displacement of the canopy and asks the flow around it for its
    /// load, into [`End::load`].
    ///
    /// # Errors
    /// Those of the programs; a load that is not finite.
    pub fn flow_around(&mut self, displacement: &[f64]) -> Result<(), RunError> {
        let w = *self.window;
        self.flow_in(&w, displacement)
    }

    /// The same in a window of the flow's own.
    ///
    /// # Errors
    /// As above.
    pub fn flow_in(&mut self, w: &Window, displacement: &[f64]) -> Result<(), RunError> {
        let answer = self.partners.mesh(w, displacement)?;
        self.take(Role::Mesh, answer);
        let answer = self.partners.flow(w, &mut self.end.load)?;
        self.take(Role::Flow, answer);
        finite(self.stage, "answer of the flow", w, &self.end.load)
    }

    /// Asks the structure for its answer to `load`, into [`End::displacement`].
    ///
    /// # Errors
    /// Those of the program; a displacement that is not finite.
    pub fn structure_under(&mut self, load: LoadOverWindow<'_>) -> Result<(), RunError> {
        let w = Window { iteration: *self.answers, ..*self.window };
        *self.answers += 1;
        let answer = self.partners.structure(&w, load, &mut self.end.displacement)?;
        self.take(Role::Structure, answer);
        finite(self.stage, "answer of the structure", &w, &self.end.displacement)
    }

    /// The descent equation after flow and structure were solved, into [`End::velocity`].
    pub fn descend(&mut self) {
        self.descend_under(self.report.force[2]);
    }

    /// The same with another vertical force of the air on the canopy at the end of the window, N.
    pub fn descend_under(&mut self, force: f64) {
        self.end.velocity = match self.descent {
            Some(model) => {
                let measured = self.report.forces(self.window.frame_acceleration[2]);
                let forces = WindowForces { canopy: force, ..measured };
                model.end_velocity(self.state.velocity, &forces, self.window.dt)
            }
            None => self.state.velocity,
        };
    }

    /// The known load at the start of the window. Where none is known yet, the answer of the
    /// flow around `displacement` at velocity as set; that costs a visit.
    ///
    /// # Errors
    /// Those of the programs.
    pub fn start_load(&mut self) -> Result<Vec<f64>, RunError> {
        if let Some(load) = &self.state.load {
            return Ok(load.clone());
        }
        let displacement = self.state.displacement.clone();
        self.flow_around(&displacement)?;
        self.window.iteration += 1;
        self.state.load = Some(self.end.load.clone());
        Ok(self.end.load.clone())
    }

    fn take(&mut self, role: Role, answer: Answer) {
        self.report.add(role, answer);
    }
}

/// What schemes with a model of the flow need.
pub struct Modelled {
    /// The model.
    pub model: FlowModel,
    /// Acceleration of the structure's iterations against it.
    pub accelerator: Box<dyn Accelerator>,
}

/// Whether a scene's scheme needs a model of the flow.
pub fn needs_model(coupling: &Coupling) -> bool {
    match coupling.scheme {
        Scheme::Staggered => coupling.staggered.sequence == StaggeredSequence::AddedMass,
        Scheme::Implicit => {
            coupling.order == CouplingOrder::GaussSeidel && coupling.acceleration == Acceleration::IbqnLs
        }
    }
}

/// The sequence that a scene asks for, starting from `state`. Without the model that it needs an
/// implicit scheme falls back to IQN-ILS, a staggered one to extrapolated loads.
pub fn sequence(
    coupling: &Coupling,
    unknowns: Unknowns,
    state: &InterfaceState,
    modelled: Option<Modelled>,
) -> Box<dyn Sequence> {
    let (order, load) = (coupling.staggered.predictor as usize, coupling.load);
    if let Some(Modelled { model, accelerator }) = modelled.filter(|_| needs_model(coupling)) {
        return match coupling.scheme {
            Scheme::Staggered => {
                Box::new(AddedMassStaggered::new(order, load, unknowns, state, model, accelerator))
            }
            Scheme::Implicit => Box::new(BlockQuasiNewton::new(load, unknowns, state, model, accelerator)),
        };
    }
    match (coupling.scheme, coupling.staggered.sequence, coupling.order) {
        (Scheme::Staggered, StaggeredSequence::StructureFirst | StaggeredSequence::AddedMass, _) => {
            Box::new(StructureFirst::new(order, unknowns, state))
        }
        (Scheme::Staggered, StaggeredSequence::FlowFirst, _) => {
            Box::new(FlowFirst::new(order, load, unknowns, state))
        }
        (Scheme::Staggered, StaggeredSequence::HalfStep, _) => {
            Box::new(HalfStep::new(order, unknowns, state))
        }
        (Scheme::Implicit, _, CouplingOrder::GaussSeidel) => {
            Box::new(GaussSeidel::new(load, unknowns, state))
        }
        (Scheme::Implicit, _, CouplingOrder::Jacobi) => Box::new(Jacobi::new(load, unknowns, state)),
    }
}

/// An error where a value is not finite.
pub(super) fn finite(stage: &str, who: &str, w: &Window, values: &[f64]) -> Result<(), RunError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(RunError::Coupling {
            place: Place { stage: stage.to_owned(), window: Some((w.index, w.iteration)) },
            message: format!("the {who} holds {} at position {at}", values[at]),
        }),
    }
}
