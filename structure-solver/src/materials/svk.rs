use super::{Material, Moduli, Strain, Stress};
use mesh::lanes::{Lanes, Real};

/// St. Venant-Kirchhoff: $`S = C:E`$ with constant moduli.
#[derive(Clone, Copy, Debug)]
pub struct StVenantKirchhoff {
    moduli: Moduli,
}

impl StVenantKirchhoff {
    /// Isotropic plane stress: Young's modulus (Pa) and Poisson's ratio.
    pub fn isotropic(youngs_modulus: f64, poisson_ratio: f64) -> Self {
        let k = youngs_modulus / (1.0 - poisson_ratio * poisson_ratio);
        let nu = poisson_ratio;
        Self { moduli: [[k, nu * k, 0.0], [nu * k, k, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu) * k]] }
    }

    /// Orthotropic plane stress along the element's axes: Young's moduli (Pa),
    /// Poisson's ratio of a pull along 1, and shear modulus (Pa).
    pub fn orthotropic(e1: f64, e2: f64, nu12: f64, g12: f64) -> Self {
        let d = 1.0 - nu12 * nu12 * e2 / e1;
        let c12 = nu12 * e2 / d;
        Self { moduli: [[e1 / d, c12, 0.0], [c12, e2 / d, 0.0], [0.0, 0.0, g12]] }
    }
}

impl StVenantKirchhoff {
    #[inline(always)]
    pub(super) fn stress_of<T: Real>(&self, e: [T; 3]) -> [T; 3] {
        let c = self.moduli.map(|row| row.map(T::splat));
        [c[0][0] * e[0] + c[0][1] * e[1], c[1][0] * e[0] + c[1][1] * e[1], c[2][2] * e[2]]
    }
}

impl Material for StVenantKirchhoff {
    #[inline(always)]
    fn stress(&self, e: Strain) -> Stress {
        self.stress_of(e)
    }

    #[inline(always)]
    fn stresses(&self, e: [Lanes; 3]) -> [Lanes; 3] {
        self.stress_of(e)
    }

    #[inline(always)]
    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        (self.stress(e), self.moduli)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniaxial_stress_gives_the_modulus() {
        // E22 = -nu E11 makes S22 vanish and S11 = Y E11.
        let s = StVenantKirchhoff::isotropic(2e6, 0.3).stress([0.01, -0.003, 0.0]);
        assert!((s[0] - 2e4).abs() < 1e-9 && s[1].abs() < 1e-9);
    }

    #[test]
    fn orthotropic_reduces_to_isotropic() {
        let (y, nu) = (3.0, 0.25);
        let a = StVenantKirchhoff::orthotropic(y, y, nu, 0.5 * y / (1.0 + nu));
        let b = StVenantKirchhoff::isotropic(y, nu);
        for (p, q) in a.moduli.iter().flatten().zip(b.moduli.iter().flatten()) {
            assert!((p - q).abs() < 1e-15);
        }
    }
}
