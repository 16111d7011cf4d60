//! Pressure-velocity law of permeable fabric.

/// Resistance of permeable fabric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Permeability {
    viscous: f64,
    inertial: f64,
}

/// Coefficients beyond this are a wall: what passes is below all round-off.
const WALL: f64 = 1e100;

impl Permeability {
    /// From the coefficients $`a`$ (Pa s/m) and $`b`$ (Pa s2/m2); infinity is a wall.
    pub fn new(viscous: f64, inertial: f64) -> Self {
        Self { viscous: viscous.min(WALL), inertial: inertial.min(WALL) }
    }

    /// The velocity at which cloth and a linear resistance `r` (Pa s/m) in series take up the
    /// pressure `push` (Pa), m/s.
    #[inline(always)]
    pub fn velocity(&self, push: f64, r: f64) -> f64 {
        let linear = self.viscous + r;
        // The root of b v^2 + linear v = |push| that loses no digits, also at b = 0.
        2.0 * push / (linear + (linear * linear + 4.0 * self.inertial * push.abs()).sqrt())
    }

    /// Derivative of [`Permeability::velocity`] by the pressure, at the velocity `v`, m/(s Pa).
    #[inline(always)]
    pub fn slope(&self, v: f64, r: f64) -> f64 {
        1.0 / (self.viscous + r + 2.0 * self.inertial * v.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permeability_velocity_and_slope_satisfy_the_quadratic_law() {
        let cloth = Permeability::new(254.0, 37.6);
        for v in [-3.0f64, -0.2, 0.0, 1e-9, 0.458, 20.0] {
            let push = (254.0 + 50.0) * v + 37.6 * v.abs() * v;
            let found = cloth.velocity(push, 50.0);
            assert!((found - v).abs() <= 1e-14 * v.abs(), "{found} {v}");
            let h = 1e-3;
            let numeric = (cloth.velocity(push + h, 50.0) - cloth.velocity(push - h, 50.0)) / (2.0 * h);
            assert!((cloth.slope(v, 50.0) / numeric - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn limits() {
        let wall = Permeability::new(f64::INFINITY, f64::INFINITY);
        for push in [0.0, 500.0] {
            assert!(wall.velocity(push, 60.0) < 1e-45 && wall.slope(push, 60.0) < 1e-45);
        }
        let open = Permeability::new(0.0, 0.0);
        assert_eq!(open.velocity(120.0, 60.0), 2.0);
        let screen = Permeability::new(0.0, 4.0);
        assert_eq!((screen.velocity(16.0, 0.0), screen.velocity(-16.0, 0.0)), (2.0, -2.0));
    }
}
