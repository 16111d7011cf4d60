//! Transfer between a level and the next coarser one.

use std::rc::Rc;

use comm::Halo;

use super::MODES;
use crate::block::Real;

/// Block rows of the prolongation: node of this level by coarse node (local indices).
pub(super) struct Prolongation<const F: usize, T: Real> {
    pub coarse: Rc<Halo>,
    pub row_ptr: Vec<usize>,
    pub cols: Vec<u32>,
    pub values: Vec<[[T; MODES]; F]>,
}

impl<const F: usize> Prolongation<F, f64> {
    /// The same in another precision.
    pub fn cast<T: Real>(self) -> Prolongation<F, T> {
        let values = self.values.iter().map(|p| p.map(|r| r.map(T::from_f64))).collect();
        Prolongation { coarse: self.coarse, row_ptr: self.row_ptr, cols: self.cols, values }
    }
}

impl<const F: usize, T: Real> Prolongation<F, T> {
    /// `rc = P^T r`: owned rows in `r`, local rows (ghosts cleared) in `rc`.
    pub fn restrict(&self, r: &[T], rc: &mut [T]) {
        rc.fill(T::default());
        let blocks = rc.as_chunks_mut::<MODES>().0;
        for (i, r) in r.as_chunks::<F>().0.iter().enumerate() {
            let row = self.row_ptr[i]..self.row_ptr[i + 1];
            for (&j, p) in self.cols[row.clone()].iter().zip(&self.values[row]) {
                let sum = &mut blocks[j as usize];
                for f in 0..F {
                    for m in 0..MODES {
                        sum[m] = p[f][m].fused(r[f], sum[m]);
                    }
                }
            }
        }
        self.coarse.accumulate(rc, MODES);
    }

    /// `x += P xc` on owned rows. Refreshes the ghosts of `xc`.
    pub fn prolong_add(&self, xc: &mut [T], x: &mut [T]) {
        self.coarse.exchange(xc, MODES);
        let blocks = xc.as_chunks::<MODES>().0;
        for (i, x) in x.as_chunks_mut::<F>().0.iter_mut().take(self.row_ptr.len() - 1).enumerate() {
            let row = self.row_ptr[i]..self.row_ptr[i + 1];
            for (&j, p) in self.cols[row.clone()].iter().zip(&self.values[row]) {
                let c = &blocks[j as usize];
                for f in 0..F {
                    let mut sum = T::default();
                    for m in 0..MODES {
                        sum = p[f][m].fused(c[m], sum);
                    }
                    x[f] += sum;
                }
            }
        }
    }

    pub fn bytes(&self) -> usize {
        self.values.len() * (size_of::<[[T; MODES]; F]>() + 4)
    }
}
