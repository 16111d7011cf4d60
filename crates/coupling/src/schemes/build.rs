//! Construction of the loop that a scene asks for: scheme, acceleration, criterion.

use case::{Acceleration, Coupling, CouplingOrder, Scheme, StaggeredSequence};

use super::acceleration::accelerator::Accelerator;
use super::acceleration::fixed_point::{Aitken, Constant};
use super::acceleration::jacobian::{LeastSquaresJacobian, MultiVectorJacobian};
use super::acceleration::quasi_newton::QuasiNewton;
use super::acceleration::quasi_newton_options::QuasiNewtonOptions;
use super::acceleration::relaxation::Relaxation;
use super::flow_model::surrogate::FlowModel;
use super::sequences::added_mass_staggered::AddedMassStaggered;
use super::sequences::block_quasi_newton::BlockQuasiNewton;
use super::sequences::gauss_seidel::GaussSeidel;
use super::sequences::jacobi::Jacobi;
use super::sequences::staggered::{FlowFirst, HalfStep, StructureFirst};
use super::unknowns::Unknowns;
use super::window::criterion::Criterion;
use super::window::scheme::CouplingScheme;
use super::window::values::InterfaceState;
use super::window::window_loop::{WindowLoop, WindowLoopParts};
use crate::descent::DescentModel;

/// What schemes with a surrogate of the flow need.
pub struct Modelled {
    /// The surrogate.
    pub model: FlowModel,
    /// Acceleration of the structure's iterations against it.
    pub accelerator: Box<dyn Accelerator>,
}

/// A stage whose windows are coupled.
pub struct WindowLoopSetup<'a> {
    /// Stage, for messages.
    pub stage: &'a str,
    /// Settings of the scene.
    pub coupling: &'a Coupling,
    /// Layout of the unknowns.
    pub unknowns: Unknowns,
    /// When iterate and response agree.
    pub criterion: Criterion,
    /// Faces of the interface.
    pub faces: usize,
    /// The descent equation.
    pub descent: Option<DescentModel>,
    /// Values on the interface at the start.
    pub interface: InterfaceState,
    /// What quasi-Newton does with what no column spans.
    pub relaxation: Box<dyn Relaxation>,
    /// The surrogate, for schemes that need one ([`needs_model`]).
    pub modelled: Option<Modelled>,
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

/// The loop over the windows of a stage.
pub fn window_loop(setup: WindowLoopSetup<'_>) -> WindowLoop {
    let WindowLoopSetup { coupling, unknowns, interface, .. } = setup;
    let parts = WindowLoopParts {
        stage: setup.stage.to_owned(),
        scheme: scheme(coupling, unknowns, &interface, setup.modelled),
        accelerator: accelerator(coupling, unknowns.len(), setup.relaxation),
        unknowns,
        criterion: setup.criterion,
        descent: setup.descent,
        max_iterations: coupling.max_iterations,
        accept_unconverged: setup.accept_unconverged,
    };
    WindowLoop::new(parts, interface, setup.faces)
}

/// The acceleration a scene asks for, for `unknowns` numbers. `rest` is what
/// quasi-Newton does with what no column spans.
pub fn accelerator(coupling: &Coupling, unknowns: usize, rest: Box<dyn Relaxation>) -> Box<dyn Accelerator> {
    let options = QuasiNewtonOptions {
        relaxation: coupling.relaxation,
        reused_windows: coupling.reused_windows,
        noise: 0.1 * coupling.tolerance,
        ..QuasiNewtonOptions::default()
    };
    match coupling.acceleration {
        Acceleration::Constant => Box::new(Constant::new(coupling.relaxation)),
        Acceleration::Aitken => Box::new(Aitken::new(coupling.relaxation)),
        Acceleration::IqnIls | Acceleration::IbqnLs => {
            Box::new(QuasiNewton::<LeastSquaresJacobian>::new(unknowns, options, rest))
        }
        Acceleration::IqnImvj => Box::new(QuasiNewton::<MultiVectorJacobian>::new(unknowns, options, rest)),
    }
}

/// Whether a scene's scheme needs a surrogate of the flow.
pub fn needs_model(coupling: &Coupling) -> bool {
    match coupling.scheme {
        Scheme::Staggered => coupling.staggered.sequence == StaggeredSequence::AddedMass,
        Scheme::Implicit => {
            coupling.order == CouplingOrder::GaussSeidel && coupling.acceleration == Acceleration::IbqnLs
        }
    }
}

/// The scheme that a scene asks for, starting from `interface`. Without the surrogate that it needs an
/// implicit scheme falls back to IQN-ILS, a staggered one to extrapolated loads.
pub fn scheme(
    coupling: &Coupling,
    unknowns: Unknowns,
    interface: &InterfaceState,
    modelled: Option<Modelled>,
) -> Box<dyn CouplingScheme> {
    let (order, load) = (coupling.staggered.predictor as usize, coupling.load);
    if let Some(Modelled { model, accelerator }) = modelled.filter(|_| needs_model(coupling)) {
        return match coupling.scheme {
            Scheme::Staggered => {
                Box::new(AddedMassStaggered::new(order, load, unknowns, interface, model, accelerator))
            }
            Scheme::Implicit => {
                Box::new(BlockQuasiNewton::new(load, unknowns, interface, model, accelerator))
            }
        };
    }
    match (coupling.scheme, coupling.staggered.sequence, coupling.order) {
        (Scheme::Staggered, StaggeredSequence::StructureFirst | StaggeredSequence::AddedMass, _) => {
            Box::new(StructureFirst::new(order, interface))
        }
        (Scheme::Staggered, StaggeredSequence::FlowFirst, _) => {
            Box::new(FlowFirst::new(order, load, unknowns, interface))
        }
        (Scheme::Staggered, StaggeredSequence::HalfStep, _) => {
            Box::new(HalfStep::new(order, unknowns, interface))
        }
        (Scheme::Implicit, _, CouplingOrder::GaussSeidel) => {
            Box::new(GaussSeidel::new(load, unknowns, interface))
        }
        (Scheme::Implicit, _, CouplingOrder::Jacobi) => Box::new(Jacobi::new(load, unknowns, interface)),
    }
}
