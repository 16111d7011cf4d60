use crate::Point;

fn at(x: &Point) -> String {
    format!("({:.6}, {:.6}, {:.6})", x[0], x[1], x[2])
}

/// Why a Gmsh file is no flow grid for a scene. Elements have the tags of the file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridFileError {
    /// No hexahedra, prisms, pyramids or tetrahedra.
    #[error("holds no volume elements: mesh its volumes too (gmsh -3)")]
    NoVolume,
    /// A scene names a group that the file does not have.
    #[error(
        "there is no physical group of surfaces named \"{name}\", which {key} wants; there are: {}",
        groups.join(", ")
    )]
    NoSuchGroup {
        /// The name.
        name: String,
        /// Key of the scene.
        key: &'static str,
        /// Groups of surfaces in the file.
        groups: Vec<String>,
    },
    /// An outer face of a named group without a condition.
    #[error(
        "the patch \"{name}\" has no condition: add `{name} = \"far-field\"` (or outlet, inlet, wall, slip, \
         symmetry) to [flow.grid_file.patches]"
    )]
    NoCondition {
        /// Name of the group.
        name: String,
    },
    /// An outer face that is in no physical group.
    #[error(
        "the outer face at {} m of element {element} is in no physical group: \
         put every outer surface into one (faces of a quadrilateral and two triangles do not match either)",
        at(place)
    )]
    NoGroup {
        /// Tag of its cell.
        element: u64,
        /// Middle of the face, m.
        place: Point,
    },
    /// A cell that is inside out or flat.
    #[error(
        "the {shape} with tag {element} (cell {cell}) at {} m has volume {volume:.3e} m3: inverted",
        at(place)
    )]
    Inverted {
        /// Shape of the element.
        shape: &'static str,
        /// Its tag.
        element: u64,
        /// Its number in the grid, from 0.
        cell: usize,
        /// Its centre, m.
        place: Point,
        /// Its volume, m3.
        volume: f64,
    },
    /// Cells that no path through faces leads to.
    #[error(
        "the volume falls into {parts} parts that share no faces; element {element} at {} m is not \
         connected to the first: are nodes doubled where blocks meet (Coherence, or \
         Mesh.MeshSizeExtendFromBoundary)?",
        at(place)
    )]
    Unconnected {
        /// Number of parts.
        parts: usize,
        /// Tag of a cell of the second.
        element: u64,
        /// Its centre, m.
        place: Point,
    },
    /// A canopy node where the grid has none.
    #[error(
        "canopy node {node} is at {} m, but the nearest node of \"{membrane}\" is {distance:.3e} m away: \
         the grid must be made around the shape that the stage starts with",
        at(place)
    )]
    NoNode {
        /// The canopy node.
        node: usize,
        /// Where it is, m.
        place: Point,
        /// Distance to the nearest, m.
        distance: f64,
        /// Group of the canopy's faces.
        membrane: String,
    },
    /// The faces of the membrane are not those of the canopy.
    #[error(
        "\"{membrane}\" has {found} faces, {alike} of which are faces of the canopy, which has {expected}: \
         both must be cut alike"
    )]
    OtherFaces {
        /// Group of the canopy's faces.
        membrane: String,
        /// Faces in the file.
        found: usize,
        /// Faces that both have.
        alike: usize,
        /// Faces of the canopy.
        expected: usize,
    },
    /// A face of a patch or of the membrane that lies elsewhere.
    #[error("the face of \"{name}\" at {} m {what}", at(place))]
    Misplaced {
        /// Group of the face.
        name: String,
        /// Its middle, m.
        place: Point,
        /// What is wrong with it.
        what: &'static str,
    },
}
