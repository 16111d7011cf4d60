//! Loads on the deformed triangle: follower pressure and traction; pressure on a bent face.

use mesh::geometry::{Mat3, Vec3};
use mesh::lanes::Real;
use nalgebra::Vector3;

/// Area vector of a triangle (m2): its normal by the right-hand rule times its area.
#[inline(always)]
pub fn area_vector<T: Real>(x: &[Vector3<T>; 3]) -> Vector3<T> {
    (x[1] - x[0]).cross(&(x[2] - x[0])) * T::splat(0.5)
}

/// Force on each node (N) of the uniform pressure jump `p` (Pa) along the normal.
#[inline(always)]
pub fn pressure_force<T: Real>(p: T, x: &[Vector3<T>; 3]) -> Vector3<T> {
    area_vector(x) * (p / T::splat(3.0))
}

/// Derivative of [`pressure_force`] by each node: block `[m]` belongs to column
/// node `m` in all three rows. Nonsymmetric over one triangle; over a sheet only
/// the terms of the rim remain so.
///
/// The area vector is $`a = \tfrac12 (x_1-x_0)\times(x_2-x_0)`$, so
/// $`\partial a/\partial x_m = \tfrac12 [e_m]_\times`$ with the opposite edge $`e_m`$.
#[inline(always)]
pub fn pressure_tangent(p: f64, x: &[Vec3; 3]) -> [Mat3; 3] {
    [0, 1, 2].map(|m| skew(opposite_edge(x, m) * (p / 6.0)))
}

/// Force on each node (N) of the traction `t` (Pa) on the deformed area. Its
/// direction is given ("dead"); its amount follows the area.
#[inline(always)]
pub fn traction_force<T: Real>(t: Vector3<T>, x: &[Vector3<T>; 3]) -> Vector3<T> {
    t * (area_vector(x).norm() / T::splat(3.0))
}

/// Derivative of [`traction_force`] by each node, as in [`pressure_tangent`].
#[inline(always)]
pub fn traction_tangent(t: Vec3, x: &[Vec3; 3]) -> [Mat3; 3] {
    let a = area_vector(x);
    let size = a.dot(&a).sqrt();
    // A collapsed triangle has no normal; its force vanishes too.
    let n = if size > 0.0 { a * (1.0 / size) } else { Vec3::zeros() };
    [0, 1, 2].map(|m| {
        let g = n.cross(&opposite_edge(x, m)) * (1.0 / 6.0);
        t * g.transpose()
    })
}

/// Forces (N) on the corners of a face that carry the load of its two triangles over to the flow's wall.
///
/// The flow's wall between four corners is a saddle (four triangles around their mean; the bilinear surface encloses the
/// same volume). Two triangles with the diagonal $`x_0 x_2`$ have the same area vector, so the same force, but enclose a
/// volume that differs by $`V = \tfrac{1}{12} \det(x_1-x_0,\, x_2-x_0,\, x_3-x_0)`$ where the face is bent. Pressure does the
/// work of the wall's volume only with the further forces $`p\,\partial V/\partial x_n`$, whose sum and moment are zero.
#[inline(always)]
pub fn bend_force<T: Real>(p: T, x: &[Vector3<T>; 4]) -> [Vector3<T>; 4] {
    let [u, v, w] = edges(x);
    let q = p / T::splat(12.0);
    let [f1, f2, f3] = [v.cross(&w), w.cross(&u), u.cross(&v)].map(|f| f * q);
    [-(f1 + (f2 + f3)), f1, f2, f3]
}

/// Derivative of [`bend_force`], blocks `[row node][column node]`; symmetric, as a potential's.
#[inline(always)]
pub fn bend_tangent(p: f64, x: &[Vec3; 4]) -> [[Mat3; 4]; 4] {
    let [u, v, w] = edges(x).map(|e| skew(e * (p / 12.0)));
    let zero = Mat3::zeros();
    // d(v x w) = [v] dw - [w] dv, and so on around. The volume is linear in each corner: no block on the diagonal.
    let mut k = [[zero; 4]; 4];
    k[1] = [zero, zero, -w, v];
    k[2] = [zero, w, zero, -u];
    k[3] = [zero, -v, u, zero];
    for n in 1..4 {
        for m in 1..4 {
            let block = k[n][m];
            k[n][0] -= block;
            k[0][m] -= block;
        }
    }
    k
}

/// The face's corners seen from its first.
#[inline(always)]
fn edges<T: Real>(x: &[Vector3<T>; 4]) -> [Vector3<T>; 3] {
    [1, 2, 3].map(|n| x[n] - x[0])
}

#[inline(always)]
fn opposite_edge(x: &[Vec3; 3], m: usize) -> Vec3 {
    x[(m + 2) % 3] - x[(m + 1) % 3]
}

/// The matrix of `v x`.
#[inline(always)]
pub(super) fn skew(v: Vec3) -> Mat3 {
    Mat3::new(0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::tangent_error;
    use crate::elements::quad;

    const X: [Vec3; 3] = [Vec3::new(0.1, -0.2, 0.3), Vec3::new(1.2, 0.1, 0.2), Vec3::new(0.3, 0.9, 0.6)];

    #[test]
    fn tangents_are_the_derivatives_of_the_forces() {
        let t = Vec3::new(0.4, -0.7, 1.1);
        let e = tangent_error(X, |x| [pressure_force(2.0, x); 3], &[pressure_tangent(2.0, &X); 3]);
        assert!(e < 1e-8, "pressure {e}");
        let e = tangent_error(X, |x| [traction_force(t, x); 3], &[traction_tangent(t, &X); 3]);
        assert!(e < 1e-8, "traction {e}");
    }

    const BENT: [Vec3; 4] = [
        Vec3::new(0.1, -0.2, 0.3),
        Vec3::new(1.2, 0.1, 0.2),
        Vec3::new(1.3, 0.9, 0.6),
        Vec3::new(-0.1, 1.1, -0.4),
    ];

    /// Two triangles with the further forces carry the exact load of the bilinear surface, whose volume is the wall's.
    #[test]
    fn a_bent_face_carries_the_load_of_the_wall() {
        let p = 2.0;
        let mut f = bend_force(p, &BENT);
        for nodes in [[0, 1, 2], [0, 2, 3]] {
            let share = pressure_force(p, &nodes.map(|n| BENT[n]));
            nodes.iter().for_each(|&n| f[n] += share);
        }
        for (f, wall) in f.iter().zip(quad::pressure_force(p, &BENT)) {
            assert!((*f - wall).norm() < 1e-15, "{f:?} {wall:?}");
        }
        assert!(bend_force(p, &BENT)[1].norm() > 0.1, "it is bent");
        let e = tangent_error(BENT, |x| bend_force(p, x), &bend_tangent(p, &BENT));
        assert!(e < 1e-8, "{e}");
    }

    #[test]
    fn pressure_on_a_closed_surface_sums_to_zero() {
        let p = [[0.0; 3], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [0.3, 0.2, 0.9]].map(Vec3::from);
        let mut sum = Vec3::zeros();
        for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
            let f = pressure_force(5.0, &[p[a], p[b], p[c]]);
            sum += f * 3.0;
        }
        assert!(sum.norm() < 1e-15);
    }
}
