//! The interface of a solver program.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{Stats, Window};

/// A solver program: the only trait that a replacement must implement.
///
/// One instance exists on each rank of the program. The calls arrive in the same order on each rank, so a participant
/// may use MPI collectives in them.
///
/// State machine of a window: `advance` (once or more, always from the state of
/// the last accepted window), then `accept`. Rolling back needs no call.
///
/// # Examples
///
/// A structure without inertia: each node moves along z by the pressure jump on its face times a compliance.
///
/// ```
/// use std::path::Path;
///
/// use channel::{Announcement, Fault, Grid, Input, Participant, Stats, Window};
///
/// struct Springs {
///     /// m/Pa
///     compliance: f64,
///     faces: Vec<[u32; 4]>,
/// }
///
/// impl Participant for Springs {
///     fn announce(&self) -> Announcement {
///         Announcement {
///             role: "structure".into(),
///             program: "springs".into(),
///             version: "1.0.0".into(),
///             canopy_nodes: self.faces.len() as u64,
///             canopy_faces: self.faces.len() as u64,
///             surface_hash: channel::surface_hash(&self.faces),
///             grid_nodes: 0,
///             output_width: 3,
///             effects: Vec::new(),
///         }
///     }
///
///     fn output_rows(&self) -> Vec<u64> {
///         (0..self.faces.len() as u64).collect()
///     }
///
///     fn advance(&mut self, _: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
///         for (load, displacement) in input.canopy.chunks_exact(8).zip(output.chunks_exact_mut(3)) {
///             // The second half of a row is the load at the end of the window.
///             displacement.copy_from_slice(&[0.0, 0.0, self.compliance * load[4]]);
///         }
///         Ok(Stats::default())
///     }
///
///     fn accept(&mut self, _: &Window) -> Result<(), Fault> {
///         Ok(())
///     }
///
///     fn save(&mut self, _: &Path) -> Result<(), Fault> {
///         Ok(())
///     }
///
///     fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
///         Ok(())
///     }
/// }
///
/// let mut springs = Springs { compliance: 1e-3, faces: vec![[0, 0, 0, 0]] };
/// let load = [0.0, 0.0, 0.0, 0.0, 12.0, 0.0, 0.0, 0.0];
/// let mut displacement = [0.0; 3];
/// let window = Window { dt: 5e-3, ..Window::default() };
/// springs.advance(&window, &Input { canopy: &load, grid: Grid::default() }, &mut displacement)?;
/// assert_eq!(displacement, [0.0, 0.0, 0.012]);
/// # Ok::<(), Fault>(())
/// ```
///
/// The `main` function of such a program serves it to the coupler, which passes the arguments ([`crate::serve`]).
pub trait Participant {
    /// What this rank announces in the handshake.
    fn announce(&self) -> Announcement;

    /// What this rank computes, in lines for the log of the program (first rank only).
    fn description(&self) -> Vec<String> {
        Vec::new()
    }

    /// Global indices of the rows that this rank's output holds, in the order of
    /// the output: canopy nodes (structure), canopy faces (flow), grid nodes (mesh).
    fn output_rows(&self) -> Vec<u64>;

    /// Global indices of the grid nodes that this rank reads (flow on a moving
    /// grid); empty otherwise.
    fn grid_rows(&self) -> Vec<u64> {
        Vec::new()
    }

    /// Seconds since the start in which this rank waited for other ranks of its program, their messages included
    /// (`WAITED_S` of [`Stats::values`] is the difference over a response). 0: one rank, or not measured.
    fn waited_s(&self) -> f64 {
        0.0
    }

    /// Computes window `w` from the state of the last accepted window.
    ///
    /// `output` is this rank's slice of shared memory, shape
    /// `[output_rows][output_width]`, to be filled completely.
    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault>;

    /// Accepts the last `advance` of window `w`: it becomes the state that later windows start from.
    fn accept(&mut self, w: &Window) -> Result<(), Fault>;

    /// Writes the accepted state below `folder` (created, shared by all ranks).
    fn save(&mut self, folder: &Path) -> Result<(), Fault>;

    /// Adds the accepted state to the ParaView series below `folder`.
    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault>;
}

/// Effect announced by a structure whose surface is not the scene's canopy: the announced numbers of nodes and faces
/// and the hash are then its own, and it has written the surface before the announcement (docs/reference/contract.md).
pub const OWN_SURFACE: &str = "surface.own";

/// Announcement of a rank: the coupler rejects a mismatch with a message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Announcement {
    /// Role: `structure`, `flow` or `mesh`.
    pub role: String,
    /// Name of the program, for messages.
    pub program: String,
    /// Version of the program.
    pub version: String,
    /// Canopy nodes of the interface.
    pub canopy_nodes: u64,
    /// Canopy faces of the interface.
    pub canopy_faces: u64,
    /// Hash of the interface faces: [`surface_hash`].
    pub surface_hash: u64,
    /// Nodes of the whole flow grid (mesh and flow on a moving grid; else 0).
    pub grid_nodes: u64,
    /// Numbers in one row of the output.
    pub output_width: u64,
    /// Effects that the program implements, by their scene keys.
    pub effects: Vec<String>,
}

/// Input of a participant, read in place from shared memory. All ranks of a program have the same `canopy` fields.
pub struct Input<'a> {
    /// Fields on the whole canopy, shape by role:
    /// * structure: `[faces][8]`: pressure jump and traction
    ///   x, y, z at the start of the window, then the same at its end;
    /// * mesh: displacement from the unstressed shape, `[nodes][3]`, m;
    /// * flow: empty; with [`crate::CANOPY_MOTION`] as the mesh.
    pub canopy: &'a [f64],
    /// Rows of the moved grid for [`Participant::grid_rows`] in their order:
    /// `[x, y, z, vx, vy, vz]`, m and m/s in the falling frame. Empty on a grid at rest.
    pub grid: Grid<'a>,
}

/// The moved grid as published by the ranks of the mesh-mover.
#[derive(Clone, Copy, Default)]
pub struct Grid<'a> {
    /// One slice for each rank of the mesh-mover, shape `[rows][6]`.
    pub pieces: &'a [&'a [f64]],
    /// Piece and row of each of the reader's `grid_rows`.
    pub index: &'a [(u32, u32)],
}

impl Grid<'_> {
    /// Whether the grid is at rest (nothing was published).
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Row `i` of the reader's `grid_rows`: position (m), velocity (m/s).
    #[inline]
    pub fn row(&self, i: usize) -> &[f64; 6] {
        let (piece, row) = self.index[i];
        let at = row as usize * 6;
        self.pieces[piece as usize][at..at + 6].try_into().expect("a row of six")
    }
}

/// Numbers in one row of the flow's output and of each half of the structure's
/// input: pressure jump (inside minus outside), Pa, and shear traction x, y, z
/// summed over both sides, Pa.
pub const LOAD_WIDTH: usize = 4;

/// An error that ends the run: problem, location, remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// The message: value, location, remedy.
    pub message: String,
}

impl Fault {
    /// From any message or error.
    pub fn new(message: impl std::fmt::Display) -> Self {
        Self { message: message.to_string() }
    }
}

/// Hash of the interface's faces (FNV-1a over the node indices as little-endian
/// `u32`), the same in every language.
pub fn surface_hash(faces: &[[u32; 4]]) -> u64 {
    archive::hash::fnv1a(faces.iter().flatten().flat_map(|n| n.to_le_bytes()))
}
