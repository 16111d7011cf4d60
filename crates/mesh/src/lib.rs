//! Canopy geometry, structure meshes, flow grids, partitions, quality and VTK files.
//!
//! Topology and coordinates only: no physics and no MPI. Everything here is
//! deterministic, so each program builds the same mesh from the same scene.

mod bodies;
mod boxes;
mod error;
mod faces;
pub mod geometry;
mod grid;
pub mod lanes;
mod msh;
mod partition;
mod periodic;
pub mod quality;
mod quality_report;
mod shape;
mod structure;
mod types;
pub mod vtk;

pub use bodies::{CanopyRoom, Clearance, body_speed, canopy_gap, canopy_room, canopy_speed, clearance};
pub use boxes::*;
pub use error::*;
pub use faces::*;
pub use geometry::Point;
pub use grid::{GridFileError, GridSizes, draft_grid, flow_grid, grid_sizes, wake_cell};
pub use msh::write_msh;
pub use partition::*;
pub use periodic::{PeriodicFace, PeriodicFaces};
pub use quality_report::*;
pub use shape::{load_shape, save_shape};
pub use structure::{PatternError, structure_mesh};
pub use types::*;
