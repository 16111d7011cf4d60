use super::{Material, Moduli, Regime, StVenantKirchhoff, Strain, Stress};

/// Tension field of an orthotropic St. Venant-Kirchhoff sheet.
///
/// The stress of a sheet that cannot be compressed is the positive semi-definite one
/// of greatest complementary energy, $`S = \arg\max_{S\succeq0} (S:E - \tfrac12 S:D:S)`$
/// with the compliance $`D`$ (the dual of Pipkin's relaxed energy, IMA J. Appl. Math. 36,
/// 1986, 85-99). Taut: $`C:E`$ where that is positive semi-definite. Slack: zero where no
/// direction is lengthened. Wrinkled: $`S=\sigma\,n\otimes n`$ with $`\sigma`$ and the angle
/// $`\theta`$ of $`n`$ that make $`L=\sigma f-\tfrac12\sigma^2 g`$ greatest, $`f=n\cdot En`$,
/// $`g=n\otimes n:D:n\otimes n`$; unlike in an isotropic sheet, $`n`$ is no principal
/// direction of $`E`$. The tangent $`-B H^{-1} B^T`$, $`H`$ the second derivatives of $`L`$ and
/// $`B`$ those of $`S`$ by $`(\sigma,\theta)`$, is exact and symmetric.
#[derive(Clone, Copy, Debug)]
pub struct OrthotropicTensionField {
    taut: StVenantKirchhoff,
    /// Compliance from (S11, S22, S12) to (E11, E22, 2 E12), 1/Pa.
    compliance: [[f64; 3]; 3],
}

/// Directions that are tried before Newton's method; 0 and 90 degrees are among
/// them, where a fabric with a soft shear has its sharp maxima.
const TRIES: usize = 12;

/// A wrinkled state.
struct Pull {
    sigma: f64,
    /// `n (x) n` and its derivative by the angle, as stresses.
    n: [f64; 3],
    turn: [f64; 3],
    /// Second derivatives of L: by sigma twice, mixed, by the angle twice.
    hessian: [f64; 3],
}

impl OrthotropicTensionField {
    /// Young's moduli (Pa) along the axes of the strain, Poisson's ratio of a pull
    /// along the first, and shear modulus (Pa).
    pub fn new(e1: f64, e2: f64, nu12: f64, g12: f64) -> Self {
        let taut = StVenantKirchhoff::orthotropic(e1, e2, nu12, g12);
        let compliance = [[1.0 / e1, -nu12 / e1, 0.0], [-nu12 / e1, 1.0 / e2, 0.0], [0.0, 0.0, 1.0 / g12]];
        Self { taut, compliance }
    }

    /// `f`, `g` and their first and second derivatives by the angle.
    fn along(&self, e: &Strain, angle: f64) -> ([f64; 3], [f64; 3], [f64; 3], [f64; 3]) {
        let (s, c) = angle.sin_cos();
        let n = [c * c, s * s, c * s];
        let turn = [-2.0 * c * s, 2.0 * c * s, c * c - s * s];
        let bend = [-2.0 * turn[2], 2.0 * turn[2], 2.0 * turn[0]];
        let by = |a: &[f64; 3]| a[0] * e[0] + a[1] * e[1] + a[2] * e[2];
        let pair = |a: &[f64; 3], b: &[f64; 3]| -> f64 {
            let d = &self.compliance;
            (0..3).map(|i| a[i] * (d[i][0] * b[0] + d[i][1] * b[1] + d[i][2] * b[2])).sum()
        };
        let f = [by(&n), by(&turn), by(&bend)];
        let g = [pair(&n, &n), 2.0 * pair(&turn, &n), 2.0 * (pair(&bend, &n) + pair(&turn, &turn))];
        (f, g, n, turn)
    }

    /// The direction of the wrinkled state: the greatest f / sqrt(g).
    fn pull(&self, e: &Strain) -> Pull {
        let step = std::f64::consts::PI / TRIES as f64;
        let principal = 0.5 * e[2].atan2(e[0] - e[1]);
        let merit = |angle: f64| {
            let (f, g, ..) = self.along(e, angle);
            f[0] / g[0].sqrt()
        };
        let tries = (0..TRIES).map(|k| k as f64 * step).chain([principal]);
        let best = tries.map(|a| (merit(a), a)).max_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |b| b.1);
        let (mut low, mut high, mut angle) = (best - step, best + step, best);
        for _ in 0..60 {
            let (f, g, ..) = self.along(e, angle);
            // The sign of the slope of f / sqrt(g), and Newton's step for its root.
            let slope = f[1] * g[0] - 0.5 * f[0] * g[1];
            let change = f[2] * g[0] + 0.5 * f[1] * g[1] - 0.5 * f[0] * g[2];
            if slope > 0.0 {
                low = angle;
            } else {
                high = angle;
            }
            let newton = angle - slope / change;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let moved = (next - angle).abs();
            angle = next;
            if moved < 1e-15 {
                break;
            }
        }
        let (f, g, n, turn) = self.along(e, angle);
        let sigma = f[0] / g[0];
        Pull {
            sigma,
            n,
            turn,
            hessian: [-g[0], f[1] - sigma * g[1], sigma * f[2] - 0.5 * sigma * sigma * g[2]],
        }
    }

    fn state(&self, e: &Strain) -> (Regime, Stress) {
        let s = self.taut.stress(*e);
        let least = 0.5 * (s[0] + s[1]) - (0.5 * (s[0] - s[1])).hypot(s[2]);
        if least >= 0.0 && e.iter().any(|e| *e != 0.0) {
            return (Regime::Taut, s);
        }
        let longest = 0.5 * (e[0] + e[1]) + (0.5 * (e[0] - e[1])).hypot(0.5 * e[2]);
        (if longest <= 0.0 { Regime::Slack } else { Regime::Wrinkled }, s)
    }
}

impl Material for OrthotropicTensionField {
    fn stress(&self, e: Strain) -> Stress {
        match self.state(&e) {
            (Regime::Taut, s) => s,
            (Regime::Slack, _) => [0.0; 3],
            (Regime::Wrinkled, _) => {
                let p = self.pull(&e);
                p.n.map(|n| p.sigma * n)
            }
        }
    }

    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        match self.state(&e) {
            (Regime::Taut, _) => self.taut.tangent(e),
            (Regime::Slack, _) => ([0.0; 3], [[0.0; 3]; 3]),
            (Regime::Wrinkled, _) => {
                let p = self.pull(&e);
                let [a, b, d] = p.hessian;
                let (n, t) = (p.n, p.turn.map(|t| p.sigma * t));
                let mut c = [[0.0; 3]; 3];
                let determinant = a * d - b * b;
                // Two directions equally good: only the pull along n is certain.
                let [aa, ab, bb] = if determinant > 1e-12 * (a * a + d * d) {
                    [-d / determinant, b / determinant, -a / determinant]
                } else {
                    [-1.0 / a, 0.0, 0.0]
                };
                for i in 0..3 {
                    for j in 0..3 {
                        c[i][j] = aa * n[i] * n[j] + ab * (n[i] * t[j] + t[i] * n[j]) + bb * t[i] * t[j];
                    }
                }
                (p.n.map(|n| p.sigma * n), c)
            }
        }
    }

    fn regime(&self, e: Strain) -> Regime {
        self.state(&e).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::TensionField;
    use proptest::prelude::*;

    const LAW: [f64; 4] = [7.0, 2.0, 0.25, 0.6];

    fn law() -> OrthotropicTensionField {
        let [a, b, c, d] = LAW;
        OrthotropicTensionField::new(a, b, c, d)
    }

    proptest! {
        /// With isotropic moduli it is the tension field of Lu, Accorsi and Leonard.
        #[test]
        fn isotropic_moduli_give_the_isotropic_field(e in prop::array::uniform3(-0.3..0.3f64)) {
            let (y, nu) = (7.0, 0.3);
            let m = OrthotropicTensionField::new(y, y, nu, 0.5 * y / (1.0 + nu));
            let (s, t) = (m.stress(e), TensionField::new(y, nu).stress(e));
            for i in 0..3 {
                prop_assert!((s[i] - t[i]).abs() < 1e-12, "{:?} {:?}", s, t);
            }
        }

        /// Duality: no positive semi-definite stress does better, and the stress
        /// pulls in every direction (a search over uniaxial and biaxial states).
        #[test]
        fn the_stress_has_the_greatest_complementary_energy(e in prop::array::uniform3(-0.3..0.3f64)) {
            let m = law();
            let merit = |s: &[f64; 3]| {
                let d = &m.compliance;
                (0..3).map(|i| s[i] * e[i]).sum::<f64>()
                    - 0.5 * (0..3).map(|i| s[i] * (0..3).map(|j| d[i][j] * s[j]).sum::<f64>()).sum::<f64>()
            };
            let s = m.stress(e);
            prop_assert!(0.5 * (s[0] + s[1]) - (0.5 * (s[0] - s[1])).hypot(s[2]) > -1e-12);
            let best = merit(&s);
            // The energy of the strain is that of the stress.
            prop_assert!((best - 0.5 * (0..3).map(|i| s[i] * e[i]).sum::<f64>()).abs() < 1e-12);
            for a in 0..24 {
                let (sin, cos) = (f64::from(a) * 0.1309).sin_cos();
                for p in 0..12 {
                    for q in 0..12 {
                        let (p, q) = (0.2 * f64::from(p), 0.2 * f64::from(q));
                        let s = [p * cos * cos + q * sin * sin, p * sin * sin + q * cos * cos, (p - q) * cos * sin];
                        prop_assert!(merit(&s) <= best + 1e-12);
                    }
                }
            }
        }

        /// Central differences, away from the borders of the states.
        #[test]
        fn tangent_is_the_derivative_of_the_stress(e in prop::array::uniform3(-0.3..0.3f64)) {
            let m = law();
            let h = 1e-6;
            let moved = |j: usize, by: f64| { let mut e = e; e[j] += by; e };
            for j in 0..3 {
                prop_assume!(m.regime(moved(j, 1e3 * h)) == m.regime(moved(j, -1e3 * h)));
            }
            let (s, c) = m.tangent(e);
            prop_assert_eq!(s, m.stress(e));
            // Two almost equally good directions turn too fast for the difference.
            prop_assume!(c.iter().flatten().all(|c| c.abs() < 30.0));
            for j in 0..3 {
                let (up, down) = (m.stress(moved(j, h)), m.stress(moved(j, -h)));
                for i in 0..3 {
                    let difference = (up[i] - down[i]) / (2.0 * h);
                    prop_assert!((difference - c[i][j]).abs() < 1e-4, "{} {}", difference, c[i][j]);
                }
            }
        }
    }

    #[test]
    fn a_pull_along_the_warp_wrinkles_across_it() {
        let m = law();
        assert_eq!(m.regime([0.1, -0.1, 0.0]), Regime::Wrinkled);
        assert_eq!(m.regime([0.1, -0.02, 0.0]), Regime::Taut);
        assert_eq!(m.regime([-0.1, -0.1, 0.1]), Regime::Slack);
        assert_eq!(m.stress([0.0; 3]), [0.0; 3]);
        let s = m.stress([0.1, -0.1, 0.0]);
        assert!((s[0] - 0.7).abs() < 1e-12 && s[1].abs() < 1e-12 && s[2].abs() < 1e-12, "{s:?}");
    }
}
