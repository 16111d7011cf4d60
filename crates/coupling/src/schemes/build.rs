//! The tables of schemes and accelerations, and the window loop for a scene.

use case::{Acceleration, Coupling, CouplingOrder, Scheme, StaggeredSequence};

use super::acceleration::accelerator::{Accelerator, FromCoupling};
use super::acceleration::relaxation::Relaxation;
use super::acceleration::{fixed_point, jacobian, quasi_newton};
use super::sequences;
use super::unknowns::Unknowns;
use super::window::criterion::Criterion;
use super::window::scheme::{CouplingScheme, FromScene, FromSurrogate, SchemeSettings, Surrogate};
use super::window::values::InterfaceState;
use super::window::window_loop::{WindowLoop, WindowLoopParts};
use crate::descent::DescentModel;

/// Accelerations by their names in a scene, one line each.
fn acceleration(named: Acceleration) -> AccelerationRow {
    match named {
        Acceleration::Constant => accelerated::<fixed_point::Constant>(),
        Acceleration::Aitken => accelerated::<fixed_point::Aitken>(),
        Acceleration::IqnIls => accelerated::<quasi_newton::QuasiNewton<jacobian::LeastSquaresJacobian>>(),
        Acceleration::IqnImvj => accelerated::<quasi_newton::QuasiNewton<jacobian::MultiVectorJacobian>>(),
        // Implemented as a row of `implicit`; IQN-ILS is the fallback without a surrogate.
        Acceleration::IbqnLs => acceleration(Acceleration::IqnIls),
    }
}

/// Staggered schemes by their names in a scene, one line each.
fn staggered(named: StaggeredSequence) -> SchemeRow {
    match named {
        StaggeredSequence::StructureFirst => plain::<sequences::staggered::StructureFirstSerialStaggered>(),
        StaggeredSequence::ConventionalSerial => plain::<sequences::staggered::ConventionalSerialStaggered>(),
        StaggeredSequence::ImprovedSerial => plain::<sequences::staggered::ImprovedSerialStaggered>(),
        StaggeredSequence::RelaxedLoad => plain::<sequences::relaxed_load::RelaxedLoad>(),
        StaggeredSequence::AddedMass => surrogate::<sequences::added_mass_staggered::AddedMassStaggered>(),
    }
}

/// Implicit schemes by their names in a scene, one line each.
fn implicit(named: CouplingOrder, by: Acceleration) -> SchemeRow {
    use CouplingOrder as Order;
    match (named, by) {
        (Order::GaussSeidel, Acceleration::IbqnLs) => {
            surrogate::<sequences::block_quasi_newton::BlockQuasiNewton>()
        }
        (Order::GaussSeidel, _) => plain::<sequences::gauss_seidel::GaussSeidel>(),
        (Order::Jacobi, _) => plain::<sequences::jacobi::Jacobi>(),
    }
}

/// A stage whose windows are coupled.
pub struct WindowLoopSetup<'a> {
    /// Stage, for messages.
    pub stage: &'a str,
    /// Settings of the scene.
    pub coupling: &'a Coupling,
    /// Layout of the unknowns.
    pub unknowns: Unknowns,
    /// Convergence criterion.
    pub criterion: Criterion,
    /// Faces of the interface.
    pub faces: usize,
    /// The descent equation.
    pub descent: Option<DescentModel>,
    /// Values on the interface at the start.
    pub interface: InterfaceState,
    /// Relaxation of the part of a residual that no quasi-Newton column spans.
    pub relaxation: Box<dyn Relaxation>,
    /// The surrogate, for schemes that need one ([`needs_surrogate`]).
    pub surrogate: Option<Surrogate>,
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

/// The loop over the windows of a stage.
pub fn window_loop(setup: WindowLoopSetup<'_>) -> WindowLoop {
    let WindowLoopSetup { coupling, unknowns, interface, .. } = setup;
    let parts = WindowLoopParts {
        stage: setup.stage.to_owned(),
        scheme: scheme(SchemeSettings { coupling, unknowns, interface: &interface }, setup.surrogate),
        accelerator: accelerator(coupling, unknowns.len(), setup.relaxation),
        unknowns,
        criterion: setup.criterion,
        descent: setup.descent,
        max_iterations: coupling.max_iterations,
        accept_unconverged: setup.accept_unconverged,
    };
    WindowLoop::new(parts, interface, setup.faces)
}

type ConstructAcceleration = fn(&Coupling, usize, Box<dyn Relaxation>) -> Box<dyn Accelerator>;
type ConstructScheme = fn(SchemeSettings<'_>) -> Box<dyn CouplingScheme>;
type ConstructWithSurrogate = fn(SchemeSettings<'_>, Surrogate) -> Box<dyn CouplingScheme>;

/// How an acceleration is constructed and described.
struct AccelerationRow {
    construct: ConstructAcceleration,
    describe: fn(&Coupling) -> String,
}

fn accelerated<A: FromCoupling>() -> AccelerationRow {
    AccelerationRow {
        construct: |coupling, unknowns, rest| Box::new(A::from_coupling(coupling, unknowns, rest)),
        describe: A::describe,
    }
}

/// How a scheme is constructed and described.
struct SchemeRow {
    construct: ConstructScheme,
    /// The same with the surrogate that the scheme needs; without a surrogate `construct` is used.
    construct_with: Option<ConstructWithSurrogate>,
    describe: fn(&Coupling) -> String,
}

fn plain<S: FromScene>() -> SchemeRow {
    SchemeRow {
        construct: |settings| Box::new(S::from_scene(settings)),
        construct_with: None,
        describe: S::describe,
    }
}

fn surrogate<S: FromSurrogate>() -> SchemeRow {
    SchemeRow {
        construct_with: Some(|settings, surrogate| Box::new(S::from_surrogate(settings, surrogate))),
        describe: S::describe,
        ..plain::<S::Fallback>()
    }
}

fn scheme_row(coupling: &Coupling) -> SchemeRow {
    match coupling.scheme {
        Scheme::Staggered => staggered(coupling.staggered.sequence),
        Scheme::Implicit => implicit(coupling.order, coupling.acceleration),
    }
}

/// Whether a scene's scheme needs a surrogate of the flow.
pub fn needs_surrogate(coupling: &Coupling) -> bool {
    scheme_row(coupling).construct_with.is_some()
}

/// The acceleration of a scene, for vectors of length `unknowns`. `rest` relaxes the part of a residual that no
/// column spans.
pub fn accelerator(coupling: &Coupling, unknowns: usize, rest: Box<dyn Relaxation>) -> Box<dyn Accelerator> {
    (acceleration(coupling.acceleration).construct)(coupling, unknowns, rest)
}

/// The scheme of a scene; its fallback where the required surrogate is missing.
fn scheme(settings: SchemeSettings<'_>, surrogate: Option<Surrogate>) -> Box<dyn CouplingScheme> {
    let row = scheme_row(settings.coupling);
    match (row.construct_with, surrogate) {
        (Some(construct), Some(surrogate)) => construct(settings, surrogate),
        _ => (row.construct)(settings),
    }
}

/// Scheme and acceleration of a scene in words, for the log.
pub fn describe(coupling: &Coupling) -> String {
    let row = scheme_row(coupling);
    let scheme = (row.describe)(coupling);
    let (order, by) = match coupling.scheme {
        Scheme::Staggered => return format!("staggered: {scheme}"),
        Scheme::Implicit if row.construct_with.is_some() => ("implicit".into(), scheme),
        Scheme::Implicit => (scheme, (acceleration(coupling.acceleration).describe)(coupling)),
    };
    format!(
        "{order}: at most {} iterations per window to a tolerance of {:.0e}, accelerated by {by}",
        coupling.max_iterations, coupling.tolerance
    )
}
