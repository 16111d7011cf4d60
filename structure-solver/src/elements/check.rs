//! What every kernel must show: one suite for all of them.

use crate::vec3::{Mat3, Vec3, add, cross, dot, norm, scale, sub};

/// An elastic element with its reference state and its law.
pub(crate) trait Kernel<const N: usize> {
    /// Internal nodal forces at `x` (m), N.
    fn force(&self, x: &[Vec3; N]) -> [Vec3; N];
    /// Their derivative, blocks `[row node][column node]`, N/m.
    fn stiffness(&self, x: &[Vec3; N]) -> [[Mat3; N]; N];
    /// Strain energy, J.
    fn energy(&self, x: &[Vec3; N]) -> f64;
}

/// Rigid motion: a turn by 1.1 about (1, 2, 2)/3, by Rodrigues' formula.
fn turn(x: Vec3) -> Vec3 {
    let k = [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
    let (c, s) = (1.1f64.cos(), 1.1f64.sin());
    add(scale(c, x), add(scale(s, cross(k, x)), scale((1.0 - c) * dot(k, x), k)))
}

/// Holds `kernel`, unstressed at `rest`, to what mechanics asks of any element where its nodes are at
/// `x`: a rigid motion makes no force and no energy and turns forces along; forces have no sum and
/// no moment, are the gradient of the energy, and have the stiffness as their derivative. Lengths
/// are of the order of a metre.
pub(crate) fn conforms<const N: usize>(kernel: &impl Kernel<N>, rest: [Vec3; N], x: [Vec3; N]) {
    let k = kernel.stiffness(&x);
    let size = largest(&k);
    let small = |f: Vec3, share: f64, what: &str| assert!(norm(f) <= share * size, "{what}: {f:?}");
    let moved = |x: [Vec3; N]| x.map(|x| add(turn(x), [3.0, -7.0, 2.0]));

    let tangent = tangent_error(x, |x| kernel.force(x), &k);
    assert!(tangent < 1e-7, "stiffness differs from finite differences by {tangent}");
    kernel.force(&moved(rest)).into_iter().for_each(|f| small(f, 1e-13, "force of a rigid motion"));
    assert!(kernel.energy(&moved(rest)).abs() <= 1e-13 * size, "energy of a rigid motion");
    let force = kernel.force(&x);
    for (f, turned) in force.iter().zip(kernel.force(&moved(x))) {
        small(sub(turned, turn(*f)), 1e-12, "force that turns along");
    }
    small(force.into_iter().fold([0.0; 3], add), 1e-13, "sum of the forces");
    let moment = x.iter().zip(force).fold([0.0; 3], |m, (x, f)| add(m, cross(*x, f)));
    small(moment, 1e-13, "moment of the forces");
    let h = 5e-6;
    for n in 0..N {
        let slope: Vec3 = std::array::from_fn(|i| {
            let at = |by: f64| {
                let mut x = x;
                x[n][i] += by;
                kernel.energy(&x)
            };
            (at(h) - at(-h)) / (2.0 * h)
        });
        small(sub(slope, force[n]), 1e-8, "gradient of the energy less the force");
    }
}

fn largest<const N: usize>(stiffness: &[[Mat3; N]; N]) -> f64 {
    stiffness.iter().flatten().flatten().flatten().fold(0.0f64, |m, v| m.max(v.abs()))
}

/// Largest difference between `stiffness` and central differences of `force`,
/// relative to the largest entry of `stiffness`.
pub(crate) fn tangent_error<const N: usize>(
    x: [Vec3; N],
    force: impl Fn(&[Vec3; N]) -> [Vec3; N],
    stiffness: &[[Mat3; N]; N],
) -> f64 {
    // Truncation falls with h^2, cancellation grows with eps/h: h near eps^(1/3).
    let h = 5e-6;
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
    worst / largest(stiffness)
}
