//! Where the flux between two cells may be central: the resolution sensor of the hybrid scheme.
//!
//! The reconstruction with the weight 1/3 has a central mean of fourth order and a jump of third order. The upwind part
//! of the flux damps eddies of eight cells before a turbulence model sees them. It is needed where the grid does not
//! resolve the flow only, so its share follows a sensor (hybrid schemes in detached-eddy practice: Travin et al. 2002).
//! The sensor compares the difference of two neighbours $`\Delta u`$ with what their mean gradient predicts along
//! the line of centres, $`\bar g \cdot d`$:
//! ```math
//! r^2 = \frac{|\Delta u - \bar g \cdot d|^2}{|\Delta u|^2 + |\bar g \cdot d|^2}
//! ```
//! It has no dimension and no threshold, and is zero for linear fields on any grid. On an even grid with spacing $`h`$ a wave
//! of wave number $`k`$ has $`r^2 = (1 - \rho)^2 / (1 + \rho^2)`$ with $`\rho = \frac{1}{3}\cos^2(kh/2)\,(4 - \cos kh)`$, of gradients with
//! their [second pass](crate::gradient::LeastSquares::compact_correction): 1, 0.08 and 0.002 for two, four and eight cells per
//! wavelength. Near walls, at rims
//! and at the outer boundary the flux stays upwind, see [`crate::topology::Topology::upwind`], and at [uneven faces](uneven).

use mesh::lanes::Real;
use nalgebra::Vector3;

use super::velocity;

/// Upwind share of an unresolved difference. Taylor-Green vortex at Re 1600 on 64 cells per wavelength, energy compared with the
/// reference at t = 5, 9, 12: -0.1, -3.0, -0.1 % with 0.5; -0.2, -2.0, +2.6 % with 1.
const UNRESOLVED: f64 = 0.5;

/// Courant number over the leading coefficient of the time derivative at which the flux is upwind. The time step does not resolve
/// the eddies of a few cells there, and central fluxes leave the potential flow around a cylinder with waves.
const UPWIND_COURANT: f64 = 5.0;

/// Smallest upwind share at a Courant number (over the leading coefficient of the time derivative).
#[inline(always)]
pub fn unresolved_in_time<T: Real>(courant: T) -> T {
    fourth_power(courant / T::splat(UPWIND_COURANT)).simd_min(T::splat(1.0))
}

#[inline(always)]
fn fourth_power<T: Real>(x: T) -> T {
    (x * x) * (x * x)
}

/// Distance of the centre of a face from the middle between the centres of its cells, over the distance of these centres, at which the
/// flux is upwind. The reconstruction reaches the centre of the face by gradients, whose part in the mean of both sides is not
/// skew-symmetric: a central flux feeds waves of two cells there. In a descent of the ATPS with detached eddies the air in cells at a seam of
/// the grid (0.45) reached 490 m/s within 70 ms.
const UPWIND_UNEVENNESS: f64 = 0.35;

/// Smallest upwind share of a face whose centre is `offset` (m) from the first of its two cells, whose centres are `way` (m) apart. An even grid
/// has none, a grid that is stretched by a tenth from cell to cell 5e-10; 1 % of the faces around the ATPS on 46 500 cells pass the threshold.
#[inline(always)]
pub fn uneven<T: Real>(offset: &Vector3<T>, way: &Vector3<T>) -> T {
    let unevenness2 = (offset - way * T::splat(0.5)).norm_squared() / way.norm_squared();
    fourth_power(unevenness2 / T::splat(UPWIND_UNEVENNESS * UPWIND_UNEVENNESS)).simd_min(T::splat(1.0))
}

/// Blending of the flux through a face. It is the same in all iterations of a step, so that the residual stays smooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blending<T = f32> {
    /// Upwind share of what the mass flux carries, and of the velocity diffusion: 1 is upwind, 0 central.
    pub upwind: T,
    /// Half the jump of the resolved pressure, which pressure diffusion leaves out, Pa.
    pub resolved: T,
}

impl Default for Blending {
    fn default() -> Self {
        Self::UPWIND
    }
}

impl Blending {
    /// Upwind flux with full pressure diffusion.
    pub const UPWIND: Self = Self { upwind: 1.0, resolved: 0.0 };
}

impl<T: Real> Blending<T> {
    /// Blending for a face between cells whose states differ by `step`, where their mean gradient predicts `along`;
    /// `half`: half the jump of the reconstructed pressure, Pa; `least`: smallest upwind share.
    #[inline(always)]
    pub fn sensed<const N: usize>(step: &[T; N], along: &[T; N], half: T, least: T) -> Self {
        let [zero, one] = [0.0, 1.0].map(T::splat);
        let (du, dg) = (velocity(step), velocity(along));
        let mut r2 = unresolved((du - dg).norm_squared(), du.norm_squared() + dg.norm_squared());
        if N > 4 {
            r2 = r2.simd_max(of_scalar(step[N - 1], along[N - 1]));
        }
        let resolved = (one - of_scalar(step[0], along[0])) * (one - least).simd_max(zero);
        Self { upwind: (T::splat(UNRESOLVED) * r2 * r2).simd_max(least), resolved: resolved * half }
    }

    /// Half the jump of pressure that is diffused, of the half jump `half`, Pa: what was resolved at the start of the
    /// step is left out. Linear in the pressure, so that the pressure correction sees all of the diffusion.
    #[inline(always)]
    pub fn diffused(self, half: T) -> T {
        half - self.resolved
    }
}

/// Sensor of one variable.
#[inline(always)]
fn of_scalar<T: Real>(step: T, along: T) -> T {
    unresolved((step - along) * (step - along), step * step + along * along)
}

/// Ratio of two squares, 0 where both vanish, at most 1.
#[inline(always)]
fn unresolved<T: Real>(difference: T, sum: T) -> T {
    (difference / (sum + T::splat(f64::MIN_POSITIVE))).simd_min(T::splat(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::Vec3;

    /// Difference and mean gradient, of fourth order, of a wave of velocity and pressure with `cells` cells per wavelength, at the
    /// face at `phase`.
    fn wave(cells: f64, phase: f64) -> ([f64; 4], [f64; 4]) {
        let k = std::f64::consts::TAU / cells;
        let u = |i: f64| (k * (i - 0.5) + phase).sin();
        let central = |i: f64| 0.5 * (u(i + 1.0) - u(i - 1.0));
        let gradient = |i: f64| central(i) - (central(i - 1.0) - 2.0 * central(i) + central(i + 1.0)) / 6.0;
        ([u(1.0) - u(0.0); 4], [0.5 * (gradient(0.0) + gradient(1.0)); 4])
    }

    #[test]
    fn sensor_of_waves_matches_the_closed_form() {
        for cells in [2.5, 3.0, 4.0, 8.0, 16.0] {
            for phase in [0.1, 1.0, 2.0, 4.0] {
                let (step, along) = wave(cells, phase);
                let (half, whole) = (std::f64::consts::PI / cells, std::f64::consts::TAU / cells);
                let rho = half.cos().powi(2) * (4.0 - whole.cos()) / 3.0;
                let r2 = (1.0 - rho).powi(2) / (1.0 + rho * rho);
                let found = Blending::sensed(&step, &along, 3.0, 0.0);
                assert!((found.upwind - 0.5 * r2 * r2).abs() < 1e-7, "{cells} {phase}: {found:?}");
                assert!((found.resolved - 3.0 * (1.0 - r2)).abs() < 1e-6, "{cells} {phase}: {found:?}");
            }
        }
    }

    #[test]
    fn linear_and_uniform_fields_are_resolved() {
        let step = [5.0, 1.0, -2.0, 0.3];
        assert_eq!(Blending::sensed(&step, &step, 2.0, 0.0), Blending { upwind: 0.0, resolved: 2.0 });
        let none = Blending::sensed(&[0.0; 4], &[0.0; 4], 0.0, 0.0);
        assert_eq!(none, Blending { upwind: 0.0, resolved: 0.0 });
    }

    #[test]
    fn uneven_faces_are_upwind() {
        let way = Vec3::new(0.0, 0.4, 0.0);
        let at = |along: f64, across: f64| uneven(&Vec3::new(across, 0.2 + along, 0.0), &way);
        assert_eq!(at(0.0, 0.0), 0.0);
        // Skewed by 0.35 of the distance, or stretched so far that the face is at 0.85 of it.
        assert!((at(0.0, 0.14) - 1.0).abs() < 1e-12 && (at(-0.14, 0.0) - 1.0).abs() < 1e-12);
        assert!((at(0.07, 0.0) - 0.5f64.powi(8)).abs() < 1e-12, "{}", at(0.07, 0.0));
        assert_eq!(at(0.1, 0.1), 1.0);
    }

    #[test]
    fn smallest_share_of_one_is_the_upwind_scheme() {
        let (step, along) = wave(8.0, 0.3);
        assert_eq!(Blending::sensed(&step, &along, 2.0, 1.0), Blending { upwind: 1.0, resolved: 0.0 });
    }

    /// With the energy equation a jump of temperature in a uniform stream is not resolved.
    #[test]
    fn jump_of_temperature_is_upwind() {
        let found = Blending::sensed(&[0.0, 0.0, 0.0, 0.0, 3.0], &[0.0; 5], 0.0, 0.0);
        assert_eq!(found.upwind, 0.5);
    }
}
