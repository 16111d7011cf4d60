//! What a rank remembers beside the state of the nodes, so that a run which goes on in the middle of a
//! stage computes the same digits: kept factors, pairs in contact, ghosts.
//!
//! The state of the nodes serves any number of ranks; this serves the same number only.

use std::path::Path;

use case::Role;
use channel::KeptError;
use linalg::BlockCsr;
use serde::{Deserialize, Serialize};

use crate::dynamics::Dynamics;
use crate::newton::State;

const MAGIC: [u8; 8] = *b"ripstmem";
const VERSION: u32 = 1;

/// What the linear solver keeps from step to step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LinearMemory {
    /// Direct factors are kept.
    pub direct: Option<DirectMemory>,
    /// They are to be renewed before the next solve.
    pub stale: bool,
}

/// What direct factors were made of, and how they served.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DirectMemory {
    /// Several subdomains on a rank.
    pub cut: bool,
    /// Iterations of the first solve with the present factor, and its relative tolerance.
    pub fresh: u64,
    /// See `fresh`.
    pub at: f64,
    /// The matrix that was factorised; empty where the factors are to be renewed in any case.
    pub matrix: Vec<[[f64; 3]; 3]>,
}

#[derive(Serialize, Deserialize)]
struct Memory {
    /// Displacements, velocities and accelerations of local nodes, ghosts included.
    nodes: [Vec<f64>; 3],
    linear: LinearMemory,
    /// Of each element loop.
    loops: Vec<Vec<f64>>,
}

/// Writes this rank's memory below `folder`.
///
/// # Errors
/// Trouble with the file.
pub fn save(dynamics: &Dynamics, folder: &Path) -> Result<(), KeptError> {
    let State { u, v, a, .. } = &dynamics.accepted;
    let memory = Memory {
        nodes: [u.clone(), v.clone(), a.clone()],
        linear: dynamics.linear.memory(),
        loops: dynamics.system.loops().iter().map(|l| l.memory()).collect(),
    };
    let comm = dynamics.system.comm();
    let file = channel::memory_file(folder, Role::Structure, comm.rank(), comm.size());
    channel::keep(&file, MAGIC, VERSION, &memory).map(|_| ())
}

/// Takes up what [`save`] wrote; `false` where another number of ranks, or another version of this
/// program, has written it. Collective.
pub fn recall(dynamics: &mut Dynamics, folder: &Path) -> bool {
    let comm = dynamics.system.comm().clone();
    let file = channel::memory_file(folder, Role::Structure, comm.rank(), comm.size());
    let fits = |m: &Memory| {
        let n = dynamics.accepted.u.len();
        let matrix = m.linear.direct.as_ref().map_or(0, |d| d.matrix.len());
        m.nodes.iter().all(|v| v.len() == n)
            && m.loops.len() == dynamics.system.loops().len()
            && (matrix == 0 || matrix == dynamics.system.matrix.values.len())
    };
    let memory = channel::kept::<Memory>(&file, MAGIC, VERSION).ok().filter(fits);
    if !comm.all(memory.is_some()) {
        return false;
    }
    let Memory { nodes: [u, v, a], linear, loops } = memory.expect("all ranks have one");
    let accepted = &mut dynamics.accepted;
    (accepted.u, accepted.v, accepted.a) = (u, v, a);
    for (element_loop, memory) in dynamics.system.loops_mut().iter_mut().zip(&loops) {
        element_loop.recall(memory);
    }
    let matrix: &mut BlockCsr<3> = &mut dynamics.system.matrix;
    dynamics.linear.recall(linear, matrix);
    true
}
