//! Launches, sequences, accelerates and reports the coupled run.

pub mod descent;
pub mod error;
pub mod launch;
pub mod partners;
pub mod schemes;
