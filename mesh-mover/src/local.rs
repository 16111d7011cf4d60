//! One rank's part of the grid: its nodes, the cells around them, and the kind of each node (free, canopy, fixed).

use std::rc::Rc;

use case::OuterBoundary;
use comm::{Comm, Halo, Numbering};
use mesh::geometry::Vec3;
use mesh::{FlowGrid, Point};

use crate::canopy_distance::canopy_distances;
use crate::near_wall_following;
use crate::quality::{Corners, corners_at};
use crate::slide::{Slide, slides};

/// Kind of a node: how its position is determined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Unknown of the pseudo-solid: index among the local free nodes.
    Free(u32),
    /// Follows the canopy: interface node.
    Canopy(u32),
    /// Fixed: outer boundary, or a node that no cell uses.
    Fixed,
}

/// The grid of one rank: owned nodes, then ghosts; every cell that touches an owned node, so that each row of the
/// stiffness matrix is complete without sums across ranks.
pub struct LocalGrid {
    /// Local and global indices of all nodes.
    pub nodes: Numbering,
    /// Kind of each local node.
    pub kind: Vec<Kind>,
    /// Cells in local nodes.
    pub cells: Vec<[u32; 8]>,
    /// Global index of each cell.
    pub cell_global: Vec<u32>,
    /// Distance of each cell from the canopy in the start grid, see [`crate::canopy_distance`].
    pub depth: Vec<f32>,
    /// Data for the quality of the cells.
    pub shapes: Corners,
    /// Local free nodes near the canopy: those that follow small motions explicitly.
    pub near: Vec<near_wall_following::Row>,
    /// Number of them that are owned, which come first.
    pub near_owned: usize,
    /// Local free nodes of the outer boundary, ascending, with their tangential projections.
    pub slides: Vec<Slide>,
    /// Local node of each local free node: owned first, then ghosts.
    pub free_node: Vec<u32>,
    /// Number of owned free nodes.
    pub n_free: usize,
    /// Exchange of values on free nodes.
    pub free_halo: Rc<Halo>,
    /// Local node and interface node of every local canopy node.
    pub canopy: Vec<(u32, u32)>,
    /// Nodes of the whole grid.
    pub n_global: usize,
    /// Cells of the whole grid.
    pub n_cells_global: usize,
    /// Interface nodes of the whole canopy.
    pub n_canopy: usize,
    /// Mean volume of the cells of the whole grid, m3.
    pub mean_volume: f64,
}

/// Numbering of the free nodes among the local ones; `n_free` of them are owned. Both numberings sort ghosts by owner and
/// global index, so `free_node` matches the halo.
fn free_numbering(nodes: &Numbering, free_node: &[u32], n_free: usize) -> Numbering {
    let (owned, ghosts) = free_node.split_at(n_free);
    let owned = owned.iter().map(|&local| nodes.global[local as usize]).collect();
    let ghosts = ghosts.iter().map(|&local| local as usize);
    let ghosts =
        ghosts.map(|local| (nodes.global[local], nodes.ghost_owner[local - nodes.n_owned])).collect();
    Numbering::new(owned, ghosts)
}

impl LocalGrid {
    /// As [`LocalGrid::with_outer`] with a fixed outer boundary.
    pub fn new(grid: &FlowGrid, owner: &[u32], comm: &Comm) -> Self {
        Self::with_outer(grid, owner, OuterBoundary::Fixed, comm)
    }

    /// Extracts this rank's part of `grid`; `owner` is the rank of each node. Collective.
    pub fn with_outer(grid: &FlowGrid, owner: &[u32], outer: OuterBoundary, comm: &Comm) -> Self {
        let (nodes, cells, cell_global) = share(grid, owner, comm.rank() as u32);
        let mut global_kind = kinds(grid);
        let depth = canopy_distances(grid, cell_global.iter().map(|&c| &grid.cells[c as usize]));
        let rings = near_wall_following::rings(grid, &global_kind);
        let sliding = match outer {
            OuterBoundary::Fixed => Default::default(),
            OuterBoundary::Sliding => slides(grid),
        };
        for &a in sliding.keys() {
            global_kind[a as usize] = Kind::Free(0);
        }
        let mut slide_rows = Vec::new();
        let mut near = Vec::new();
        let mut kind = Vec::with_capacity(nodes.n_local());
        let (mut free_node, mut canopy) = (Vec::new(), Vec::new());
        for (local, &g) in nodes.global.iter().enumerate() {
            kind.push(match global_kind[g as usize] {
                Kind::Free(_) => {
                    let index = free_node.len() as u32;
                    near.extend(rings[g as usize].map(|ring| ring.row(index)));
                    slide_rows.extend(
                        sliding.get(&(g as u32)).map(|&projection| Slide { free: index, projection }),
                    );
                    free_node.push(local as u32);
                    Kind::Free(index)
                }
                Kind::Canopy(k) => {
                    canopy.push((local as u32, k));
                    Kind::Canopy(k)
                }
                Kind::Fixed => Kind::Fixed,
            });
        }
        let n_free = free_node.partition_point(|&local| (local as usize) < nodes.n_owned);
        let free_halo = Rc::new(Halo::new(comm, &free_numbering(&nodes, &free_node, n_free)));
        let start: Vec<f64> = nodes.global.iter().flat_map(|&g| grid.coords[g as usize]).collect();
        Self {
            depth,
            shapes: Corners::new(&cells, &start),
            near_owned: near.partition_point(|row: &near_wall_following::Row| (row.free as usize) < n_free),
            near,
            slides: slide_rows,
            nodes,
            kind,
            cells,
            cell_global,
            free_node,
            n_free,
            free_halo,
            canopy,
            n_global: grid.coords.len(),
            n_cells_global: grid.cells.len(),
            n_canopy: grid.canopy_nodes.len(),
            mean_volume: mean_volume(grid),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.shapes.bytes()
            + self.cells.len() * 40
            + self.n_local() * (size_of::<Kind>() + 8 + 24)
            + 4 * self.free_node.len()
            + size_of_val(&self.near[..])
            + size_of_val(&self.slides[..])
    }

    /// The ranks that share the grid.
    pub fn comm(&self) -> &Comm {
        self.free_halo.comm()
    }

    /// Owned and ghost nodes.
    pub fn n_local(&self) -> usize {
        self.nodes.n_local()
    }

    /// Values of a global field at the local nodes.
    pub fn gather(&self, global: &[Point]) -> Vec<f64> {
        self.nodes.global.iter().flat_map(|&g| global[g as usize]).collect()
    }

    /// Corner positions of local cell `c`.
    pub fn corners(&self, c: usize, x: &[f64]) -> [Vec3; 8] {
        corners_at(&self.cells[c], x)
    }

    /// Smallest scaled Jacobian of local cell `c`, see [`Corners::quality`].
    pub fn quality(&self, c: usize, x: &[f64]) -> f64 {
        self.shapes.quality(&self.cells, c, x)
    }

    /// The worst local cell and its quality; `None` without cells.
    pub fn worst(&self, x: &[f64]) -> Option<(usize, f64)> {
        let all = (0..self.cells.len()).map(|c| (c, self.quality(c, x)));
        all.reduce(|a, b| if b.1 < a.1 { b } else { a })
    }

    /// Mean of the distinct corners of local cell `c`.
    pub fn centre(&self, c: usize, x: &[f64]) -> Point {
        let mut list = self.cells[c].to_vec();
        list.sort_unstable();
        list.dedup();
        let mut m = [0.0; 3];
        for a in &list {
            for i in 0..3 {
                m[i] += x[3 * *a as usize + i] / list.len() as f64;
            }
        }
        m
    }

    /// Shortest edge of the cells around each local free node at `x`, m: the scale of position errors of the node.
    pub fn free_sizes(&self, x: &[f64]) -> Vec<f64> {
        let mut size = vec![f64::INFINITY; self.n_local()];
        for c in 0..self.cells.len() {
            let p = self.corners(c, x);
            let mut shortest = f64::INFINITY;
            for (i, j) in EDGES {
                if self.cells[c][i] != self.cells[c][j] {
                    shortest = shortest.min((p[i] - p[j]).norm());
                }
            }
            for &a in &self.cells[c] {
                size[a as usize] = size[a as usize].min(shortest);
            }
        }
        let mut free: Vec<f64> = self.free_node.iter().map(|&a| size[a as usize]).collect();
        // A ghost has only some of its cells here: exchange the owner's value.
        self.free_halo.exchange(&mut free, 1);
        free
    }
}

/// The nodes of rank `me`, its cells in local nodes, and their global indices.
fn share(grid: &FlowGrid, owner: &[u32], me: u32) -> (Numbering, Vec<[u32; 8]>, Vec<u32>) {
    let n = grid.coords.len();
    let (mut cells, mut cell_global) = (Vec::new(), Vec::new());
    let mut seen = vec![false; n];
    for (c, cell) in grid.cells.iter().enumerate() {
        if cell.iter().any(|&a| owner[a as usize] == me) {
            cells.push(*cell);
            cell_global.push(c as u32);
            cell.iter().for_each(|&a| seen[a as usize] = true);
        }
    }
    let owned: Vec<u64> = (0..n).filter(|&a| owner[a] == me).map(|a| a as u64).collect();
    let ghosts = |a: &usize| seen[*a] && owner[*a] != me;
    let ghost_list: Vec<(u64, u32)> = (0..n).filter(ghosts).map(|a| (a as u64, owner[a])).collect();
    let nodes = Numbering::new(owned, ghost_list);
    for cell in &mut cells {
        *cell = cell.map(|a| nodes.local(u64::from(a)).expect("nodes of local cells are local") as u32);
    }
    (nodes, cells, cell_global)
}

/// Kind of each global node; free ones are not numbered yet. The same on all ranks, so a ghost is free exactly where
/// it is on its owner.
fn kinds(grid: &FlowGrid) -> Vec<Kind> {
    let mut kind = vec![Kind::Fixed; grid.coords.len()];
    for a in grid.cells.iter().flatten() {
        kind[*a as usize] = Kind::Free(0);
    }
    for a in grid.boundary.iter().flat_map(|(_, face)| face) {
        kind[*a as usize] = Kind::Fixed;
    }
    for (k, &a) in grid.canopy_nodes.iter().enumerate() {
        kind[a as usize] = Kind::Canopy(k as u32);
    }
    kind
}

/// Mean volume of the cells, m3.
fn mean_volume(grid: &FlowGrid) -> f64 {
    let total: f64 = (0..grid.cells.len()).map(|c| mesh::quality::cell_volume(grid, c)).sum();
    total / grid.cells.len().max(1) as f64
}

/// Edges of a hexahedron in VTK order.
pub(crate) const EDGES: [(usize, usize); 12] =
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)];
