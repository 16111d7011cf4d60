//! Unsteady low-Mach flow on moving grids: finite volumes under MPI.
//!
//! The method follows section 2 of the paper (Weiss-Smith preconditioned
//! primitive variables, BDF2 with moving control volumes, dual time), on
//! cell-centred finite volumes of second order:
//!
//! * [`physics`]: gas, fluxes, viscosity as functions of small arrays;
//! * [`geometry`]: closed faces, volumes and swept volumes, exact to round-off;
//! * [`topology`]: the part of a grid that one rank works on;
//! * [`implicit`]: what turns a residual into a correction;
//! * [`Solver`]: one time step of the whole.

// Kernels walk several arrays with one index; that reads better than nested zips.
#![allow(clippy::needless_range_loop)]

mod allocator;
pub mod boundary_values;
mod error;
mod extreme;
pub mod face_permeability;
pub mod geometry;
pub mod gradient;
pub mod handover;
pub mod immersed_canopy;
pub mod implicit;
pub mod limiter;
mod loads;
pub mod monitors;
mod participant;
pub mod periodic;
pub mod permeable;
pub mod physics;
pub mod residual;
mod self_test;
pub mod setup;
pub mod shear;
mod snapshot;
mod solver;
pub mod state;
pub mod steady;
mod stencil;
mod surface_force;
mod symmetry;
pub mod time;
pub mod topology;
pub mod turbulence;
pub mod warm_start;

pub use allocator::return_large_blocks;
pub use error::FlowError;
pub use loads::{FaceLoad, Loads, Total};
pub use participant::{FlowParticipant, participant};
pub use self_test::self_test;
pub use snapshot::Snapshots;
pub use solver::{CouplingIterations, Method, Report, Settings, Solver, Step, WarmStart};
pub use surface_force::{Coefficients, ForceSum, Surfaces, Watched};
