//! Prescribed velocity.

use super::{BoundaryFace, OpenBoundary, OpenFace, Passing};
use crate::physics::flux::Interface;
use crate::physics::gas::Gas;

/// The velocity of the undisturbed air, or of the inlet's own data, whatever the flow does, as the fan of a closed wind tunnel imposes it; the
/// pressure comes from inside. Air that enters has the undisturbed temperature. Waves are reflected.
#[derive(Clone, Copy, Debug)]
pub struct Inlet;

impl<G: Gas<N>, const N: usize> OpenBoundary<G, N> for Inlet {
    fn flux(
        &self,
        gas: &G,
        at: &BoundaryFace<'_>,
        q: &[f64; N],
        _: &[f64; N],
        _: [f32; 2],
    ) -> Interface<f64, N> {
        let open = OpenFace::new(at);
        let far = gas.undisturbed(at.scheme.wind);
        let mut entering = far;
        entering[0] = q[0];
        let speed = open.speed(&far);
        let leaves = speed * open.magnitude > open.grid_flux;
        let upwind = if leaves { q } else { &entering };
        let momentum = gas.density(upwind) * speed;
        open.flux(gas, upwind, &entering, Passing { momentum, pressure: q[0], rhie_chow: 0.0 })
    }

    fn mass_by_pressure(&self, _: &BoundaryFace<'_>, _: f64, _: f64) -> f64 {
        0.0
    }

    fn mass_by_velocity(&self, _: &BoundaryFace<'_>) -> f64 {
        0.0
    }
}
