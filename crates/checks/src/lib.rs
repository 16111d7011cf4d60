//! Checks of a scene before a run (the inspection), and checks of the programs during the run.
//!
//! [`table::all`] lists every check with its estimate, its range, the source of that range, its severity and
//! its remedy. `ripstop check`, `ripstop run`, `summary.json`, the report and `docs/reference/checks.md` read this
//! table. A check before the run is a pure function of [`facts::Facts`]; a check during the run is
//! described in [`run_time`] and performed by the program that its row names.

// An error ends the run: its size does not affect performance.
#![allow(clippy::result_large_err)]

pub mod description;
pub mod document;
pub mod facts;
pub mod finding;
pub mod inspection;
pub mod names;
pub mod run_time;
pub mod shared_memory;
pub mod table;

mod bodies;
mod boundaries;
mod descent;
mod disk;
mod fabric;
mod flow;
mod lines;
mod reactions;
mod resources;
mod tapes;
mod time;

pub use finding::{Finding, Judged, Severity};
pub use inspection::Inspection;
pub use table::{Check, When, all};
pub use time::AT_REST;
