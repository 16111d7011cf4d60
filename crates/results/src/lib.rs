//! The results of a run, written and read here only: the history of its windows, the summary, checkpoints, states
//! of stages, recordings of the exchange, and the comparison of two runs.

// An error ends the run: its size is no cost.
#![allow(clippy::result_large_err)]

pub mod checkpoint;
pub mod columns;
pub mod diff;
pub mod files;
pub mod finding;
pub mod history;
pub mod lock;
pub mod machine;
pub mod program;
pub mod progress;
pub mod provenance;
pub mod recording;
pub mod state;
pub mod summary;
pub mod timings;
