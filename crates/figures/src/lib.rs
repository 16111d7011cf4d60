//! Charts and pictures of runs: plots of a history, views of canopy and flow.

// An error ends the run: its size is no cost.
#![allow(clippy::result_large_err)]

pub mod picture;
pub mod plot;
