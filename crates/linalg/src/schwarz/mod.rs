//! Restricted additive Schwarz with a direct factor on every subdomain.

mod overlap;
mod schur;

use std::cell::RefCell;

use crate::block::Real;
use crate::direct::BlockLu;
use crate::{BlockCsr, FactorError, Preconditioner};
use overlap::Overlap;

pub use schur::SchurLu;

/// Restricted additive Schwarz (Cai and Sarkis 1999) with one layer of overlap and a
/// sparse LU factor of each subdomain, stored in precision `T`.
///
/// The elimination is planned once, in [`SchwarzLu::new`]; [`SchwarzLu::refactor`] takes
/// new values on the same pattern. On one rank this is a direct solver. Subdomains see
/// zero values beyond their overlap. The map is not symmetric: use it with GMRES.
///
/// Single precision halves what a solve reads and costs GMRES an iteration where the matrix
/// is very ill conditioned; the solution is as accurate, since GMRES computes in `f64`.
pub struct SchwarzLu<const B: usize = 3, T: Real = f32> {
    overlap: Overlap<B>,
    lu: BlockLu<B, T>,
    /// Values of the owned and overlap rows (unused without overlap).
    values: Vec<[[f64; B]; B]>,
    residual: RefCell<Vec<f64>>,
}

impl<const B: usize, T: Real> SchwarzLu<B, T> {
    /// Plans and does the first factorisation. Collective.
    pub fn new(a: &BlockCsr<B>) -> Result<Self, FactorError> {
        let mut this = Self::plan(a);
        this.refactor(a)?;
        Ok(this)
    }

    /// Plans the factorisation of matrices with the pattern of `a`, whose values are not
    /// read: call [`SchwarzLu::refactor`] before the first use. Collective.
    pub fn plan(a: &BlockCsr<B>) -> Self {
        let overlap = Overlap::new(a);
        let (row_ptr, cols) = overlap.pattern(a);
        let lu = BlockLu::new(&row_ptr, &cols);
        let n_local = a.halo().n_local() * B;
        Self { overlap, lu, values: Vec::new(), residual: RefCell::new(vec![0.0; n_local]) }
    }

    /// Factorises the present values of `a`, which has the pattern of the planned matrix.
    /// Collective: when one rank fails, all return an error.
    pub fn refactor(&mut self, a: &BlockCsr<B>) -> Result<(), FactorError> {
        let values = if self.overlap.is_empty() {
            &a.values
        } else {
            self.overlap.gather(a, &mut self.values);
            &self.values
        };
        let result = self.lu.factor(values);
        if a.halo().comm().all(result.is_ok()) { Ok(()) } else { result.and(Err(FactorError::OtherRank)) }
    }

    /// Bytes of the factor on this rank.
    pub fn bytes(&self) -> usize {
        self.lu.bytes()
    }

    /// Multiplications, each with an addition, that a factorisation on this rank needs.
    pub fn flops(&self) -> u64 {
        self.lu.flops()
    }
}

impl<const B: usize, T: Real> Preconditioner for SchwarzLu<B, T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let mut local = self.residual.borrow_mut();
        let halo = self.overlap.halo();
        let n = halo.n_owned() * B;
        local[..n].copy_from_slice(&r[..n]);
        halo.exchange(&mut local, B);
        self.lu.solve(&mut local);
        z[..n].copy_from_slice(&local[..n]);
    }
}
