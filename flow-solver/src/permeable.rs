//! Fabric that lets air through.
//!
//! Across the fabric the pressure falls by
//! $$\Delta p = a\,v + b\,|v|\,v,$$
//! with $v$ the velocity of the air relative to the fabric, from inside to outside. The two half
//! cells beside the fabric hold their mass flux as any two cells do (see
//! [`crate::physics::interface`]): what it has more than the mean of the cells, $e = \rho (v - \bar
//! v)$, needs a pressure
//! $$\delta\,\partial_t e + 2 (U + U_\infty)\, e = (p^- - p^+) - a\,v - b\,|v|\,v,$$
//! with the pressures extrapolated to the two sides and $\delta$ the distance of the centres along
//! the normal. A cloth that resists without limit is a wall; a cloth without resistance is a face between
//! two cells; and the flux never answers pressure more stiffly than air does, so it needs no
//! smaller step.
//!
//! What leaves one side enters the other: mass, and with it the velocity and the enthalpy
//! that it had. The fabric thus feels exactly the jump of pressure.

pub use crate::physics::Permeability;

use crate::gradient::{self, Field};
use crate::physics::{FaceFlow, Gas, Scheme, relative_speed, velocity};
use crate::residual::{Domain, Spatial};
use crate::topology::Pore;

/// Air that passes one pore.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    /// Mass flux from inside to outside, kg/s.
    pub mass: f64,
    /// Its derivative by the pressure on the inside, kg/(s Pa).
    pub slope: f64,
    /// Share of the cells' mean velocity that passes: 1 for no cloth, 0 for a wall.
    pub share: f64,
    /// What passes more than the mean of the cells, kg/(m2 s).
    pub tie: f64,
}

/// State on the fabric as `cell` has it.
fn beside<const N: usize>(on: &Domain<'_>, pore: &Pore, cell: usize, field: Field<'_, N>) -> [f64; N] {
    let d = on.metrics.border(pore.face) - on.metrics.centre(cell);
    gradient::extrapolated(&field.q[cell], &field.gradient[cell], &d)
}

/// Air that passes `pore`, with the states `l` inside and `r` outside, on the fabric.
#[inline]
fn passage<G: Gas<N>, const N: usize>(
    gas: &G,
    on: &Domain<'_>,
    scheme: &Scheme,
    pore: &Pore,
    past: [f32; 2],
    cells: [&[f64; N]; 2],
    [l, r]: [&[f64; N]; 2],
) -> Passage {
    let face = &on.metrics.faces[pore.face as usize];
    let way = on.metrics.centre(pore.outside as usize) - on.metrics.centre(pore.inside as usize);
    let spacing = (way.dot(&face.area) / face.magnitude()).max(0.2 * way.norm());
    let mean = (velocity(cells[0]) + velocity(cells[1])) * 0.5;
    let relative = (mean.dot(&face.area) - face.grid_flux) / face.magnitude();
    let (held, resistance) = scheme.resistance(past, spacing, relative_speed(scheme, mean));
    let jump = l[0] - r[0];
    let rho = gas.density(if jump > 0.0 { l } else { r });
    let resistance = rho * resistance;
    let v = pore.cloth.velocity(jump - held + resistance * relative, resistance);
    let slope = pore.cloth.slope(v, resistance);
    let mass = rho * face.magnitude();
    let share = slope * resistance;
    Passage { mass: mass * v, slope: mass * slope, share, tie: rho * (v - relative) }
}

impl<G, V> Spatial<G, V> {
    /// Adds what passes the pores to the residuals of both sides and writes what passes.
    pub(crate) fn pores<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &Scheme,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
        through: &mut [FaceFlow],
    ) where
        G: Gas<N>,
    {
        for pore in &on.topology.pores {
            let (i, o) = (pore.inside as usize, pore.outside as usize);
            let (l, r) = (beside(on, pore, i, field), beside(on, pore, o, field));
            let kept = &mut through[pore.face as usize];
            let p = passage(&self.gas, on, scheme, pore, kept.past, [&field.q[i], &field.q[o]], [&l, &r]);
            (kept.mass, kept.tie) = (p.mass as f32, p.tie as f32);
            let carried = self.gas.carried(if p.mass > 0.0 { &l } else { &r });
            for v in 0..N {
                residual[i][v] += p.mass * carried[v];
                residual[o][v] -= p.mass * carried[v];
            }
        }
    }

    /// Air that passes each pore, for the implicit part. Without gradients: the derivatives
    /// need not be exact.
    pub(crate) fn passages<'a, const N: usize>(
        &'a self,
        on: &'a Domain<'_>,
        scheme: &'a Scheme,
        q: &'a [[f64; N]],
    ) -> impl Iterator<Item = (&'a Pore, Passage)>
    where
        G: Gas<N>,
    {
        on.topology.pores.iter().map(move |pore| {
            let cells = [&q[pore.inside as usize], &q[pore.outside as usize]];
            (pore, passage(&self.gas, on, scheme, pore, [0.0; 2], cells, cells))
        })
    }
}
