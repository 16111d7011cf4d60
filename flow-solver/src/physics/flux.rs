//! Convective fluxes of low dissipation at any Mach number below one.
//!
//! A simple scheme of the AUSM family (Liou 2006, AUSM+-up; Sachdev et al. 2012
//! for its scaling in unsteady flow): one mass flux with a pressure-diffusion
//! term, everything carried upwind by it, one interface pressure with a
//! velocity-diffusion term. Two reference speeds scale the two terms:
//!
//! * pressure diffusion in the mass flux is the momentum interpolation of
//!   pressure-based methods (Rhie-Chow). The flux that it adds to the interpolated
//!   momentum, $`e`$, is an unknown of the face with its own history (Cubero and Fueyo 2007),
//!   ```math
//!   \partial_t e + \left(\frac{2(U + U_\infty)}{\delta} + \frac{6\nu}{\delta^2}\right) e = -\frac{k}{2\delta}[p],
//!   ```
//!   by the backward difference of the step: strong enough against odd-even
//!   decoupling, limited by the time that pressure acts in a step, and independent of
//!   the step in the steady limit (without the history the scheme is first
//!   order in time). The acoustic term $`[p]/2c`$ is added for sound waves;
//! * velocity diffusion in the interface pressure uses the *steady* limit
//!   $`U_u = \min(c, U)`$. With the unsteady one it would swamp the momentum
//!   equation whenever the time step is small.

use mesh::lanes::Real;
use nalgebra::Vector3;

use super::blending::Blending;
use super::gas::Gas;
use super::velocity;
use crate::geometry::FaceGeometry;
use crate::geometry::vec3::Vec3;

/// Weight of the velocity diffusion: the interface pressure lacks a quarter of $`\rho U [u_n]`$, half of what the
/// upwind flux of Godunov's method has where sound is as fast as $`U`$.
pub const VELOCITY_DIFFUSION: f64 = 0.5;

/// Parameters of the flux, the same for all faces in a time step.
#[derive(Clone, Copy, Debug)]
pub struct FluxParameters {
    /// Leading coefficient of the time derivative over the step, 1/s.
    pub rate: f64,
    /// Coefficients of the time derivative of the Rhie-Chow flux, divided by the step, 1/s.
    pub rhie_chow: [f64; 3],
    /// Velocity of the frame that the grid is given in, m/s.
    pub frame: Vec3,
    /// Undisturbed velocity, m/s.
    pub wind: Vec3,
    /// Square of the smallest reference speed, m2/s2.
    pub floor_squared: f64,
    /// Weight of the velocity diffusion.
    pub velocity_diffusion: f64,
    /// Whether the evaluation sets the blending of faces by its state.
    pub renews_blending: bool,
    /// Kinematic viscosity of the fluid, m2/s.
    pub kinematic_viscosity: f64,
    /// Weight of the pressure diffusion: 2 is the momentum interpolation of
    /// pressure-based methods for states that the jump takes in full.
    pub pressure_diffusion: f64,
}

impl FluxParameters {
    /// Rhie-Chow flux of a face of the outer boundary, kg/(m2 s): the difference of its mass flux per area from the mean momentum.
    /// `previous`: the same at the last two time levels; `push`: driving pressure, Pa; `spacing`: distance of the
    /// cell centres along the normal, m; `speed`: speed of the air relative to the frame, m/s.
    #[inline(always)]
    pub(super) fn rhie_chow(&self, previous: [f32; 2], push: f64, spacing: f64, speed: f64) -> f64 {
        let (held, resistance) = self.resistance(previous.map(f64::from), spacing, speed);
        (push - held) / resistance
    }

    /// History term of the Rhie-Chow equation, Pa, and its resistance without viscosity (the coefficient of the new value), m/s: see
    /// [`FluxParameters::rhie_chow`].
    #[inline(always)]
    pub(crate) fn resistance<T: Real>(&self, previous: [T; 2], spacing: T, speed: T) -> (T, T) {
        let [new, one, two] = self.rhie_chow.map(T::splat);
        let held = one * previous[0] + two * previous[1];
        let fade = T::splat(FADING) * (speed + T::splat(10.0 * self.floor_squared.sqrt()));
        (spacing * held, spacing * new + fade)
    }
}

/// How many times while air crosses a cell what pressure adds to a mass flux fades by a
/// factor e. It is an error of the order of the square of the cell, so it should fade
/// fast, and what keeps cells from decoupling, so it should not. Taylor-Green on 32 x 32
/// cells is off by 13.8e-4, 8.8e-4, 6.8e-4, 5.8e-4 with 1, 2, 3, 4; the plate takes 2.9,
/// 3.1, 3.25, 3.5 iterations a step.
const FADING: f64 = 2.0;

/// Viscous part of the resistance, times $`\nu/\delta`$: what the neighbours of a cube of side $`\delta`$ hold its velocity with.
/// Without it the pressure diffusion of a step with $`\nu\Delta t/h^2 \gg 1`$ is that many times too strong: a cavity takes 71
/// iterations at 10 instead of 13, and does not converge from 50 on. Faces of the outer boundary have none: there the whole pressure drives the
/// flux, not its difference from the reconstruction.
const VISCOUS_RESISTANCE: f64 = 6.0;

/// Stored flux of a face, in single precision: the mass flux is read by preconditioners only, the Rhie-Chow flux is
/// small against the mass flux.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaceFlux {
    /// Mass flux, kg/s (outward at the outer boundary).
    pub mass: f32,
    /// Rhie-Chow flux, kg/(m2 s).
    pub rhie_chow: f32,
    /// Rhie-Chow flux at the last two accepted time levels, newest first, kg/(m2 s).
    pub previous: [f32; 2],
    /// Upwind share and resolved pressure, of the step.
    pub blending: Blending,
}

impl FaceFlux {
    /// What a new flux depends on.
    #[inline(always)]
    pub fn history(&self) -> FaceHistory<f64> {
        let Blending { upwind, resolved } = self.blending;
        FaceHistory {
            previous: self.previous.map(f64::from),
            blending: Blending { upwind: f64::from(upwind), resolved: f64::from(resolved) },
        }
    }
}

/// What the flux through a face, or through each face of a batch, depends on besides its state and shape; see [`FaceFlux`].
#[derive(Clone, Copy, Debug)]
pub struct FaceHistory<T> {
    /// Rhie-Chow flux at the last two accepted time levels, newest first, kg/(m2 s).
    pub previous: [T; 2],
    /// Upwind share and resolved pressure, of the step.
    pub blending: Blending<T>,
}

/// Numerical flux through a face, or through each face of a batch.
#[derive(Clone, Copy, Debug)]
pub struct Interface<T, const N: usize> {
    /// Fluxes of the conserved quantities along the area vector.
    pub flux: [T; N],
    /// Mass flux, kg/s.
    pub mass: T,
    /// Rhie-Chow flux, kg/(m2 s).
    pub rhie_chow: T,
}

/// Flux through a face between the states `l` and `r` on its two sides.
#[inline(always)]
pub fn interface<T: Real, G: Gas<N>, const N: usize>(
    gas: &G,
    scheme: &FluxParameters,
    l: &[T; N],
    r: &[T; N],
    face: &FaceGeometry<T>,
    history: &FaceHistory<T>,
) -> Interface<T, N> {
    let [zero, half, one] = [0.0, 0.5, 1.0].map(T::splat);
    let &FaceHistory { previous, blending } = history;
    let &FaceGeometry { area: s, grid_flux, spacing, .. } = face;
    let magnitude = s.norm();
    let upwind = |flux: T| -> [T; N] { std::array::from_fn(|v| l[v].select(flux.simd_gt(zero), r[v])) };
    let mean = (velocity(l) + velocity(r)) * half;
    let speed = relative_speed(scheme, mean);
    let volume = mean.dot(&s) - grid_flux;
    let from = upwind(volume);
    let (rho, c2) = (gas.density(&from), gas.sound_speed_squared(&from));
    let half_jump = half * (l[0] - r[0]);
    let push = T::splat(scheme.pressure_diffusion) * blending.diffused(half_jump);
    let (held, resistance) = scheme.resistance(previous, spacing, speed);
    let friction = T::splat(VISCOUS_RESISTANCE * scheme.kinematic_viscosity)
        / spacing.simd_max(T::splat(f64::MIN_POSITIVE));
    let rhie_chow = (push - held) / (resistance + friction);
    let mass = rho * volume + magnitude * (rhie_chow + half_jump / c2.simd_sqrt());
    let mut carried = gas.carried(&upwind(mass));
    let down = gas.carried(&upwind(-mass));
    for (c, d) in carried.iter_mut().zip(down) {
        *c += half * (one - blending.upwind) * (d - *c);
    }
    let jump = (velocity(r) - velocity(l)).dot(&s);
    let diffusion = blending.upwind * T::splat(scheme.velocity_diffusion) * rho * speed * jump / magnitude;
    let p = half * (l[0] + r[0] - diffusion);
    let mut flux = gas.pressure_flux(p, s, grid_flux);
    for (f, c) in flux.iter_mut().zip(carried) {
        *f += mass * c;
    }
    Interface { flux, mass, rhie_chow }
}

/// What the central flux of momentum lacks of the fourth-order split form (Pirozzoli 2010), per unit of density and
/// share of the central flux: a volume flux along the area vector `s` times velocity.
///
/// On an even grid the means of the reconstructed states are $`\hat u = \frac{4}{3}a - \frac{1}{6}(b + c)`$ with the means $`a`$ of
/// the two cells of the face, $`b`$ and $`c`$ of pairs two cells apart. The product $`\hat u_n\hat u`$ is of second order in the nonlinear
/// terms; the split form $`\frac{4}{3}a_n a - \frac{1}{6}(b_n b + c_n c)`$ is of fourth, and keeps kinetic energy. With
/// $`\beta = b - a`$ and $`\gamma = c - a`$ they differ by
/// ```math
/// -\tfrac{1}{6}(\beta_n\beta + \gamma_n\gamma) - \tfrac{1}{36}(\beta_n + \gamma_n)(\beta + \gamma).
/// ```
/// `beta`, `gamma`: half the difference of the farther neighbour and the near cell, behind the first cell and behind the second, m/s.
/// It vanishes with the square of the distance on any grid, and for a uniform stream.
#[inline(always)]
pub fn split_form_correction<T: Real>(beta: Vector3<T>, gamma: Vector3<T>, s: Vector3<T>) -> Vector3<T> {
    let (bn, cn) = (beta.dot(&s), gamma.dot(&s));
    (beta * bn + gamma * cn) * T::splat(-1.0 / 6.0) - (beta + gamma) * ((bn + cn) / T::splat(36.0))
}

/// Flux through a wall at gauge pressure `p`: no mass.
#[inline(always)]
pub fn wall<G: Gas<N>, const N: usize>(gas: &G, p: f64, area: Vec3, grid_flux: f64) -> Interface<f64, N> {
    Interface { flux: gas.pressure_flux(p, area, grid_flux), mass: 0.0, rhie_chow: 0.0 }
}

/// Speed relative to the frame, bounded from below.
#[inline(always)]
pub(crate) fn relative_speed<T: Real>(scheme: &FluxParameters, u: Vector3<T>) -> T {
    let frame = scheme.frame.map(T::splat);
    ((u - frame).norm_squared() + T::splat(scheme.floor_squared)).simd_sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::{Air, Isothermal};

    fn scheme() -> FluxParameters {
        FluxParameters {
            rate: 100.0,
            rhie_chow: [150.0, -200.0, 50.0],
            frame: Vec3::new(0.0, 0.0, 1.0),
            wind: Vec3::zeros(),
            floor_squared: 0.25,
            velocity_diffusion: VELOCITY_DIFFUSION,
            pressure_diffusion: 3.0,
            renews_blending: false,
            kinematic_viscosity: 0.0,
        }
    }

    /// A face of 2 m2 along x.
    fn face() -> FaceGeometry<f64> {
        FaceGeometry { area: Vec3::new(2.0, 0.0, 0.0), grid_flux: 0.0, spacing: 0.0, offset: Vec3::zeros() }
    }

    /// Two states of equal pressure with velocities 3 and 2 m/s along the normal of a face of 2 m2: mass by the
    /// mean velocity, momentum carried upwind, and a pressure that lacks rho U [u] / 4 with
    /// U = sqrt(2.5^2 + 1 + 0.25), by hand.
    #[test]
    fn interface_pressure_has_velocity_diffusion_of_one_quarter() {
        let gas = Isothermal::new(Air::new(1.225, 288.15));
        let face = face();
        let (l, r) = ([7.0, 3.0, 0.0, 0.0], [7.0, 2.0, 0.0, 0.0]);
        let found = interface(&gas, &scheme(), &l, &r, &face, &FaceFlux::default().history());
        let rho = gas.density(&l);
        let mass = rho * 2.5 * 2.0;
        assert!((found.mass - mass).abs() < 1e-12 * mass && found.rhie_chow == 0.0, "{found:?}");
        let speed = (2.5f64 * 2.5 + 1.0 + 0.25).sqrt();
        let pressure = 7.0 + 0.25 * rho * speed * 1.0;
        let momentum = mass * 3.0 + 2.0 * pressure;
        assert!((found.flux[1] - momentum).abs() < 1e-12 * momentum, "{} {momentum}", found.flux[1]);
    }

    /// The same pressure jump at equal velocities: the mass flux gains pressure_diffusion [p] / 2 over the
    /// resistance of the face, and the acoustic [p] / 2c.
    #[test]
    fn rhie_chow_flux_is_pressure_jump_over_resistance() {
        let gas = Isothermal::new(Air::new(1.225, 288.15));
        let face = face();
        let (l, r) = ([10.0, 0.0, 0.0, 1.0], [4.0, 0.0, 0.0, 1.0]);
        let found = interface(&gas, &scheme(), &l, &r, &face, &FaceFlux::default().history());
        // A spacing of zero leaves what fades: 2 (U + 10 floor), U = 0.5, floor = 0.5.
        let rhie_chow = 3.0 * 3.0 / (2.0 * (0.5 + 5.0));
        let sound = gas.sound_speed_squared(&r).sqrt();
        let mass = 2.0 * (rhie_chow + 3.0 / sound);
        assert!((found.mass - mass).abs() < 1e-12 * mass, "{} {mass}", found.mass);
    }

    /// The product of the reconstructed means with the correction is the split form of its definition.
    #[test]
    fn corrected_product_is_the_split_form() {
        let u = [[0.3, -1.2, 0.7], [2.0, 0.4, -0.9], [1.1, 0.8, 0.2], [-0.6, 1.9, 1.3]].map(Vec3::from);
        let s = Vec3::new(0.4, -0.7, 1.5);
        let mean = |i: usize, j: usize| (u[i] + u[j]) * 0.5;
        let (a, b, c) = (mean(1, 2), mean(0, 2), mean(1, 3));
        let product = |u: Vec3| u * u.dot(&s);
        let split = product(a) * (4.0 / 3.0) - (product(b) + product(c)) * (1.0 / 6.0);
        let reconstructed = (u[1] + u[2]) * (7.0 / 12.0) - (u[0] + u[3]) * (1.0 / 12.0);
        let correction = split_form_correction((u[0] - u[1]) * 0.5, (u[3] - u[2]) * 0.5, s);
        let found = product(reconstructed) + correction;
        assert!((found - split).norm() < 1e-14, "{found} {split}");
    }

    /// Derivative of the square of a wave: of fourth order with the correction, of second without.
    #[test]
    fn corrected_product_has_a_derivative_of_fourth_order() {
        let error = |cells: f64, share: f64| {
            let k = std::f64::consts::TAU / cells;
            let u = |i: f64| Vec3::new((k * i + 0.3).sin(), (k * i + 1.1).cos(), 0.0);
            let flux = |i: f64| {
                let u = [-1.0, 0.0, 1.0, 2.0].map(|d| u(i + d));
                let mean = (u[1] + u[2]) * (7.0 / 12.0) - (u[0] + u[3]) * (1.0 / 12.0);
                let correction = split_form_correction((u[0] - u[1]) * 0.5, (u[3] - u[2]) * 0.5, Vec3::x());
                mean * mean.x + correction * share
            };
            let exact = |i: f64| k * (2.0 * k * i + 1.4).cos();
            let off =
                |i: i32| ((flux(f64::from(i)) - flux(f64::from(i - 1))).y - exact(f64::from(i))).abs() / k;
            (0..cells as i32).map(off).fold(0.0, f64::max)
        };
        let order = |share: f64| (error(16.0, share) / error(32.0, share)).log2();
        assert!((3.7..4.3).contains(&order(1.0)), "{}", order(1.0));
        assert!((1.7..2.3).contains(&order(0.0)), "{}", order(0.0));
    }
}
