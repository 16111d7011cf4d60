//! From a residual to a correction.

mod lusgs;
mod multigrid;
mod nonlinear_gmres;
mod pressure;
mod simple;

pub use lusgs::LuSgs;
pub use multigrid::MergedCells;
pub use nonlinear_gmres::NonlinearGmres;
pub use pressure::{PressureSystem, SolveReport};
pub use simple::PressureCorrection;

use comm::Halo;

use crate::gradient::Field;
use crate::physics::{FaceFlux, FluxParameters};
use crate::residual::{Domain, Spatial};
use crate::topology::Adjacency;

/// An approximate inverse of the linearised step.
pub trait Correction<G, const N: usize> {
    /// Prepares for the state of `field` with the fluxes of the faces, `face_flux`.
    /// `extra` = 1 is the default pseudo-time step; larger values shorten it.
    /// Collective.
    fn assemble(
        &mut self,
        spatial: &Spatial<G>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        face_flux: &[FaceFlux],
        extra: f64,
    );

    /// Adds to `q` this share of the correction for the primitive residual `r`. Collective.
    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport;

    /// Coarse cells of the multigrid, once they are built.
    fn merged(&self) -> Option<MergedCells> {
        None
    }

    /// Restores the result of [`Correction::merged`] for the same cells, in `rows`. Collective.
    ///
    /// # Errors
    /// On every rank, if the data of any rank does not fit.
    fn restore_state(&mut self, _merged: MergedCells, _rows: &Adjacency, _halo: &Halo) -> Result<(), String> {
        Ok(())
    }
}
