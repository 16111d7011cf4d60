//! One face: triangles about its middle, the same seen from both sides.
//!
//! A quadrilateral with corners $`p_0..p_3`$ need not be plane. It stands for the
//! four triangles $`(p_k, p_{k+1}, m)`$ about the mean $`m`$ of its corners, so two
//! cells that share it agree on its surface and every cell is closed exactly.
//! A triangle repeats its last corner.

use mesh::lanes::Real;
use nalgebra::Vector3;

use super::vec3::Vec3;

/// Area vector and centre of a face, or of each face of a batch, at one time level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceShape<T: Real = f64> {
    /// Area vector, m2: exactly that of the boundary polygon.
    pub area: Vector3<T>,
    /// Mean of the corners, m: the apex that all its triangles share.
    pub middle: Vector3<T>,
    /// Centre of area, m.
    pub centre: Vector3<T>,
}

/// Area vector, middle and centre of a face.
#[inline]
pub fn shape(p: &[Vec3; 4], triangle: bool) -> FaceShape {
    if triangle {
        let middle = (p[0] + p[1] + p[2]) * (1.0 / 3.0);
        let area = (p[1] - p[0]).cross(&(p[2] - p[0])) * 0.5;
        return FaceShape { area, middle, centre: middle };
    }
    shape_of_quadrilateral(p)
}

/// The same of quadrilaterals.
#[inline(always)]
pub fn shape_of_quadrilateral<T: Real>(p: &[Vector3<T>; 4]) -> FaceShape<T> {
    let number = T::splat;
    let middle = mean(p);
    let area = (p[2] - p[0]).cross(&(p[3] - p[1])) * number(0.5);
    // Triangles weighted by their area along the mean normal.
    let mut moment = Vector3::repeat(number(0.0));
    let mut weight = number(0.0);
    for k in 0..4 {
        let (a, b) = (p[k] - middle, p[(k + 1) % 4] - middle);
        let w = a.cross(&b).dot(&area);
        weight += w;
        moment += (a + b) * (w / number(3.0));
    }
    let has_area = weight.simd_gt(number(0.0));
    let share = number(1.0) / weight;
    let shift = moment.map(|m| (m * share).select(has_area, number(0.0)));
    FaceShape { area, middle, centre: middle + shift }
}

/// Mean of four corners.
#[inline(always)]
pub(crate) fn mean<T: Real>(p: &[Vector3<T>; 4]) -> Vector3<T> {
    ((p[0] + p[1]) + (p[2] + p[3])) * T::splat(0.25)
}

/// Volume that a face sweeps along its area vector while its corners move on
/// straight lines from `old` to `new`, m3.
///
/// The velocity is linear on each triangle and its area vector quadratic in
/// time, so Simpson's rule is exact: the swept volumes of a cell's faces sum to
/// the change of its volume to round-off (the geometric conservation law).
#[inline]
pub fn swept_volume(old: &[Vec3; 4], new: &[Vec3; 4], triangle: bool) -> f64 {
    if triangle {
        let (o, n) = ([old[0], old[1], old[2]], [new[0], new[1], new[2]]);
        return swept_by_triangle(&o, &n);
    }
    swept_by_quadrilateral(old, new)
}

/// The same of quadrilaterals.
#[inline(always)]
pub fn swept_by_quadrilateral<T: Real>(old: &[Vector3<T>; 4], new: &[Vector3<T>; 4]) -> T {
    let (om, nm) = (mean(old), mean(new));
    let by = |k: usize| {
        let l = (k + 1) % 4;
        swept_by_triangle(&[old[k], old[l], om], &[new[k], new[l], nm])
    };
    by(0) + by(1) + by(2) + by(3)
}

#[inline(always)]
fn swept_by_triangle<T: Real>(old: &[Vector3<T>; 3], new: &[Vector3<T>; 3]) -> T {
    let (a0, b0) = (old[1] - old[0], old[2] - old[0]);
    let (a1, b1) = (new[1] - new[0], new[2] - new[0]);
    // Twice the sum of the area vectors at the ends, and eight times the middle one.
    let ends = a0.cross(&b0) + a1.cross(&b1);
    let half = (a0 + a1).cross(&(b0 + b1));
    let path = (new[0] - old[0]) + (new[1] - old[1]) + (new[2] - old[2]);
    // (1/3) path . (A0 + 4 Ah + A1) / 6 with A = cross / 2, Ah = half / 8.
    path.dot(&(ends + half)) / T::splat(36.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [Vec3; 4] = [
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(2.0, 0.0, 0.0),
        Vec3::new(2.0, 1.0, 0.0),
        Vec3::new(0.0, 1.0, 0.0),
    ];

    #[test]
    fn plane_rectangle() {
        let f = shape(&SQUARE, false);
        assert_eq!(f.area, Vec3::new(0.0, 0.0, 2.0));
        assert_eq!(f.centre, Vec3::new(1.0, 0.5, 0.0));
    }

    #[test]
    fn centre_of_a_trapezium() {
        let p = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(Vec3::from);
        let f = shape(&p, false);
        // Closed form for parallel sides a = 3, b = 1, h = 1: y = h (a + 2 b) / (3 (a + b)).
        assert!((f.centre[1] - 5.0 / 12.0).abs() < 1e-15);
    }

    #[test]
    fn translation_sweeps_the_volume_of_a_prism() {
        let d = Vec3::new(0.3, -0.2, 0.7);
        let moved = SQUARE.map(|p| p + d);
        assert!((swept_volume(&SQUARE, &moved, false) - 2.0 * 0.7).abs() < 1e-15);
    }

    #[test]
    fn reversed_node_order_gives_the_same_face() {
        let p = [[0.0, 0.0, 0.1], [2.0, 0.2, -0.3], [2.1, 1.0, 0.4], [-0.1, 1.2, 0.0]].map(Vec3::from);
        let q = [[0.1, 0.0, 0.5], [2.2, 0.1, 0.3], [1.9, 1.1, 0.2], [0.1, 1.0, 0.4]].map(Vec3::from);
        let turn = |p: [Vec3; 4]| [p[0], p[3], p[2], p[1]];
        let (f, g) = (shape(&p, false), shape(&turn(p), false));
        for c in 0..3 {
            assert!((f.area[c] + g.area[c]).abs() < 1e-15);
            assert!((f.centre[c] - g.centre[c]).abs() < 1e-15);
        }
        let forward = swept_volume(&p, &q, false);
        assert!((forward + swept_volume(&turn(p), &turn(q), false)).abs() < 1e-15);
    }
}
