//! Box grids for tests and verification.

use std::ops::Range;

use crate::{FlowGrid, Patch, Point};

/// Shape of the cells of a box grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxShape {
    /// One hexahedron for each box.
    Hexahedra,
    /// Two prisms, cut along a diagonal in x-y.
    Prisms,
    /// Six pyramids about the middle.
    Pyramids,
    /// Six tetrahedra about the main diagonal.
    Tetrahedra,
}

/// A box from `lo` to `hi` of `n` hexahedra along x, y, z. Patches: low x, high
/// x, low y, high y, low z, high z. Nodes and cells run along x first.
pub fn box_grid(n: [usize; 3], lo: Point, hi: Point, patches: [Patch; 6]) -> FlowGrid {
    let node = |i: usize, j: usize, k: usize| (i + (n[0] + 1) * (j + (n[1] + 1) * k)) as u32;
    let mut grid = FlowGrid::default();
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                let at = |a: usize, m: usize| {
                    let s = m as f64 / n[a] as f64;
                    lo[a] * (1.0 - s) + hi[a] * s
                };
                grid.coords.push([at(0, i), at(1, j), at(2, k)]);
            }
        }
    }
    add_box_cells(&mut grid, n, patches, node);
    grid
}

/// Adds `n` hexahedra along x, y, z between the nodes that `node` numbers, and the outer faces with their patches:
/// low x, high x, low y, high y, low z, high z.
pub(crate) fn add_box_cells(
    grid: &mut FlowGrid,
    n: [usize; 3],
    patches: [Patch; 6],
    node: impl Fn(usize, usize, usize) -> u32,
) {
    grid.patch_names = case::BoxSides::NAMES.map(String::from).to_vec();
    grid.periodic =
        [0, 2, 4].into_iter().filter(|k| patches[*k] == Patch::Periodic).map(pair_of_sides).collect();
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                let quad = |k| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
                let (low, high) = (quad(k), quad(k + 1));
                let cell = [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]];
                // Local faces in the order of the patches: x, y, z.
                let ends = [
                    (i == 0, 5),
                    (i + 1 == n[0], 3),
                    (j == 0, 2),
                    (j + 1 == n[1], 4),
                    (k == 0, 0),
                    (k + 1 == n[2], 1),
                ];
                for (((outer, face), patch), side) in ends.into_iter().zip(patches).zip(0..) {
                    if outer {
                        grid.boundary_patch.push(side);
                        grid.boundary.push((patch, crate::HEX_FACES[face].map(|v| cell[v])));
                    }
                }
                grid.cells.push(cell);
            }
        }
    }
}

/// A side of a box and the opposite one.
fn pair_of_sides(low: usize) -> [u16; 2] {
    [low as u16, low as u16 + 1]
}

/// A box of hexahedra with a plate of zero thickness: the z-faces at level
/// `level` whose cells lie in the given ranges of i and j. Normal +z.
pub fn plate_grid(
    n: [usize; 3],
    lo: Point,
    hi: Point,
    patches: [Patch; 6],
    level: usize,
    ranges: [Range<usize>; 2],
) -> FlowGrid {
    let mut grid = box_grid(n, lo, hi, patches);
    let node = |i: usize, j: usize| (i + (n[0] + 1) * (j + (n[1] + 1) * level)) as u32;
    let [is, js] = ranges;
    for j in js.start..=js.end {
        for i in is.start..=is.end {
            grid.canopy_nodes.push(node(i, j));
        }
    }
    for j in js {
        for i in is.clone() {
            grid.canopy_faces.push([node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)]);
        }
    }
    grid
}

/// A box of hexahedra whose side at low z is the canopy, with a cell on one side only: outside where `normal_up`, so that the
/// normal +z points into the box, else inside. The patch of this side is not used.
pub fn floor_grid(n: [usize; 3], lo: Point, hi: Point, patches: [Patch; 6], normal_up: bool) -> FlowGrid {
    let mut grid = plate_grid(n, lo, hi, patches, 0, [0..n[0], 0..n[1]]);
    grid.one_sided = true;
    if !normal_up {
        grid.canopy_faces.iter_mut().for_each(|face| face.reverse());
    }
    let floor = |k: &usize| grid.boundary_patch[*k] != FLOOR;
    let kept: Vec<usize> = (0..grid.boundary.len()).filter(floor).collect();
    grid.boundary = kept.iter().map(|&k| grid.boundary[k]).collect();
    grid.boundary_patch = kept.iter().map(|&k| grid.boundary_patch[k]).collect();
    grid
}

/// Place of the side at low z among the patches of a box.
const FLOOR: u16 = 4;

/// A box of hexahedra without those whose i, j, k lie in the ranges of `block`: a rigid body inside, whose faces are the
/// named patch `body` with the condition wall. The sides have the names of [`case::BoxSides::NAMES`].
pub fn block_grid(
    n: [usize; 3],
    lo: Point,
    hi: Point,
    patches: [Patch; 6],
    block: [Range<usize>; 3],
) -> FlowGrid {
    let base = box_grid(n, lo, hi, patches);
    let inside = |cell: usize| {
        let place = [cell % n[0], cell / n[0] % n[1], cell / (n[0] * n[1])];
        place.iter().zip(&block).all(|(p, range)| range.contains(p))
    };
    // Nodes in use keep their order.
    let mut number = vec![None; base.coords.len()];
    let kept = || (0..base.cells.len()).filter(|&c| !inside(c));
    kept().flat_map(|c| base.cells[c]).for_each(|v| number[v as usize] = Some(0));
    let mut grid = FlowGrid::default();
    for (x, number) in base.coords.iter().zip(&mut number).filter(|(_, number)| number.is_some()) {
        *number = Some(grid.coords.len() as u32);
        grid.coords.push(*x);
    }
    let used = |face: [u32; 4]| face.map(|v| number[v as usize].unwrap_or_default());
    let sorted = |mut face: [u32; 4]| {
        face.sort_unstable();
        face
    };
    // Where the block reaches the sides of the box, these have no faces.
    let gone: std::collections::HashSet<[u32; 4]> = (0..base.cells.len())
        .filter(|&c| inside(c))
        .flat_map(|c| crate::HEX_FACES.map(|face| sorted(face.map(|v| base.cells[c][v]))))
        .collect();
    let outer =
        || base.boundary.iter().zip(&base.boundary_patch).filter(|((_, f), _)| !gone.contains(&sorted(*f)));
    let mut sides: Vec<u16> = outer().map(|(_, side)| *side).collect();
    grid.cells = kept().map(|c| base.cells[c].map(|v| number[v as usize].unwrap_or_default())).collect();
    grid.boundary = outer().map(|((patch, f), _)| (*patch, used(*f))).collect();
    let step = [1, n[0], n[0] * n[1]];
    for c in kept() {
        for (face, (axis, up)) in [
            (5, (0, false)),
            (3, (0, true)),
            (2, (1, false)),
            (4, (1, true)),
            (0, (2, false)),
            (1, (2, true)),
        ] {
            let place = c / step[axis] % n[axis];
            let next = if up {
                (place + 1 < n[axis]).then(|| c + step[axis])
            } else {
                (place > 0).then(|| c - step[axis])
            };
            if next.is_some_and(inside) {
                grid.boundary.push((Patch::Wall, used(crate::HEX_FACES[face].map(|v| base.cells[c][v]))));
                sides.push(case::BoxSides::NAMES.len() as u16);
            }
        }
    }
    grid.patch_names = case::BoxSides::NAMES.into_iter().chain(["body"]).map(String::from).collect();
    grid.boundary_patch = sides;
    grid.periodic = base.periodic;
    grid
}

/// A box of cells of another shape, from the same boxes.
pub fn box_grid_of(shape: BoxShape, n: [usize; 3], lo: Point, hi: Point, patches: [Patch; 6]) -> FlowGrid {
    let base = box_grid(n, lo, hi, patches);
    let mut grid = FlowGrid {
        coords: base.coords.clone(),
        patch_names: base.patch_names,
        periodic: base.periodic,
        ..Default::default()
    };
    for cell in &base.cells {
        let [a, b, c, d, e, f, g, h] = *cell;
        match shape {
            BoxShape::Hexahedra => grid.cells.push(*cell),
            BoxShape::Prisms => grid.cells.extend([[a, b, c, c, e, f, g, g], [a, c, d, d, e, g, h, h]]),
            BoxShape::Pyramids => {
                let m = grid.coords.len() as u32;
                grid.coords.push(std::array::from_fn(|x| {
                    cell.iter().map(|&v| base.coords[v as usize][x]).sum::<f64>() / 8.0
                }));
                for face in crate::HEX_FACES {
                    let [p, q, r, s] = face.map(|v| cell[v]);
                    grid.cells.push([s, r, q, p, m, m, m, m]);
                }
            }
            BoxShape::Tetrahedra => {
                for [p, q] in [[b, c], [c, d], [d, h], [h, e], [e, f], [f, b]] {
                    grid.cells.push([a, p, q, q, g, g, g, g]);
                }
            }
        }
    }
    for (&(patch, f), &side) in base.boundary.iter().zip(&base.boundary_patch) {
        // Diagonals as the cells' own: prisms cut z-faces from the first node to
        // the third; tetrahedra cut all faces from the lowest to the highest node.
        let z_face = base.coords[f[0] as usize][2] == base.coords[f[1] as usize][2]
            && base.coords[f[0] as usize][2] == base.coords[f[2] as usize][2];
        if shape == BoxShape::Tetrahedra || (shape == BoxShape::Prisms && z_face) {
            let low = (0..4).min_by_key(|&i| f[i]).expect("four nodes");
            let [p, q, r, s] = std::array::from_fn(|i| f[(low + i) % 4]);
            grid.boundary.extend([(patch, [p, q, r, r]), (patch, [p, r, s, s])]);
            grid.boundary_patch.extend([side; 2]);
        } else {
            grid.boundary_patch.push(side);
            grid.boundary.push((patch, f));
        }
    }
    grid
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FaceTable;

    /// A block that reaches from one side of the box to the opposite one: both sides have a hole there, and stay a periodic pair.
    #[test]
    fn a_block_through_the_box_leaves_holes_in_its_sides() {
        let (p, s) = (Patch::Periodic, Patch::Slip);
        let grid = block_grid([4, 3, 4], [0.0; 3], [1.0; 3], [s, s, p, p, s, s], [1..3, 0..3, 1..3]);
        assert_eq!(grid.cells.len(), 36);
        let of = |patch| grid.boundary.iter().filter(|(other, _)| *other == patch).count();
        assert_eq!((of(p), of(s), of(Patch::Wall)), (24, 48, 24));
        assert_eq!(grid.boundary.len(), grid.boundary_patch.len());
        let table = FaceTable::new(&grid).expect("every face has a cell");
        assert_eq!(table.periodic.faces.len(), 12);
    }
}
