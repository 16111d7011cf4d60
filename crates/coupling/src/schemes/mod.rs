//! The sequence of the programs in a window, and how its iteration is accelerated.
//!
//! One loop ([`window::WindowLoop`]) serves every scheme. A scheme ([`Sequence`]) is a map
//! from the coupled unknowns to the answer of the programs, an acceleration
//! ([`Accelerator`]) a function from the iterate `x` and the answer `x_tilde` to the next
//! iterate.

mod accelerate;
mod criterion;
mod extrapolate;
mod flow_model;
mod groups;
mod implicit;
mod imvj;
mod inverse;
mod iqn;
mod jacobi_relaxation;
mod lattice;
mod least_squares;
mod load_shape;
mod memory;
mod model_schemes;
mod predictor;
mod relaxation;
mod sequence;
mod staggered;
mod unknowns;
mod window;

pub use accelerate::{Accelerator, Aitken, Constant, accelerator};
pub use criterion::{Criterion, Field, LoadFloor};
pub use extrapolate::{Past, lagrange};
pub use flow_model::FlowModel;
pub use implicit::{GaussSeidel, Jacobi};
pub use imvj::IqnImvj;
pub use iqn::{IqnIls, IqnOptions};
pub use jacobi_relaxation::JacobiRelaxation;
pub use lattice::{Air, Lattice};
pub use least_squares::Columns;
pub use memory::{pack, unpack};

pub use load_shape::{FlowLoads, MEAN_WEIGHTS, mean_weights, shape_load};
pub use model_schemes::{AddedMassStaggered, BlockQuasiNewton, SAFE_DENSITY};
pub use predictor::Predictor;
pub use relaxation::{AddedMassRelaxation, Relaxation, Uniform, Weights};
pub use sequence::{End, Modelled, Sequence, Visit, needs_model, sequence};
pub use staggered::{FlowFirst, HalfStep, StructureFirst};
pub use unknowns::Unknowns;
pub use window::{InterfaceState, WindowLoop, WindowReport};

#[cfg(test)]
mod descent_tests;
#[cfg(test)]
mod model_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod tests;
