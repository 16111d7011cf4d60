//! Finite differences for the tests of the kernels.

use crate::vec3::{Mat3, Vec3};

/// Largest difference between `stiffness` and central differences of `force`,
/// relative to the largest entry of `stiffness`.
pub(crate) fn tangent_error<const N: usize>(
    x: [Vec3; N],
    force: impl Fn(&[Vec3; N]) -> [Vec3; N],
    stiffness: &[[Mat3; N]; N],
) -> f64 {
    // Truncation falls with h^2, cancellation grows with eps/h: h near eps^(1/3).
    let h = 5e-6;
    let largest = stiffness.iter().flatten().flatten().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    let mut worst = 0.0f64;
    for m in 0..N {
        for j in 0..3 {
            let (mut up, mut down) = (x, x);
            up[m][j] += h;
            down[m][j] -= h;
            let (fu, fd) = (force(&up), force(&down));
            for n in 0..N {
                for i in 0..3 {
                    let difference = (fu[n][i] - fd[n][i]) / (2.0 * h);
                    worst = worst.max((difference - stiffness[n][m][i][j]).abs());
                }
            }
        }
    }
    worst / largest
}
