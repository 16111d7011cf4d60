//! One contact: its forces and its energy, the same for nodes on triangles and for edges on edges.

use super::friction::Stick;
use crate::flat::{Block, add_block};
use mesh::geometry::{Mat3, Vec3};

/// A pair in contact. Its four nodes are those of both sides; the weights of the first side add up to 1, those of the
/// other to -1, so that the forces are in balance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touch {
    pub(super) nodes: [u32; 4],
    /// Derivatives of the distance by the nodes along the normal.
    pub(super) weights: [f64; 4],
    /// Unit normal from the other side to the first.
    pub(super) normal: Vec3,
    /// Distance along the normal, and how much closer than the distance that is kept it is, m.
    pub(super) distance: f64,
    pub(super) gap: f64,
    /// Factor of the energy.
    pub(super) fade: f64,
    /// Its derivatives by the edges from the first to the second and from the third to the fourth node, 1/m.
    pub(super) turn: [Vec3; 2],
    /// Where the pair sticks, with friction.
    pub(super) stick: Option<Stick>,
}

impl Touch {
    /// Energy at a stiffness (N/m), J.
    pub(super) fn energy(&self, stiffness: f64) -> f64 {
        0.5 * stiffness * self.gap * self.gap * self.fade
    }

    /// Size of the force on either side at a stiffness (N/m), N.
    pub(super) fn force(&self, stiffness: f64) -> f64 {
        stiffness * self.gap * self.fade
    }

    /// Adds the derivative of the energy by the nodes (N) to the rows that `add` leads to.
    #[inline(always)]
    pub(super) fn add_forces(&self, stiffness: f64, mut add: impl FnMut(u32, Vec3)) {
        let f = self.normal * -self.force(stiffness);
        for (node, w) in self.nodes.iter().zip(self.weights) {
            add(*node, f * w);
        }
        if self.fade < 1.0 {
            for (ends, turn) in self.nodes.as_chunks::<2>().0.iter().zip(self.turn) {
                let f = turn * (0.5 * stiffness * self.gap * self.gap);
                add(ends[0], -f);
                add(ends[1], f);
            }
        }
    }

    /// Adds the blocks of the nodes with themselves at a stiffness (N/m), without the derivative of the normal.
    pub(super) fn add_blocks(
        &self,
        stiffness: f64,
        mut block: impl FnMut(u32) -> Option<usize>,
        blocks: &mut [Block],
    ) {
        let k: Mat3 = self.normal * (stiffness * self.fade) * self.normal.transpose();
        for (node, w) in self.nodes.iter().zip(self.weights) {
            if let Some(b) = block(*node) {
                add_block(&mut blocks[b], &(k * (w * w)));
            }
        }
    }
}
