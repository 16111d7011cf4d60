//! Recordings of every exchange of a stage. They allow to run one program against its recorded partners (`ripstop replay`)
//! and to compare two runs value by value ([`compare`]).
//!
//! A recording is a folder:
//!
//! ```text
//! scene.toml            the scene of the run
//! <stage>/exchange.rec  the exchanges of a stage, in the order in which they happened
//! <stage>/state/        the saved state at the end of the stage
//! ```
//!
//! `exchange.rec` is the eight bytes of [`file::MAGIC`], then frames: length and CRC-32 of what
//! follows (two little-endian `u32`), then bincode ([`archive::codec::compact`]). The first frame is the [`Header`],
//! each other is an [`Event`]. Arrays are stored without loss: each is combined by exclusive or with the previous one of the
//! same channel, its bytes are sorted by significance, and the result is compressed (LZ4 blocks).

pub mod baseline;
pub mod compare;
pub mod file;
pub mod observed;
mod pack;
pub mod recorder;
pub mod stand_in;
pub mod totals;

use std::path::{Path, PathBuf};

use case::Role;
use channel::{STATS, Window};
use serde::{Deserialize, Serialize};

pub use baseline::Baseline;
pub use file::{Reader, RecordingError, Writer};
pub use recorder::Recorder;

/// Header of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the contract.
    pub contract: u32,
    /// Version of the program that recorded.
    pub version: String,
    /// Name of the scene.
    pub scene: String,
    /// Name and index of the stage.
    pub stage: (String, u64),
    /// Canopy nodes and faces.
    pub canopy: (u64, u64),
    /// [`channel::surface_hash`] of the faces.
    pub surface_hash: u64,
    /// Number of grid nodes whose motion is recorded; 0 if not recorded.
    pub grid_nodes: u64,
    /// Ranks of structure, flow and mesh.
    pub ranks: [u32; 3],
}

/// A [`Window`] as stored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// See [`Window`].
    pub index: u64,
    /// See [`Window`].
    pub iteration: u64,
    /// See [`Window`].
    pub substeps: u64,
    /// See [`Window`].
    pub time: f64,
    /// See [`Window`].
    pub dt: f64,
    /// See [`Window`].
    pub frame_velocity: [f64; 3],
    /// See [`Window`].
    pub frame_acceleration: [f64; 3],
}

impl From<&Window> for Moment {
    fn from(w: &Window) -> Self {
        let Window { index, iteration, substeps, time, dt, frame_velocity, frame_acceleration } = *w;
        Self { index, iteration, substeps, time, dt, frame_velocity, frame_acceleration }
    }
}

impl From<&Moment> for Window {
    fn from(m: &Moment) -> Self {
        let Moment { index, iteration, substeps, time, dt, frame_velocity, frame_acceleration } = *m;
        Self { index, iteration, substeps, time, dt, frame_velocity, frame_acceleration }
    }
}

/// An array exchanged with a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Coupler to structure: load at the start and at the end of the window, `[faces][8]`, Pa.
    StructureLoad,
    /// Structure to coupler: displacement, `[nodes][3]`, m.
    StructureDisplacement,
    /// Coupler to mesh: displacement, `[nodes][3]`, m.
    MeshDisplacement,
    /// Mesh to flow: positions and velocities, `[grid nodes][6]`, m and m/s.
    Grid,
    /// Flow to coupler: load, `[faces][4]`, Pa.
    FlowLoad,
}

impl Channel {
    /// All channels.
    pub const ALL: [Self; 5] = [
        Self::StructureLoad,
        Self::StructureDisplacement,
        Self::MeshDisplacement,
        Self::Grid,
        Self::FlowLoad,
    ];

    /// Values per row.
    pub fn width(self) -> usize {
        match self {
            Self::StructureLoad => 8,
            Self::StructureDisplacement | Self::MeshDisplacement => 3,
            Self::Grid => 6,
            Self::FlowLoad => channel::LOAD_WIDTH,
        }
    }
}

/// Statistics as a sequence: arrays of this length have no serialisation of their own. A shorter one, of a contract with
/// fewer statistics, is filled with zeros.
mod statistics {
    use channel::STATS;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(values: &[f64; STATS], to: S) -> Result<S::Ok, S::Error> {
        values.as_slice().serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; STATS], D::Error> {
        let values = Vec::<f64>::deserialize(from)?;
        let mut all = [0.0; STATS];
        let known = all.get_mut(..values.len());
        known
            .ok_or_else(|| serde::de::Error::invalid_length(values.len(), &"statistics of the contract"))?
            .copy_from_slice(&values);
        Ok(all)
    }
}

/// One exchange, with arrays of kind `A`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Event<A> {
    /// A structure solve.
    Structure {
        /// Window and iteration.
        at: Moment,
        /// [`Channel::StructureLoad`].
        load: A,
        /// [`Channel::StructureDisplacement`].
        displacement: A,
        /// Statistics.
        #[serde(with = "statistics")]
        stats: [f64; STATS],
    },
    /// A mesh solve.
    Mesh {
        /// Window and iteration.
        at: Moment,
        /// [`Channel::MeshDisplacement`].
        displacement: A,
        /// [`Channel::Grid`], if recorded.
        grid: Option<A>,
        /// Statistics.
        #[serde(with = "statistics")]
        stats: [f64; STATS],
    },
    /// A flow solve.
    Flow {
        /// Window and iteration.
        at: Moment,
        /// [`Channel::FlowLoad`].
        load: A,
        /// Statistics.
        #[serde(with = "statistics")]
        stats: [f64; STATS],
    },
    /// The window is accepted.
    Accept {
        /// The window.
        at: Moment,
    },
}

impl<A> Event<A> {
    /// Window and iteration.
    pub fn at(&self) -> &Moment {
        match self {
            Self::Structure { at, .. }
            | Self::Mesh { at, .. }
            | Self::Flow { at, .. }
            | Self::Accept { at } => at,
        }
    }

    /// The arrays, inputs first.
    pub fn arrays(&self) -> Vec<(Channel, &A)> {
        match self {
            Self::Structure { load, displacement, .. } => {
                vec![(Channel::StructureLoad, load), (Channel::StructureDisplacement, displacement)]
            }
            Self::Mesh { displacement, grid, .. } => {
                std::iter::once((Channel::MeshDisplacement, displacement))
                    .chain(grid.as_ref().map(|g| (Channel::Grid, g)))
                    .collect()
            }
            Self::Flow { load, .. } => vec![(Channel::FlowLoad, load)],
            Self::Accept { .. } => Vec::new(),
        }
    }

    /// Statistics of a solve.
    pub fn stats(&self) -> Option<&[f64; STATS]> {
        match self {
            Self::Structure { stats, .. } | Self::Mesh { stats, .. } | Self::Flow { stats, .. } => {
                Some(stats)
            }
            Self::Accept { .. } => None,
        }
    }

    /// The event with its arrays converted by `f`.
    ///
    /// # Errors
    /// The first error of `f`.
    pub fn map<B, E>(self, mut f: impl FnMut(Channel, A) -> Result<B, E>) -> Result<Event<B>, E> {
        Ok(match self {
            Self::Structure { at, load, displacement, stats } => Event::Structure {
                at,
                load: f(Channel::StructureLoad, load)?,
                displacement: f(Channel::StructureDisplacement, displacement)?,
                stats,
            },
            Self::Mesh { at, displacement, grid, stats } => Event::Mesh {
                at,
                displacement: f(Channel::MeshDisplacement, displacement)?,
                grid: grid.map(|g| f(Channel::Grid, g)).transpose()?,
                stats,
            },
            Self::Flow { at, load, stats } => Event::Flow { at, load: f(Channel::FlowLoad, load)?, stats },
            Self::Accept { at } => Event::Accept { at },
        })
    }

    /// Program that solved; none for an accepted window.
    pub fn role(&self) -> Option<Role> {
        match self {
            Self::Structure { .. } => Some(Role::Structure),
            Self::Mesh { .. } => Some(Role::Mesh),
            Self::Flow { .. } => Some(Role::Flow),
            Self::Accept { .. } => None,
        }
    }

    /// Number of the program, for matching events of two recordings.
    pub(crate) fn kind(&self) -> u8 {
        match self {
            Self::Structure { .. } => 0,
            Self::Mesh { .. } => 1,
            Self::Flow { .. } => 2,
            Self::Accept { .. } => 3,
        }
    }
}

/// File with the exchanges of a stage in the recording `folder`.
pub fn stage_file(folder: &Path, stage: &str) -> PathBuf {
    folder.join(stage).join("exchange.rec")
}
