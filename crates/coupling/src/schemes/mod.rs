//! The sequence of the programs in a window, and how its iteration is accelerated.
//!
//! One loop ([`WindowLoop`]) serves every scheme. A scheme ([`CouplingScheme`]) is a map
//! from the coupled unknowns to the response of the solvers, an acceleration
//! ([`Accelerator`]) a function from the iterate `x` and the response `x_tilde` to the next
//! iterate. [`window_loop`] makes the loop that a scene asks for. Each scheme and each acceleration is a file in
//! `sequences` or `acceleration` and a line in one of the tables of `build`.
//!
//! Files depend on each other in this order: `unknowns`, `least_squares` and `codec`; `flow_model`;
//! `acceleration`; `window`; `sequences`; `build`.

pub(crate) mod acceleration;
pub(crate) mod build;
pub(crate) mod codec;
pub(crate) mod flow_model;
pub(crate) mod least_squares;
pub(crate) mod sequences;
pub(crate) mod unknowns;
pub(crate) mod window;

pub use acceleration::accelerator::Accelerator;
pub use acceleration::added_mass::{AddedMassRelaxation, Weights};
pub use acceleration::jacobi_relaxation::JacobiRelaxation;
pub use acceleration::relaxation::{Relaxation, Uniform};
pub use build::{WindowLoopSetup, accelerator, describe, needs_model, window_loop};
pub use codec::{pack, unpack};
pub use flow_model::lattice::{Air, Lattice};
pub use flow_model::surrogate::FlowModel;
pub use least_squares::Columns;
pub use sequences::added_mass_staggered::SAFE_DENSITY;
pub use sequences::extrapolate::{Past, lagrange};
pub use sequences::predictor::Predictor;
pub use unknowns::Unknowns;
pub use window::criterion::{Criterion, Field, LoadFloor};
pub use window::load_shape::{FlowLoads, MEAN_WEIGHTS, mean_weights, shape_load};
pub use window::report::WindowReport;
pub use window::scheme::{CouplingScheme, Modelled};
pub use window::solvers::Solvers;
pub use window::state::{Configuration, WindowState};
pub use window::values::{InterfaceState, InterfaceValues};
pub use window::window_loop::{WindowLoop, WindowLoopParts};

#[cfg(test)]
mod descent_tests;
#[cfg(test)]
mod model_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod test_support;
#[cfg(test)]
mod tests;
