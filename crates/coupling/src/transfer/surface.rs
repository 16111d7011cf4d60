//! A surface of faces, and mismatches between two of them.

use serde::{Deserialize, Serialize};

use crate::geometry::{Vec3, distinct, quad_area_vector};

/// A surface: unstressed positions of its nodes, m, and its faces, a triangle repeating its last node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// Unstressed positions, m.
    pub nodes: Vec<[f64; 3]>,
    /// Nodes of the faces.
    pub faces: Vec<[u32; 4]>,
    /// Displacement of the nodes when the stage begins, `[nodes][3]`, m; empty: none.
    #[serde(default)]
    pub displacement: Vec<f64>,
}

impl Surface {
    /// Unstressed position of a node, m.
    pub(super) fn node(&self, node: u32) -> Vec3 {
        Vec3::from(self.nodes[node as usize])
    }

    /// Positions of the nodes with `displacement` (`[nodes][3]`), m.
    pub(super) fn moved(&self, displacement: &[f64]) -> Vec<Vec3> {
        let rows = self.nodes.iter().zip(displacement.chunks_exact(3));
        rows.map(|(x, d)| Vec3::from(*x) + Vec3::from_column_slice(d)).collect()
    }
}

/// Area vector (m2) of a face whose nodes are at `x`.
pub(super) fn face_area(face: &[u32; 4], x: &[Vec3]) -> Vec3 {
    quad_area_vector(face.map(|n| x[n as usize]))
}

/// Mean of the corners of a face whose nodes are at `x`.
pub(super) fn middle(face: &[u32; 4], x: &[Vec3]) -> Vec3 {
    let nodes = distinct(face);
    let sum = nodes[1..].iter().fold(x[nodes[0] as usize], |sum, &n| sum + x[n as usize]);
    sum / nodes.len() as f64
}

/// The triangles of a face, as nodes.
pub(super) fn triangles_of(face: &[u32; 4]) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [a, b, c, d] = *face;
    [Some([a, b, c]), (c != d).then_some([a, c, d])].into_iter().flatten()
}

/// Mismatch of two surfaces.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// No face with an area.
    #[error("the surface of the structure has no face with an area")]
    Empty,
    /// A face names a node that does not exist.
    #[error("face {face} of the structure's surface names node {node} of {nodes}")]
    Node {
        /// The face.
        face: usize,
        /// The node that it names.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A canopy node far from all faces.
    #[error(
        "canopy node {node} is {distance:.3} m from the structure's surface, whose longest edge is {edge:.3} m, so it is \
         the surface of another canopy; give the structure the geometry of the scene"
    )]
    Far {
        /// Canopy node.
        node: usize,
        /// Distance, m.
        distance: f64,
        /// Longest edge, m.
        edge: f64,
    },
}
