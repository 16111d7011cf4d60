//! Studies: many runs of a scene, and what they say together. What accuracy costs in time ([`accuracy`]); where coupling schemes
//! are stable ([`stability`]); what effects change and cost ([`effects`]). They start `ripstop run` as anyone would.

// An error ends the study: its size is no cost.
#![allow(clippy::result_large_err)]

pub mod accuracy;
pub mod effects;
mod process;
pub mod stability;
