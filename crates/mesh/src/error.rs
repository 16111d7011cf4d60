use std::path::PathBuf;

use crate::Point;

/// Errors of creating, checking, partitioning, reading or writing a mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// A geometry parameter out of range.
    #[error("{key} = {value}: {reason}")]
    Parameter {
        /// Key of the scene.
        key: &'static str,
        /// Value in the scene.
        value: String,
        /// Why it cannot be, and what can.
        reason: String,
    },
    /// A scene names a node set that is missing or empty.
    #[error("{key}: the node set \"{name}\" {what}; available: {}", sets.join(", "))]
    UnknownNodeSet {
        /// Where the scene says so.
        key: String,
        /// The name.
        name: String,
        /// What is wrong with it.
        what: &'static str,
        /// Sets that have nodes.
        sets: Vec<String>,
    },
    /// The vents are too narrow for a cell.
    #[error(
        "the vents are closed (widest opening {width_m:.3e} m, at least {least_m:.3e} m needed): \
         the flow grid needs an inflated canopy; run a stage of kind \"pre-inflation\" first"
    )]
    VentsClosed {
        /// Opening of the least open vent, m.
        width_m: f64,
        /// Least opening that the grid accepts, m.
        least_m: f64,
    },
    /// No valid grid was found around this shape.
    #[error(
        "cell {cell} of the flow grid near ({:.3}, {:.3}, {:.3}) has a scaled Jacobian of {quality:.4} \
         after smoothing: the canopy shape is too distorted for this grid; \
         lower `first_layer_m`, change `layers_inside`, or start from a smoother pre-inflated shape",
        at[0], at[1], at[2]
    )]
    Tangled {
        /// Worst cell.
        cell: usize,
        /// Its centre, m.
        at: Point,
        /// Its scaled Jacobian.
        quality: f64,
    },
    /// An array of a wrong length for this mesh.
    #[error("{what}: {found} given, {expected} expected")]
    Count {
        /// Quantity that was counted.
        what: &'static str,
        /// Number given.
        found: usize,
        /// Number expected.
        expected: usize,
    },
    /// A cell face with neither neighbour nor boundary condition.
    #[error("face {nodes:?} of cell {cell} is open: it has neither a neighbour nor a boundary condition")]
    OpenFace {
        /// Nodes of the face.
        nodes: [u32; 4],
        /// Its cell.
        cell: usize,
    },
    /// More than two cells share a face, or two on the same side.
    #[error(
        "face {nodes:?} is shared by cells {cells:?}, but at most two cells on opposite sides can share a face"
    )]
    NonManifoldFace {
        /// Nodes of the face.
        nodes: [u32; 4],
        /// Cells that have it.
        cells: Vec<usize>,
    },
    /// A canopy or boundary face that is not a face of any cell.
    #[error("{kind} face {index} with nodes {nodes:?} is not a face of the grid's cells")]
    UnmatchedFace {
        /// "canopy" or "boundary".
        kind: &'static str,
        /// Number of the face.
        index: usize,
        /// Nodes of the face.
        nodes: [u32; 4],
    },
    /// Two patches of a periodic pair that are not the same but for a translation, or that cannot be periodic.
    #[error("the periodic patches \"{}\" and \"{}\": {reason}", patches[0], patches[1])]
    Periodic {
        /// Names of the patches.
        patches: [String; 2],
        /// What is wrong, and what helps.
        reason: String,
    },
    /// A cell with no or negative volume.
    #[error("cell {cell} near ({:.4}, {:.4}, {:.4}) has the volume {volume:.3e} m3, but volumes must be positive", at[0], at[1], at[2])]
    NegativeVolume {
        /// The cell.
        cell: usize,
        /// Its centre, m.
        at: Point,
        /// Its volume, m3.
        volume: f64,
    },
    /// A Gmsh file that cannot be used as the flow grid of the scene.
    #[error("{}: {source}", path.display())]
    GridFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<crate::GridFileError>,
    },
    /// A pattern that cannot be cut, sewn or meshed.
    #[error("{}: {source}", path.display())]
    Pattern {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<crate::PatternError>,
    },
    /// A pattern file that cannot be read.
    #[error(transparent)]
    PatternFile(#[from] case::pattern::PatternFileError),
    /// More ranks than elements.
    #[error("{parts} ranks for {elements} elements: use at most {elements} ranks")]
    TooManyParts {
        /// Requested number of parts.
        parts: usize,
        /// Elements to share out.
        elements: usize,
    },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A file with wrong or damaged content.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}
