//! Undisturbed air far away.

use super::{BoundaryFace, OpenBoundary, OpenFace, Passing, hypot};
use crate::physics::flux::{Interface, relative_speed};
use crate::physics::gas::Gas;

/// Undisturbed air far away.
///
/// Where the undisturbed stream enters or passes by, the acoustic
/// characteristics set velocity and pressure (waves leave, the stream is held);
/// where it leaves, gauge pressure is zero, so that a wake may pass. In between
/// the two are blended by direction. The characteristics take the cell's own
/// state: at low Mach numbers they are so stiff in the velocity that an
/// extrapolated one would couple cells which no local correction couples.
#[derive(Clone, Copy, Debug)]
pub struct FarField;

impl FarField {
    /// Share of the outflow condition at a far face: 0 where the undisturbed stream
    /// enters or passes along, 1 within 60 degrees of the outward normal.
    #[inline(always)]
    pub fn leaving(self, at: &BoundaryFace<'_>) -> f64 {
        let &BoundaryFace { scheme, metric: face, sign, .. } = at;
        let relative = sign * (scheme.wind - scheme.frame).dot(&face.area) / face.magnitude();
        (2.0 * relative / relative_speed(scheme, scheme.wind)).clamp(0.0, 1.0)
    }
}

impl<G: Gas<N>, const N: usize> OpenBoundary<G, N> for FarField {
    fn flux(
        &self,
        gas: &G,
        at: &BoundaryFace<'_>,
        q: &[f64; N],
        cell: &[f64; N],
        previous: [f32; 2],
    ) -> Interface<f64, N> {
        let scheme = at.scheme;
        let open = OpenFace::new(at);
        let far = gas.undisturbed(scheme.wind);
        let (rho, c) = (gas.density(q), gas.sound_speed_squared(q).sqrt());
        let (inner, outer, near) = (open.speed(q), open.speed(&far), open.speed(cell));
        let leaving = self.leaving(at);
        let speed = 0.5 * (near + outer + cell[0] / (rho * c));
        let p = 0.5 * (cell[0] + rho * c * (near - outer));
        // At a leaving stream pressure pulls the mass flux as it does between cells.
        let rhie_chow = scheme.rhie_chow(previous, q[0], at.metric.spacing(), hypot(speed, scheme));
        let free = inner + (rhie_chow + q[0] / c) / rho;
        let momentum = rho * (leaving * free + (1.0 - leaving) * speed);
        open.flux(gas, q, &far, Passing { momentum, pressure: (1.0 - leaving) * p, rhie_chow })
    }

    fn mass_by_pressure(&self, at: &BoundaryFace<'_>, response: f64, sound: f64) -> f64 {
        let leaving = self.leaving(at);
        let open = response / at.metric.spacing();
        let closed = 0.5 / sound;
        at.metric.magnitude() * (leaving * open + (1.0 - leaving) * closed)
    }

    fn mass_by_velocity(&self, at: &BoundaryFace<'_>) -> f64 {
        0.5 + 0.5 * self.leaving(at)
    }

    /// The characteristic pressure grows by rho c / 2 for each m/s.
    fn force_by_velocity(&self, at: &BoundaryFace<'_>, impedance: f64) -> Option<f64> {
        Some((1.0 - self.leaving(at)) * 0.5 * impedance * at.metric.magnitude())
    }
}
