//! Conditions on boundaries that air passes: a file for each.

mod far_field;
mod inlet;
mod outlet;

pub use far_field::FarField;
pub use outlet::Outlet;

use mesh::Patch;

use super::flux::{FluxParameters, Interface};
use super::gas::Gas;
use super::velocity;
use crate::geometry::FaceMetric;
use crate::geometry::vec3::Vec3;

/// The condition on the faces of `patch`; none where no air passes.
pub fn open_boundary<G: Gas<N>, const N: usize>(patch: Patch) -> Option<&'static dyn OpenBoundary<G, N>> {
    match patch {
        Patch::FarField => Some(&FarField),
        Patch::Outlet => Some(&Outlet),
        Patch::Inlet => Some(&inlet::Inlet),
        Patch::Wall | Patch::Slip | Patch::Symmetry | Patch::Periodic => None,
    }
}

/// A face of the outer boundary and what is known around it.
#[derive(Clone, Copy, Debug)]
pub struct BoundaryFace<'a> {
    /// Constants of the flux, with the undisturbed wind at the face.
    pub scheme: &'a FluxParameters,
    /// The face.
    pub metric: &'a FaceMetric,
    /// +1 where the face's area vector points out of the domain, else -1.
    pub sign: f64,
    /// Gauge pressure outside, Pa: that of an outlet.
    pub pressure: f64,
}

/// Boundary condition of an open outer face: its flux, and the derivatives that a preconditioner needs.
/// The methods that have a body are those of a face at given pressure.
pub trait OpenBoundary<G: Gas<N>, const N: usize>: Sync {
    /// Flux out of the domain, with the state `q` just inside the face and `cell` at the centre of the cell; `previous`:
    /// the Rhie-Chow flux at the last two time levels, kg/(m2 s).
    fn flux(
        &self,
        gas: &G,
        at: &BoundaryFace<'_>,
        q: &[f64; N],
        cell: &[f64; N],
        previous: [f32; 2],
    ) -> Interface<f64, N>;

    /// Derivative of the mass flux by the cell's pressure, kg/(s Pa). Pressure acts on a velocity for `response`, s;
    /// sound is as fast as `sound`, m/s.
    fn mass_by_pressure(&self, at: &BoundaryFace<'_>, response: f64, _sound: f64) -> f64 {
        response * at.metric.magnitude() / at.metric.spacing()
    }

    /// Derivative of the mass flux by the cell's, which is its density times velocity times area.
    fn mass_by_velocity(&self, _at: &BoundaryFace<'_>) -> f64 {
        1.0
    }

    /// Derivative of the force on the face by the cell's normal velocity, kg/s, where it depends on it; `impedance`: density times speed of
    /// sound, kg/(m2 s).
    fn force_by_velocity(&self, _at: &BoundaryFace<'_>, _impedance: f64) -> Option<f64> {
        None
    }
}

/// A face of the outer boundary, seen from inside.
struct OpenFace {
    /// Area vector out of the domain, m2, and its length.
    area: Vec3,
    magnitude: f64,
    /// Volume that the face sweeps outwards in unit time, m3/s.
    grid_flux: f64,
}

/// Flux through an open boundary.
struct Passing {
    /// Momentum along the outward normal, kg/(m2 s).
    momentum: f64,
    /// Gauge pressure on the face, Pa.
    pressure: f64,
    /// Rhie-Chow flux, kg/(m2 s).
    rhie_chow: f64,
}

impl OpenFace {
    #[inline(always)]
    fn new(at: &BoundaryFace<'_>) -> Self {
        let &BoundaryFace { metric, sign, .. } = at;
        Self { area: metric.area * sign, magnitude: metric.magnitude(), grid_flux: sign * metric.grid_flux }
    }

    /// Velocity of the state `q` along the outward normal, m/s.
    #[inline(always)]
    fn speed<const N: usize>(&self, q: &[f64; N]) -> f64 {
        velocity(q).dot(&self.area) / self.magnitude
    }

    /// Flux of what passes, carried from the state `q` inside or `far` outside.
    #[inline(always)]
    fn flux<G: Gas<N>, const N: usize>(
        &self,
        gas: &G,
        q: &[f64; N],
        far: &[f64; N],
        passing: Passing,
    ) -> Interface<f64, N> {
        let mass = passing.momentum * self.magnitude - gas.density(q) * self.grid_flux;
        let carried = gas.carried(if mass > 0.0 { q } else { far });
        let mut flux = gas.pressure_flux(passing.pressure, self.area, self.grid_flux);
        for (f, c) in flux.iter_mut().zip(carried) {
            *f += mass * c;
        }
        Interface { flux, mass, rhie_chow: passing.rhie_chow }
    }
}

/// A speed through a boundary, bounded from below.
#[inline(always)]
fn hypot(speed: f64, scheme: &FluxParameters) -> f64 {
    (speed * speed + scheme.floor_squared).sqrt()
}
