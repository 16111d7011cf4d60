//! Prescribed pressure.

use super::{BoundaryFace, OpenBoundary, OpenFace, Passing, hypot};
use crate::physics::flux::Interface;
use crate::physics::gas::Gas;

/// A given gauge pressure, zero unless the outlet has data; the velocity comes from inside. What comes in is undisturbed
/// air.
#[derive(Clone, Copy, Debug)]
pub struct Outlet;

impl<G: Gas<N>, const N: usize> OpenBoundary<G, N> for Outlet {
    fn flux(
        &self,
        gas: &G,
        at: &BoundaryFace<'_>,
        q: &[f64; N],
        _: &[f64; N],
        previous: [f32; 2],
    ) -> Interface<f64, N> {
        let scheme = at.scheme;
        let open = OpenFace::new(at);
        let far = gas.undisturbed(scheme.wind);
        let (rho, c) = (gas.density(q), gas.sound_speed_squared(q).sqrt());
        let inner = open.speed(q);
        let push = q[0] - at.pressure;
        let rhie_chow = scheme.rhie_chow(previous, push, at.metric.spacing(), hypot(inner, scheme));
        open.flux(
            gas,
            q,
            &far,
            Passing { momentum: rho * inner + rhie_chow + push / c, pressure: at.pressure, rhie_chow },
        )
    }
}
