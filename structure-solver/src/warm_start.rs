//! Data of a rank besides the state of the nodes, so that a run which restarts within a
//! stage computes the same digits: kept factors, pairs in contact, ghosts.
//!
//! The state of the nodes serves any number of ranks; this serves the same number only.

use std::path::Path;

use case::Role;
use channel::Fault;
use comm::Comm;
use linalg::BlockCsr;
use serde::{Deserialize, Serialize};

use crate::dynamics::Dynamics;
use crate::newton::State;

const MAGIC: [u8; 8] = *b"ripstmem";
const VERSION: u32 = 1;

/// What the linear solver keeps from step to step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LinearWarmStart {
    /// Direct factors are kept.
    pub direct: Option<DirectWarmStart>,
    /// They are to be renewed before the next solve.
    pub stale: bool,
}

/// What direct factors were made of, and how they served.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DirectWarmStart {
    /// What they are of: 0 the symmetric part, 1 that in several subdomains on a rank, 2 the matrix
    /// itself. Earlier versions had a truth value for the first two in this place.
    pub kind: u8,
    /// Iterations of the first solve with the present factor, and its relative tolerance.
    pub fresh: u64,
    /// See `fresh`.
    pub at: f64,
    /// The matrix that was factorised; empty where the factors are to be renewed in any case.
    pub matrix: Vec<[[f64; 3]; 3]>,
}

/// Warm-start data of a rank.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WarmStart {
    /// Displacements, velocities and accelerations of local nodes, ghosts included.
    pub nodes: [Vec<f64>; 3],
    /// Of the linear solver.
    pub linear: LinearWarmStart,
    /// Of each element loop.
    pub loops: Vec<Vec<f64>>,
}

/// Dimensions that saved warm-start data must match.
#[derive(Clone, Copy, Debug)]
pub struct Dimensions {
    /// Numbers of a vector over the local nodes.
    pub numbers: usize,
    /// Element loops.
    pub loops: usize,
    /// Blocks of the matrix.
    pub blocks: usize,
}

impl WarmStart {
    /// Reads what [`save`] wrote; `None` where there is none.
    ///
    /// # Errors
    /// The file is damaged or does not match, or contains a value that is not a number.
    pub fn read(file: &Path, dimensions: Dimensions) -> Result<Option<Self>, archive::Error> {
        channel::load_warm_start(file, MAGIC, VERSION, |m: &Self| m.check(dimensions))
    }

    fn check(&self, dimensions: Dimensions) -> Result<(), String> {
        let matrix = self.linear.direct.as_ref().map_or(&[][..], |d| &d.matrix);
        let at = self.linear.direct.as_ref().map_or(0.0, |d| d.at);
        let vectors = self.nodes.iter().chain(&self.loops).flatten();
        if self.nodes.iter().any(|v| v.len() != dimensions.numbers) || self.loops.len() != dimensions.loops {
            return Err("it belongs to another structure".into());
        }
        if !matrix.is_empty() && matrix.len() != dimensions.blocks {
            return Err("its matrix belongs to another structure".into());
        }
        if !vectors.chain(matrix.as_flattened().as_flattened()).chain([&at]).all(|x| x.is_finite()) {
            return Err("it contains values that are not finite".into());
        }
        Ok(())
    }
}

/// Writes the warm-start data of this rank below `folder`.
///
/// # Errors
/// The file cannot be written.
pub fn save(dynamics: &Dynamics, folder: &Path) -> Result<(), archive::Error> {
    let State { u, v, a, .. } = &dynamics.accepted;
    let warm_start = WarmStart {
        nodes: [u.clone(), v.clone(), a.clone()],
        linear: dynamics.linear.save_state(),
        loops: dynamics.system.loops().iter().map(|l| l.save_state()).collect(),
    };
    let comm = dynamics.system.comm();
    let file = channel::warm_start_file(folder, Role::Structure, comm.rank(), comm.size());
    archive::save(&file, MAGIC, VERSION, &warm_start).map(|_| ())
}

/// Restores what [`save`] wrote; `false` if another number of ranks wrote it. Collective.
///
/// # Errors
/// On every rank, if the file of one of them cannot be used.
pub fn restore_state(dynamics: &mut Dynamics, folder: &Path) -> Result<bool, Fault> {
    let comm = dynamics.system.comm().clone();
    let file = channel::warm_start_file(folder, Role::Structure, comm.rank(), comm.size());
    let dimensions = Dimensions {
        numbers: dynamics.accepted.u.len(),
        loops: dynamics.system.loops().len(),
        blocks: dynamics.system.matrix.values.len(),
    };
    let warm_start = agree(&comm, WarmStart::read(&file, dimensions))?;
    if !comm.all(warm_start.is_some()) {
        return Ok(false);
    }
    let WarmStart { nodes: [u, v, a], linear, loops } = warm_start.expect("all ranks have one");
    let restored =
        dynamics.system.loops_mut().iter_mut().zip(&loops).try_for_each(|(l, m)| l.restore_state(m));
    agree(&comm, restored.map_err(|reason| archive::Error::content(&file, reason)))?;
    let accepted = &mut dynamics.accepted;
    (accepted.u, accepted.v, accepted.a) = (u, v, a);
    let kind = linear.direct.as_ref().map_or(u64::MAX, |d| u64::from(d.kind));
    if comm.all_gather_u64(kind).iter().any(|k| *k != kind) {
        return Err(Fault::new(archive::Error::content(
            &file,
            "the saved factorisations of the ranks differ",
        )));
    }
    let matrix: &mut BlockCsr<3> = &mut dynamics.system.matrix;
    dynamics.linear.restore_state(linear, matrix);
    Ok(true)
}

/// An error on one rank becomes one on every rank. Collective.
fn agree<T>(comm: &Comm, result: Result<T, archive::Error>) -> Result<T, Fault> {
    let all = comm.all(result.is_ok());
    match result {
        Ok(_) if !all => Err(Fault::new("another rank could not use its part of the structure's state")),
        other => other.map_err(Fault::new),
    }
}
