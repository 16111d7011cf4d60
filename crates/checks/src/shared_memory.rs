//! Shared memory of a stage, estimated before a program starts.
//!
//! Memory is taken page by page when it is first written: a program that runs out of it
//! then is killed by SIGBUS without a word.

use std::path::Path;

use case::{Role, Scene};
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use results::machine::free_in;

/// Where it is.
const PLACE: &str = "/dev/shm";
/// Messages of a channel that are written while others are read, at most.
const COPIES: u64 = 3;
/// OpenMPI's own files of a program (its key-value store), bytes, measured with 4.1.
const MPI_PROGRAM: u64 = 2 * 4_194_304 + 100_000;
/// OpenMPI's segment of a rank, which fills while ranks talk.
const MPI_RANK: u64 = 4_194_312;
/// Small messages and counters of a rank.
const RANK: u64 = 500_000;
/// With so much left for the grid it is not counted before a run.
const PLENTY: u64 = 4_000_000_000;

/// Bytes that a stage needs; `grid_nodes` of a grid that moves.
pub fn needed(scene: &Scene, stage: usize, interface: &CanopyInterface, grid_nodes: u64) -> u64 {
    let (nodes, faces) = (interface.nodes() as u64, interface.faces.len() as u64);
    let width = channel::LOAD_WIDTH as u64;
    let of = |role: &Role| {
        // Input, output, and the rows of the output.
        let numbers = match role {
            Role::Structure => 2 * width * faces + 3 * nodes + nodes,
            Role::Mesh => 3 * nodes + 6 * grid_nodes + grid_nodes,
            Role::Flow => width * faces + faces,
        };
        let ranks = u64::from(scene.ranks.of(*role));
        let shared = if ranks > 1 { ranks * MPI_RANK } else { 0 };
        COPIES * 8 * numbers + MPI_PROGRAM + shared + ranks * RANK
    };
    scene.roles(&scene.stages[stage]).iter().map(of).sum()
}

/// Nodes of the moving grid of a scene; 0 where its parameters make none.
pub fn grid_nodes(scene: &Scene) -> u64 {
    if !scene.stages.iter().any(|s| scene.roles(s).contains(&Role::Mesh)) {
        return 0;
    }
    let made = mesh::structure_mesh(scene).and_then(|c| mesh::grid_sizes(scene, &c));
    made.map_or(0, |grid| grid.nodes)
}

/// Bytes of shared memory that are free; `None` where there is none, or it cannot be asked.
pub fn free() -> Option<u64> {
    free_in(Path::new(PLACE))
}

/// Refuses to start what would not fit.
///
/// # Errors
/// [`RunError::Input`] with what is needed and what is free.
pub fn require(scene: &Scene, first: usize, interface: &CanopyInterface) -> Result<(), RunError> {
    let Some(free) = free().filter(|_| Path::new(PLACE).is_dir()) else { return Ok(()) };
    let grid = if free > PLENTY { 0 } else { grid_nodes(scene) };
    for stage in first..scene.stages.len() {
        let needed = needed(scene, stage, interface, grid);
        if needed > free {
            return Err(RunError::Input(format!(
                "stage `{}` needs {} in {PLACE}, where {} are free: make room (`ls -l {PLACE}`), or enlarge it \
                 (`mount -o remount,size=...`, in a container `--shm-size`)",
                scene.stages[stage].name,
                megabytes(needed),
                megabytes(free)
            )));
        }
    }
    Ok(())
}

/// A line for `ripstop check`.
pub fn line(scene: &Scene, first: usize, interface: &CanopyInterface) -> String {
    let grid = grid_nodes(scene);
    let most = (first..scene.stages.len()).map(|s| needed(scene, s, interface, grid)).max().unwrap_or(0);
    let free = free().map_or_else(|| "unknown".into(), megabytes);
    format!("shared memory: at most {} of {PLACE} ({free} free)", megabytes(most))
}

fn megabytes(bytes: u64) -> String {
    format!("{} MB", bytes.div_ceil(1_000_000))
}
