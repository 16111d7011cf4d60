//! Studies: many runs of a scene and their joint evaluation. Discretisation error against cost ([`accuracy`]), stability maps
//! of coupling schemes ([`stability`]), influence and cost of physical effects ([`effects`]), tables of varied values ([`sweep`]), comparison of cases with
//! their recorded references ([`regression`]). Each run is a separate
//! `ripstop run` process.

// An error ends the study once, so its size does not matter.
#![allow(clippy::result_large_err)]

pub mod accuracy;
pub mod effects;
mod key;
mod process;
pub mod regression;
pub mod stability;
pub mod sweep;
