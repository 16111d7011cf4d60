//! Canopy geometry, structure meshes, flow grids, partitions, quality and VTK files.
//!
//! Topology and coordinates only: no physics and no MPI. Everything here is
//! deterministic, so each program builds the same mesh from the same scene.

mod boxes;
mod error;
mod faces;
pub mod quality;
mod structure;
mod types;

pub use boxes::*;
pub use error::*;
pub use faces::*;
pub use structure::structure_mesh;
pub use types::*;
