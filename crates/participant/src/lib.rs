//! Solver programs in Rust that live in packages of their own and replace one of Ripstop's.
//!
//! A program implements [`Participant`] and passes its constructor to [`main`]. Nothing but the contract connects it to the other
//! programs: no METIS, no VTK and no MPI is compiled with it. `ripstop new participant --role flow` writes such a package, from
//! the examples of this crate; `docs/how-to/replace-a-solver.md` has the steps.
//!
//! | role | input `canopy` | output row | sign |
//! |---|---|---|---|
//! | structure | `[faces][8]`: pressure jump and shear traction x, y, z at the start of the window, then at its end, Pa | displacement of each canopy node from the unstressed shape, m | a positive jump pushes along the normal of the face |
//! | flow | empty; with the effect [`CANOPY_MOTION`] as the mesh | pressure jump (inside minus outside) and shear traction x, y, z of each face, Pa | the force on the canopy is jump times area vector plus traction times area |
//! | mesh | displacement of each canopy node from the unstressed shape, m | position (m) and velocity (m/s) of each grid node in the falling frame | |
//!
//! The area vector of a face with the corners a, b, c, d is half of (c - a) x (d - b); triangles repeat their third corner. z points up,
//! and the frame falls with the payload: air at rest comes with minus [`Window::frame_velocity`].

// An error ends the program: its size does not affect performance.
#![allow(clippy::result_large_err)]

mod data;
mod run;
mod state;

pub use case::Role;
pub use channel::{
    Announcement, CANOPY_MOTION, Fault, Grid, Input, LOAD_WIDTH, OWN_SURFACE, Participant, Stats, Window,
    bdf2, flow_stats, mesh_stats, structure_stats, surface_hash,
};

pub use data::{Cable, FlowGrid, StageData, StructureMesh};
pub use run::{Run, main};
pub use state::{load_state, save_state, write_shape};
