#![allow(clippy::needless_range_loop)]

//! The flow grid as a pseudo-solid that follows the canopy (paper, section 3).

pub mod alone;
pub mod elastic;
pub mod element;
pub mod glance;
pub mod inverse_distance;
pub mod local;
pub mod motion;
pub mod mover;
pub mod participant;
pub mod quality;
pub mod sample;
pub mod solve;
pub mod state;
pub mod untangle;
pub mod velocity;
pub mod warm;
