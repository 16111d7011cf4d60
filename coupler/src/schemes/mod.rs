//! The sequence of the programs in a window, and how its iteration is accelerated.
//!
//! One loop ([`window::WindowLoop`]) serves every scheme; an acceleration is a
//! function from the iterate `x` and the answer `x_tilde` to the next iterate.

mod accelerate;
mod criterion;
mod iqn;
mod load_shape;
mod predictor;
mod relaxation;
mod unknowns;
mod window;

pub use accelerate::{Accelerator, Aitken, Constant, accelerator};
pub use criterion::{Criterion, Field};
pub use iqn::{IqnIls, IqnOptions};
pub use load_shape::{FlowLoads, MEAN_WEIGHTS, shape_load};
pub use predictor::Predictor;
pub use relaxation::{AddedMassRelaxation, Relaxation, Uniform, Weights};
pub use unknowns::Unknowns;
pub use window::{InterfaceState, WindowLoop, WindowReport};

#[cfg(test)]
mod tests;
