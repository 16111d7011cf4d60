//! Loads on the deformed triangle: follower pressure and traction.

use crate::vec3::{Mat3, Vec3, cross, dot, norm, scale, sub};

/// Area vector of a triangle (m2): its normal by the right-hand rule times its area.
#[inline(always)]
pub fn area_vector(x: &[Vec3; 3]) -> Vec3 {
    scale(0.5, cross(sub(x[1], x[0]), sub(x[2], x[0])))
}

/// Force on each node (N) of the uniform pressure jump `p` (Pa) along the normal.
#[inline(always)]
pub fn pressure_force(p: f64, x: &[Vec3; 3]) -> Vec3 {
    scale(p / 3.0, area_vector(x))
}

/// Derivative of [`pressure_force`] by each node: block `[m]` belongs to column
/// node `m` in all three rows. Nonsymmetric over one triangle; over a sheet only
/// the terms of the rim remain so.
///
/// The area vector is $a = \tfrac12 (x_1-x_0)\times(x_2-x_0)$, so
/// $\partial a/\partial x_m = \tfrac12 [e_m]_\times$ with the opposite edge $e_m$.
#[inline(always)]
pub fn pressure_tangent(p: f64, x: &[Vec3; 3]) -> [Mat3; 3] {
    [0, 1, 2].map(|m| skew(scale(p / 6.0, opposite_edge(x, m))))
}

/// Force on each node (N) of the traction `t` (Pa) on the deformed area. Its
/// direction is given ("dead"); its amount follows the area.
#[inline(always)]
pub fn traction_force(t: Vec3, x: &[Vec3; 3]) -> Vec3 {
    scale(norm(area_vector(x)) / 3.0, t)
}

/// Derivative of [`traction_force`] by each node, as in [`pressure_tangent`].
#[inline(always)]
pub fn traction_tangent(t: Vec3, x: &[Vec3; 3]) -> [Mat3; 3] {
    let a = area_vector(x);
    let size = dot(a, a).sqrt();
    // A collapsed triangle has no normal; its force vanishes too.
    let n = if size > 0.0 { scale(1.0 / size, a) } else { [0.0; 3] };
    [0, 1, 2].map(|m| {
        let g = scale(1.0 / 6.0, cross(n, opposite_edge(x, m)));
        t.map(|ti| scale(ti, g))
    })
}

#[inline(always)]
fn opposite_edge(x: &[Vec3; 3], m: usize) -> Vec3 {
    sub(x[(m + 2) % 3], x[(m + 1) % 3])
}

/// The matrix of `v x`.
#[inline(always)]
fn skew(v: Vec3) -> Mat3 {
    [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::tangent_error;

    const X: [Vec3; 3] = [[0.1, -0.2, 0.3], [1.2, 0.1, 0.2], [0.3, 0.9, 0.6]];

    #[test]
    fn tangents_are_the_derivatives_of_the_forces() {
        let t = [0.4, -0.7, 1.1];
        let e = tangent_error(X, |x| [pressure_force(2.0, x); 3], &[pressure_tangent(2.0, &X); 3]);
        assert!(e < 1e-8, "pressure {e}");
        let e = tangent_error(X, |x| [traction_force(t, x); 3], &[traction_tangent(t, &X); 3]);
        assert!(e < 1e-8, "traction {e}");
    }

    #[test]
    fn pressure_on_a_closed_surface_sums_to_zero() {
        let p = [[0.0; 3], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [0.3, 0.2, 0.9]];
        let mut sum = [0.0; 3];
        for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
            let f = pressure_force(5.0, &[p[a], p[b], p[c]]);
            (0..3).for_each(|i| sum[i] += 3.0 * f[i]);
        }
        assert!(norm(sum) < 1e-15);
    }
}
