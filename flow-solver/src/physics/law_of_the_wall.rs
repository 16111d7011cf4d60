//! Law of the wall of the Spalart-Allmaras model: mean velocity next to a wall, from the viscous sublayer to the
//! logarithmic layer.
//!
//! In wall units, $`y^+ = u_\tau y/\nu`$ and $`u^+ = u/u_\tau`$ with $`u_\tau = \sqrt{\tau_w/\rho}`$, the constant stress
//! of the inner layer and $`\tilde\nu = \kappa u_\tau y`$ give
//! ```math
//! \frac{du^+}{dy^+} = \frac{1}{1 + \nu_t^+},\qquad \nu_t^+ = \frac{\chi^4}{\chi^3 + c_{v1}^3},\qquad \chi = \kappa y^+ .
//! ```
//! The integral in closed form is that of Allmaras, Johnson and Spalart (ICCFD7-1902, 2012).

use crate::turbulence::{CV1, KAPPA};

/// How friction on no-slip walls follows from the flow in the adjacent cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallTreatment {
    /// The velocity is linear between wall and cell centre: the grid resolves the viscous sublayer.
    Resolved,
    /// The velocity follows the law of the wall: any $`y^+`$ within the inner layer.
    Automatic,
}

/// Below this $`y^+`$ the integral is computed by quadrature, which keeps its relative accuracy down to zero.
const QUADRATURE: f64 = 2.0;
/// Nodes in (0, 1) and weights of the Gauss-Legendre rule with five points.
const GAUSS: [[f64; 2]; 5] = [
    [0.046_910_077_030_668, 0.118_463_442_528_094_5],
    [0.230_765_344_947_158_5, 0.239_314_335_249_683_2],
    [0.5, 0.284_444_444_444_444_4],
    [0.769_234_655_052_841_5, 0.239_314_335_249_683_2],
    [0.953_089_922_969_332, 0.118_463_442_528_094_5],
];

/// $`du^+/dy^+`$ at `y` in wall units.
pub fn velocity_slope(y: f64) -> f64 {
    let chi = KAPPA * y;
    let chi3 = chi * chi * chi;
    let cv3 = CV1 * CV1 * CV1;
    (chi3 + cv3) / (chi3 + cv3 + chi * chi3)
}

/// $`u^+/y^+`$ at `y` in wall units: 1 at the wall.
pub fn velocity_ratio(y: f64) -> f64 {
    if y < QUADRATURE {
        let missing = |[node, weight]: &[f64; 2]| weight * (1.0 - velocity_slope(node * y));
        return 1.0 - GAUSS.iter().map(missing).sum::<f64>();
    }
    const B: f64 = 5.033_390_879_050_558;
    const A1: f64 = 8.148_221_580_024_245;
    const A2: f64 = -6.928_709_384_902_294_5;
    const B1: f64 = 7.460_087_608_252_795;
    const B2: f64 = 7.468_145_790_401_841;
    const C1: f64 = 2.549_677_353_975_474_7;
    const C2: f64 = 1.330_165_158_853_522_8;
    const C3: f64 = 3.599_459_109_332_379;
    const C4: f64 = 3.639_753_186_868_449_4;
    let (one, two) = (y + A1, y + A2);
    let logarithms = C1 * (one * one + B1 * B1).ln() - C2 * (two * two + B2 * B2).ln();
    (B + logarithms - C3 * B1.atan2(one) - C4 * B2.atan2(two)) / y
}

/// Newton iterations at most; from the first guess below, five reach round-off at any Reynolds number.
const NEWTON: usize = 8;

/// The law of the wall at a point near a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallLaw {
    /// Distance of the point in wall units, $`y^+`$.
    pub y: f64,
    /// Wall stress over that of a linear profile with the same velocity, $`y^+/u^+`$: an effective viscosity over the
    /// molecular one.
    pub stress: f64,
    /// Logarithmic derivative of the wall stress by the velocity: 1 in the sublayer, towards 2 above.
    pub exponent: f64,
    /// Velocity gradient at the point over that of a linear profile with the same velocity.
    pub gradient: f64,
}

impl WallLaw {
    /// Where the velocity relative to the wall is `speed` (m/s) at the `distance` (m), for the kinematic viscosity `nu` (m2/s).
    pub fn new(speed: f64, distance: f64, nu: f64) -> Self {
        Self::at_reynolds(speed * distance / nu)
    }

    /// By the Reynolds number $`y^+ u^+`$ of velocity and distance, whose root $`y^+`$ is found by Newton's method.
    pub fn at_reynolds(reynolds: f64) -> Self {
        // The sublayer, and the power law of 1/7 above it.
        let mut y = reynolds.sqrt().max((reynolds / 8.3).powf(0.875));
        for _ in 0..NEWTON {
            // Of y u+ by y, over y; the floor is for air at rest.
            let derivative = y.max(f64::MIN_POSITIVE) * (velocity_ratio(y) + velocity_slope(y));
            let change = (reynolds - velocity_ratio(y) * y * y) / derivative;
            y += change;
            if change.abs() <= 1e-15 * y {
                break;
            }
        }
        let (ratio, slope) = (velocity_ratio(y), velocity_slope(y));
        Self { y, stress: 1.0 / ratio, exponent: 2.0 / (1.0 + slope / ratio), gradient: slope / ratio }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// $`u^+`$ by Simpson's rule on even steps of $`\ln(1 + y)`$.
    fn integrated(y: f64) -> f64 {
        let n = 20_000;
        let h = (1.0 + y).ln() / f64::from(n);
        let f = |k: i32| {
            let e = (h * f64::from(k)).exp();
            velocity_slope(e - 1.0) * e
        };
        let inner: f64 = (1..n).map(|k| f(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
        (f(0) + inner + f(n)) * h / 3.0
    }

    /// The slope from the eddy viscosity of the model itself, with its working variable linear.
    #[test]
    fn slope_is_that_of_the_turbulence_model() {
        for y in [0.1, 1.0, 5.0, 12.0, 80.0, 2e3] {
            let nu = 1.5e-5;
            let eddy = crate::turbulence::eddy_viscosity(0.41 * y * nu, nu);
            assert!((velocity_slope(y) * (1.0 + eddy / nu) - 1.0).abs() < 1e-14, "{y}");
        }
    }

    #[test]
    fn closed_form_matches_the_integral() {
        for y in [1e-3, 0.1, 1.0, 1.999_999, 2.0, 3.0, 5.0, 8.0, 12.0, 30.0, 100.0, 1e3, 1e4] {
            let (found, exact) = (y * velocity_ratio(y), integrated(y));
            assert!((found / exact - 1.0).abs() < 2e-12, "y+ {y}: {found} {exact}");
        }
        // Logarithmic far out, linear at the wall.
        assert!((1e5 * velocity_ratio(1e5) - (1e5f64.ln() / 0.41 + 5.033_390_879)).abs() < 1e-3);
        assert_eq!(velocity_ratio(0.0), 1.0);
        assert!((1.0 - velocity_ratio(0.1)) < 2e-9);
    }

    /// From nothing to 1e14: the Reynolds number of the solution is the given one, and the derivatives are those of
    /// finite differences.
    #[test]
    fn inverse_converges_at_any_reynolds_number() {
        assert_eq!(WallLaw::at_reynolds(0.0), WallLaw { y: 0.0, stress: 1.0, exponent: 1.0, gradient: 1.0 });
        for k in -1200..=560 {
            let reynolds = 10f64.powf(f64::from(k) / 40.0);
            let law = WallLaw::at_reynolds(reynolds);
            let back = law.y * law.y * velocity_ratio(law.y);
            assert!((back / reynolds - 1.0).abs() < 1e-13, "{reynolds}: {law:?}");
            assert!((law.stress * reynolds / (law.y * law.y) - 1.0).abs() < 1e-13, "{reynolds}");
            let h = 1e-5;
            let stress = |f: f64| WallLaw::at_reynolds(reynolds * f).y.ln() * 2.0;
            let slope = (stress(1.0 + h) - stress(1.0 - h)) / (2.0 * h);
            assert!((slope - law.exponent).abs() < 1e-7, "{reynolds}: {slope} {law:?}");
        }
    }

    /// Friction velocity 0.4 m/s: stress and gradient follow from velocity and distance alone.
    #[test]
    fn friction_velocity_in_air() {
        let (nu, tau) = (1.5e-5, 0.4);
        for y in [0.5, 4.0, 11.0, 40.0, 700.0] {
            let distance = y * nu / tau;
            let speed = tau * integrated(y);
            let law = WallLaw::new(speed, distance, nu);
            assert!((law.y / y - 1.0).abs() < 1e-11, "{law:?}");
            // Stress: rho u_tau^2 = mu U / d times the factor.
            assert!((nu * speed / distance * law.stress / (tau * tau) - 1.0).abs() < 1e-11);
            // Gradient: u_tau^2 / (nu + nu_t).
            let exact = tau * tau / nu * velocity_slope(y);
            assert!((speed / distance * law.gradient / exact - 1.0).abs() < 1e-11);
        }
    }
}
