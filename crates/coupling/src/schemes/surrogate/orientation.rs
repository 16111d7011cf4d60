//! Rotation of the canopy since its lattice was assembled.
//!
//! The influence matrix contains distances and angles between panels only: a rotation of the whole canopy leaves it as it is. What rotates is the normals along
//! which the air is accelerated, and the vertical parts of the areas. Both cost a thousandth of a matrix.

use nalgebra::Matrix3;

use crate::geometry::Vec3;

/// The canopy's faces after a rotation, for operators that were assembled before it.
pub struct Orientation {
    /// The rotation.
    pub rotation: Matrix3<f64>,
    /// Area vectors of the faces, m2.
    pub areas: Vec<Vec3>,
    /// Their directions.
    pub normals: Vec<Vec3>,
}

/// The rotation $`R`$ with the least $`\sum_f w_f |n_f - R m_f|^2`$ (Wahba 1965; by the singular values of $`\sum_f w_f n_f m_f^T`$, Kabsch 1976) for the directions
/// $`m`$ (`from`) and $`n`$ (`to`) and these weights. The identity where they determine none.
pub(crate) fn best_rotation(from: &[Vec3], to: &[Vec3], weights: &[f64]) -> Matrix3<f64> {
    let correlation: Matrix3<f64> =
        from.iter().zip(to).zip(weights).map(|((m, n), w)| n * m.transpose() * *w).sum();
    if !correlation.iter().all(|c| c.is_finite()) {
        return Matrix3::identity();
    }
    let svd = correlation.svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    // Singular values decrease: a reflection is removed in the direction that matters least.
    let handedness = Vec3::new(1.0, 1.0, (u * vt).determinant().signum());
    u * Matrix3::from_diagonal(&handedness) * vt
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn directions() -> Vec<Vec3> {
        (0..40).map(f64::from).map(|i| Vec3::new((2.0 * i).sin(), i.cos(), 1.5).normalize()).collect()
    }

    #[test]
    fn rotation_of_directions_is_found() {
        let from = directions();
        let weights: Vec<f64> = (0..from.len()).map(|i| 1.0 + (i % 3) as f64).collect();
        for angles in [[0.0, 0.0, 0.0], [0.3, -0.7, 1.9], [-2.0, 0.4, 3.0]] {
            let exact = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
            let to: Vec<Vec3> = from.iter().map(|m| exact * m).collect();
            let found = best_rotation(&from, &to, &weights);
            assert!((found - exact).norm() < 1e-13, "{found} {exact}");
        }
    }

    /// Of all rotations none near the one found has a smaller sum, where the directions have changed among themselves too.
    #[test]
    fn rotation_is_the_best_one() {
        let from = directions();
        let weights: Vec<f64> = (0..from.len()).map(|i| 1.0 + (i % 5) as f64).collect();
        let turned = Rotation3::from_euler_angles(0.4, 0.2, -0.6);
        let to: Vec<Vec3> = from
            .iter()
            .enumerate()
            .map(|(i, m)| (turned * (m + Vec3::new(0.2, 0.3 * (i as f64).sin(), 0.0))).normalize())
            .collect();
        let sum = |r: &Matrix3<f64>| -> f64 {
            from.iter().zip(&to).zip(&weights).map(|((m, n), w)| w * (n - r * m).norm_squared()).sum()
        };
        let found = best_rotation(&from, &to, &weights);
        assert!((found.determinant() - 1.0).abs() < 1e-13);
        let least = sum(&found);
        for axis in 0..3 {
            for angle in [-1e-3, 1e-3] {
                let mut step = Vec3::zeros();
                step[axis] = angle;
                let other = Rotation3::new(step).into_inner() * found;
                assert!(sum(&other) > least, "axis {axis}, {angle}: {} {least}", sum(&other));
            }
        }
    }

    /// A flat canopy has one normal: the rotation about it stays free, but a rotation it is, and it maps the normal.
    #[test]
    fn one_direction_gives_a_rotation_without_reflection() {
        let (from, to) = (vec![Vec3::z(); 5], vec![Vec3::new(0.6, 0.0, 0.8); 5]);
        let found = best_rotation(&from, &to, &[1.0; 5]);
        assert!((found.determinant() - 1.0).abs() < 1e-13 && (found * from[0] - to[0]).norm() < 1e-13);
        assert_eq!(best_rotation(&from, &[Vec3::repeat(f64::NAN); 5], &[1.0; 5]), Matrix3::identity());
    }
}
