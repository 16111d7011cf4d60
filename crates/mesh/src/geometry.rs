//! Vectors, and what triangles and quadrilaterals look like.
//!
//! Positions are stored and sent as [`Point`]s; a calculation gathers the points that it needs by [`at`] and continues
//! with vectors.

/// A position as it is stored and sent: x, y, z, m.
pub type Point = [f64; 3];

/// A vector to calculate with.
pub type Vec3 = nalgebra::Vector3<f64>;

/// A matrix of three rows and columns to calculate with.
pub type Mat3 = nalgebra::Matrix3<f64>;

/// Position of node `node` of `coords`, shape `[nodes]`, m.
#[inline(always)]
pub fn at(coords: &[Point], node: u32) -> Vec3 {
    Vec3::from(coords[node as usize])
}

/// Corners of a face, a triangle's without its repeated one.
#[inline(always)]
pub fn distinct(face: &[u32; 4]) -> &[u32] {
    if face[2] == face[3] { &face[..3] } else { face }
}

/// Area vector of a triangle, m2: $`\tfrac12 (b - a) \times (c - a)`$, along its normal by the right-hand rule.
#[inline(always)]
pub fn triangle_area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)) * 0.5
}

/// Area vector of a quadrilateral, m2: $`\tfrac12 (c - a) \times (d - b)`$, however it is bent or cut into triangles.
/// A triangle repeats its last corner.
#[inline(always)]
pub fn quad_area_vector([a, b, c, d]: [Vec3; 4]) -> Vec3 {
    (c - a).cross(&(d - b)) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_vectors_of_known_shapes() {
        let [a, b, c, d] =
            [[1.0, 1.0, 5.0], [3.0, 1.0, 5.0], [3.0, 2.0, 5.0], [1.0, 2.0, 5.0]].map(Vec3::from);
        assert_eq!(triangle_area_vector([a, b, c]), Vec3::new(0.0, 0.0, 1.0));
        assert_eq!(quad_area_vector([a, b, c, d]), Vec3::new(0.0, 0.0, 2.0));
        assert_eq!(quad_area_vector([a, b, c, c]), triangle_area_vector([a, b, c]));
        // Bent: the sum of its two triangles, whichever diagonal cuts it.
        let d = d + Vec3::new(0.3, -0.2, 0.7);
        for cut in [[[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]] {
            let sum: Vec3 = cut.into_iter().map(triangle_area_vector).sum();
            assert!((sum - quad_area_vector([a, b, c, d])).norm() < 1e-15);
        }
    }
}
