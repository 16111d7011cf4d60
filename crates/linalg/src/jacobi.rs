//! Block Jacobi.

use crate::block::{Real, add_mul, invert};
use crate::{BlockCsr, Preconditioner};

/// Inverses of the diagonal blocks, stored in precision `T`.
#[derive(Clone, Debug)]
pub struct BlockJacobi<const B: usize, T: Real = f64> {
    inverse: Vec<[[T; B]; B]>,
}

/// A diagonal block without inverse.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error(
    "the diagonal block of local row {row} is singular or not finite: \
     is the node attached to an element, or constrained?"
)]
pub struct SingularBlock {
    /// Local row.
    pub row: usize,
}

impl<const B: usize, T: Real> BlockJacobi<B, T> {
    /// Inverts the diagonal blocks of `a`.
    pub fn new<S: Real>(a: &BlockCsr<B, S>) -> Result<Self, SingularBlock> {
        let mut jacobi = Self { inverse: vec![[[T::default(); B]; B]; a.n_rows()] };
        jacobi.refactor(a)?;
        Ok(jacobi)
    }

    /// Inverts the diagonal blocks again, after the values of `a` changed.
    pub fn refactor<S: Real>(&mut self, a: &BlockCsr<B, S>) -> Result<(), SingularBlock> {
        for (row, inverse) in self.inverse.iter_mut().enumerate() {
            let d = a.values[a.diagonal_slot(row)].map(|r| r.map(S::to_f64));
            let inv = invert(&d).ok_or(SingularBlock { row })?;
            *inverse = inv.map(|r| r.map(T::from_f64));
        }
        Ok(())
    }
}

impl<const B: usize, T: Real> Preconditioner for BlockJacobi<B, T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let (r, z) = (r.as_chunks::<B>().0, z.as_chunks_mut::<B>().0);
        for ((d, r), z) in self.inverse.iter().zip(r).zip(z) {
            *z = [0.0; B];
            add_mul(z, d, r);
        }
    }
}
