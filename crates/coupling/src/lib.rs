//! Coupling schemes with their acceleration and the added-mass surrogate of the flow, data transfer between surfaces,
//! the descent equation, convergence criteria, and balances of energy and momentum. Nothing here starts a process or
//! opens a file: the programs are behind [`partners::Partners`], which closed-form models implement as well.

// An error ends the run, so its size does not matter.
#![allow(clippy::result_large_err)]

pub mod assembly;
pub mod balance;
pub mod boundary_drive;
pub mod convergence;
pub mod descent;
pub mod descent_limits;
pub mod energy;
pub mod energy_limit;
pub mod error;
mod floors;
pub mod flow_bounds;
pub mod frame_axes;
mod geometry;
mod impossible_flow;
pub mod interface;
pub mod leakage;
pub mod local_mach;
pub mod partners;
pub mod release;
pub mod schemes;
pub mod structure_energy;
pub mod trajectory;
pub mod transfer;
pub mod window_clock;
