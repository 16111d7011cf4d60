//! Small motions of the canopy between the solves of one window: the nodes near the canopy follow explicitly, without
//! a linear solve.
//!
//! The solves of a coupled window differ by a few per cent of a cell. Any smooth extension of such a difference keeps
//! all cells valid. So the grid of the window's first solve is kept, and the nearest rings of nodes follow their
//! canopy node, each ring by a smaller share. Within a window the grid is then a fixed linear function of the canopy,
//! exact bitwise: the coupling sees no solver noise. No error accumulates, because the first solve of the next window
//! depends on the canopy's position alone.

use mesh::FlowGrid;

use crate::local::{EDGES, Kind, LocalGrid};

/// Number of rings that follow. (A coupled ATPS descent moves the canopy by up to 2 % of a cell between solves; with
/// four rings each loses a fifth of that to the next.)
const RINGS: u8 = 4;

/// A motion is small while each canopy node moves by less than this fraction of the shortest edge around the nodes
/// that follow it: cells between two rings then change by at most a twentieth of an edge.
pub const SMALL: f64 = 0.25;

/// Ring of a node, and the canopy node that it follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ring {
    canopy: u32,
    ring: u8,
}

impl Ring {
    /// The row of local free node `free`.
    pub fn row(self, free: u32) -> Row {
        Row { free, canopy: self.canopy, share: 1.0 - f32::from(self.ring) / f32::from(RINGS + 1) }
    }
}

/// A free node that follows the canopy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Local free node.
    pub free: u32,
    /// Interface node that it follows.
    pub canopy: u32,
    /// Fraction of the canopy node's motion.
    pub share: f32,
}

/// Ring of each node of the whole grid: breadth-first search along edges from the canopy through free nodes, so that
/// in a structured layer each column follows its own canopy node.
pub fn rings(grid: &FlowGrid, kind: &[Kind]) -> Vec<Option<Ring>> {
    let mut rings = vec![None; grid.coords.len()];
    for (k, &a) in grid.canopy_nodes.iter().enumerate() {
        rings[a as usize] = Some(Ring { canopy: k as u32, ring: 0 });
    }
    for ring in 1..=RINGS {
        let last = ring - 1;
        let mut found: Vec<(u32, u32)> = Vec::new();
        for cell in &grid.cells {
            for (i, j) in EDGES {
                for (a, b) in [(cell[i], cell[j]), (cell[j], cell[i])] {
                    if rings[b as usize].is_none()
                        && matches!(kind[b as usize], Kind::Free(_))
                        && let Some(r) = rings[a as usize]
                        && r.ring == last
                    {
                        found.push((b, r.canopy));
                    }
                }
            }
        }
        // Of several canopy nodes the lowest: the same on every rank.
        found.sort_unstable();
        for (b, canopy) in found {
            rings[b as usize].get_or_insert(Ring { canopy, ring });
        }
    }
    for &a in &grid.canopy_nodes {
        rings[a as usize] = None;
    }
    rings
}

/// Adds to the displacements `u` of the owned free nodes the share of `canopy` that the near ones follow.
pub fn follow(grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
    let u = u.as_chunks_mut::<3>().0;
    for row in &grid.near[..grid.near_owned] {
        let d = &canopy[3 * row.canopy as usize..][..3];
        let share = f64::from(row.share);
        u[row.free as usize].iter_mut().zip(d).for_each(|(u, d)| *u += share * d);
    }
}

/// Largest small motion of each canopy node, m: [`SMALL`] times the shortest edge `sizes` around the local free
/// nodes. Collective.
pub fn follow_limit(grid: &LocalGrid, sizes: &[f64]) -> Vec<f64> {
    let mut follow_limit = vec![f64::INFINITY; grid.n_canopy];
    for row in &grid.near {
        let r = &mut follow_limit[row.canopy as usize];
        *r = r.min(SMALL * sizes[row.free as usize]);
    }
    let all = grid.comm().all_gather_var(&follow_limit);
    for (k, r) in follow_limit.iter_mut().enumerate() {
        *r = all.iter().skip(k).step_by(grid.n_canopy).copied().fold(*r, f64::min);
    }
    follow_limit
}
