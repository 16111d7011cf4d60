//! The flow around a canopy that moves through a Cartesian grid ([`case::Immersed`]): the crate `immersed` as a participant.
//!
//! Velocities are relative to the wind, so that a gust accelerates nothing. The grid moves with the frame and follows the canopy
//! (`moving_grid.rs`). Where the canopy cuts the grid at the end of a window follows from the windows before it, so that all solves of a
//! window differ in the prescribed velocities alone, and the load is a linear function of them. So is the friction of viscous air, which acts from
//! the accepted motion.
//!
//! Each rank computes a slab of the grid along z; all of them know the canopy and where it cuts the grid.

mod canopy;
mod cut;
mod force_along;
mod forces;
mod impulsive_start;
mod moving_grid;
mod participant;
mod ranks;
mod snapshot;
mod state;
mod step;
mod wind_by_height;

pub use participant::{ImmersedParticipant, participant};
pub(crate) use state::Saved;
