//! Launches, sequences, accelerates and reports the coupled run.

// An error ends the run: its size is no cost.
#![allow(clippy::result_large_err)]

pub mod accuracy;
pub mod check;
pub mod checkpoint;
pub mod checks;
pub mod cli;
pub mod command_line;
pub mod conform;
pub mod diff;
pub mod effects;
pub mod history;
pub mod hub_partners;
pub mod launch;
pub mod machine;
pub mod mesh_command;
pub mod picture;
pub mod plot;
pub mod progress;
pub mod provenance;
pub mod recording;
pub mod replay;
pub mod report;
pub mod run;
pub mod settings;
pub mod stability;
pub mod stages;
pub mod state;
pub mod summary;
