//! Warm-start data of a rank: with it, a run restarted within a stage is bitwise identical to one without a
//! restart. The state itself can be read by any number of ranks; warm-start data by the same number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use serde::{Deserialize, Serialize};

use crate::monitors::ProbeLocation;
use crate::solver::WarmStart;
use crate::topology::Topology;

const MAGIC: [u8; 8] = *b"ripflmem";
const VERSION: u32 = 2;

/// Warm-start data of one rank.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RankWarmStart {
    /// Warm-start data of the solver.
    pub solver: WarmStart,
    /// Cell around each probe and its faces.
    pub probes: Vec<ProbeLocation>,
}

impl RankWarmStart {
    /// Writes it below `folder`. Collective.
    ///
    /// # Errors
    /// A file cannot be written; returned on every rank.
    pub fn save(&self, comm: &Comm, folder: &Path) -> Result<(), Fault> {
        let file = channel::warm_start_file(folder, Role::Flow, comm.rank(), comm.size());
        let outcome = archive::save(&file, MAGIC, VERSION, self);
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        Err(match outcome {
            Err(e) => Fault::new(format!("cannot write the warm-start data of the flow: {e}")),
            Ok(_) => Fault::new("another rank could not write its warm-start data of the flow"),
        })
    }

    /// Reads the file of [`RankWarmStart::save`] for this part of the grid; `None` if there is no file.
    ///
    /// # Errors
    /// A damaged file, one of another part of the grid, or values that are not finite.
    pub fn read(file: &Path, part: &Topology) -> Result<Option<Self>, archive::Error> {
        channel::load_warm_start(file, MAGIC, VERSION, |m: &Self| m.check(part).map_err(Into::into))
    }

    /// Loads the data of [`RankWarmStart::save`]; `None` if it is from another number of ranks. Collective.
    ///
    /// # Errors
    /// On every rank: a file of one of them that cannot be used.
    pub fn load(comm: &Comm, folder: &Path, part: &Topology) -> Result<Option<Self>, Fault> {
        let file = channel::warm_start_file(folder, Role::Flow, comm.rank(), comm.size());
        let memory = Self::read(&file, part);
        if !comm.all(memory.is_ok()) {
            let elsewhere = || Fault::new("another rank could not read its warm-start data of the flow");
            return Err(memory.err().map_or_else(elsewhere, Fault::new));
        }
        let memory = memory.map_err(Fault::new)?;
        Ok(if comm.all(memory.is_some()) { memory } else { None })
    }

    fn check(&self, part: &Topology) -> Result<(), &'static str> {
        self.solver.check(part)?;
        let faces = part.face_nodes.len();
        let face = |&(f, sign): &(u32, f64)| (f as usize) < faces && sign.abs() == 1.0;
        let home = |(cell, faces): &ProbeLocation| {
            cell.is_none_or(|c| (c as usize) < part.n_owned) && faces.iter().all(face)
        };
        if self.probes.iter().all(home) { Ok(()) } else { Err("the cell of a probe does not exist") }
    }
}
