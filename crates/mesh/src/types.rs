//! The meshes that pass between the crates.

use std::collections::BTreeMap;

/// Condition on an outer boundary face, as scenes name it.
pub use case::Condition as Patch;
use case::{Scene, TapePlace};
use serde::{Deserialize, Serialize};

use crate::geometry::Point;

/// Fabric, lines and payload.
///
/// The first [`StructureMesh::n_canopy`] nodes are the canopy: in this order
/// they are the interface nodes of the contract. Faces are ordered too and are
/// the interface faces of the contract.
///
/// # Examples
///
/// ```
/// # use std::path::Path;
/// let scene = case::load(Path::new("../../cases/square-drop/scene.toml"))?;
/// let mesh = mesh::structure_mesh(&scene)?;
/// assert_eq!((mesh.n_canopy, mesh.faces.len()), (13 * 13, 12 * 12));
/// // A square of 2 m.
/// assert!((mesh.fabric_area(|_panel| true) - 4.0).abs() < 1e-12);
/// assert_eq!(mesh.node_sets["canopy"].len(), mesh.n_canopy);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StructureMesh {
    /// Unstressed positions, m; with flat shapes those from which the canopy starts.
    pub coords: Vec<Point>,
    /// Number of canopy (interface) nodes.
    pub n_canopy: usize,
    /// Interface faces as quadrilaterals of canopy nodes; a triangle repeats its
    /// last node. The right-hand normal points out of the canopy, so a positive
    /// pressure jump (inside minus outside) pushes along it.
    pub faces: Vec<[u32; 4]>,
    /// Panel of each face (0: top; arms from 1), for pictures and reports.
    pub face_panel: Vec<u32>,
    /// Place of the group of each face in the scene's `[[canopy.fabric]]`, whose cloth it has; `None` where it is `[fabric]`. Empty: all are.
    #[serde(default)]
    pub face_fabric: Vec<Option<u16>>,
    /// Membrane elements, oriented as their face.
    pub triangles: Vec<[u32; 3]>,
    /// Interface face of each triangle.
    pub triangle_face: Vec<u32>,
    /// Unstressed flat shape of each triangle, m, in axes of its panel whose first one is the warp, counter-clockwise as seen from outside. Empty: `coords` are the
    /// unstressed shape. Otherwise all faces are triangles, and triangle t is face t.
    #[serde(default)]
    pub flat: Vec<[[f64; 2]; 3]>,
    /// Cable elements.
    pub cables: Vec<Cable>,
    /// Node and mass, kg.
    pub point_masses: Vec<(u32, f64)>,
    /// Node and its constrained components.
    pub fixed: Vec<(u32, [bool; 3])>,
    /// Nodes by names: `held`, `rim`, `canopy`, and the physical groups of a mesh file.
    pub node_sets: BTreeMap<String, Vec<u32>>,
}

/// A two-node cable element.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cable {
    /// End nodes.
    pub nodes: [u32; 2],
    /// Unstretched length, m: not the distance of the nodes.
    pub rest_length: f64,
    /// Kind of line that it models.
    pub kind: CableKind,
    /// Number of the line it is a part of, for line tensions.
    pub line: u32,
    /// Lines of its kind that it stands for: 1, except for tapes of a grid ([`case::TapeGrid`]). Stiffness and mass
    /// for each metre are those of its kind times this number.
    pub share: f64,
    /// Place of its group in the scene's `[[canopy.cable]]`, whose section it has. Absent: it has that of its kind.
    #[serde(default)]
    pub group: Option<u16>,
}

impl Cable {
    /// Section of this cable in a scene; `None` where the scene gives none.
    pub fn section(&self, scene: &Scene) -> Option<Section> {
        section(self.kind, self.group, scene)
    }
}

/// Section of a cable of a kind, and of a group where it belongs to one; `None` where the scene gives none.
pub fn section(kind: CableKind, group: Option<u16>, scene: &Scene) -> Option<Section> {
    let Some(group) = group else { return kind.section(scene) };
    let g = scene.cable_groups().get(usize::from(group))?;
    Some(Section { axial_stiffness_n: g.axial_stiffness_n, mass_kg_m: g.mass_kg_m })
}

/// Kind of line that a cable element models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CableKind {
    /// From the hem to a confluence point.
    SuspensionLine,
    /// From a confluence point to the payload.
    Riser,
    /// Along a panel edge, on canopy nodes, with the section of the suspension lines.
    Reinforcement,
    /// A tape on canopy nodes, with a section of its own.
    Tape(TapePlace),
}

impl CableKind {
    /// Number in `lines.pvd`: 0 suspension line, 1 riser, 2 reinforcement, tapes: 3 hem, 4 seam, 5 vent, 6 grid.
    pub fn number(self) -> u32 {
        match self {
            CableKind::SuspensionLine => 0,
            CableKind::Riser => 1,
            CableKind::Reinforcement => 2,
            CableKind::Tape(place) => 3 + place as u32,
        }
    }

    /// Whether it stands free in the air.
    pub fn is_free(self) -> bool {
        matches!(self, CableKind::SuspensionLine | CableKind::Riser)
    }

    /// Section of this kind in a scene; `None` where the scene gives none.
    pub fn section(self, scene: &Scene) -> Option<Section> {
        let of = |axial_stiffness_n, mass_kg_m| Section { axial_stiffness_n, mass_kg_m };
        match self {
            CableKind::Tape(place) => {
                let tape = scene.tapes.as_ref()?.section(place)?;
                Some(of(tape.axial_stiffness_n, tape.mass_kg_m))
            }
            CableKind::Riser if scene.risers.is_some() => {
                scene.risers.map(|r| of(r.axial_stiffness_n, r.mass_kg_m))
            }
            _ => {
                let l = scene.lines.as_ref()?;
                Some(of(l.youngs_modulus_pa * l.area_m2, l.density_kg_m3 * l.area_m2))
            }
        }
    }
}

/// Section of lines, risers or tapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Axial stiffness EA, N.
    pub axial_stiffness_n: f64,
    /// Mass for each metre, kg/m.
    pub mass_kg_m: f64,
}

impl Section {
    /// Speed of a wave along it, m/s.
    pub fn wave_speed(&self) -> f64 {
        (self.axial_stiffness_n / self.mass_kg_m).sqrt()
    }
}

/// The volume grid around a canopy.
///
/// # Examples
///
/// A box of 24 cells without a canopy, its volume and the quality of its cells:
///
/// ```
/// use mesh::{FaceTable, Patch, box_grid, quality};
///
/// let grid = box_grid([2, 3, 4], [0.0; 3], [1.0, 1.0, 2.0], [Patch::FarField; 6]);
/// let volume: f64 = (0..grid.cells.len()).map(|c| quality::cell_volume(&grid, c)).sum();
/// assert!((volume - 2.0).abs() < 1e-12);
/// assert!((quality::scaled_jacobian(&grid.coords, &grid.cells[0]) - 1.0).abs() < 1e-12);
/// assert_eq!(grid.boundary.len(), 2 * (2 * 3 + 3 * 4 + 2 * 4));
/// assert!(FaceTable::new(&grid).is_ok());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FlowGrid {
    /// Node positions, m.
    pub coords: Vec<Point>,
    /// Hexahedra in VTK order (0-3 one face, 4-7 the opposite one). Other shapes
    /// repeat nodes: prism `[a,b,c,c, d,e,f,f]`, pyramid `[a,b,c,d, e,e,e,e]`,
    /// tetrahedron `[a,b,c,c, d,d,d,d]`, or any collapsed edge.
    pub cells: Vec<[u32; 8]>,
    /// Grid node of each canopy node.
    pub canopy_nodes: Vec<u32>,
    /// Interface faces in grid nodes, in the order and orientation of
    /// [`StructureMesh::faces`]. Each is a wall of zero thickness between two
    /// cells that share these nodes; with `one_sided` a wall of one cell.
    pub canopy_faces: Vec<[u32; 4]>,
    /// Every canopy face has a cell on one side only, instead of on both ([`case::GridFile::one_sided`]).
    pub one_sided: bool,
    /// Outer boundary faces with their condition.
    pub boundary: Vec<(Patch, [u32; 4])>,
    /// Names of the patches of the outer boundary, as [`case::Flow::patches`]. Empty where the grid names none.
    pub patch_names: Vec<String>,
    /// Patch of each face of [`FlowGrid::boundary`], as its place among the names. Empty where the grid names none.
    pub boundary_patch: Vec<u16>,
    /// Pairs of patches with the condition [`Patch::Periodic`], as their places among the names: the second is the first, translated.
    pub periodic: Vec<[u16; 2]>,
}

impl FlowGrid {
    /// Name of the patch of a boundary face, if it has one.
    pub fn patch_name(&self, boundary_face: usize) -> Option<&str> {
        let patch = *self.boundary_patch.get(boundary_face)?;
        self.patch_names.get(usize::from(patch)).map(String::as_str)
    }

    /// Boundary faces of the patches with these names, as their places in [`FlowGrid::boundary`].
    pub fn faces_of<'a>(&'a self, patches: &'a [String]) -> impl Iterator<Item = usize> + 'a {
        let of_patch = |k: &usize| self.patch_name(*k).is_some_and(|name| patches.iter().any(|p| p == name));
        (0..self.boundary.len()).filter(of_patch)
    }
}

/// The six faces of a hexahedron in VTK order, each oriented outwards.
pub const HEX_FACES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
