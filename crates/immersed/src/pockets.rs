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

    /// Cells in a row along x that no face separates: the first of each run, in order, and one more than the last of all.
    fn runs(&self) -> Vec<usize> {
        let nx = self.extent[0];
        let starts = |cell: &usize| cell.is_multiple_of(nx) || self.cut[*cell][0];
        let mut runs: Vec<usize> = (0..self.cut.len()).filter(starts).collect();
        runs.push(self.cut.len());
        runs
    }

    /// The connected parts as runs and, for each, that of the part's representative.
    fn parts(&self) -> Parts {
        let runs = self.runs();
        let mut parts = Parts { part: (0..runs.len() as u32 - 1).collect(), sizes: Vec::new(), runs };
        let [nx, ny, _] = self.extent;
        for (axis, back) in [(1, nx), (2, nx * ny)] {
            // The run of the cell below along the axis advances with the own one.
            let mut below = 0;
            for own in 0..parts.part.len() {
                let (start, end) = (parts.runs[own], parts.runs[own + 1]);
                let row = if axis == 1 { start / nx % ny } else { start / nx / ny };
                if row == 0 {
                    continue;
                }
                while parts.runs[below + 1] <= start - back {
                    below += 1;
                }
                let mut other = below;
                let mut cell = start;
                while cell < end {
                    // Cells of both runs up to the end of either: one open face connects them.
                    let last = end.min(parts.runs[other + 1] + back);
                    if (cell..last).any(|c| !self.cut[c][axis]) {
                        parts.connect(own, other);
                    }
                    cell = last;
                    other += 1;
                }
            }
        }
        parts.measure();
        parts
    }
}

/// Connected parts of the cells.
struct Parts {
    /// First cell of each run, and the end of the last.
    runs: Vec<usize>,
    /// A run of the same part that comes earlier, or itself.
    part: Vec<u32>,
    /// Cells of the part of each run that represents one.
    sizes: Vec<usize>,
}

impl Parts {
    /// The first run of a part.
    fn first(&mut self, mut run: usize) -> usize {
        while self.part[run] as usize != run {
            let before = self.part[self.part[run] as usize];
            self.part[run] = before;
            run = before as usize;
        }
        run
    }

    fn connect(&mut self, a: usize, b: usize) {
        let (a, b) = (self.first(a), self.first(b));
        self.part[a.max(b)] = a.min(b) as u32;
    }

    /// Finds the sizes of all parts.
    fn measure(&mut self) {
        self.sizes = vec![0; self.part.len()];
        for run in 0..self.part.len() {
            let first = self.first(run);
            self.part[run] = first as u32;
            self.sizes[first] += self.runs[run + 1] - self.runs[run];
        }
    }

    /// Whether there is one part only.
    fn one(&self) -> bool {
        self.part.iter().all(|first| *first == 0)
    }

    /// Whether the cell is in a part that the grid does not resolve; the first one surrounds all.
    fn small(&self, cell: usize) -> bool {
        let run = self.runs.partition_point(|start| *start <= cell) - 1;
        let first = self.part[run] as usize;
        first > 0 && self.sizes[first] <= MOST_CELLS
    }
}

/// The rows next to pockets that the grid does not resolve.
pub fn unresolved(grid: &Grid, rows: &FluxConstraints) -> Vec<usize> {
    if rows.is_empty() {
        return Vec::new();
    }
    let cells = Cells::new(grid, rows);
    let parts = cells.parts();
    if parts.one() {
        return Vec::new();
    }
    let first = grid.at(cells.start);
    let mut known: HashMap<(u8, usize), bool> = HashMap::new();
    let mut at_pocket = |face: (u8, usize)| {
        *known.entry(face).or_insert_with(|| {
            let upper = cells.of_position(grid, face.1 - first);
            let mut lower = cells.place(upper);
            lower[face.0 as usize] -= 1;
            parts.small(upper) || parts.small(cells.number(lower))
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

    /// Parts of randomly cut cells are those that a search from cell to cell finds.
    #[test]
    fn parts_are_connected_through_open_faces() {
        let mut state = 7u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut pockets = 0;
        for share in [0.0, 0.3, 0.6, 0.7, 0.8, 0.95] {
            let extent = [7, 6, 9];
            let count = extent.iter().product();
            let cut = (0..count).map(|_| [0; 3].map(|_| noise() < share)).collect();
            let cells = Cells { start: [0; 3], extent, cut };
            let mut parts = cells.parts();
            let mut found = vec![usize::MAX; count];
            for first in 0..count {
                let mut open = vec![first];
                while let Some(cell) = open.pop() {
                    if found[cell] != usize::MAX {
                        continue;
                    }
                    found[cell] = first;
                    let at = cells.place(cell);
                    for (axis, back) in [1, extent[0], extent[0] * extent[1]].into_iter().enumerate() {
                        if at[axis] > 0 && !cells.cut[cell][axis] {
                            open.push(cell - back);
                        }
                        if at[axis] + 1 < extent[axis] && !cells.cut[cell + back][axis] {
                            open.push(cell + back);
                        }
                    }
                }
            }
            let run = |cell: usize| parts.runs.partition_point(|start| *start <= cell) - 1;
            let runs: Vec<usize> = (0..count).map(run).collect();
            for a in 0..count {
                let size = found.iter().filter(|f| **f == found[a]).count();
                let small = found[a] != found[0] && size <= MOST_CELLS;
                assert_eq!(parts.small(a), small, "{share}: cell {a}");
                pockets += usize::from(small);
                for b in 0..a {
                    assert_eq!(parts.first(runs[a]) == parts.first(runs[b]), found[a] == found[b]);
                }
            }
            assert_eq!(parts.one(), found.iter().all(|f| *f == 0));
        }
        assert!(pockets > 300, "{pockets}");
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
