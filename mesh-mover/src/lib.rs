//! The flow grid as a pseudo-solid that follows the canopy (paper, section 3).
//!
//! * [`element`]: stiffness of one cell, a pure function; [`quality`]: scaled Jacobians of cells;
//! * [`local`]: a rank's part of the grid; it contains every cell that touches an owned node, so matrix rows are
//!   complete without sums across ranks;
//! * [`mover`]: the trait; [`elastic`] is the pseudo-solid (conjugate gradients in [`solve`], multigrid, initial
//!   guesses by [`solution_projection`], a cheap [`error_estimate`]);
//! * [`laplacian`], [`radial_basis`] and [`inverse_distance`] are for comparison; [`movers`] selects the mover of the
//!   scene;
//! * [`near_wall_following`]: explicit small motions between the solves of one window;
//! * [`motion`]: one linear solve first, then increments with an updated reference, then [`untangle`], then an error
//!   that names the cell; new grids where the scene requests them;
//! * [`rigid_motion`]: the rotation of the canopy that the whole grid follows;
//! * [`bodies`]: rigid bodies that move as prescribed;
//! * [`participant`]: the contract with the coupler, [`velocity`], saved [`state`] and warm-start data ([`warm_start`]);
//!   [`allocator`];
//! * [`standalone`]: a prescribed motion without partners, on any mesh of a canopy ([`resample`]), with pictures
//!   ([`cross_section`]); [`example_grid`] and [`benchmark_motions`]: a small grid and large motions for tests and
//!   comparisons.
//!
//! The interior of the grid is not physics: canopy nodes are exact bitwise, all other nodes to `mesh.tolerance` in
//! the norm of [`position_error`]. Outer nodes may [`slide`].

// Small vectors are written in index notation, like the formulas.
#![allow(clippy::needless_range_loop)]

pub mod allocator;
pub mod benchmark_motions;
pub mod bodies;
pub mod canopy_distance;
pub mod cross_section;
pub mod elastic;
pub mod element;
pub mod error_estimate;
pub mod example_grid;
pub mod inverse_distance;
pub mod laplacian;
pub mod local;
pub mod motion;
pub mod mover;
pub mod movers;
pub mod near_wall_following;
pub mod participant;
pub mod position_error;
pub mod quality;
pub mod radial_basis;
pub mod resample;
pub mod rigid_motion;
pub mod slide;
pub mod solution_projection;
pub mod solve;
pub mod standalone;
pub mod state;
pub mod untangle;
pub mod velocity;
pub mod warm_start;
