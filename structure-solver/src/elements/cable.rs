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

/// Force on the second end (N), by the cable's own pull inwards its negative:
/// the internal force vector is `[-f, f]`.
#[inline(always)]
pub fn force(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, area: f64) -> Vec3 {
    let d = sub(x[1], x[0]);
    let (s, _) = law.stress(strain(d, rest_length));
    scale(area * s / rest_length, d)
}

/// Force as [`force`] and the block $k$ of its tangent $[[k,-k],[-k,k]]$ (N/m).
#[inline(always)]
pub fn stiffness(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, area: f64) -> (Vec3, Mat3) {
    let d = sub(x[1], x[0]);
    let (s, y) = law.stress(strain(d, rest_length));
    let (geometric, material) = (area * s / rest_length, area * y / rest_length.powi(3));
    let mut k = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            k[i][j] = material * d[i] * d[j];
        }
        k[i][i] += geometric;
    }
    (scale(geometric, d), k)
}

/// Axial force (N), positive in tension.
pub fn tension(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, area: f64) -> f64 {
    let d = sub(x[1], x[0]);
    area * law.stress(strain(d, rest_length)).0 * dot(d, d).sqrt() / rest_length
}

/// Strain energy (J).
pub fn energy(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, area: f64) -> f64 {
    let e = strain(sub(x[1], x[0]), rest_length);
    0.5 * law.stress(e).0 * e * area * rest_length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::tangent_error;

    const X: [Vec3; 2] = [[0.1, 0.2, -0.3], [1.0, 0.7, 0.4]];

    fn error(law: impl CableLaw, rest_length: f64) -> f64 {
        let minus = |k: Mat3| k.map(|r| r.map(|v| -v));
        let (_, k) = stiffness(&law, &X, rest_length, 0.3);
        let f = |x: &[Vec3; 2]| {
            let f = force(&law, x, rest_length, 0.3);
            [scale(-1.0, f), f]
        };
        tangent_error(X, f, &[[k, minus(k)], [minus(k), k]])
    }

    #[test]
    fn tangent_is_the_derivative_of_the_force() {
        assert!(error(TensionOnly { youngs_modulus: 5.0 }, 1.1) < 1e-8);
        assert!(error(TwoWay { youngs_modulus: 5.0 }, 1.1) < 1e-8);
        assert!(error(TwoWay { youngs_modulus: 5.0 }, 1.4) < 1e-8, "compressed");
    }

    #[test]
    fn a_slack_line_carries_nothing() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        assert_eq!(stiffness(&law, &X, 1.4, 0.3), ([0.0; 3], [[0.0; 3]; 3]));
        assert_eq!(energy(&law, &X, 1.4, 0.3), 0.0);
    }

    #[test]
    fn tension_is_measured_against_the_rest_length() {
        // Stretch 1.1: E = 0.105, N = A Y E l/L.
        let x = [[0.0; 3], [2.2, 0.0, 0.0]];
        let law = TensionOnly { youngs_modulus: 7.0 };
        assert!((tension(&law, &x, 2.0, 0.5) - 0.5 * 7.0 * 0.105 * 1.1).abs() < 1e-14);
        assert!((energy(&law, &x, 2.0, 0.5) - 0.5 * 7.0 * 0.105f64.powi(2)).abs() < 1e-14);
    }
}
