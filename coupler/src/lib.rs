//! Launches, sequences, accelerates and reports the coupled run.

pub mod check;
pub mod cli;
pub mod descent;
pub mod effects;
pub mod error;
pub mod history;
pub mod hub_partners;
pub mod interface;
pub mod launch;
pub mod partners;
pub mod picture;
pub mod plot;
pub mod progress;
pub mod run;
pub mod schemes;
pub mod stages;
pub mod state;
pub mod summary;
