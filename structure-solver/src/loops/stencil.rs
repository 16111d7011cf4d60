//! Where an element lies: its nodes, and its blocks in the system matrix.
//!
//! Gathering from nodes and scattering into them and into the matrix is here alone; the loops
//! add what their kernels compute, element after element, node after node.

use super::ELSEWHERE;
use crate::flat::{Block, add_at, add_block, at};
use mesh::geometry::{Mat3, Vec3};

/// Nodes of an element and the slots of its blocks. Flat arrays have shape `[n_local][3]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stencil<const N: usize> {
    pub(super) nodes: [u32; N],
    /// Blocks `[row node][column node]`; [`ELSEWHERE`] in rows of other ranks.
    slots: [[u32; N]; N],
}

impl<const N: usize> Stencil<N> {
    /// On local nodes, without a place in a matrix yet.
    pub(super) fn new(nodes: [u32; N]) -> Self {
        Self { nodes, slots: [[ELSEWHERE; N]; N] }
    }

    /// Finds the blocks in the matrix, see [`super::ElementLoop::place`].
    pub(super) fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.slots = self.nodes.map(|n| self.nodes.map(|m| slot(n, m)));
    }

    /// Whether a node is `active`, shape `[n_local]`.
    #[inline(always)]
    pub(super) fn touches(&self, active: &[bool]) -> bool {
        self.nodes.iter().any(|&n| active[n as usize])
    }

    /// Values of the nodes. A loop, because closures over arrays are not inlined everywhere.
    #[inline(always)]
    pub(super) fn gather(&self, x: &[f64]) -> [Vec3; N] {
        let mut values = [Vec3::zeros(); N];
        for n in 0..N {
            values[n] = at(x, self.nodes[n] as usize);
        }
        values
    }

    /// Adds a force of each node.
    #[inline(always)]
    pub(super) fn scatter(&self, f: &[Vec3; N], out: &mut [f64]) {
        for n in 0..N {
            add_at(out, self.nodes[n] as usize, f[n]);
        }
    }

    /// Adds blocks in the rows of owned nodes.
    #[inline(always)]
    pub(super) fn add_blocks(&self, k: &[[Mat3; N]; N], blocks: &mut [Block]) {
        for (n, row) in k.iter().enumerate() {
            if self.slots[n][n] != ELSEWHERE {
                for m in 0..N {
                    add_block(&mut blocks[self.slots[n][m] as usize], &row[m]);
                }
            }
        }
    }
}
