//! Pockets: air that cut faces enclose entirely.
//!
//! Folded cloth encloses single cells. Air without divergence has no way out of them, so that their pressure has no bound when the cloth closes
//! them further. Pockets of few cells are not resolved: the air is not that between the layers but what the steps of the grid leave there. Through
//! their walls passes a part of what the pressure in them moves.

use std::collections::HashMap;

use crate::constraints::FluxConstraints;
use crate::grid::Grid;

/// Cells of a pocket that is not resolved, at most: four across.
const MOST_CELLS: usize = 64;

/// Cells around the surface, with a layer that no face cuts.
struct Cells {
    start: [isize; 3],
    extent: [usize; 3],
    /// By cell and axis: the lower face is cut.
    cut: Vec<[bool; 3]>,
}

impl Cells {
    fn new(grid: &Grid, rows: &FluxConstraints) -> Self {
        let start = [0, 1, 2].map(|d| rows.cells[d].start as isize - 1);
        let extent = [0, 1, 2].map(|d| rows.cells[d].len() + 2);
        let mut cells = Self { start, extent, cut: vec![[false; 3]; extent.iter().product()] };
        let first = grid.at(start);
        for (c, at) in &rows.faces {
            let cell = cells.of_position(grid, at - first);
            cells.cut[cell][*c as usize] = true;
        }
        cells
    }

    /// Cell whose values lie `offset` after those of the first one.
    fn of_position(&self, grid: &Grid, offset: usize) -> usize {
        let [_, y, z] = grid.strides;
        self.number([offset % y, offset % z / y, offset / z])
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.extent[1] + j) * self.extent[0] + i
    }

    fn place(&self, cell: usize) -> [usize; 3] {
        let [nx, ny, _] = self.extent;
        [cell % nx, cell / nx % ny, cell / nx / ny]
    }

    /// Cells that share a face with this one which is not cut.
    fn open_neighbours(&self, cell: usize) -> impl Iterator<Item = usize> {
        let at = self.place(cell);
        (0..6).filter_map(move |side| {
            let (axis, up) = (side / 2, side % 2 == 1);
            let mut other = at;
            other[axis] = if up { at[axis] + 1 } else { at[axis].checked_sub(1)? };
            if other[axis] == self.extent[axis] {
                return None;
            }
            let other = self.number(other);
            let face = if up { other } else { cell };
            (!self.cut[face][axis]).then_some(other)
        })
    }

    /// Number of the connected part of each cell, the outer one first, and their sizes.
    fn parts(&self) -> (Vec<u32>, Vec<usize>) {
        let mut part = vec![u32::MAX; self.cut.len()];
        let (mut sizes, mut open) = (Vec::new(), Vec::new());
        for first in 0..part.len() {
            if part[first] != u32::MAX {
                continue;
            }
            let number = sizes.len() as u32;
            let mut size = 0;
            part[first] = number;
            open.push(first);
            while let Some(cell) = open.pop() {
                size += 1;
                for other in self.open_neighbours(cell) {
                    if part[other] == u32::MAX {
                        part[other] = number;
                        open.push(other);
                    }
                }
            }
            sizes.push(size);
        }
        (part, sizes)
    }
}

/// The rows next to pockets that the grid does not resolve.
pub fn unresolved(grid: &Grid, rows: &FluxConstraints) -> Vec<usize> {
    if rows.is_empty() {
        return Vec::new();
    }
    let cells = Cells::new(grid, rows);
    let (part, sizes) = cells.parts();
    if sizes.len() == 1 {
        return Vec::new();
    }
    let small = |cell: usize| part[cell] > 0 && sizes[part[cell] as usize] <= MOST_CELLS;
    let first = grid.at(cells.start);
    let mut known: HashMap<(u8, usize), bool> = HashMap::new();
    let mut at_pocket = |face: (u8, usize)| {
        *known.entry(face).or_insert_with(|| {
            let upper = cells.of_position(grid, face.1 - first);
            let mut lower = cells.place(upper);
            lower[face.0 as usize] -= 1;
            small(upper) || small(cells.number(lower))
        })
    };
    (0..rows.len())
        .filter(|row| rows.faces[rows.offsets[*row]..rows.offsets[row + 1]].iter().any(|f| at_pocket(*f)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::cut_faces::CutFaces;
    use crate::flow::{Flow, Settings};
    use crate::grid::{End, Ends};
    use crate::momentum::Momentum;
    use crate::shapes;
    use nalgebra::Vector3;

    fn grid() -> Grid {
        let axis = || Axis::even(-1.0, 1.0, 40);
        let open = Ends::Open([End::Inflow, End::Outflow]);
        let slip = Ends::Open([End::Slip, End::Slip]);
        Grid::new([axis(), axis(), axis()], [open, slip, slip])
    }

    /// Spheres of 3.6 and 4.4 cells across enclose fewer than 64 cells, one of 6 cells more. An open cup of the small sphere encloses none.
    #[test]
    fn pockets_of_few_cells_are_found() {
        let grid = grid();
        for (radius, pocket) in [(0.09, true), (0.11, true), (0.15, false)] {
            let (nodes, faces) = shapes::sphere(radius, 3);
            let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
            let found = unresolved(&grid, &cut.rows);
            assert_eq!(found.len(), if pocket { cut.rows.len() } else { 0 }, "{radius}");
            let cup: Vec<_> =
                faces.iter().filter(|f| f.iter().any(|n| nodes[*n as usize].z < 0.0)).copied().collect();
            let cut = CutFaces::new(&grid, &nodes, &cup, 0.0).expect("inside");
            assert!(unresolved(&grid, &cut.rows).is_empty(), "{radius}");
        }
    }

    /// A small sphere shrinks at 1 m/s. The air in it has no way out; its pressure is a few times that of the air outside, which is of the order of
    /// density x velocity x cell / step.
    #[test]
    fn pressure_in_a_shrinking_pocket_is_bounded() {
        let (speed, dt, density) = (1.0, 1e-3, 1.2);
        let momentum = Momentum { upwind_share: 1.0, viscosity: 0.0 };
        let settings = Settings { density, far: Vector3::new(0.1, 0.0, 0.0), momentum, tolerance: 1e-8 };
        let largest = |radius: f64| {
            let mut flow = Flow::new(grid(), settings);
            let (nodes, faces) = shapes::sphere(radius, 3);
            let mut cut = CutFaces::new(&flow.grid, &nodes, &faces, 0.0).expect("inside");
            let inwards: Vec<_> = nodes.iter().map(|x| -x.normalize() * speed).collect();
            cut.set_velocities(&faces, &inwards);
            flow.predict(dt, Vector3::zeros());
            let jumps = flow.solve_constraints(&cut.rows);
            // All air that the sphere gives up passes its wall, to the tolerance of the constraints.
            let (leakage, swept) =
                (flow.leakage(&cut.rows, &jumps.jump), cut.rows.target.iter().sum::<f64>().abs());
            assert!((leakage / swept - 1.0).abs() < 1e-6, "{radius}: {leakage:e} of {swept:e} m3/s");
            jumps.jump.iter().fold(0.0f64, |most, p| most.max(p.abs())) / (density * speed * 0.05 / dt)
        };
        let (pocket, resolved) = (largest(0.09), largest(0.15));
        println!("pocket {pocket:.2}, resolved {resolved:.0}");
        assert!(pocket > 2.0 && pocket < 4.5, "{pocket}");
        assert!(resolved > 1e3, "{resolved}");
    }
}
