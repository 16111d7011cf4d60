//! Warm-start data of a rank, in addition to the positions of the grid, so that a resumed run is bitwise identical.
//! Positions are valid for any number of ranks, these data for the same number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use serde::{Deserialize, Serialize};

const MAGIC: [u8; 8] = *b"ripgrmem";
const VERSION: u32 = 1;

/// Warm-start data of a mover on its reference grid; empty for movers without any.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MoverWarmStart {
    /// Vectors in single precision.
    pub singles: Vec<Vec<f32>>,
    /// Vectors in double precision.
    pub doubles: Vec<Vec<f64>>,
    /// Single numbers.
    pub numbers: Vec<f64>,
}

/// History of the grid motion.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MotionWarmStart {
    /// Quality of the start grid, of the reference, of the last accepted grid.
    pub qualities: [f64; 3],
    /// Distance of the canopy from its start when the start grid was replaced as reference, m.
    pub rebase_distance: f64,
    /// Largest recent loss of quality per window.
    pub quality_loss: f64,
    /// Quality below which the next new grid is built.
    pub next_grid: Option<f64>,
    /// Number of reference changes.
    pub rebased: u32,
    /// Number of new grids.
    pub new_grids: u32,
    /// The reference is the start grid.
    pub at_start: bool,
    /// Data of the mover.
    pub mover: MoverWarmStart,
}

/// Writes this rank's warm-start data below `folder`.
///
/// # Errors
/// An error of the file system.
pub fn save(saved: &MotionWarmStart, comm: &Comm, folder: &Path) -> Result<(), archive::Error> {
    let file = channel::warm_start_file(folder, Role::Mesh, comm.rank(), comm.size());
    archive::save(&file, MAGIC, VERSION, saved).map(|_| ())
}

/// Reads a file written by [`save`]; `None` where there is none.
///
/// # Errors
/// A file that is damaged, or contains values that are not finite.
pub fn read(file: &Path) -> Result<Option<MotionWarmStart>, archive::Error> {
    channel::load_warm_start(file, MAGIC, VERSION, MotionWarmStart::check)
}

/// Reads the data written by [`save`]; `None` where another number of ranks wrote them. Collective.
///
/// # Errors
/// On every rank, if the file of any of them cannot be used.
pub fn load(comm: &Comm, folder: &Path) -> Result<Option<MotionWarmStart>, Fault> {
    let file = channel::warm_start_file(folder, Role::Mesh, comm.rank(), comm.size());
    let saved = agree(comm, read(&file))?;
    if !comm.all(saved.is_some()) {
        return Ok(None);
    }
    // Each vector is distributed over all ranks.
    let vectors = saved.as_ref().map_or(0, |m| m.mover.singles.len() as u64);
    let same = comm.all_gather_u64(vectors).iter().all(|n| *n == vectors);
    let same = if same {
        Ok(())
    } else {
        Err(archive::Error::content(&file, "ranks have different numbers of saved vectors"))
    };
    agree(comm, same).map(|()| saved)
}

/// Turns an error on one rank into one on every rank. Collective.
pub(crate) fn agree<T>(comm: &Comm, result: Result<T, archive::Error>) -> Result<T, Fault> {
    let all = comm.all(result.is_ok());
    match result {
        Ok(_) if !all => Err(Fault::new("another rank could not read its part of the grid's saved state")),
        other => other.map_err(Fault::new),
    }
}

impl MotionWarmStart {
    fn check(&self) -> Result<(), String> {
        let mover = &self.mover;
        let single = [self.rebase_distance, self.quality_loss, self.next_grid.unwrap_or_default()];
        let doubles = self.qualities.iter().chain(&single).chain(&mover.numbers);
        let finite = doubles.chain(mover.doubles.iter().flatten()).all(|x| x.is_finite())
            && mover.singles.iter().flatten().all(|x| x.is_finite());
        if finite { Ok(()) } else { Err("it contains values that are not finite".into()) }
    }
}
