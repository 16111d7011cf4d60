//! The added-mass surrogate of the flow: a vortex lattice, its groups of faces, and the secants that correct it.

pub mod groups;
pub mod inverse;
pub mod lattice;
pub mod surrogate;
