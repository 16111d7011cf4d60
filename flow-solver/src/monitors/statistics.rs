//! Means and fluctuations in time, cell by cell.

use std::path::Path;

use channel::Fault;
use serde::{Deserialize, Serialize};

use crate::physics::{Gas, velocity};
use crate::solver::Solver;
use crate::state::{gather, load_legacy};
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
    /// Integrals of the squared deviations from the mean.
    moment: Vec<[f64; 4]>,
}

const FILE: &str = "flow-statistics.bin";
const KIND: [u8; 8] = *b"RIPSTAT\0";
const VERSION: u32 = 2;

#[derive(Serialize, Deserialize)]
struct Saved {
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
    pub fn record<G: Gas<N>, const N: usize>(&mut self, solver: &Solver<G, N>, time: f64, dt: f64) {
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
    /// The file cannot be written; returned on every rank.
    pub fn save(&self, folder: &Path, comm: &Comm, topology: &Topology, cells: usize) -> Result<(), Fault> {
        let mean = gather(comm, topology.numbering.owned(), &self.mean, cells);
        let moment = gather(comm, topology.numbering.owned(), &self.moment, cells);
        let file = folder.join(FILE);
        let mut outcome = Ok(());
        if comm.is_root() {
            let saved = Saved { cells: cells as u64, span: self.span, mean, moment };
            outcome = archive::save(&file, KIND, VERSION, &saved).map(|_| ());
        }
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        let elsewhere = || Fault::new(format!("rank 0 could not write {}", file.display()));
        Err(outcome.err().map_or_else(elsewhere, |e| Fault::new(format!("statistics: {e}"))))
    }

    /// Continues with those saved in `folder`; a stage before that gathered none leaves
    /// none.
    ///
    /// # Errors
    /// A file that is damaged or of another grid.
    pub fn load(&mut self, folder: &Path, topology: &Topology, cells: usize) -> Result<(), Fault> {
        let file = folder.join(FILE);
        let fail = |e: archive::Error| Fault::new(format!("statistics: {e}"));
        let version_1 = |bytes: &[u8]| load_legacy(bytes, KIND, 1);
        let loaded = archive::load_or_earlier(&file, KIND, VERSION, version_1);
        let Some(saved): Option<Saved> = archive::if_present(loaded).map_err(fail)? else { return Ok(()) };
        let unfit = |reason: &str| fail(archive::Error::content(&file, reason));
        let rows = [&saved.mean, &saved.moment].iter().all(|v| v.len() == 4 * cells);
        if saved.cells as usize != cells || !rows {
            return Err(unfit(&format!("it has {} cells, but this grid has {cells}", saved.cells)));
        }
        let numbers = saved.mean.iter().chain(&saved.moment).chain([&saved.span]);
        if !numbers.copied().all(f64::is_finite) || saved.span < 0.0 {
            return Err(unfit("it contains values that are not finite numbers"));
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
