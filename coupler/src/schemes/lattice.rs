//! The canopy as a lattice of vortex rings: which normal velocities unit jumps of the potential
//! over its faces induce.

use mesh::Vec3;
use nalgebra::DMatrix;

use super::groups::Groups;

/// A surface in potential flow.
pub(super) struct Lattice {
    /// Area vectors of the faces, m2.
    pub areas: Vec<Vec3>,
    /// Their directions.
    pub normals: Vec<Vec3>,
    /// Faces that share a ring: each has its own where they are few.
    pub groups: Groups,
    /// Normal velocity at group i per strength of the ring around group j, 1/m: with the jump of the
    /// potential $\Gamma$, $A\Gamma$ is the velocity of the surface.
    pub influence: DMatrix<f64>,
}

impl Lattice {
    /// With `most` rings at most; `None` where the faces do not go into so few groups.
    ///
    /// The ring of a group runs along its outline, and its velocity is the mean of those at its faces by
    /// area. (At the centroid alone it was worse for all motions, and much worse where groups are not regular.)
    pub fn new(positions: &[Vec3], faces: &[[u32; 4]], most: usize) -> Option<Self> {
        let corners: Vec<[Vec3; 4]> = faces.iter().map(|f| f.map(|node| positions[node as usize])).collect();
        let areas: Vec<Vec3> = corners.iter().map(area_vector).collect();
        let unit = |a: &Vec3| a.map(|x| x / dot(*a, *a).sqrt().max(f64::MIN_POSITIVE));
        let normals: Vec<Vec3> = areas.iter().map(unit).collect();
        let groups = Groups::new(positions, faces, &areas, &normals, most)?;
        let n = groups.len();
        let ends = |edge: &[u32; 2]| edge.map(|node| positions[node as usize]);
        let rings: Vec<Vec<[Vec3; 2]>> =
            groups.outlines.iter().map(|outline| outline.iter().map(ends).collect()).collect();
        let mut influence = DMatrix::zeros(n, n);
        for (f, &g) in groups.of.iter().enumerate() {
            let at = centre(&corners[f]);
            for (j, edges) in rings.iter().enumerate() {
                influence[(g as usize, j)] += groups.share[f] * dot(normals[f], ring(edges, at));
            }
        }
        Some(Self { areas, normals, groups, influence })
    }
}

/// Corners of a face, a triangle's without its repeated one.
pub(super) fn distinct(face: &[u32; 4]) -> &[u32] {
    if face[2] == face[3] { &face[..3] } else { face }
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn area_vector(corners: &[Vec3; 4]) -> Vec3 {
    cross(minus(corners[2], corners[0]), minus(corners[3], corners[1])).map(|a| 0.5 * a)
}

fn centre(corners: &[Vec3; 4]) -> Vec3 {
    let used = if corners[2] == corners[3] { 3 } else { 4 };
    std::array::from_fn(|i| corners[..used].iter().map(|c| c[i]).sum::<f64>() / used as f64)
}

/// Velocity at `p` of a vortex ring of unit strength along these edges
/// (Biot-Savart; straight segments, Katz and Plotkin section 10.4.5).
fn ring(edges: &[[Vec3; 2]], p: Vec3) -> Vec3 {
    let mut velocity = [0.0; 3];
    for &[a, b] in edges {
        let (r1, r2, r0) = (minus(p, a), minus(p, b), minus(b, a));
        let normal = cross(r1, r2);
        let square = dot(normal, normal);
        let (l1, l2) = (dot(r1, r1).sqrt(), dot(r2, r2).sqrt());
        // On the segment's own line it induces nothing.
        if square <= 1e-12 * dot(r0, r0) * l1 * l2 || l1 == 0.0 || l2 == 0.0 {
            continue;
        }
        let along = dot(r0, r1) / l1 - dot(r0, r2) / l2;
        let factor = along / (4.0 * std::f64::consts::PI * square);
        (0..3).for_each(|i| velocity[i] += factor * normal[i]);
    }
    velocity
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_of_unit_strength() {
        // Middle of a square ring with half side a: w = sqrt(2) / (pi a)... for a = 1/2: 2 sqrt(2) / pi.
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let edges: Vec<[Vec3; 2]> = (0..4).map(|k| [corners[k], corners[(k + 1) % 4]]).collect();
        let v = ring(&edges, [0.5, 0.5, 0.0]);
        assert!((v[2] - 2.0 * 2f64.sqrt() / std::f64::consts::PI).abs() < 1e-12, "{v:?}");
    }
}
