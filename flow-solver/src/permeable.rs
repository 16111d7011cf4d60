//! Permeable fabric.
//!
//! Across the fabric the pressure falls by
//! ```math
//! \Delta p = a\,v + b\,|v|\,v,
//! ```
//! with $`v`$ the velocity of the air relative to the fabric, from inside to outside. The two half cells next to the
//! fabric resist their mass flux as any two cells do (see [`crate::physics::interface`]): what it has more than the
//! mean of the cells, $`e = \rho (v - \bar v)`$, needs a pressure
//! ```math
//! \delta\,\partial_t e + 2 (U + U_\infty)\, e = (p^- - p^+) - a\,v - b\,|v|\,v,
//! ```
//! with the pressures extrapolated to the two sides and $`\delta`$ the distance of the centres along
//! the normal. Fabric of infinite resistance is a wall; fabric of zero resistance is a face between
//! two cells; and the flux never answers pressure more stiffly than air does, so it needs no
//! smaller step.
//!
//! What leaves one side enters the other: mass, and with it the velocity and the enthalpy
//! that it had. The load on the fabric is thus exactly the pressure jump.

pub use crate::physics::Permeability;

use crate::gradient::{self, Field};
use crate::physics::{FaceFlux, FluxParameters, Gas, relative_speed, velocity};
use crate::residual::{Domain, Spatial};
use crate::topology::PorousFace;

/// Flux through one porous face.
#[derive(Clone, Copy, Debug)]
pub struct PorousFlux {
    /// Mass flux from inside to outside, kg/s.
    pub mass: f64,
    /// Its derivative by the pressure on the inside, kg/(s Pa).
    pub slope: f64,
    /// Fraction of the mean velocity of the two cells that passes: 1 without fabric, 0 at a wall.
    pub share: f64,
    /// Rhie-Chow flux: difference from the mean momentum of the cells, kg/(m2 s).
    pub rhie_chow: f64,
}

/// State on the fabric as `cell` has it.
fn extrapolated_to_face<const N: usize>(
    on: &Domain<'_>,
    porous_face: &PorousFace,
    cell: usize,
    field: Field<'_, N>,
) -> [f64; N] {
    let d = on.metrics.border(porous_face.face) - on.metrics.centre(cell);
    gradient::extrapolated(&field.q[cell], &field.gradient[cell], &d)
}

/// Flux through `porous_face`, with the states `l` inside and `r` outside, on the fabric.
#[inline]
fn porous_flux<G: Gas<N>, const N: usize>(
    gas: &G,
    on: &Domain<'_>,
    scheme: &FluxParameters,
    porous_face: &PorousFace,
    previous: [f32; 2],
    cells: [&[f64; N]; 2],
    [l, r]: [&[f64; N]; 2],
) -> PorousFlux {
    let face = &on.metrics.faces[porous_face.face as usize];
    let way =
        on.metrics.centre(porous_face.outside as usize) - on.metrics.centre(porous_face.inside as usize);
    let spacing = (way.dot(&face.area) / face.magnitude()).max(0.2 * way.norm());
    let mean = (velocity(cells[0]) + velocity(cells[1])) * 0.5;
    let relative = (mean.dot(&face.area) - face.grid_flux) / face.magnitude();
    let (held, resistance) =
        scheme.resistance(previous.map(f64::from), spacing, relative_speed(scheme, mean));
    let jump = l[0] - r[0];
    let rho = gas.density(if jump > 0.0 { l } else { r });
    let resistance = rho * resistance;
    let v = porous_face.cloth.velocity(jump - held + resistance * relative, resistance);
    let slope = porous_face.cloth.slope(v, resistance);
    let mass = rho * face.magnitude();
    let share = slope * resistance;
    PorousFlux { mass: mass * v, slope: mass * slope, share, rhie_chow: rho * (v - relative) }
}

impl<G, V> Spatial<G, V> {
    /// Adds the fluxes of the porous faces to the residuals of both sides, and stores them.
    pub(crate) fn porous_fluxes<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
        face_flux: &mut [FaceFlux],
    ) where
        G: Gas<N>,
    {
        for porous_face in &on.topology.porous_faces {
            let (i, o) = (porous_face.inside as usize, porous_face.outside as usize);
            let (l, r) = (
                extrapolated_to_face(on, porous_face, i, field),
                extrapolated_to_face(on, porous_face, o, field),
            );
            let kept = &mut face_flux[porous_face.face as usize];
            let p = porous_flux(
                &self.gas,
                on,
                scheme,
                porous_face,
                kept.previous,
                [&field.q[i], &field.q[o]],
                [&l, &r],
            );
            (kept.mass, kept.rhie_chow) = (p.mass as f32, p.rhie_chow as f32);
            let carried = self.gas.carried(if p.mass > 0.0 { &l } else { &r });
            for v in 0..N {
                residual[i][v] += p.mass * carried[v];
                residual[o][v] -= p.mass * carried[v];
            }
        }
    }

    /// Fluxes of the porous faces, for the implicit part. Without gradients: the derivatives
    /// need not be exact.
    pub(crate) fn passages<'a, const N: usize>(
        &'a self,
        on: &'a Domain<'_>,
        scheme: &'a FluxParameters,
        q: &'a [[f64; N]],
    ) -> impl Iterator<Item = (&'a PorousFace, PorousFlux)>
    where
        G: Gas<N>,
    {
        on.topology.porous_faces.iter().map(move |porous_face| {
            let cells = [&q[porous_face.inside as usize], &q[porous_face.outside as usize]];
            (porous_face, porous_flux(&self.gas, on, scheme, porous_face, [0.0; 2], cells, cells))
        })
    }
}
