//! From a residual to a correction.

mod acceleration;
mod pressure;
mod simple;

pub use acceleration::Acceleration;
pub use pressure::{PressureSystem, SolveReport};
pub use simple::PressureCorrection;
