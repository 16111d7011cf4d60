use std::path::PathBuf;

use crate::Point;

/// Why a mesh could not be made, checked, cut or stored.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// A parameter of the geometry has no mesh.
    #[error("{key} = {value}: {reason}")]
    Parameter {
        /// Key of the scene.
        key: &'static str,
        /// What the scene says.
        value: String,
        /// Why it cannot be, and what can.
        reason: String,
    },
    /// A scene speaks of nodes that are not there.
    #[error("{key}: the node set \"{name}\" {what}; there are: {}", sets.join(", "))]
    NoSuchNodes {
        /// Where the scene says so.
        key: String,
        /// The name.
        name: String,
        /// What is wrong with it.
        what: &'static str,
        /// Sets that have nodes.
        sets: Vec<String>,
    },
    /// The vents have (nearly) no opening, so no cell fits in.
    #[error(
        "the vents are closed (widest opening {width_m:.3e} m, at least {least_m:.3e} m needed): \
         a flow grid needs an inflated canopy, so run a stage of kind \"pre-inflation\" first"
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
         try thinner `first_layer_m`, other `layers_inside`, or a smoother pre-inflated shape",
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
    /// Positions do not belong to this mesh.
    #[error("{what}: {found} given, {expected} expected")]
    Count {
        /// What was counted.
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
    #[error("face {nodes:?} is shared by cells {cells:?}, which is not a volume grid")]
    CrowdedFace {
        /// Nodes of the face.
        nodes: [u32; 4],
        /// Cells that have it.
        cells: Vec<usize>,
    },
    /// A canopy or boundary face that is no face of any cell.
    #[error("{kind} face {index} with nodes {nodes:?} is not a face of the grid's cells")]
    LooseFace {
        /// "canopy" or "boundary".
        kind: &'static str,
        /// Number of the face.
        index: usize,
        /// Nodes of the face.
        nodes: [u32; 4],
    },
    /// A cell with no or negative volume.
    #[error("cell {cell} near ({:.4}, {:.4}, {:.4}) has volume {volume:.3e} m3", at[0], at[1], at[2])]
    NegativeVolume {
        /// The cell.
        cell: usize,
        /// Its centre, m.
        at: Point,
        /// Its volume, m3.
        volume: f64,
    },
    /// A Gmsh file is no flow grid for the scene.
    #[error("{}: {source}", path.display())]
    GridFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<crate::GridFileError>,
    },
    /// More ranks than elements.
    #[error("{parts} ranks for {elements} elements: use at most {elements} ranks")]
    TooManyParts {
        /// Parts asked for.
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
    /// A file does not hold what it should.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}
