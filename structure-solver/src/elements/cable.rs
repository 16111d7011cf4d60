//! The 2-node cable (paper, equation 4).
//!
//! The Green strain is measured against the rest length $L$, which need not be
//! the initial distance: $E = (l^2 - L^2) / (2 L^2)$. The axial force is
//! $N = A S l / L$ with $S = Y E$.

use crate::vec3::{Mat3, Vec3, dot, scale, sub};

/// Stiffness of a cable element under axial strain.
pub trait CableLaw: Copy + 'static {
    /// Second Piola-Kirchhoff stress (Pa) and its derivative for Green strain `e`.
    fn stress(&self, e: f64) -> (f64, f64);
}

/// Pulls and pushes: a bar.
#[derive(Clone, Copy, Debug)]
pub struct TwoWay {
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
}

impl CableLaw for TwoWay {
    #[inline(always)]
    fn stress(&self, e: f64) -> (f64, f64) {
        (self.youngs_modulus * e, self.youngs_modulus)
    }
}

/// Pulls only: a line shorter than its rest length carries nothing.
#[derive(Clone, Copy, Debug)]
pub struct TensionOnly {
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
}

impl CableLaw for TensionOnly {
    #[inline(always)]
    fn stress(&self, e: f64) -> (f64, f64) {
        let y = if e > 0.0 { self.youngs_modulus } else { 0.0 };
        (y * e, y)
    }
}

/// Green strain against the rest length for the vector `d` between the ends (m).
#[inline(always)]
pub fn strain(d: Vec3, rest_length: f64) -> f64 {
    0.5 * (dot(d, d) / (rest_length * rest_length) - 1.0)
}

/// Stress of a step from Green strain `start` to `end`, and its derivative by `end`
/// divided by `w`: see [`crate::materials::step`]. With `w = 1` the law itself.
#[inline(always)]
pub fn step(law: &impl CableLaw, start: f64, end: f64, w: f64) -> (f64, f64) {
    let (s, y) = law.stress(w * end + (1.0 - w) * start);
    if w == 1.0 {
        return (s, y);
    }
    let (s1, s0) = (law.stress(end).0, law.stress(start).0);
    let (stored, work) = (0.5 * (s1 * end - s0 * start), s * (end - start));
    if stored - work > 1e-13 * (s1 * end + s0 * start) {
        let mean = stored / (end - start);
        (mean, (s1 - mean) / ((end - start) * w))
    } else {
        (s, y)
    }
}

/// Force on the second end (N) for the stress `s` (Pa), `d` the vector between the
/// ends: the internal force vector is `[-f, f]`.
#[inline(always)]
pub fn force(s: f64, d: Vec3, rest_length: f64, area: f64) -> Vec3 {
    scale(area * s / rest_length, d)
}

/// The block $k$ of the tangent $[[k,-k],[-k,k]]$ of [`force`] (N/m), `y` the
/// derivative of the stress. The strain grows along `by` (m): `d` itself, or the
/// vector between the ends in another configuration that makes the stress.
#[inline(always)]
pub fn stiffness(s: f64, y: f64, d: Vec3, by: Vec3, rest_length: f64, area: f64) -> Mat3 {
    let (geometric, material) = (area * s / rest_length, area * y / rest_length.powi(3));
    let mut k = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            k[i][j] = material * d[i] * by[j];
        }
        k[i][i] += geometric;
    }
    k
}

/// Axial force (N), positive in tension. `offset`: strain at rest length that makes
/// the pre-stress.
pub fn tension(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, offset: f64, area: f64) -> f64 {
    let d = sub(x[1], x[0]);
    area * law.stress(strain(d, rest_length) + offset).0 * dot(d, d).sqrt() / rest_length
}

/// Strain energy (J), that of the pre-stress included.
pub fn energy(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, offset: f64, area: f64) -> f64 {
    let e = strain(sub(x[1], x[0]), rest_length) + offset;
    0.5 * law.stress(e).0 * e * area * rest_length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::{Kernel, conforms};

    const X: [Vec3; 2] = [[0.1, 0.2, -0.3], [1.0, 0.7, 0.4]];

    /// A line of a law and a rest length (m).
    struct Line<L>(L, f64);

    impl<L: CableLaw> Kernel<2> for Line<L> {
        fn force(&self, x: &[Vec3; 2]) -> [Vec3; 2] {
            let d = sub(x[1], x[0]);
            let f = force(self.0.stress(strain(d, self.1)).0, d, self.1, 0.3);
            [scale(-1.0, f), f]
        }
        fn stiffness(&self, x: &[Vec3; 2]) -> [[Mat3; 2]; 2] {
            let d = sub(x[1], x[0]);
            let (s, y) = self.0.stress(strain(d, self.1));
            let k = stiffness(s, y, d, d, self.1, 0.3);
            let minus = k.map(|row| scale(-1.0, row));
            [[k, minus], [minus, k]]
        }
        fn energy(&self, x: &[Vec3; 2]) -> f64 {
            energy(&self.0, x, self.1, 0.0, 0.3)
        }
    }

    #[test]
    fn lines_conform() {
        let rest = |length: f64| [[0.1, 0.2, 0.3], [0.1 + length, 0.2, 0.3]];
        conforms(&Line(TensionOnly { youngs_modulus: 5.0 }, 1.1), rest(1.1), X);
        conforms(&Line(TwoWay { youngs_modulus: 5.0 }, 1.1), rest(1.1), X);
        // Compressed.
        conforms(&Line(TwoWay { youngs_modulus: 5.0 }, 1.4), rest(1.4), X);
    }

    #[test]
    fn a_slack_line_carries_nothing() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let d = sub(X[1], X[0]);
        assert_eq!(law.stress(strain(d, 1.4)), (0.0, 0.0));
        assert_eq!(stiffness(0.0, 0.0, d, d, 1.4, 0.3), [[0.0; 3]; 3]);
        assert_eq!(energy(&law, &X, 1.4, 0.0, 0.3), 0.0);
    }

    #[test]
    fn a_step_creates_no_energy_and_knows_its_derivative() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let stored = |e: f64| 0.5 * law.stress(e).0 * e;
        for w in [0.5, 0.6, 1.0] {
            for (a, b) in [(0.1, 0.3), (-0.2, 0.3), (0.3, -0.25), (-0.3, -0.1), (-0.1, 0.05), (0.2, 0.2)] {
                let (s, y) = step(&law, a, b, w);
                assert!(s * (b - a) >= stored(b) - stored(a) - 1e-15, "{w} {a} {b}");
                let h = 1e-6;
                let slope = (step(&law, a, b + h, w).0 - step(&law, a, b - h, w).0) / (2.0 * h);
                assert!((slope - w * y).abs() < 1e-6, "{w} {a} {b}: {slope} {}", w * y);
            }
        }
    }

    /// The stress of the averaged strain where its work covers the energy, also from slack to taut; the least that does
    /// elsewhere.
    #[test]
    fn a_step_is_corrected_where_it_must_be() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let stored = |e: f64| 0.5 * law.stress(e).0 * e;
        for (a, b, w, corrected) in [
            (-0.05, 0.3, 0.6, false),
            (-0.3, 0.3, 0.6, true),
            (-0.05, 0.3, 0.5, true),
            (0.1, 0.3, 0.5, false),
            (0.3, -0.25, 0.6, false),
        ] {
            let plain = law.stress(w * b + (1.0 - w) * a).0;
            let exact = if corrected { (stored(b) - stored(a)) / (b - a) } else { plain };
            assert!((step(&law, a, b, w).0 - exact).abs() < 1e-14, "{w} {a} {b}");
            assert_eq!(stored(b) - stored(a) > plain * (b - a) + 1e-12, corrected, "{w} {a} {b}");
        }
    }

    /// Pre-stress S0 at rest length; released at the length where Y E = -S0.
    #[test]
    fn a_prestressed_line_pulls_at_its_rest_length() {
        let (y, s0) = (7.0, 0.7);
        let law = TensionOnly { youngs_modulus: y };
        let at = |l: f64| tension(&law, &[[0.0; 3], [l, 0.0, 0.0]], 2.0, s0 / y, 0.5);
        assert!((at(2.0) - 0.5 * s0).abs() < 1e-15);
        let free = 2.0 * (1.0f64 - 2.0 * s0 / y).sqrt();
        assert_eq!(at(free - 1e-6), 0.0);
        assert!(at(free + 1e-6) > 0.0);
        // The energy is the work of pulling from there: Simpson's rule, exact for the
        // cubic tension.
        let work = (2.0 - free) / 6.0 * (at(free) + 4.0 * at(0.5 * (2.0 + free)) + at(2.0));
        let stored = energy(&law, &[[0.0; 3], [2.0, 0.0, 0.0]], 2.0, s0 / y, 0.5);
        assert!((work - stored).abs() < 1e-15, "{work} {stored}");
    }

    #[test]
    fn tension_is_measured_against_the_rest_length() {
        // Stretch 1.1: E = 0.105, N = A Y E l/L.
        let x = [[0.0; 3], [2.2, 0.0, 0.0]];
        let law = TensionOnly { youngs_modulus: 7.0 };
        assert!((tension(&law, &x, 2.0, 0.0, 0.5) - 0.5 * 7.0 * 0.105 * 1.1).abs() < 1e-14);
        assert!((energy(&law, &x, 2.0, 0.0, 0.5) - 0.5 * 7.0 * 0.105f64.powi(2)).abs() < 1e-14);
    }
}
