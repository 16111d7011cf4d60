//! What a rank remembers beside its share of the flow's state, so that a run which goes on in the middle
//! of a stage computes the same digits. The state serves any number of ranks; this the same
//! number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use serde::{Deserialize, Serialize};

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
    pub at: Vec<[f64; 3]>,
}

/// What a memory must fit: numbers of a rank's part of the grid.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Owned cells.
    pub cells: usize,
    /// Faces, boundaries included.
    pub faces: usize,
    /// Faces with a flow through them.
    pub flows: usize,
    /// Nodes.
    pub nodes: usize,
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
        let outcome = archive::save(&file, MAGIC, VERSION, self);
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        Err(match outcome {
            Err(e) => Fault::new(format!("cannot write flow state {e}")),
            Ok(_) => Fault::new("another rank could not write its part of the flow state"),
        })
    }

    /// Reads what [`Memory::save`] wrote; `None` where there is none.
    ///
    /// # Errors
    /// A file that is damaged or does not fit, or holds what is no number.
    pub fn read(file: &Path, shape: Shape) -> Result<Option<Self>, archive::Error> {
        channel::remembered(file, MAGIC, VERSION, |m: &Self| m.check(shape).map_err(Into::into))
    }

    /// What [`Memory::save`] wrote; `None` where another number of ranks has written it. Collective.
    ///
    /// # Errors
    /// On every rank: a file of one of them that cannot be used.
    pub fn load(comm: &Comm, folder: &Path, shape: Shape) -> Result<Option<Self>, Fault> {
        let file = channel::memory_file(folder, Role::Flow, comm.rank(), comm.size());
        let memory = Self::read(&file, shape);
        if !comm.all(memory.is_ok()) {
            let elsewhere = || Fault::new("another rank could not use its part of the flow state");
            return Err(memory.err().map_or_else(elsewhere, Fault::new));
        }
        let memory = memory.map_err(Fault::new)?;
        Ok(if comm.all(memory.is_some()) { memory } else { None })
    }

    fn check(&self, shape: Shape) -> Result<(), &'static str> {
        if self.ties.len() != shape.flows {
            return Err("it is of another part of the grid");
        }
        if !self.ties.as_flattened().iter().all(|x| x.is_finite()) {
            return Err("what passed the faces is not finite");
        }
        if let Some(w) = &self.walls {
            // Before the first step of transported turbulence nothing is known of walls.
            let known = w.wall.len() == shape.cells && w.at.len() == shape.nodes;
            let unknown = w.wall.is_empty() && w.at.is_empty();
            if w.delta.len() != shape.cells || !(known || unknown) {
                return Err("its walls are of another part of the grid");
            }
            let numbers = w.wall.iter().chain(&w.delta).chain(w.at.as_flattened());
            if !numbers.copied().all(f64::is_finite) {
                return Err("its walls are not finite");
            }
        }
        let face = |&(f, sign): &(u32, f64)| (f as usize) < shape.faces && sign.abs() == 1.0;
        let home =
            |(cell, faces): &Home| cell.is_none_or(|c| (c as usize) < shape.cells) && faces.iter().all(face);
        if self.probes.iter().all(home) { Ok(()) } else { Err("a probe is in no cell") }
    }
}
