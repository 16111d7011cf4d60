//! The added-mass surrogate of the flow: a vortex lattice, its groups of faces, and the secants that correct it.

pub mod added_mass_surrogate;
pub mod closed_volume;
mod definite;
pub mod inverse;
pub mod orientation;
pub mod panel_groups;
pub mod vortex_lattice;
mod vortex_rings;
