//! The coarsest level, gathered on every rank and solved directly.

use std::cell::RefCell;

use comm::Comm;

use super::MODES;
use crate::block::Real;
use crate::direct::BlockLu;
use crate::ghost_rows::{GhostRows, starts};
use crate::{BlockCsr, FactorError};

pub(super) struct Coarsest {
    comm: Comm,
    n_rows: usize,
    first: usize,
    lu: BlockLu<MODES, f64>,
    residual: RefCell<Vec<f64>>,
}

impl Coarsest {
    /// Gathers and factorises. Collective.
    pub fn new(a: &BlockCsr<MODES>) -> Result<Self, FactorError> {
        let comm = a.halo().comm().clone();
        let ghosts = GhostRows::new(a.halo());
        let lengths: Vec<u64> = (0..a.n_rows()).map(|i| a.row(i).len() as u64).collect();
        let cols: Vec<u64> = a.cols().iter().map(|&j| ghosts.id[j as usize]).collect();
        let values: Vec<f64> = a.values.iter().flatten().flatten().copied().collect();
        let lengths = comm.all_gather_var(&lengths);
        let cols: Vec<u32> = comm.all_gather_var(&cols).iter().map(|&j| j as u32).collect();
        let values = comm.all_gather_var(&values);
        let mut row_ptr: Vec<usize> = starts(&lengths).iter().map(|&s| s as usize).collect();
        row_ptr.push(cols.len());
        let mut lu = BlockLu::new(&row_ptr, &cols);
        // Every rank factorises the same matrix, so all succeed or all fail.
        lu.factor(values.as_chunks::<MODES>().0.as_chunks::<MODES>().0)?;
        Ok(Self {
            n_rows: a.n_rows(),
            first: ghosts.first[comm.rank()] as usize,
            lu,
            residual: RefCell::new(Vec::new()),
            comm,
        })
    }

    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    pub fn bytes(&self) -> usize {
        self.lu.bytes()
    }

    /// `x = A^-1 r` on owned rows. Collective.
    pub fn solve<T: Real>(&self, r: &[T], x: &mut [T]) {
        let n = self.n_rows * MODES;
        let mut all = self.residual.borrow_mut();
        all.clear();
        all.extend(r[..n].iter().map(|r| r.to_f64()));
        if self.comm.size() > 1 {
            *all = self.comm.all_gather_var(&all);
        }
        self.lu.solve(&mut all);
        for (x, y) in x[..n].iter_mut().zip(&all[self.first * MODES..]) {
            *x = T::from_f64(*y);
        }
    }
}
