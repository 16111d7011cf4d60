use crate::Point;

fn at(x: &Point) -> String {
    format!("({:.6}, {:.6}, {:.6})", x[0], x[1], x[2])
}

/// Why a Gmsh file cannot be used as the flow grid of a scene. Element tags are those of the file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridFileError {
    /// No hexahedra, prisms, pyramids or tetrahedra.
    #[error("the file has no volume elements; mesh the volumes as well (gmsh -3)")]
    NoVolume,
    /// A scene names a group that the file does not have.
    #[error(
        "{key} names the physical group of surfaces \"{name}\", but the file has none of that name; available: {}",
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
         symmetry, periodic) to [flow.grid_file.patches]"
    )]
    NoCondition {
        /// Name of the group.
        name: String,
    },
    /// An outer face that is in no physical group.
    #[error(
        "the outer face at {} m of element {element} is in no physical group, so it has no boundary condition; \
         put every outer surface into a group (the same message results where a quadrilateral meets two triangles)",
        at(place)
    )]
    NoGroup {
        /// Tag of its cell.
        element: u64,
        /// Middle of the face, m.
        place: Point,
    },
    /// A cell with zero or negative volume.
    #[error(
        "the {shape} with tag {element} (cell {cell}) at {} m has the volume {volume:.3e} m3: it is inverted; remesh that region",
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
    /// A grid whose cells are not all connected through faces.
    #[error(
        "the volume mesh has {parts} parts that share no faces; element {element} at {} m is not \
         connected to the first part; if nodes are duplicated where blocks meet, merge them with \
         Coherence or set Mesh.MeshSizeExtendFromBoundary",
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
    /// A canopy node without a grid node at its position.
    #[error(
        "canopy node {node} is at {} m, but the nearest node of \"{membrane}\" is {distance:.3e} m away; \
         generate the grid around the shape at the start of the stage",
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
        "\"{membrane}\" has {found} faces, {common} of them match the {expected} faces of the canopy; \
         divide both into the same faces"
    )]
    OtherFaces {
        /// Group of the canopy's faces.
        membrane: String,
        /// Faces in the file.
        found: usize,
        /// Faces that both have.
        common: usize,
        /// Faces of the canopy.
        expected: usize,
    },
    /// Too many faces whose normal is far from the line of the two cell centres: the pressure iterations of the flow would stall.
    #[error(
        "{:.0} % of the faces between cells have a normal more than {limit} degrees from the line of the two cell centres (at most {:.0} % are \
         solved; the worst, {worst:.1} degrees, is at element {element} at {} m): the cells are too flat; use prisms or hexahedra in thin layers, or \
         smaller elements along them",
        100.0 * share, 100.0 * allowed, at(place)
    )]
    NonOrthogonal {
        /// Share of such faces.
        share: f64,
        /// Share that is allowed.
        allowed: f64,
        /// Angle from which a face counts, degrees.
        limit: f64,
        /// Largest angle, degrees.
        worst: f64,
        /// Tag of a cell of that face.
        element: u64,
        /// Centre of that cell, m.
        place: Point,
    },
    /// A face of a patch or of the membrane at a wrong location.
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
