//! The flow grid as a pseudo-solid that follows the canopy (paper, section 3).
//!
//! * [`element`]: stiffness of one cell, a pure function; [`quality`]: shape of cells;
//! * [`local`]: a rank's part of the grid; every cell that touches an owned node is
//!   there, so matrix rows are complete without sums across ranks;
//! * [`mover`]: the trait; [`elastic`] is the pseudo-solid (conjugate gradients in
//!   [`solve`], multigrid, [`warm`] starts, a cheap first look in [`glance`]);
//!   [`laplacian`], [`radial_basis`] and [`inverse_distance`] are for comparison; [`movers`] picks the one of the scene;
//! * [`near`]: small motions between the calls of one window, without equations;
//! * [`motion`]: total form first, then increments with an updated reference, then
//!   [`untangle`], then an error that names the cell; new grids where the scene asks for them;
//! * [`participant`]: the contract with the coupler, [`velocity`], saved [`state`]; [`allocator`];
//! * [`alone`]: a prescribed motion without partners, on any mesh of a canopy ([`resample`]),
//!   with pictures ([`cut`]); [`sample`] and [`torture`]: a small grid and large
//!   motions for tests and comparisons.
//!
//! The interior of the grid is not physics: canopy nodes are exact to the bit, all other
//! nodes to `mesh.tolerance` of what their cells feel ([`felt`]). Outer nodes may [`slide`].

// Small vectors are written in index notation, like the formulas they implement.
#![allow(clippy::needless_range_loop)]

pub mod allocator;
pub mod alone;
pub mod cut;
pub mod depth;
pub mod elastic;
pub mod element;
pub mod felt;
pub mod glance;
pub mod inverse_distance;
pub mod laplacian;
pub mod local;
pub mod memory;
pub mod motion;
pub mod mover;
pub mod movers;
pub mod near;
pub mod participant;
pub mod quality;
pub mod radial_basis;
pub mod resample;
pub mod sample;
pub mod slide;
pub mod solve;
pub mod state;
pub mod torture;
pub mod untangle;
pub mod velocity;
pub mod warm;
