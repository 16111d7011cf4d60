//! A ParaView series whose files are written by those ranks that have something to show.

use std::path::Path;

use channel::Fault;
use comm::Comm;
use mesh::MeshError;
use mesh::vtk::Series;

/// The series `stem.pvd`, its files in the folder `stem`.
pub struct Pieces {
    stem: String,
    series: Option<Series>,
}

impl Pieces {
    /// A series; nothing is written yet.
    pub fn new(stem: &str) -> Self {
        Self { stem: stem.into(), series: None }
    }

    /// Adds what `write` puts into the file it is given, on ranks where `present`.
    /// Collective.
    ///
    /// # Errors
    /// A file cannot be written; returned on every rank.
    pub fn push(
        &mut self,
        comm: &Comm,
        folder: &Path,
        window: u64,
        time: f64,
        present: bool,
        write: impl FnOnce(&Path) -> Result<(), MeshError>,
    ) -> Result<(), Fault> {
        let stem = &self.stem;
        let name = |rank: usize| format!("{stem}/{stem}_{window:06}_{rank}.vtu");
        let there = comm.all_gather_u64(u64::from(present));
        let mut outcome = if present { write(&folder.join(name(comm.rank()))) } else { Ok(()) };
        if comm.is_root() && outcome.is_ok() {
            let files: Vec<String> = (0..comm.size()).filter(|&r| there[r] > 0).map(name).collect();
            let file = folder.join(format!("{stem}.pvd"));
            outcome = self.series.get_or_insert_with(|| Series::resume(file, time)).push(time, &files);
        }
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        Err(match outcome {
            Err(e) => Fault::new(e),
            Ok(()) => Fault::new(format!("another rank could not write its part of {stem}.pvd")),
        })
    }
}
