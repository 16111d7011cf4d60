//! Means and fluctuations in time, cell by cell.

use std::path::Path;

use channel::Fault;
use serde::{Deserialize, Serialize};

use crate::physics::{Gas, Viscosity, velocity};
use crate::solver::Solver;
use crate::state::{checksum, gather};
use crate::topology::Topology;
use comm::Comm;

/// Running mean and sum of squares about it of gauge pressure (Pa) and of velocity
/// relative to the falling frame (m/s), weighted by time (West 1979: no cancellation).
pub struct Statistics {
    start: f64,
    /// Time gathered so far, s.
    pub span: f64,
    /// Means of the owned cells.
    mean: Vec<[f64; 4]>,
    /// Integrals of the squared departures from the mean.
    moment: Vec<[f64; 4]>,
}

const FILE: &str = "flow-statistics.bin";
const MAGIC: u64 = u64::from_le_bytes(*b"RIPSTAT\0");
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Saved {
    magic: u64,
    version: u32,
    cells: u64,
    span: f64,
    /// `[cells][4]` in global order.
    mean: Vec<f64>,
    moment: Vec<f64>,
}

impl Statistics {
    /// From `start` (s) on, for the owned cells of a rank.
    pub fn new(start: f64, cells: usize) -> Self {
        Self { start, span: 0.0, mean: vec![[0.0; 4]; cells], moment: vec![[0.0; 4]; cells] }
    }

    /// Adds the end of a window that began at `time` and took `dt`, s.
    pub fn record<G: Gas<N>, V: Viscosity, const N: usize>(
        &mut self,
        solver: &Solver<G, V, N>,
        time: f64,
        dt: f64,
    ) {
        if time < self.start - 1e-6 * dt {
            return;
        }
        self.span += dt;
        let share = dt / self.span;
        let frame = solver.scheme.frame;
        for ((q, mean), moment) in solver.q.iter().zip(&mut self.mean).zip(&mut self.moment) {
            let u = velocity(q) - frame;
            for (k, x) in [q[0], u.x, u.y, u.z].into_iter().enumerate() {
                let away = x - mean[k];
                mean[k] += share * away;
                moment[k] += dt * away * (x - mean[k]);
            }
        }
    }

    /// Mean and root mean square of the fluctuation in an owned cell: pressure and the
    /// three components of velocity.
    pub fn of(&self, cell: usize) -> ([f64; 4], [f64; 4]) {
        let span = self.span.max(f64::MIN_POSITIVE);
        (self.mean[cell], self.moment[cell].map(|m| (m / span).max(0.0).sqrt()))
    }

    /// Saves them in `folder`. Collective.
    ///
    /// # Errors
    /// Trouble with the file, on every rank.
    pub fn save(&self, folder: &Path, comm: &Comm, topology: &Topology, cells: usize) -> Result<(), Fault> {
        let mean = gather(comm, topology.numbering.owned(), &self.mean, cells);
        let moment = gather(comm, topology.numbering.owned(), &self.moment, cells);
        let file = folder.join(FILE);
        let mut outcome = Ok(());
        if comm.is_root() {
            let saved =
                Saved { magic: MAGIC, version: VERSION, cells: cells as u64, span: self.span, mean, moment };
            outcome = bincode::serde::encode_to_vec(&saved, bincode::config::standard())
                .map_err(|e| e.to_string())
                .and_then(|mut bytes| {
                    bytes.extend(checksum(&bytes).to_le_bytes());
                    let aside = file.with_extension("part");
                    std::fs::write(&aside, &bytes)
                        .and_then(|()| std::fs::rename(&aside, &file))
                        .map_err(|e| e.to_string())
                });
        }
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        let why = outcome.err().unwrap_or_else(|| "rank 0 failed".into());
        Err(Fault::new(format!("cannot write the statistics {}: {why}", file.display())))
    }

    /// Goes on with those saved in `folder`; a stage before that gathered none leaves
    /// none.
    ///
    /// # Errors
    /// A file that is damaged or of another grid.
    pub fn load(&mut self, folder: &Path, topology: &Topology, cells: usize) -> Result<(), Fault> {
        let file = folder.join(FILE);
        let bytes = match std::fs::read(&file) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(e) => return Err(Fault::new(format!("cannot read {}: {e}", file.display()))),
        };
        let fail = |what: &str| {
            Fault::new(format!("statistics {}: {what}; run the stage that writes them again", file.display()))
        };
        let (body, tail) = bytes.split_last_chunk::<8>().ok_or_else(|| fail("empty"))?;
        if checksum(body) != u64::from_le_bytes(*tail) {
            return Err(fail("damaged (checksum)"));
        }
        let (saved, _): (Saved, usize) = bincode::serde::decode_from_slice(body, bincode::config::standard())
            .map_err(|e| fail(&e.to_string()))?;
        if saved.magic != MAGIC || saved.version != VERSION {
            return Err(fail("of another version"));
        }
        let rows = [&saved.mean, &saved.moment].iter().all(|v| v.len() == 4 * cells);
        if saved.cells as usize != cells || !rows {
            return Err(fail(&format!("{} cells, this grid has {cells}", saved.cells)));
        }
        let numbers = saved.mean.iter().chain(&saved.moment).chain([&saved.span]);
        if !numbers.copied().all(f64::is_finite) || saved.span < 0.0 {
            return Err(fail("values that are not finite"));
        }
        self.span = saved.span;
        for (k, &g) in topology.numbering.owned().iter().enumerate() {
            let row = g as usize * 4;
            self.mean[k].copy_from_slice(&saved.mean[row..row + 4]);
            self.moment[k].copy_from_slice(&saved.moment[row..row + 4]);
        }
        Ok(())
    }
}
