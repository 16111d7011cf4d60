//! A flat rectangular panel.

use case::{PanelCanopy, PanelEdges};

use super::{positive, refuse};
use crate::{MeshError, StructureMesh};

/// Node (i, j) of a panel is `i + (cells[0] + 1) j`: along x first. Its edges are node sets: `left` and `right` at low and high x, `front` and `back` at low and
/// high y.
pub(super) fn panel(p: &PanelCanopy) -> Result<StructureMesh, MeshError> {
    let [lx, ly] = [positive("canopy.size_m", p.size_m[0])?, positive("canopy.size_m", p.size_m[1])?];
    if let Some(n) = p.cells.into_iter().find(|n| !(1..=10_000).contains(n)) {
        return Err(refuse("canopy.cells", n, "must be from 1 to 10000"));
    }
    let [nx, ny] = p.cells.map(|n| n as usize);
    let node = |i: usize, j: usize| (i + (nx + 1) * j) as u32;
    // From -1/2 to 1/2, exactly antisymmetric.
    let share = |i: usize, n: usize| (2.0 * i as f64 - n as f64) / (2 * n) as f64;
    let mut mesh = StructureMesh::default();
    for j in 0..=ny {
        for i in 0..=nx {
            mesh.push_node([lx * share(i, nx), ly * share(j, ny), 0.0]);
            let (end, side) = (i == 0 || i == nx, j == 0 || j == ny);
            let fixed = match p.held {
                PanelEdges::All => [end || side; 3],
                PanelEdges::Ends => [end, end || side, end],
                PanelEdges::Root => [i == 0, i == 0 || side, i == 0],
            };
            if fixed.contains(&true) {
                mesh.fixed.push((node(i, j), fixed));
            }
        }
    }
    mesh.n_canopy = mesh.coords.len();
    let along_x = |j: usize| (0..=nx).map(|i| node(i, j)).collect();
    let along_y = |i: usize| (0..=ny).map(|j| node(i, j)).collect();
    let edges = [("left", along_y(0)), ("right", along_y(nx)), ("front", along_x(0)), ("back", along_x(ny))];
    mesh.node_sets = edges.map(|(name, nodes)| (name.into(), nodes)).into();
    for j in 0..ny {
        for i in 0..nx {
            let quad = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            // Diagonals alternate: no direction is preferred.
            mesh.push_quad(quad, 0, (i + j) % 2 == 0);
        }
    }
    Ok(mesh)
}
