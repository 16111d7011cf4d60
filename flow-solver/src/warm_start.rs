//! Data of a rank besides its part of the state of the flow, so that a run restarts within a stage with the same digits.
//! The state serves any number of ranks; this data serves the same number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use serde::{Deserialize, Serialize};

use crate::monitors::Home;
use crate::solver::WarmStart;
use crate::topology::Topology;

const MAGIC: [u8; 8] = *b"ripflmem";
const VERSION: u32 = 1;

/// Warm-start data of a rank.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RankWarmStart {
    /// Of the solver.
    pub solver: WarmStart,
    /// Cell around each probe and its faces.
    pub probes: Vec<Home>,
}

impl RankWarmStart {
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

    /// Reads what [`RankWarmStart::save`] wrote for this part of the grid; `None` where there is none.
    ///
    /// # Errors
    /// A file that is damaged or does not fit, or holds what is no number.
    pub fn read(file: &Path, part: &Topology) -> Result<Option<Self>, archive::Error> {
        channel::remembered(file, MAGIC, VERSION, |m: &Self| m.check(part).map_err(Into::into))
    }

    /// What [`RankWarmStart::save`] wrote; `None` where another number of ranks has written it. Collective.
    ///
    /// # Errors
    /// On every rank: a file of one of them that cannot be used.
    pub fn load(comm: &Comm, folder: &Path, part: &Topology) -> Result<Option<Self>, Fault> {
        let file = channel::memory_file(folder, Role::Flow, comm.rank(), comm.size());
        let memory = Self::read(&file, part);
        if !comm.all(memory.is_ok()) {
            let elsewhere = || Fault::new("another rank could not use its part of the flow state");
            return Err(memory.err().map_or_else(elsewhere, Fault::new));
        }
        let memory = memory.map_err(Fault::new)?;
        Ok(if comm.all(memory.is_some()) { memory } else { None })
    }

    fn check(&self, part: &Topology) -> Result<(), &'static str> {
        self.solver.check(part)?;
        let faces = part.face_nodes.len();
        let face = |&(f, sign): &(u32, f64)| (f as usize) < faces && sign.abs() == 1.0;
        let home =
            |(cell, faces): &Home| cell.is_none_or(|c| (c as usize) < part.n_owned) && faces.iter().all(face);
        if self.probes.iter().all(home) { Ok(()) } else { Err("a probe is in no cell") }
    }
}
