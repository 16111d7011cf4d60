//! The results of a run, written and read here only: the history of its windows, the summary, checkpoints and states to go
//! on from, recordings of what the programs exchanged, and how two runs differ.

// An error ends the run: its size is no cost.
#![allow(clippy::result_large_err)]

pub mod checkpoint;
pub mod diff;
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
