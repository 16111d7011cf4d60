//! Contact on several ranks: positions of all nodes on each of them.

use std::cell::{Ref, RefCell};

use comm::Comm;

use crate::loops::ELSEWHERE;
use crate::model::Model;

/// What a rank needs to find all pairs itself. Each rank finds the same pairs from the same positions and adds the forces on its
/// own nodes, so that no force travels and no result depends on the number of ranks beyond rounding.
pub(super) struct Ranks {
    comm: Comm,
    /// Nodes of the mesh that this rank owns, in its order.
    owned: Vec<u32>,
    /// Rows of the nodes of the mesh here; [`ELSEWHERE`] where another rank owns them.
    rows: Vec<u32>,
    /// Positions of the nodes of the mesh, m.
    x: RefCell<Vec<f64>>,
}

impl Ranks {
    /// Of a mesh with `n` nodes; `None` where one rank has all of them in the order of the mesh.
    pub(super) fn of(model: &Model, n: usize) -> Option<Self> {
        if model.comm.size() == 1 {
            return None;
        }
        let owned: Vec<u32> = model.numbering.owned().iter().map(|n| *n as u32).collect();
        let mut rows = vec![ELSEWHERE; n];
        owned.iter().enumerate().for_each(|(row, n)| rows[*n as usize] = row as u32);
        Some(Self { comm: model.comm.clone(), owned, rows, x: RefCell::new(vec![0.0; 3 * n]) })
    }

    /// Whether this rank counts the sums over all pairs.
    pub(super) fn counts(&self) -> bool {
        self.comm.is_root()
    }

    /// Row of a node of the mesh, where this rank owns it.
    #[inline(always)]
    pub(super) fn row(&self, node: u32) -> Option<usize> {
        let row = self.rows[node as usize];
        (row != ELSEWHERE).then_some(row as usize)
    }

    /// Positions of the nodes of the mesh from those of the local nodes, m. Collective.
    pub(super) fn gather(&self, x: &[f64]) -> Ref<'_, Vec<f64>> {
        {
            let mut all = self.x.borrow_mut();
            all.fill(0.0);
            for (from, &n) in x.as_chunks::<3>().0.iter().zip(&self.owned) {
                all[3 * n as usize..3 * n as usize + 3].copy_from_slice(from);
            }
            // Each number has one owner: the sum is that number.
            self.comm.sum_slice(&mut all);
        }
        self.x.borrow()
    }
}
