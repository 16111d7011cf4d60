//! Coupling schemes: the order of the solves in a window, and the acceleration of their iteration.
//!
//! One loop ([`WindowLoop`]) serves every scheme. A scheme ([`CouplingScheme`]) maps the coupled unknowns to the
//! response of the solvers; an acceleration ([`Accelerator`]) maps the iterate `x` and the response `x_tilde` to the
//! next iterate. [`window_loop`] builds the loop of a scene. Each scheme and each acceleration is a file in
//! `sequences` or `acceleration` and a line in one of the tables of `build`.
//!
//! Files depend on each other in this order: `unknowns`, `least_squares` and `codec`; `surrogate`; `acceleration`;
//! `window`; `sequences`; `build`.

pub(crate) mod acceleration;
pub(crate) mod build;
pub(crate) mod codec;
pub(crate) mod least_squares;
pub(crate) mod sequences;
pub(crate) mod surrogate;
pub(crate) mod unknowns;
pub(crate) mod window;

pub use acceleration::accelerator::Accelerator;
pub use acceleration::added_mass::{AddedMassRelaxation, MassProperties};
pub use acceleration::jacobi_relaxation::JacobiRelaxation;
pub use acceleration::relaxation::{Relaxation, Uniform};
pub use build::{WindowLoopSetup, accelerator, describe, needs_surrogate, window_loop};
pub use codec::{pack, unpack};
pub use least_squares::Columns;
pub use sequences::added_mass_staggered::SURROGATE_DENSITY_FACTOR;
pub use sequences::extrapolate::{TimeHistory, lagrange};
pub use sequences::predictor::Predictor;
pub use surrogate::added_mass_surrogate::AddedMassSurrogate;
pub use surrogate::vortex_lattice::{Air, VortexLattice};
pub use unknowns::Unknowns;
pub use window::criterion::{Criterion, Field, LoadFloor};
pub use window::load_shape::{FlowLoads, MEAN_WEIGHTS, mean_weights, shape_load};
pub use window::report::WindowReport;
pub use window::scheme::{CouplingScheme, Surrogate};
pub use window::solvers::Solvers;
pub use window::state::{Configuration, WindowState};
pub use window::values::{InterfaceState, InterfaceValues};
pub use window::window_loop::{WindowLoop, WindowLoopParts};

#[cfg(test)]
mod descent_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod surrogate_tests;
#[cfg(test)]
mod test_support;
#[cfg(test)]
mod tests;
