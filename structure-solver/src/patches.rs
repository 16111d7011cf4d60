//! Triangles with their neighbours across their sides, on which fabric bends.

use std::collections::HashMap;

use mesh::StructureMesh;

use crate::elements::bending;
use crate::model::ModelError;

/// A triangle and what lies across its sides. In a [`crate::model::Model`] node numbers are local.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Corners, then for each of them the node across the side opposite to it: the corner itself where there is no
    /// neighbour.
    pub nodes: [u32; 6],
    /// Reference state.
    pub reference: bending::Reference,
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Ends of the side opposite to corner `i`, the lower node first.
fn side(nodes: &[u32; 3], i: usize) -> [u32; 2] {
    sorted([nodes[(i + 1) % 3], nodes[(i + 2) % 3]])
}

/// The patches of `mesh`, in the order of its triangles and with its nodes; none of triangles without a neighbour.
///
/// # Errors
/// A triangle without area.
pub fn of(mesh: &StructureMesh) -> Result<Vec<Patch>, ModelError> {
    let mut across: HashMap<[u32; 2], Vec<(usize, u32)>> = HashMap::new();
    for (t, nodes) in mesh.triangles.iter().enumerate() {
        for i in 0..3 {
            across.entry(side(nodes, i)).or_default().push((t, nodes[i]));
        }
    }
    let mut all = Vec::new();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let neighbour = |i: usize| match across[&side(corners, i)][..] {
            [a, b] => Some(if a.0 == t { b } else { a }),
            _ => None,
        };
        let found = [0, 1, 2].map(neighbour);
        let opposite = |i: usize| found[i].map_or(corners[i], |(_, node)| node);
        let nodes = std::array::from_fn(|i| if i < 3 { corners[i] } else { opposite(i - 3) });
        if found != [None; 3] {
            let flat = ModelError::FlatTriangle { triangle: t, nodes: *corners };
            let across = std::array::from_fn(|i| {
                let (other, node) = found[i]?;
                let x = mesh.reference_triangle(other);
                let place = |n: u32| mesh.triangles[other].iter().position(|m| *m == n).unwrap_or(0);
                Some([corners[(i + 1) % 3], corners[(i + 2) % 3], node].map(|n| x[place(n)]))
            });
            let reference = bending::Reference::sewn(mesh.reference_triangle(t), across).ok_or(flat)?;
            all.push(Patch { nodes, reference });
        }
    }
    Ok(all)
}
