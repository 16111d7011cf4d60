//! What a rank remembers beside the positions of the grid, so that a run which goes on in the middle of
//! a stage computes the same digits. Positions serve any number of ranks; this the same number only.

use std::path::Path;

use case::Role;
use channel::KeptError;
use comm::Comm;
use serde::{Deserialize, Serialize};

const MAGIC: [u8; 8] = *b"ripgrmem";
const VERSION: u32 = 1;

/// What a mover has learnt on its reference grid; empty where it learns nothing.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MoverMemory {
    /// Vectors in single precision.
    pub singles: Vec<Vec<f32>>,
    /// Vectors in double precision.
    pub doubles: Vec<Vec<f64>>,
    /// Single numbers.
    pub numbers: Vec<f64>,
}

/// What the motion of the grid has come through.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MotionMemory {
    /// Quality of the start grid, of the reference, of the last accepted grid.
    pub qualities: [f64; 3],
    /// Distance of the canopy from its start where that was given up as reference, m.
    pub left: f64,
    /// What a window takes from the quality at most.
    pub fall: f64,
    /// The next new grid is made below this quality.
    pub next_grid: Option<f64>,
    /// References so far.
    pub rebased: u32,
    /// New grids so far.
    pub new_grids: u32,
    /// The reference is the start grid.
    pub at_start: bool,
    /// Of the mover.
    pub mover: MoverMemory,
}

/// Writes this rank's memory below `folder`.
///
/// # Errors
/// Trouble with the file.
pub fn save(memory: &MotionMemory, comm: &Comm, folder: &Path) -> Result<(), KeptError> {
    let file = channel::memory_file(folder, Role::Mesh, comm.rank(), comm.size());
    channel::keep(&file, MAGIC, VERSION, memory).map(|_| ())
}

/// What [`save`] wrote; `None` where another number of ranks, or another version of this program, has
/// written it. Collective.
pub fn load(comm: &Comm, folder: &Path) -> Option<MotionMemory> {
    let file = channel::memory_file(folder, Role::Mesh, comm.rank(), comm.size());
    let memory = channel::kept(&file, MAGIC, VERSION).ok();
    if comm.all(memory.is_some()) { memory } else { None }
}
