//! Membranes and cables: total Lagrangian finite elements under MPI.
//!
//! Section 1 of the paper: constant-strain membranes and cables of St.
//! Venant-Kirchhoff material with a tension field, follower pressure, implicit
//! time integration, Newton's method, GMRES.

// Small fixed-size blocks are written in index notation, like their formulas.
#![allow(clippy::needless_range_loop)]

pub mod alone;
pub mod assemble;
pub mod connected;
pub mod dynamics;
pub mod elements;
mod elimination;
pub mod energy;
pub mod equilibrium;
pub mod explicit;
pub mod failure_site;
pub mod flat;
pub mod linear;
pub mod loops;
pub mod materials;
pub mod measures;
pub mod model;
pub mod motion;
pub mod newton;
pub mod participant;
pub mod patches;
pub mod payload;
pub mod reactions;
pub mod rigid;
pub mod scheme;
pub mod snapshot;
pub mod state_file;
pub mod stream;
mod support;
pub mod system;
pub mod velocity_average;
pub mod warm_start;

#[cfg(test)]
mod contact_tests;
#[cfg(test)]
mod effect_tests;
#[cfg(test)]
mod fabric_group_tests;
#[cfg(test)]
mod fabric_hysteresis_tests;
#[cfg(test)]
mod pattern_tests;
#[cfg(test)]
mod reaction_tests;
#[cfg(test)]
mod scene_tests;
#[cfg(test)]
mod support_tests;
