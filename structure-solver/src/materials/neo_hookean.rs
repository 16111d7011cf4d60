use super::{Material, Moduli, Regime, Strain, Stress};
use mesh::lanes::{Lanes, Real};

/// Incompressible neo-Hookean film in plane stress: rubber, latex, soft polymer films at large strain.
///
/// $`W = \tfrac{\mu}{2}(C_{11}+C_{22}+1/J-3)`$ with $`C = I+2E`$, $`J = \det C`$ in the plane; the
/// thickness stretches by $`J^{-1/2}`$, so that the volume stays. $`S = \mu\,(I - C^{-1}/J)`$, and
/// with the cofactors $`a = (C_{22}, C_{11}, -C_{12})`$ the tangent is
/// $`\mu\,(4\,a\otimes a/J^3 - (\partial a/\partial E)/J^2)`$. Young's modulus at small strains is
/// $`3\mu`$, Poisson's ratio 1/2. (Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5.)
#[derive(Clone, Copy, Debug)]
pub struct NeoHookean {
    /// Shear modulus, Pa.
    mu: f64,
}

impl NeoHookean {
    /// Of Young's modulus at small strains, Pa.
    pub fn new(youngs_modulus: f64) -> Self {
        Self { mu: youngs_modulus / 3.0 }
    }
}

/// Cofactors of C in the order 11, 22, 12, and its determinant.
#[inline(always)]
fn cofactors<T: Real>(e: &[T; 3]) -> ([T; 3], T) {
    let [one, two] = [1.0, 2.0].map(T::splat);
    let a = [one + two * e[1], one + two * e[0], -e[2]];
    (a, a[0] * a[1] - a[2] * a[2])
}

impl NeoHookean {
    #[inline(always)]
    fn stress_of<T: Real>(&self, e: [T; 3]) -> [T; 3] {
        let (a, j) = cofactors(&e);
        let mu = T::splat(self.mu);
        let by = mu / (j * j);
        [mu - by * a[0], mu - by * a[1], -by * a[2]]
    }
}

impl Material for NeoHookean {
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
        let (a, j) = cofactors(&e);
        let (square, cube) = (self.mu / (j * j), 4.0 * self.mu / (j * j * j));
        let mut c = a.map(|a1| a.map(|a2| cube * a1 * a2));
        c[0][1] -= 2.0 * square;
        c[1][0] -= 2.0 * square;
        c[2][2] += square;
        (self.stress(e), c)
    }

    #[inline(always)]
    fn energy(&self, _s: &Stress, e: &Strain) -> f64 {
        let (_, j) = cofactors(e);
        self.mu * (e[0] + e[1] + 0.5 * (1.0 / j - 1.0))
    }
}

/// Tension field of [`NeoHookean`]: the relaxed energy of Pipkin (IMA J. Appl. Math. 36, 1986,
/// 85-99; closed form by Steigmann, Proc. R. Soc. A 429, 1990, 141-173).
///
/// With principal stretches $`\lambda_1\ge\lambda_2`$: slack where $`\lambda_1\le1`$, taut where
/// $`\lambda_2\ge\lambda_1^{-1/2}`$, the width of a strip under tension; between them wrinkled, with
/// $`S = \mu\,(1-\lambda_1^{-3})\,n\otimes n`$ along the first principal direction.
#[derive(Clone, Copy, Debug)]
pub struct NeoHookeanTensionField {
    taut: NeoHookean,
}

/// The wrinkled or slack state: the first principal value of C, the difference of both, twice the angle.
struct Stretches {
    regime: Regime,
    c1: f64,
    difference: f64,
    cos2: f64,
    sin2: f64,
}

impl NeoHookeanTensionField {
    /// Of Young's modulus at small strains, Pa.
    pub fn new(youngs_modulus: f64) -> Self {
        Self { taut: NeoHookean::new(youngs_modulus) }
    }

    #[inline(always)]
    fn stretches(e: &Strain) -> Stretches {
        let (m, d, s) = (1.0 + e[0] + e[1], e[0] - e[1], e[2]);
        let r = (d * d + s * s).sqrt();
        // Equal stretches are taut or slack: the direction is not used.
        let inverse = if r > 0.0 { 1.0 / r } else { 0.0 };
        let (c1, c2) = (m + r, m - r);
        let regime = if c1 <= 1.0 {
            Regime::Slack
        } else if c2 * c1.sqrt() >= 1.0 {
            Regime::Taut
        } else {
            Regime::Wrinkled
        };
        Stretches { regime, c1, difference: c1 - c2, cos2: d * inverse, sin2: s * inverse }
    }

    /// Tension of a wrinkled state, Pa.
    #[inline(always)]
    fn tension(&self, c1: f64) -> f64 {
        self.taut.mu * (1.0 - 1.0 / (c1 * c1.sqrt()))
    }
}

impl Material for NeoHookeanTensionField {
    #[inline(always)]
    fn stress(&self, e: Strain) -> Stress {
        let p = Self::stretches(&e);
        match p.regime {
            Regime::Taut => self.taut.stress(e),
            Regime::Slack => [0.0; 3],
            Regime::Wrinkled => {
                let s = 0.5 * self.tension(p.c1);
                [s * (1.0 + p.cos2), s * (1.0 - p.cos2), s * p.sin2]
            }
        }
    }

    #[inline(always)]
    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        let p = Self::stretches(&e);
        match p.regime {
            Regime::Taut => self.taut.tangent(e),
            Regime::Slack => ([0.0; 3], [[0.0; 3]; 3]),
            Regime::Wrinkled => {
                // n (x) n and its derivative by twice the angle act on (E11, E22, 2 E12).
                let n = [0.5 * (1.0 + p.cos2), 0.5 * (1.0 - p.cos2), 0.5 * p.sin2];
                let t = [-0.5 * p.sin2, 0.5 * p.sin2, 0.5 * p.cos2];
                let along = 3.0 * self.taut.mu / (p.c1 * p.c1 * p.c1.sqrt());
                let turn = 4.0 * self.tension(p.c1) / p.difference;
                let row = |i: usize| [0, 1, 2].map(|j| along * n[i] * n[j] + turn * t[i] * t[j]);
                (self.stress(e), [row(0), row(1), row(2)])
            }
        }
    }

    #[inline(always)]
    fn energy(&self, s: &Stress, e: &Strain) -> f64 {
        let p = Self::stretches(e);
        match p.regime {
            Regime::Taut => self.taut.energy(s, e),
            Regime::Slack => 0.0,
            Regime::Wrinkled => 0.5 * self.taut.mu * (p.c1 + 2.0 / p.c1.sqrt() - 3.0),
        }
    }

    fn regime(&self, e: Strain) -> Regime {
        Self::stretches(&e).regime
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::check::{conforms, turned};

    const Y: f64 = 6.0;

    /// Uniaxial: nominal stress $`\mu(\lambda-\lambda^{-2})`$ at a width of $`\lambda^{-1/2}`$; equal pulls:
    /// $`\mu(\lambda-\lambda^{-5})`$ (Treloar, The Physics of Rubber Elasticity, 1975, chapter 4).
    #[test]
    fn pulls_have_their_closed_forms() {
        let mu = Y / 3.0;
        for l in [1.1f64, 1.7, 3.0] {
            let green = |l: f64| 0.5 * (l * l - 1.0);
            let uniaxial = [green(l), green(l.powf(-0.5)), 0.0];
            let narrow = [green(l), green(0.9 * l.powf(-0.5)), 0.0];
            let equal = [green(l), green(l), 0.0];
            let exact = [mu * (l - l.powi(-2)), mu * (l - l.powi(-5))];
            let field = NeoHookeanTensionField::new(Y);
            let film = NeoHookean::new(Y);
            for (s, exact, across) in [
                (film.stress(uniaxial), exact[0], 0.0),
                (field.stress(narrow), exact[0], 0.0),
                (film.stress(equal), exact[1], exact[1]),
                (field.stress(equal), exact[1], exact[1]),
            ] {
                assert!((l * s[0] - exact).abs() < 1e-13 && (l * s[1] - across).abs() < 1e-13, "{l}: {s:?}");
            }
            assert_eq!(field.regime(narrow), Regime::Wrinkled);
            assert_eq!(field.regime(equal), Regime::Taut);
            assert_eq!(field.regime(narrow.map(|e| -0.1 * e.abs())), Regime::Slack);
        }
    }

    #[test]
    fn films_conform() {
        for angle in [0.0, 0.4, 1.3] {
            for (e1, e2) in [(0.3, 0.1), (1.5, 0.2), (0.4, -0.1), (-0.1, -0.2)] {
                conforms(&NeoHookean::new(Y), turned(e1, e2, angle));
            }
            for (e1, e2) in [(0.3, 0.1), (0.5, -0.3), (2.0, -0.4), (-0.1, -0.2)] {
                conforms(&NeoHookeanTensionField::new(Y), turned(e1, e2, angle));
            }
        }
    }
}
