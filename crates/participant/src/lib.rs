//! Solver programs in Rust that live in packages of their own and replace one of Ripstop's.
//!
//! A program implements [`Participant`] and passes its constructor to [`main`]. Nothing but the contract connects it to the other
//! programs: no METIS, no VTK and no MPI is compiled with it. `ripstop new participant --role flow` writes such a package, from
//! the examples of this crate; `docs/how-to/replace-a-solver.md` has the steps.
//!
//! <!-- roles: from the code -->
//! | role | input `canopy` | output | sign | when it is empty |
//! |---|---|---|---|---|
//! | structure | `[faces][8]`: pressure jump and shear traction x, y, z at the start of the window, then at its end, Pa; linear in between | `[canopy nodes][3]`: displacement from the unstressed shape, m | a positive jump (inside minus outside) pushes along the area vector of the face | never: in a stage without a flow the load is that of the scene |
//! | flow | empty; with the effect `canopy.motion` `[canopy nodes][3]`, as the mesh | `[faces][4]`: pressure jump (inside minus outside) and shear traction x, y, z summed over both sides, at the end of the window, Pa | the force on the canopy is jump times area vector plus traction times area | the moved grid is empty where no mesh-mover runs: the canopy is held still, or the effect `canopy.motion` moves it through the flow's own grid |
//! | mesh | `[canopy nodes][3]`: displacement from the unstressed shape at the end of the window, m | `[grid nodes][6]`: position, m, and velocity, m/s, in the falling frame at the end of the window | the velocity is the second-order backward difference of the positions, first order in the first window | never: a mesh-mover runs only where the canopy moves |
//!
//! The area vector of a face with the corners a, b, c, d is half of (c - a) x (d - b); triangles repeat their third corner. z points up, and the frame falls with the payload: air at rest comes with minus the velocity of the frame. Rows are numbered over the whole canopy or grid, from 0; each rank has some of the output's rows and the whole input. No number may be NaN or infinite.
//! <!-- end of roles -->

// An error ends the program: its size does not affect performance.
#![allow(clippy::result_large_err)]

mod data;
mod run;
mod state;

pub use case::Role;
pub use channel::{
    Announcement, CANOPY_MOTION, CONTRACT_VERSION, Fault, Grid, Input, LOAD_WIDTH, OWN_SURFACE, Participant,
    ProgramArgs, STATS, Stats, Window, bdf2, flow_stats, mesh_stats, role_code, structure_stats,
    surface_hash,
};

pub use data::{Cable, FlowGrid, StageData, StructureMesh};
pub use run::{Run, main, serve};
pub use state::{load_state, save_state, write_shape};
