//! What a rank remembers beside its share of the flow's state, so that a run which goes on in the middle
//! of a stage computes the same digits. The state serves any number of ranks; this the same
//! number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use serde::{Deserialize, Serialize};

use crate::geometry::vec3::Vec3;
use crate::implicit::MergedCells;
use crate::monitors::Home;

const MAGIC: [u8; 8] = *b"ripflmem";
const VERSION: u32 = 1;

/// Walls as transported turbulence knows them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WallMemory {
    /// Distance of owned cells to the nearest wall, m.
    pub wall: Vec<f64>,
    /// Largest extent of owned cells, m.
    pub delta: Vec<f64>,
    /// Node positions at which both were computed, m.
    pub at: Vec<Vec3>,
}

/// A rank's memory.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Memory {
    /// What pressure added to the mean momentum through local faces, newest first.
    pub ties: Vec<[f32; 2]>,
    /// Coarse cells of the pressure equation; none before they are merged.
    pub merged: Option<MergedCells>,
    /// Of transported turbulence.
    pub walls: Option<WallMemory>,
    /// Cell around each probe and its faces.
    pub probes: Vec<Home>,
}

impl Memory {
    /// Writes it below `folder`. Collective.
    ///
    /// # Errors
    /// Trouble with a file, on every rank.
    pub fn save(&self, comm: &Comm, folder: &Path) -> Result<(), Fault> {
        let file = channel::memory_file(folder, Role::Flow, comm.rank(), comm.size());
        let outcome = channel::keep(&file, MAGIC, VERSION, self);
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        Err(match outcome {
            Err(e) => Fault::new(format!("cannot write flow state {e}")),
            Ok(_) => Fault::new("another rank could not write its part of the flow state"),
        })
    }

    /// What [`Memory::save`] wrote; `None` where another number of ranks, or another version of this
    /// program, has written it. Collective.
    pub fn load(comm: &Comm, folder: &Path) -> Option<Self> {
        let file = channel::memory_file(folder, Role::Flow, comm.rank(), comm.size());
        let memory = channel::kept(&file, MAGIC, VERSION).ok();
        if comm.all(memory.is_some()) { memory } else { None }
    }
}
