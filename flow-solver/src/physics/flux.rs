//! Convective fluxes of low dissipation at any Mach number below one.
//!
//! A simple member of the AUSM family (Liou 2006, AUSM+-up; Sachdev et al. 2012
//! for its scaling in unsteady flow): one mass flux with a pressure-diffusion
//! term, everything carried upwind by it, one interface pressure with a
//! velocity-diffusion term. Two reference speeds scale the two terms:
//!
//! * pressure diffusion in the mass flux uses the *unsteady* limit of Weiss and
//!   Smith, $U_p = \min(c, U + \delta/\Delta t)$. It then equals the
//!   momentum interpolation of pressure-based methods: strong enough against
//!   odd-even decoupling, never stronger than the time step lets pressure act;
//! * velocity diffusion in the interface pressure uses the *steady* limit
//!   $U_u = \min(c, U)$. With the unsteady one it would swamp the momentum
//!   equation whenever the time step is small.

use super::gas::Gas;
use crate::geometry::FaceMetric;
use crate::geometry::vec3::{Vec3, dot};

/// Constants of the flux, the same for all faces of a time step.
#[derive(Clone, Copy, Debug)]
pub struct Scheme {
    /// Leading coefficient of the time derivative over the step, 1/s.
    pub rate: f64,
    /// Velocity of the frame that the grid is given in, m/s.
    pub frame: Vec3,
    /// Undisturbed velocity, m/s.
    pub wind: Vec3,
    /// Square of the smallest reference speed, m2/s2.
    pub floor_squared: f64,
    /// Weight of the velocity diffusion.
    pub velocity_diffusion: f64,
    /// Weight of the pressure diffusion: 2 is the momentum interpolation of
    /// pressure-based methods for states that the jump takes in full.
    pub pressure_diffusion: f64,
}

/// What passes a face.
#[derive(Clone, Copy, Debug)]
pub struct Interface<const N: usize> {
    /// Fluxes of the conserved quantities along the area vector.
    pub flux: [f64; N],
    /// Mass flux, kg/s.
    pub mass: f64,
}

/// Flux through a face between the states `l` and `r` on its two sides.
#[inline(always)]
pub fn interface<G: Gas<N>, const N: usize>(
    gas: &G,
    scheme: &Scheme,
    l: &[f64; N],
    r: &[f64; N],
    face: &FaceMetric,
) -> Interface<N> {
    let s = face.area;
    let velocity = [0.5 * (l[1] + r[1]), 0.5 * (l[2] + r[2]), 0.5 * (l[3] + r[3])];
    let speed = relative_speed(scheme, velocity);
    let volume = dot(velocity, s) - face.grid_flux;
    let upwind = |x: f64| if x > 0.0 { l } else { r };
    let rho = gas.density(upwind(volume));
    let c2 = gas.sound_speed_squared(upwind(volume));
    let up = ((face.spacing * scheme.rate + speed) / scheme.pressure_diffusion).min(c2.sqrt());
    let mass = rho * volume - 0.5 * face.magnitude * (r[0] - l[0]) / up;
    let carried = gas.carried(upwind(mass));
    let jump = (r[1] - l[1]) * s[0] + (r[2] - l[2]) * s[1] + (r[3] - l[3]) * s[2];
    let diffusion = scheme.velocity_diffusion * rho * speed * jump / face.magnitude;
    let p = 0.5 * (l[0] + r[0] - diffusion);
    let mut flux = gas.pressure_flux(p, s, face.grid_flux);
    for (f, c) in flux.iter_mut().zip(carried) {
        *f += mass * c;
    }
    Interface { flux, mass }
}

/// Flux through a wall at gauge pressure `p`: no mass.
#[inline(always)]
pub fn wall<G: Gas<N>, const N: usize>(gas: &G, p: f64, area: Vec3, grid_flux: f64) -> Interface<N> {
    Interface { flux: gas.pressure_flux(p, area, grid_flux), mass: 0.0 }
}

/// Flux out of the domain into undisturbed air, with `q` just inside the face
/// and `cell` at the centre of the cell.
///
/// Where the undisturbed stream enters or passes by, the acoustic
/// characteristics set velocity and pressure (waves leave, the stream is held);
/// where it leaves, gauge pressure is zero, so that a wake may pass. In between
/// the two are blended by direction. The characteristics take the cell's own
/// state: at low Mach numbers they are so stiff in the velocity that an
/// extrapolated one would couple cells which no local correction couples.
#[inline(always)]
pub fn far_field<G: Gas<N>, const N: usize>(
    gas: &G,
    scheme: &Scheme,
    q: &[f64; N],
    cell: &[f64; N],
    face: &FaceMetric,
    sign: f64,
) -> Interface<N> {
    let s = [sign * face.area[0], sign * face.area[1], sign * face.area[2]];
    let grid_flux = sign * face.grid_flux;
    let far = gas.undisturbed(scheme.wind);
    let (rho, c) = (gas.density(q), gas.sound_speed_squared(q).sqrt());
    let through = |q: &[f64; N]| (q[1] * s[0] + q[2] * s[1] + q[3] * s[2]) / face.magnitude;
    let (inner, outer) = (through(q), through(&far));
    let leaving = leaving(scheme, face, sign);
    let near = through(cell);
    let speed = 0.5 * (near + outer + cell[0] / (rho * c));
    let p = 0.5 * (cell[0] + rho * c * (near - outer));
    // At a leaving stream pressure pulls the mass flux as it does between cells.
    let up = (face.spacing * scheme.rate + speed.abs()).min(c);
    let open = inner + q[0] / (rho * up);
    boundary(
        gas,
        q,
        &far,
        rho * (leaving * open + (1.0 - leaving) * speed),
        (1.0 - leaving) * p,
        s,
        grid_flux,
        face,
    )
}

/// Share of the outflow condition at a far face: 0 where the undisturbed stream
/// enters or passes along, 1 within 60 degrees of the outward normal.
#[inline(always)]
pub fn leaving(scheme: &Scheme, face: &FaceMetric, sign: f64) -> f64 {
    let w = [
        scheme.wind[0] - scheme.frame[0],
        scheme.wind[1] - scheme.frame[1],
        scheme.wind[2] - scheme.frame[2],
    ];
    let relative = sign * dot(w, face.area) / face.magnitude;
    (2.0 * relative / relative_speed(scheme, scheme.wind)).clamp(0.0, 1.0)
}

/// Flux through a boundary at zero gauge pressure, with `q` just inside. What
/// comes in is undisturbed air.
#[inline(always)]
pub fn outlet<G: Gas<N>, const N: usize>(
    gas: &G,
    scheme: &Scheme,
    q: &[f64; N],
    _: &[f64; N],
    face: &FaceMetric,
    sign: f64,
) -> Interface<N> {
    let s = [sign * face.area[0], sign * face.area[1], sign * face.area[2]];
    let far = gas.undisturbed(scheme.wind);
    let (rho, c) = (gas.density(q), gas.sound_speed_squared(q).sqrt());
    let inner = (q[1] * s[0] + q[2] * s[1] + q[3] * s[2]) / face.magnitude;
    let up = (face.spacing * scheme.rate + inner.abs()).min(c);
    boundary(gas, q, &far, rho * (inner + q[0] / (rho * up)), 0.0, s, sign * face.grid_flux, face)
}

#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn boundary<G: Gas<N>, const N: usize>(
    gas: &G,
    q: &[f64; N],
    far: &[f64; N],
    momentum: f64,
    p: f64,
    s: Vec3,
    grid_flux: f64,
    face: &FaceMetric,
) -> Interface<N> {
    let mass = momentum * face.magnitude - gas.density(q) * grid_flux;
    let carried = gas.carried(if mass > 0.0 { q } else { far });
    let mut flux = gas.pressure_flux(p, s, grid_flux);
    for (f, c) in flux.iter_mut().zip(carried) {
        *f += mass * c;
    }
    Interface { flux, mass }
}

/// Speed relative to the frame, bounded from below.
#[inline(always)]
pub(crate) fn relative_speed(scheme: &Scheme, u: Vec3) -> f64 {
    let d = [u[0] - scheme.frame[0], u[1] - scheme.frame[1], u[2] - scheme.frame[2]];
    (dot(d, d) + scheme.floor_squared).sqrt()
}
