//! Parts of a structure that hang together, and whether something holds them.

use mesh::StructureMesh;

use crate::model::ModelError;

/// Refuses a structure with a part that may drift away as a whole, because no node of
/// it is held, or moved as prescribed, along some axis. `moved` are nodes with
/// components that a stage prescribes. A part that only touches another one, node on
/// node, is named as such: a mesh whose nodes were not merged.
///
/// # Errors
/// [`ModelError::Apart`] or [`ModelError::Drifts`].
pub fn check(mesh: &StructureMesh, moved: &[(u32, [bool; 3])]) -> Result<(), ModelError> {
    let n = mesh.coords.len();
    let mut root: Vec<u32> = (0..n as u32).collect();
    let faces = mesh.faces.iter().map(|f| &f[..]);
    let triangles = mesh.triangles.iter().map(|t| &t[..]);
    for nodes in faces.chain(triangles).chain(mesh.cables.iter().map(|c| &c.nodes[..])) {
        for pair in nodes.windows(2) {
            let (a, b) = (find(&mut root, pair[0]), find(&mut root, pair[1]));
            root[a.max(b) as usize] = a.min(b);
        }
    }
    let part: Vec<u32> = (0..n as u32).map(|i| find(&mut root, i)).collect();
    let mut held = vec![[false; 3]; n];
    for (node, components) in mesh.fixed.iter().chain(moved) {
        let own = &mut held[part[*node as usize] as usize];
        (0..3).for_each(|c| own[c] |= components[c]);
    }
    // A part is known by its lowest node.
    let Some(node) = (0..n).find(|&i| part[i] == i as u32 && held[i] != [true; 3]) else { return Ok(()) };
    if let Some([here, there]) = touching(mesh, &part, node as u32) {
        return Err(ModelError::Apart { here, there, position: mesh.coords[here as usize] });
    }
    let nodes = part.iter().filter(|p| **p == node as u32).count();
    let axes = (0..3).filter(|&c| !held[node][c]).map(|c| ["x", "y", "z"][c]).collect::<Vec<_>>();
    Err(ModelError::Drifts { node, nodes, position: mesh.coords[node], axes: axes.join(", ") })
}

fn find(root: &mut [u32], mut i: u32) -> u32 {
    while root[i as usize] != i {
        let up = root[root[i as usize] as usize];
        root[i as usize] = up;
        i = up;
    }
    i
}

/// A node of part `which` that lies where a node of another part does, with that one.
fn touching(mesh: &StructureMesh, part: &[u32], which: u32) -> Option<[u32; 2]> {
    let size = mesh.coords.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    let near = 1e-9 * size;
    let mut order: Vec<u32> = (0..mesh.coords.len() as u32).collect();
    order.sort_by(|a, b| mesh.coords[*a as usize][0].total_cmp(&mesh.coords[*b as usize][0]));
    for (k, &a) in order.iter().enumerate() {
        let x = mesh.coords[a as usize];
        for &b in &order[k + 1..] {
            let y = mesh.coords[b as usize];
            if y[0] - x[0] > near {
                break;
            }
            let one = (part[a as usize] == which) != (part[b as usize] == which);
            if one && (0..3).all(|c| (x[c] - y[c]).abs() <= near) {
                return Some(if part[a as usize] == which { [a, b] } else { [b, a] });
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use mesh::{Cable, CableKind};

    use super::*;

    fn two_triangles() -> StructureMesh {
        let base = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        StructureMesh {
            coords: base.iter().copied().chain(base.map(|x| [x[0] + 1.0, x[1], 0.0])).collect(),
            n_canopy: 6,
            faces: vec![[0, 1, 2, 2], [3, 4, 5, 5]],
            face_panel: vec![0; 2],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            triangle_face: vec![0, 1],
            fixed: vec![(0, [true; 3])],
            ..Default::default()
        }
    }

    #[test]
    fn parts_that_nothing_holds_are_named() {
        let mut m = two_triangles();
        let error = check(&m, &[]).expect_err("nodes 1 and 3 are two").to_string();
        assert!(error.contains("nodes 3 and 1") && error.contains("merge"), "{error}");
        m.coords[3][1] = -0.5;
        let error = check(&m, &[]).expect_err("a loose triangle").to_string();
        assert!(
            error.contains("node 3") && error.contains("3 nodes") && error.contains("x, y, z"),
            "{error}"
        );
        m.fixed.push((4, [true, false, true]));
        assert!(check(&m, &[]).expect_err("slides").to_string().contains("along y"));
        // Prescribed, or hung up on a line, it is held.
        assert_eq!(check(&m, &[(5, [false, true, false])]), Ok(()));
        m.cables.push(Cable {
            nodes: [2, 4],
            rest_length: 1.0,
            kind: CableKind::Riser,
            line: 0,
            share: 1.0,
            group: None,
        });
        assert_eq!(check(&m, &[]), Ok(()));
        m.fixed.clear();
        assert!(check(&m, &[]).expect_err("nothing is held").to_string().contains("6 nodes"));
    }
}
