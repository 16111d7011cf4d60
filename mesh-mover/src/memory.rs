//! What a rank remembers beside the positions of the grid, so that a run which goes on in the middle of
//! a stage computes the same digits. Positions serve any number of ranks; this the same number only.

use std::path::Path;

use case::Role;
use channel::Fault;
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
pub fn save(memory: &MotionMemory, comm: &Comm, folder: &Path) -> Result<(), archive::Error> {
    let file = channel::memory_file(folder, Role::Mesh, comm.rank(), comm.size());
    archive::save(&file, MAGIC, VERSION, memory).map(|_| ())
}

/// Reads what [`save`] wrote; `None` where there is none.
///
/// # Errors
/// A file that is damaged, or holds what is no number.
pub fn read(file: &Path) -> Result<Option<MotionMemory>, archive::Error> {
    channel::remembered(file, MAGIC, VERSION, MotionMemory::check)
}

/// What [`save`] wrote; `None` where another number of ranks has written it. Collective.
///
/// # Errors
/// On every rank: a file of one of them that cannot be used.
pub fn load(comm: &Comm, folder: &Path) -> Result<Option<MotionMemory>, Fault> {
    let file = channel::memory_file(folder, Role::Mesh, comm.rank(), comm.size());
    let memory = agree(comm, read(&file))?;
    if !comm.all(memory.is_some()) {
        return Ok(None);
    }
    // Each vector that is remembered is one of sums over all ranks.
    let vectors = memory.as_ref().map_or(0, |m| m.mover.singles.len() as u64);
    let same = comm.all_gather_u64(vectors).iter().all(|n| *n == vectors);
    let same = if same {
        Ok(())
    } else {
        Err(archive::Error::content(&file, "ranks remember different numbers of vectors"))
    };
    agree(comm, same).map(|()| memory)
}

/// An error on one rank becomes one on every rank. Collective.
pub(crate) fn agree<T>(comm: &Comm, result: Result<T, archive::Error>) -> Result<T, Fault> {
    let all = comm.all(result.is_ok());
    match result {
        Ok(_) if !all => Err(Fault::new("another rank could not use its part of the grid's state")),
        other => other.map_err(Fault::new),
    }
}

impl MotionMemory {
    fn check(&self) -> Result<(), String> {
        let mover = &self.mover;
        let single = [self.left, self.fall, self.next_grid.unwrap_or_default()];
        let doubles = self.qualities.iter().chain(&single).chain(&mover.numbers);
        let finite = doubles.chain(mover.doubles.iter().flatten()).all(|x| x.is_finite())
            && mover.singles.iter().flatten().all(|x| x.is_finite());
        if finite { Ok(()) } else { Err("it holds values that are not finite".into()) }
    }
}
