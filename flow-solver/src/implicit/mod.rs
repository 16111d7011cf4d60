//! From a residual to a correction.

mod acceleration;
mod lusgs;
mod multigrid;
mod pressure;
mod simple;

pub use acceleration::Acceleration;
pub use lusgs::LuSgs;
pub use multigrid::MergedCells;
pub use pressure::{PressureSystem, SolveReport};
pub use simple::PressureCorrection;

use comm::Halo;

use crate::gradient::Field;
use crate::physics::{FaceFlow, Scheme};
use crate::residual::{Domain, Spatial};
use crate::topology::Adjacency;

/// An approximate inverse of the linearised step.
pub trait Correction<G, const N: usize> {
    /// Prepares for the state of `field` with what passes the faces, `through`.
    /// `extra` of 1 is the method's own pseudo-time step, more a shorter one.
    /// Collective.
    fn assemble(
        &mut self,
        spatial: &Spatial<G>,
        on: &Domain<'_>,
        scheme: &Scheme,
        field: Field<'_, N>,
        through: &[FaceFlow],
        extra: f64,
    );

    /// Adds to `q` this share of the correction for the primitive residual `r`. Collective.
    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        scheme: &Scheme,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport;

    /// Coarse cells that were merged once and are kept; none where there are none.
    fn merged(&self) -> Option<MergedCells> {
        None
    }

    /// Takes up what [`Correction::merged`] gave on the same cells, in `rows`. Collective.
    ///
    /// # Errors
    /// On every rank, what does not fit on one of them.
    fn restore_state(&mut self, _merged: MergedCells, _rows: &Adjacency, _halo: &Halo) -> Result<(), String> {
        Ok(())
    }
}
