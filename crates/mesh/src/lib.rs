//! Canopy geometry, structure meshes, flow grids, partitions, quality and VTK files.
//!
//! Topology and coordinates only: no physics and no MPI. Everything here is
//! deterministic, so each program builds the same mesh from the same scene.

mod types;

pub use types::*;
