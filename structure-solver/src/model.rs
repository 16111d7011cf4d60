//! A rank's part of the structure (paper, Fig. 1): element level and system level.
//!
//! System level: METIS gives each rank nodes, the rows it solves for. Element
//! level: a rank computes every element that touches one of its nodes, so its
//! rows are complete without sending element data; elements on a border are
//! computed by each rank that they touch.

use std::rc::Rc;

use comm::{Comm, Halo, Numbering};
use mesh::{CableKind, StructureMesh};

use crate::elements::{membrane, quad};
use crate::patches::{self, Patch};
use mesh::geometry::{Point, Vec3, at};

/// A structure that cannot be computed: what, where, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A triangle without area.
    #[error("triangle {triangle} (nodes {nodes:?}) has no area: its nodes lie on one line; repair the mesh")]
    FlatTriangle {
        /// Triangle of the mesh.
        triangle: usize,
        /// Its nodes.
        nodes: [u32; 3],
    },
    /// A face that is no bilinear element.
    #[error(
        "face {face} (nodes {nodes:?}) cannot be a quadrilateral element: it has no area, or is folded over \
         itself; repair the mesh, or choose membrane = \"triangle\""
    )]
    BadQuad {
        /// Face of the mesh.
        face: usize,
        /// Its nodes.
        nodes: [u32; 4],
    },
    /// The warp of a fabric stands on it.
    #[error(
        "fabric.orthotropic.direction is normal to face {face}: its projection onto the face vanishes; give another direction, or none"
    )]
    NoWarp {
        /// Face of the mesh.
        face: usize,
    },
    /// A cable that cannot be strained.
    #[error("cable {cable} (nodes {nodes:?}) has a rest length of {rest_length} m: it must be above zero")]
    NoLength {
        /// Cable of the mesh.
        cable: usize,
        /// Its nodes.
        nodes: [u32; 2],
        /// Rest length, m.
        rest_length: f64,
    },
    /// A reefing line without a skirt.
    #[error(
        "a reefing line connects the nodes where suspension lines are attached to the canopy, but the canopy has only {nodes} of them"
    )]
    NoSkirt {
        /// Nodes where lines are attached.
        nodes: usize,
    },
    /// A cable without a material.
    #[error("cable {cable} has no material: add [lines] to the scene, or [tapes] where it is a tape")]
    NoMaterial {
        /// Cable of the mesh.
        cable: usize,
    },
    /// A node that nothing holds.
    #[error(
        "node {node} at {position:?} m belongs to no element and has no mass: it cannot move; \
         remove it or fix it"
    )]
    LooseNode {
        /// Node of the mesh.
        node: usize,
        /// Its position, m.
        position: Point,
    },
    /// Two parts that touch without being joined.
    #[error(
        "nodes {here} and {there} both lie at {position:?} m, but no element connects their parts, and the part \
         of node {here} has no support: merge the nodes (in Gmsh: Coherence Mesh)"
    )]
    Apart {
        /// Node of the part that nothing holds.
        here: u32,
        /// Node of another part.
        there: u32,
        /// Where both are, m.
        position: Point,
    },
    /// A part that nothing holds.
    #[error(
        "the part of node {node} at {position:?} m ({nodes} nodes) has no support along {axes}: \
         connect it with the rest, or fix one of its nodes"
    )]
    Drifts {
        /// Lowest node of the part.
        node: usize,
        /// Its number of nodes.
        nodes: usize,
        /// Position of `node`, m.
        position: Point,
        /// Axes along which it may drift.
        axes: String,
    },
    /// Two nodes of one element in one place, or a node outside the mesh.
    #[error("{what} {element} names node {node} {reason}")]
    BadNode {
        /// Kind of element.
        what: &'static str,
        /// Its number.
        element: usize,
        /// The node.
        node: u32,
        /// What is wrong.
        reason: &'static str,
    },
    /// More ranks than nodes to share.
    #[error("{ranks} ranks are too many for {nodes} nodes: use at most {nodes}")]
    TooManyRanks {
        /// Ranks of the program.
        ranks: usize,
        /// Nodes of the mesh.
        nodes: usize,
    },
}

/// A membrane element of this rank. Node numbers are local.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    /// Nodes.
    pub nodes: [u32; 3],
    /// Interface face whose load acts on it (global).
    pub face: u32,
    /// Reference state.
    pub reference: membrane::Reference,
    /// Number in the mesh, for messages.
    pub global: u32,
    /// Group of its cloth, as [`StructureMesh::face_fabric`].
    pub fabric: Option<u16>,
}

/// A bilinear membrane element of this rank. Node numbers are local.
#[derive(Clone, Debug)]
pub struct Quad {
    /// Nodes; a triangle repeats its last one.
    pub nodes: [u32; 4],
    /// Interface face that it is (global).
    pub face: u32,
    /// Reference state.
    pub reference: quad::Reference,
    /// Group of its cloth, as [`StructureMesh::face_fabric`].
    pub fabric: Option<u16>,
}

/// A face of four nodes that two triangles approximate. Node numbers are local.
#[derive(Clone, Copy, Debug)]
pub struct SplitFace {
    /// Nodes in order; the diagonal that both triangles share joins the first and the third.
    pub nodes: [u32; 4],
    /// Interface face that it is (global).
    pub face: u32,
    /// Group of its cloth, as [`StructureMesh::face_fabric`].
    pub fabric: Option<u16>,
}

/// Direction of the warp in the unstressed fabric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warp {
    /// Along the first edge of each face; along the warp of the panel, where the mesh has flat shapes.
    FirstEdge,
    /// Along a vector laid onto the fabric.
    Vector(Point),
}

/// How faces become elements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surface {
    /// Bilinear elements are used; the triangles then only describe the surface.
    pub quadrilaterals: bool,
    /// First axis of strains and stresses; anywhere if `None`.
    pub warp: Option<Warp>,
    /// Triangles bend with their neighbours.
    pub bending: bool,
}

/// A cable element of this rank. Node numbers are local.
#[derive(Clone, Copy, Debug)]
pub struct CableElement {
    /// End nodes.
    pub nodes: [u32; 2],
    /// Rest length, m.
    pub rest_length: f64,
    /// What it models.
    pub kind: CableKind,
    /// Line that it is a part of.
    pub line: u32,
    /// Lines of its kind that it stands for.
    pub share: f64,
    /// Number in the mesh, for messages.
    pub global: u32,
    /// Its group, where it has the section of one, as [`mesh::Cable::group`].
    pub group: Option<u16>,
}

/// Nodes and elements of one rank.
#[derive(Debug)]
pub struct Model {
    /// Ranks of the program.
    pub comm: Comm,
    /// Local numbering of the nodes.
    pub numbering: Numbering,
    /// Exchange of nodal values.
    pub halo: Rc<Halo>,
    /// Positions of zero displacement, m, shape `[n_local][3]`: unstressed, unless the mesh has flat shapes of its own.
    pub reference: Vec<f64>,
    /// Factor on these positions at which fabric is taut: 1 where they are unstressed.
    pub tautening: f64,
    /// Membrane elements; the first [`Model::n_own_triangles`] are counted here
    /// in sums over all ranks.
    pub triangles: Vec<Triangle>,
    /// Triangles whose first node is owned here.
    pub n_own_triangles: usize,
    /// Bilinear elements, if chosen, ordered like the triangles.
    pub quads: Vec<Quad>,
    /// Bilinear elements whose first node is owned here.
    pub n_own_quads: usize,
    /// Faces of four nodes that are two triangles each; none where they are bilinear elements.
    pub split_faces: Vec<SplitFace>,
    /// Triangles with their neighbours, if they bend, ordered like the triangles.
    pub patches: Vec<Patch>,
    /// Patches whose first node is owned here.
    pub n_own_patches: usize,
    /// Cable elements, ordered like the triangles.
    pub cables: Vec<CableElement>,
    /// Cables whose first node is owned here.
    pub n_own_cables: usize,
    /// Pairs of nodes coupled by other terms than elements, in the order of the triangles.
    pub ties: Vec<[u32; 2]>,
    /// Ties whose first node is owned here.
    pub n_own_ties: usize,
    /// Constrained components, shape `[n_local][3]`.
    pub fixed: Vec<bool>,
    /// Point masses of local nodes, kg.
    pub point_masses: Vec<(u32, f64)>,
    /// Interface faces of the whole canopy.
    pub n_faces: usize,
}

impl Model {
    /// The part of `mesh` that `comm.rank()` works on, given the `owner` rank of
    /// each node. Collective.
    pub fn new(comm: &Comm, mesh: &StructureMesh, owner: &[u32]) -> Result<Self, ModelError> {
        Self::with(comm, mesh, owner, Surface::default())
    }

    /// As [`Model::new`], with a choice of elements and axes. Collective.
    pub fn with(
        comm: &Comm,
        mesh: &StructureMesh,
        owner: &[u32],
        surface: Surface,
    ) -> Result<Self, ModelError> {
        Self::with_ties(comm, mesh, owner, surface, &[])
    }

    /// As [`Model::with`], with pairs of nodes of the mesh that a rank needs together. Collective.
    pub fn with_ties(
        comm: &Comm,
        mesh: &StructureMesh,
        owner: &[u32],
        surface: Surface,
        ties: &[[u32; 2]],
    ) -> Result<Self, ModelError> {
        check(mesh)?;
        let mut reach = Reach { owner, rank: comm.rank() as u32, ghosts: Vec::new() };
        let triangles: Vec<usize> =
            (0..mesh.triangles.len()).filter(|&t| reach.touches(&mesh.triangles[t])).collect();
        let cables: Vec<usize> =
            (0..mesh.cables.len()).filter(|&c| reach.touches(&mesh.cables[c].nodes)).collect();
        let mut ties: Vec<[u32; 2]> = ties.iter().filter(|t| reach.touches(&t[..])).copied().collect();
        let split = if surface.quadrilaterals { Vec::new() } else { split_faces(mesh) };
        let faces = if surface.quadrilaterals { mesh.faces.len() } else { 0 };
        let faces: Vec<usize> = (0..faces).filter(|&f| reach.touches(&mesh.faces[f])).collect();
        let mut split_faces: Vec<SplitFace> = split.into_iter().filter(|f| reach.touches(&f.nodes)).collect();
        let patches = if surface.bending { patches::of(mesh)? } else { Vec::new() };
        let mut patches: Vec<Patch> = patches.into_iter().filter(|p| reach.touches(&p.nodes)).collect();
        let numbering = reach.numbering(mesh.coords.len());
        let halo = Rc::new(Halo::new(comm, &numbering));

        let part = Part { mesh, numbering: &numbering, warp: surface.warp };
        split_faces.iter_mut().flat_map(|f| &mut f.nodes).for_each(|n| *n = part.local(*n));
        let triangles = part.triangles(&triangles)?;
        let quads = part.quads(&faces)?;
        let cables = part.cables(&cables);
        patches.iter_mut().flat_map(|p| &mut p.nodes).for_each(|n| *n = part.local(*n));
        patches.sort_by_key(|p| part.is_ghost(p.nodes[0]));
        ties.iter_mut().flatten().for_each(|n| *n = part.local(*n));
        ties.sort_by_key(|t| part.is_ghost(t[0]));
        let (fixed, point_masses) = (part.fixed(), part.point_masses());
        let n_owned = numbering.n_owned as u32;
        Ok(Self {
            comm: comm.clone(),
            reference: numbering.global.iter().flat_map(|&g| mesh.coords[g as usize]).collect(),
            tautening: tautening(mesh),
            n_own_triangles: triangles.partition_point(|t| t.nodes[0] < n_owned),
            triangles,
            n_own_quads: quads.partition_point(|q| q.nodes[0] < n_owned),
            quads,
            split_faces,
            n_own_patches: patches.partition_point(|p| p.nodes[0] < n_owned),
            patches,
            n_own_cables: cables.partition_point(|c| c.nodes[0] < n_owned),
            cables,
            n_own_ties: ties.partition_point(|t| t[0] < n_owned),
            ties,
            fixed,
            point_masses,
            n_faces: mesh.faces.len(),
            numbering,
            halo,
        })
    }

    /// Owned nodes.
    pub fn n_owned(&self) -> usize {
        self.numbering.n_owned
    }

    /// Owned and ghost nodes.
    pub fn n_local(&self) -> usize {
        self.numbering.n_local()
    }
}

/// Finds what touches the nodes of a rank, and the ghosts that it brings along.
struct Reach<'a> {
    /// Rank of each node of the mesh.
    owner: &'a [u32],
    rank: u32,
    /// Nodes of other ranks with their owners.
    ghosts: Vec<(u64, u32)>,
}

impl Reach<'_> {
    /// Whether an element with `nodes` of the mesh is computed here.
    fn touches(&mut self, nodes: &[u32]) -> bool {
        let mine = |n: &u32| self.owner[*n as usize] == self.rank;
        let here = nodes.iter().any(mine);
        if here {
            let others = nodes.iter().filter(|n| !mine(n));
            self.ghosts.extend(others.map(|&n| (u64::from(n), self.owner[n as usize])));
        }
        here
    }

    /// Local numbers of the nodes of this rank and of the ghosts, of a mesh of `n` nodes.
    fn numbering(self, n: usize) -> Numbering {
        let owned = (0..n as u64).filter(|&n| self.owner[n as usize] == self.rank).collect();
        Numbering::new(owned, self.ghosts)
    }
}

/// Makes the elements of a rank; those whose first node is owned come first.
struct Part<'a> {
    mesh: &'a StructureMesh,
    numbering: &'a Numbering,
    warp: Option<Warp>,
}

impl Part<'_> {
    /// Local number of a node of a local element.
    fn local(&self, n: u32) -> u32 {
        self.numbering.local(u64::from(n)).expect("nodes of local elements are local") as u32
    }

    /// Whether another rank owns the local node `n`.
    fn is_ghost(&self, n: u32) -> bool {
        n >= self.numbering.n_owned as u32
    }

    /// Direction of the warp on a face of the mesh.
    fn warp_on(&self, face: usize) -> Option<Vec3> {
        if !self.mesh.flat.is_empty() {
            return self.warp.map(|_| Vec3::x());
        }
        let [a, b] = [0, 1].map(|i| at(&self.mesh.coords, self.mesh.faces[face][i]));
        match self.warp {
            None => None,
            Some(Warp::FirstEdge) => Some(b - a),
            Some(Warp::Vector(v)) => Some(v.into()),
        }
    }

    fn triangles(&self, numbers: &[usize]) -> Result<Vec<Triangle>, ModelError> {
        let of = |&t: &usize| {
            let nodes = self.mesh.triangles[t];
            let x = self.mesh.reference_triangle(t);
            let mut reference =
                membrane::Reference::new(x).ok_or(ModelError::FlatTriangle { triangle: t, nodes })?;
            let face = self.mesh.triangle_face[t];
            if let Some(v) = self.warp_on(face as usize) {
                let none = ModelError::NoWarp { face: face as usize };
                reference = membrane::Reference::along(x, v).ok_or(none)?;
            }
            let fabric = self.mesh.fabric_group(face as usize);
            Ok(Triangle { nodes: nodes.map(|n| self.local(n)), face, reference, global: t as u32, fabric })
        };
        let mut all = numbers.iter().map(of).collect::<Result<Vec<_>, _>>()?;
        all.sort_by_key(|t| self.is_ghost(t.nodes[0]));
        Ok(all)
    }

    fn quads(&self, faces: &[usize]) -> Result<Vec<Quad>, ModelError> {
        let of = |&face: &usize| {
            let nodes = self.mesh.faces[face];
            let x = self.mesh.reference_face(face);
            // One axis for all points of an element, so that their strains have a mean.
            let axis = self.warp_on(face).unwrap_or_else(|| x[1] - x[0]);
            let reference = quad::Reference::new(x, Some(axis)).ok_or(ModelError::BadQuad { face, nodes })?;
            let fabric = self.mesh.fabric_group(face);
            Ok(Quad { nodes: nodes.map(|n| self.local(n)), face: face as u32, reference, fabric })
        };
        let mut all = faces.iter().map(of).collect::<Result<Vec<_>, _>>()?;
        all.sort_by_key(|q| self.is_ghost(q.nodes[0]));
        Ok(all)
    }

    fn cables(&self, numbers: &[usize]) -> Vec<CableElement> {
        let of = |&c: &usize| {
            let mesh::Cable { nodes, rest_length, kind, line, share, group } = self.mesh.cables[c];
            let nodes = nodes.map(|n| self.local(n));
            CableElement { nodes, rest_length, kind, line, share, global: c as u32, group }
        };
        let mut all: Vec<_> = numbers.iter().map(of).collect();
        all.sort_by_key(|c| self.is_ghost(c.nodes[0]));
        all
    }

    /// Constrained components of the local nodes, shape `[n_local][3]`.
    fn fixed(&self) -> Vec<bool> {
        let mut fixed = vec![false; 3 * self.numbering.n_local()];
        for (n, components) in &self.mesh.fixed {
            if let Some(i) = self.numbering.local(u64::from(*n)) {
                (0..3).for_each(|c| fixed[3 * i + c] |= components[c]);
            }
        }
        fixed
    }

    /// Point masses of the local nodes, kg.
    fn point_masses(&self) -> Vec<(u32, f64)> {
        let local = |&(n, m): &(u32, f64)| self.numbering.local(u64::from(n)).map(|i| (i as u32, m));
        self.mesh.point_masses.iter().filter_map(local).collect()
    }
}

/// Most by which the start of sewn fabric is scaled to make it taut: cloth that is gathered further starts as folds, which are left out.
const MOST_TAUTENING: f64 = 1.5;

/// Factor on the positions of `mesh` at which no triangle is slack.
fn tautening(mesh: &StructureMesh) -> f64 {
    if mesh.flat.is_empty() {
        return 1.0;
    }
    let least = (0..mesh.triangles.len()).map(|t| mesh.starting_stretches(t)[1]).fold(1.0, f64::min);
    (1.0 / least).min(MOST_TAUTENING)
}

/// Faces of `mesh` that two triangles with a common diagonal approximate, with nodes of the mesh.
fn split_faces(mesh: &StructureMesh) -> Vec<SplitFace> {
    let mut triangles = vec![Vec::new(); mesh.faces.len()];
    for (nodes, &face) in mesh.triangles.iter().zip(&mesh.triangle_face) {
        triangles[face as usize].push(nodes);
    }
    let diagonal = |face: usize, nodes: [u32; 2]| {
        triangles[face].len() == 2 && triangles[face].iter().all(|t| nodes.iter().all(|n| t.contains(n)))
    };
    let split = |face: usize| {
        let [a, b, c, d] = mesh.faces[face];
        let nodes = if diagonal(face, [a, c]) {
            [a, b, c, d]
        } else if diagonal(face, [b, d]) {
            [b, c, d, a]
        } else {
            return None;
        };
        Some(SplitFace { nodes, face: face as u32, fabric: mesh.fabric_group(face) })
    };
    (0..mesh.faces.len()).filter(|&f| mesh.faces[f][2] != mesh.faces[f][3]).filter_map(split).collect()
}

/// Refuses meshes that no rank could compute; the same verdict on each rank.
fn check(mesh: &StructureMesh) -> Result<(), ModelError> {
    let n = mesh.coords.len();
    let mut held = vec![false; n];
    let mut visit = |what, element, nodes: &[u32]| {
        for (k, &node) in nodes.iter().enumerate() {
            if node as usize >= n {
                return Err(ModelError::BadNode { what, element, node, reason: "outside the mesh" });
            }
            if nodes[..k].contains(&node) {
                return Err(ModelError::BadNode { what, element, node, reason: "twice" });
            }
            held[node as usize] = true;
        }
        Ok(())
    };
    for (t, nodes) in mesh.triangles.iter().enumerate() {
        visit("triangle", t, nodes)?;
    }
    for (c, cable) in mesh.cables.iter().enumerate() {
        visit("cable", c, &cable.nodes)?;
        if !(cable.rest_length.is_finite() && cable.rest_length > 0.0) {
            let mesh::Cable { nodes, rest_length, .. } = *cable;
            return Err(ModelError::NoLength { cable: c, nodes, rest_length });
        }
    }
    for &(node, mass) in &mesh.point_masses {
        held[node as usize] |= mass > 0.0;
    }
    for &(node, components) in &mesh.fixed {
        held[node as usize] |= components == [true; 3];
    }
    match held.iter().position(|h| !h) {
        Some(node) => Err(ModelError::LooseNode { node, position: mesh.coords[node] }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_triangle() -> StructureMesh {
        StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            n_canopy: 3,
            faces: vec![[0, 1, 2, 2]],
            face_panel: vec![0],
            triangles: vec![[0, 1, 2]],
            triangle_face: vec![0],
            ..Default::default()
        }
    }

    fn error(mesh: &StructureMesh) -> String {
        let owner = vec![0; mesh.coords.len()];
        Model::new(&Comm::solo(), mesh, &owner).expect_err("a bad mesh").to_string()
    }

    #[test]
    fn bad_meshes_are_refused_by_name() {
        let mut m = one_triangle();
        m.coords[2] = [2.0, 0.0, 0.0];
        assert!(error(&m).contains("triangle 0"));
        let mut m = one_triangle();
        m.triangles[0] = [0, 1, 1];
        assert!(error(&m).contains("node 1 twice"));
        let mut m = one_triangle();
        m.triangles[0] = [0, 1, 7];
        assert!(error(&m).contains("node 7 outside"));
        let mut m = one_triangle();
        m.coords.push([5.0; 3]);
        assert!(error(&m).contains("node 3"));
        let mut m = one_triangle();
        let kind = CableKind::SuspensionLine;
        m.cables.push(mesh::Cable {
            nodes: [0, 1],
            rest_length: 0.0,
            kind,
            line: 0,
            share: 1.0,
            group: None,
        });
        assert!(error(&m).contains("rest length of 0 m"));
    }
}
