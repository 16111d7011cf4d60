//! Results of a run. All result files of the coupler are written and read here: history, summary, checkpoints and saved
//! states, recordings of the exchanged data, and the comparison of runs.

// An error ends the run once, so its size does not matter.
#![allow(clippy::result_large_err)]

pub mod alternation;
pub mod checkpoint;
pub mod columns;
pub mod diff;
pub mod eta;
pub mod files;
pub mod finding;
pub mod follow;
pub mod forced_oscillation;
pub mod history;
pub mod lock;
pub mod long_term;
pub mod machine;
pub mod mean_descent;
pub mod opening;
pub mod pendulum;
pub mod pooled;
pub mod program;
pub mod progress;
pub mod provenance;
pub mod rank_advice;
pub mod recording;
mod row_file;
pub mod run_state;
pub mod settled;
pub mod state;
pub mod strength;
pub mod summary;
pub mod timings;
pub mod wake;
