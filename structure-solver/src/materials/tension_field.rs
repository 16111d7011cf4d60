use super::{Material, Moduli, Regime, StVenantKirchhoff, Strain, Stress};
use mesh::lanes::{Lanes, Real};

/// Tension field of an isotropic St. Venant-Kirchhoff sheet (Lu, Accorsi and
/// Leonard, Int. J. Numer. Meth. Eng. 50, 2001, 1017-1038).
///
/// Wrinkles shorten the sheet at no cost: they add $`\mu\,w\otimes w`$, $`\mu\ge0`$,
/// to the Green strain until no stress acts across them, $`\tilde S w = 0`$. The
/// wrinkled stress is then uniaxial, so the lengthened strain has its principal
/// axes along and across the wrinkles; as only its $`ww`$ part was changed, the
/// tension runs along the principal direction $`n`$ of $`E`$ itself. With
/// principal Green strains $`e_1\ge e_2`$:
/// * slack, $`e_1\le0`$: $`S=0`$;
/// * taut, $`e_2+\nu e_1\ge0`$: the full law;
/// * wrinkled, between: $`S = Y e_1\, n\otimes n`$.
///
/// The stress is continuous over both borders. The wrinkled tangent
/// $`Y\,(N\otimes N + \frac{2e_1}{e_1-e_2} P\otimes P)`$, with $`N=n\otimes n`$ and
/// $`P=\mathrm{sym}(n\otimes w)`$, includes the rotation of $`n`$. It is symmetric
/// and positive semi-definite, and $`e_1-e_2>(1+\nu)e_1`$ keeps it bounded.
#[derive(Clone, Copy, Debug)]
pub struct TensionField {
    taut: StVenantKirchhoff,
    youngs_modulus: f64,
    poisson_ratio: f64,
}

/// Principal strains with the cosine and sine of twice the angle of the first.
struct Principal<T = f64> {
    e1: T,
    e2: T,
    cos2: T,
    sin2: T,
}

#[inline(always)]
fn principal<T: Real>(e: [T; 3]) -> Principal<T> {
    let [zero, half, one] = [0.0, 0.5, 1.0].map(T::splat);
    let (m, d, s) = (half * (e[0] + e[1]), half * (e[0] - e[1]), half * e[2]);
    let r = (d * d + s * s).simd_sqrt();
    // Equal principal strains are taut or slack: the direction is not used.
    let inverse = (one / r).select(r.simd_gt(zero), zero);
    Principal { e1: m + r, e2: m - r, cos2: d * inverse, sin2: s * inverse }
}

impl TensionField {
    /// Young's modulus (Pa) and Poisson's ratio.
    pub fn new(youngs_modulus: f64, poisson_ratio: f64) -> Self {
        Self {
            taut: StVenantKirchhoff::isotropic(youngs_modulus, poisson_ratio),
            youngs_modulus,
            poisson_ratio,
        }
    }

    #[inline(always)]
    fn state(&self, p: &Principal) -> Regime {
        if p.e1 <= 0.0 {
            Regime::Slack
        } else if p.e2 + self.poisson_ratio * p.e1 >= 0.0 {
            Regime::Taut
        } else {
            Regime::Wrinkled
        }
    }

    #[inline(always)]
    fn uniaxial<T: Real>(&self, p: &Principal<T>) -> [T; 3] {
        let one = T::splat(1.0);
        let s = T::splat(0.5 * self.youngs_modulus) * p.e1;
        [s * (one + p.cos2), s * (one - p.cos2), s * p.sin2]
    }

    /// Stress of each lane in its own state: both stresses are computed and one is taken.
    #[inline(always)]
    fn selected<T: Real>(&self, e: [T; 3]) -> [T; 3] {
        let p = principal(e);
        let zero = T::splat(0.0);
        let slack = p.e1.simd_le(zero);
        let is_taut = (p.e2 + T::splat(self.poisson_ratio) * p.e1).simd_ge(zero);
        let (taut, wrinkled) = (self.taut.stress_of(e), self.uniaxial(&p));
        std::array::from_fn(|i| zero.select(slack, taut[i].select(is_taut, wrinkled[i])))
    }
}

impl Material for TensionField {
    #[inline(always)]
    fn stress(&self, e: Strain) -> Stress {
        let p = principal(e);
        match self.state(&p) {
            Regime::Taut => self.taut.stress(e),
            Regime::Wrinkled => self.uniaxial(&p),
            Regime::Slack => [0.0; 3],
        }
    }

    #[inline(always)]
    fn stresses(&self, e: [Lanes; 3]) -> [Lanes; 3] {
        self.selected(e)
    }

    #[inline(always)]
    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        let p = principal(e);
        match self.state(&p) {
            Regime::Taut => self.taut.tangent(e),
            Regime::Slack => ([0.0; 3], [[0.0; 3]; 3]),
            Regime::Wrinkled => {
                // N and P act on (E11, E22, 2 E12).
                let n = [0.5 * (1.0 + p.cos2), 0.5 * (1.0 - p.cos2), 0.5 * p.sin2];
                let t = [-0.5 * p.sin2, 0.5 * p.sin2, 0.5 * p.cos2];
                let y = self.youngs_modulus;
                let turn = 2.0 * y * p.e1 / (p.e1 - p.e2);
                let mut c = [[0.0; 3]; 3];
                for i in 0..3 {
                    for j in 0..3 {
                        c[i][j] = y * n[i] * n[j] + turn * t[i] * t[j];
                    }
                }
                (self.uniaxial(&p), c)
            }
        }
    }

    fn regime(&self, e: Strain) -> Regime {
        self.state(&principal(e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::check::{conforms, turned};
    use proptest::prelude::*;

    const Y: f64 = 7.0;
    const NU: f64 = 0.3;

    #[test]
    fn fields_conform() {
        for angle in [0.0, 0.4, 1.3] {
            for (e1, e2) in [(0.3, 0.1), (0.2, -0.15), (-0.1, -0.2)] {
                conforms(&TensionField::new(Y, NU), turned(e1, e2, angle));
            }
        }
    }

    #[test]
    fn states_follow_the_mixed_criterion() {
        let m = TensionField::new(Y, NU);
        for angle in [0.0, 0.4, 1.3, 2.8] {
            assert_eq!(m.regime(turned(0.1, 0.05, angle)), Regime::Taut);
            assert_eq!(m.regime(turned(0.1, -0.029, angle)), Regime::Taut);
            assert_eq!(m.regime(turned(0.1, -0.031, angle)), Regime::Wrinkled);
            assert_eq!(m.regime(turned(-0.01, -0.03, angle)), Regime::Slack);
        }
        assert_eq!(m.regime([0.0; 3]), Regime::Slack);
    }

    #[test]
    fn wrinkled_stress_is_uniaxial_along_the_first_principal_strain() {
        let m = TensionField::new(Y, NU);
        let angle = 0.7f64;
        let s = m.stress(turned(0.1, -0.2, angle));
        let (c, n) = (angle.cos(), angle.sin());
        let exact = [Y * 0.1 * c * c, Y * 0.1 * n * n, Y * 0.1 * c * n];
        for i in 0..3 {
            assert!((s[i] - exact[i]).abs() < 1e-15);
        }
    }

    #[test]
    fn stress_is_continuous_over_the_borders() {
        let m = TensionField::new(Y, NU);
        let eps = 1e-9;
        for angle in [0.0, 0.3, 1.1, 2.0] {
            for (a, b) in [
                (turned(0.1, -NU * 0.1 + eps, angle), turned(0.1, -NU * 0.1 - eps, angle)),
                (turned(eps, -0.1, angle), turned(-eps, -0.1, angle)),
            ] {
                assert_ne!(m.regime(a), m.regime(b));
                let (p, q) = (m.stress(a), m.stress(b));
                for i in 0..3 {
                    assert!((p[i] - q[i]).abs() < 3.0 * Y * eps, "{p:?} {q:?}");
                }
            }
        }
    }

    proptest! {
        /// Central differences, kept away from the borders where the tangent jumps.
        #[test]
        fn tangent_is_the_derivative_of_the_stress(
            e1 in -0.3..0.5f64, e2 in -0.5..0.5f64, angle in 0.0..3.1f64,
        ) {
            let (e1, e2) = (e1.max(e2), e1.min(e2));
            prop_assume!(e1.abs() > 1e-3 && (e2 + NU * e1).abs() > 1e-3 && e1 - e2 > 1e-3);
            let m = TensionField::new(Y, NU);
            let e = turned(e1, e2, angle);
            let (s, c) = m.tangent(e);
            prop_assert_eq!(s, m.stress(e));
            let h = 1e-6;
            for j in 0..3 {
                let (mut up, mut down) = (e, e);
                up[j] += h;
                down[j] -= h;
                let (su, sd) = (m.stress(up), m.stress(down));
                for i in 0..3 {
                    let difference = (su[i] - sd[i]) / (2.0 * h);
                    // Third derivatives grow like 1/(e1-e2)^2 <= 1e6: h^2 1e6 Y.
                    prop_assert!((difference - c[i][j]).abs() < 1e-5 * Y, "{} {}", difference, c[i][j]);
                }
            }
        }

        /// The relaxed energy never exceeds the full one, and is their minimum over
        /// all lengthenings: S:E/2 is checked against a search.
        #[test]
        fn energy_is_the_relaxed_one(e1 in -0.3..0.5f64, e2 in -0.5..0.5f64, angle in 0.0..3.1f64) {
            let (e1, e2) = (e1.max(e2), e1.min(e2));
            let full = |e: Strain| {
                let s = StVenantKirchhoff::isotropic(Y, NU).stress(e);
                0.5 * (s[0] * e[0] + s[1] * e[1] + s[2] * e[2])
            };
            // In principal axes the best positive semi-definite addition is diagonal.
            let mut best = f64::MAX;
            for i in 0..=400 {
                for j in 0..=400 {
                    best = best.min(full([e1 + i as f64 * 2e-3, e2 + j as f64 * 2e-3, 0.0]));
                }
            }
            let e = turned(e1, e2, angle);
            let s = TensionField::new(Y, NU).stress(e);
            let energy = 0.5 * (s[0] * e[0] + s[1] * e[1] + s[2] * e[2]);
            // The grid misses the minimum by at most half a cell: curvature Y/(1-nu), cell 2e-3.
            prop_assert!(energy <= best + 1e-12 && best - energy < 2e-5 * Y, "{} {}", energy, best);
        }
    }
}
