//! Sliding nodes of the outer boundary, which stay in their plane.

use std::collections::BTreeMap;

use linalg::BlockCsr;
use mesh::geometry::{Vec3, at};
use mesh::{FlowGrid, Patch};

use crate::elastic::Coupling;

/// Projection on the tangential directions of a node.
pub type TangentProjection = [[f64; 3]; 3];

/// A node of the outer boundary that may slide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// Local free node.
    pub free: u32,
    /// Projection on its tangential directions.
    pub projection: TangentProjection,
}

/// Faces belong to one plane where their unit normals and the heights of their corners, relative to their size, agree
/// within this.
const FLAT: f64 = 1e-9;

/// The nodes of the outer boundary that may slide, by global node: within the plane of their faces, or along the edge
/// of two planes. Nodes of three planes, of curved faces, of periodic patches and of the canopy are fixed.
pub fn slides(grid: &FlowGrid) -> BTreeMap<u32, TangentProjection> {
    // Orthonormalised unit normals of the planes that meet in a node; `None`: fixed.
    let mut planes: BTreeMap<u32, Option<Vec<Vec3>>> = BTreeMap::new();
    for (patch, face) in &grid.boundary {
        let p = face.map(|a| at(&grid.coords, a));
        let area = (p[2] - p[0]).cross(&(p[3] - p[1]));
        let size = area.norm();
        let n = area / size;
        let flat = *patch != Patch::Periodic
            && size > 0.0
            && p.iter().all(|q| n.dot(&(q - p[0])).abs() <= FLAT * size.sqrt());
        for &a in face {
            let known = planes.entry(a).or_insert_with(|| Some(Vec::new()));
            let Some(list) = known.as_mut().filter(|_| flat) else {
                *known = None;
                continue;
            };
            let mut rest = n;
            for m in &*list {
                rest -= m * rest.dot(m);
            }
            let new = rest.norm();
            if new > FLAT {
                list.push(rest / new);
            }
        }
    }
    for a in &grid.canopy_nodes {
        planes.remove(a);
    }
    let projection = |(a, normals): (u32, Option<Vec<Vec3>>)| {
        let normals = normals.filter(|n| n.len() < 3)?;
        let mut projection = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for n in normals {
            (0..9).for_each(|e| projection[e / 3][e % 3] -= n[e / 3] * n[e % 3]);
        }
        Some((a, projection))
    };
    planes.into_iter().filter_map(projection).collect()
}

/// Constrains the sliding nodes to their planes: for stiffness A and projections P the matrix becomes P A P + s (1 -
/// P), which is symmetric and definite where A is on the tangential directions; the node's own stiffness s acts
/// normal to its plane.
pub(crate) fn constrain(slides: &[Slide], matrix: &mut BlockCsr<3, f32>, canopy: &mut Coupling) {
    if slides.is_empty() {
        return;
    }
    let projection = |i: u32| slides.binary_search_by_key(&i, |s| s.free).ok().map(|k| slides[k].projection);
    for row in 0..matrix.n_rows() {
        let own = projection(row as u32);
        for slot in matrix.row(row) {
            let col = matrix.cols()[slot];
            let other = projection(col);
            if own.is_none() && other.is_none() {
                continue;
            }
            let mut block = matrix.values[slot].map(|r| r.map(f64::from));
            let stiffness = (block[0][0] + block[1][1] + block[2][2]) / 3.0;
            if let Some(p) = &own {
                block = product(p, &block);
            }
            if let Some(p) = &other {
                block = product(&block, p);
            }
            if let Some(p) = own.filter(|_| col as usize == row) {
                for e in 0..9 {
                    let one = f64::from(u8::from(e / 3 == e % 3));
                    block[e / 3][e % 3] += stiffness * (one - p[e / 3][e % 3]);
                }
            }
            matrix.values[slot] = block.map(|r| r.map(|v| v as f32));
        }
    }
    for (row, _, block) in canopy {
        if let Some(p) = projection(*row) {
            *block = product(&p, block);
        }
    }
}

/// Projects the displacements `u` of owned free nodes on their planes.
pub(crate) fn project(slides: &[Slide], u: &mut [f64]) {
    let u = u.as_chunks_mut::<3>().0;
    for s in slides {
        // Owned nodes come first.
        let Some(u) = u.get_mut(s.free as usize) else { break };
        let whole = Vec3::from(*u);
        *u = s.projection.map(|row| Vec3::from(row).dot(&whole));
    }
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let entry = |i: usize, j: usize| (0..3).map(|k| a[i][k] * b[k][j]).sum();
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| entry(i, j)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example_grid::plate_in_box;

    #[test]
    fn tangential_directions_match_faces_edges_and_corners_of_a_box() {
        let grid = plate_in_box(8, 0.1, 0.8, true);
        let slides = slides(&grid);
        let mut free = [0; 3];
        for (_, face) in &grid.boundary {
            for a in face {
                let walls = grid.coords[*a as usize].iter().filter(|x| x.abs() == 1.0).count();
                let trace = slides.get(a).map_or(0.0, |w| w[0][0] + w[1][1] + w[2][2]);
                assert_eq!(trace, 3.0 - walls as f64, "{:?}", grid.coords[*a as usize]);
                free[walls - 1] += 1;
            }
        }
        assert!(free.iter().all(|&n| n > 0));
    }

    #[test]
    fn curved_faces_fix_their_nodes() {
        let mut grid = plate_in_box(8, 0.0, 1.0, false);
        for x in &mut grid.coords {
            let r = Vec3::from(*x).norm();
            (0..3).for_each(|i| x[i] *= 1.0 + 0.1 * r * r);
        }
        assert!(slides(&grid).is_empty(), "{:?}", slides(&grid));
    }
}
