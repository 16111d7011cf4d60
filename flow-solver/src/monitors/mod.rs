//! Output during the run: probes, forces, surfaces, slices, statistics.
//!
//! Each monitor exists only if the scene enables it, and samples the accepted
//! state of a window. All calls are collective.

mod forces;
mod pieces;
mod probes;
mod slice;
mod statistics;
mod surface;
mod table;

use std::path::PathBuf;

use channel::{Fault, Window};

pub use forces::Forces;
pub(crate) use forces::{coefficient_columns, put, sum_columns};
pub use probes::{ProbeLocation, Probes};
pub use slice::Slice;
pub use statistics::Statistics;
pub use surface::Surface;
pub(crate) use table::Table;

use crate::loads::Loads;
use crate::physics::Gas;
use crate::setup::Setup;
use crate::solver::Solver;

/// All monitors of a stage.
pub struct Monitors {
    probes: Option<Probes>,
    statistics: Option<Statistics>,
    forces: Option<Forces>,
    slices: Vec<Slice>,
    surface: Option<Surface>,
    /// Where the state that the stage starts from lies.
    folder: PathBuf,
}

impl Monitors {
    /// As the scene of `setup` says. Collective.
    ///
    /// # Errors
    /// A probe outside of the grid, saved statistics that do not fit.
    pub fn new<G: Gas<N>, const N: usize>(setup: &Setup, solver: &Solver<G, N>) -> Result<Self, Fault> {
        let flow = &setup.flow;
        let probes = match &flow.probes[..] {
            [] => None,
            list => Some(Probes::new(list, solver)?),
        };
        let statistics = match &flow.statistics {
            None => None,
            Some(s) => {
                let mut gathered = Statistics::new(s.start_s, solver.topology.n_owned);
                if let Some(folder) = setup.source.as_ref().and_then(|f| f.parent())
                    && (s.across_stages || setup.resumed)
                {
                    gathered.load(folder, &solver.topology, setup.grid.cells.len())?;
                }
                Some(gathered)
            }
        };
        Ok(Self {
            probes,
            statistics,
            forces: flow.forces.as_ref().map(|f| Forces::new(f, setup, solver)).transpose()?,
            slices: flow.slices.iter().map(Slice::new).collect(),
            surface: flow.surface_pressure.as_ref().map(|s| Surface::new(s.every_windows, solver)),
            folder: setup.folder.clone(),
        })
    }

    /// Writes down the accepted end of window `w`; `moved` says whether the grid moved
    /// in it. Collective.
    ///
    /// # Errors
    /// A file cannot be written; returned on every rank.
    pub fn record<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        loads: &Loads,
        w: &Window,
        moved: bool,
    ) -> Result<(), Fault> {
        let time = w.time + w.dt;
        let done = w.index + 1;
        if let Some(p) = &mut self.probes {
            p.record(solver, time, moved, &self.folder)?;
        }
        if let Some(s) = &mut self.statistics {
            s.record(solver, w.time, w.dt);
        }
        if let Some(f) = &mut self.forces {
            f.record(solver, loads, time, &self.folder)?;
        }
        for s in &mut self.slices {
            s.record(solver, done, time, &self.folder)?;
        }
        if let Some(s) = &mut self.surface {
            s.record(solver, loads, done, time, &self.folder)?;
        }
        Ok(())
    }

    /// Warm-start data of the probes, for a restart within a stage.
    pub fn probes(&self) -> Vec<ProbeLocation> {
        self.probes.as_ref().map(Probes::save_state).unwrap_or_default()
    }

    /// Takes up [`Monitors::probes`].
    pub fn restore_state(&mut self, probes: Vec<ProbeLocation>) {
        if let Some(p) = &mut self.probes {
            p.restore_state(probes);
        }
    }

    /// Means and fluctuations, if the scene wants them.
    pub fn statistics(&self) -> Option<&Statistics> {
        self.statistics.as_ref()
    }
}
