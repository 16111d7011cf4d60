//! Velocities that vortex rings induce.

use std::collections::HashMap;
use std::f64::consts::PI;

use mesh::lanes::{LANES, Lanes, lanes};
use nalgebra::{SimdComplexField, SimdPartialOrd, SimdValue, Vector3};

use crate::geometry::Vec3;

/// Rings along outlines that share edges. The velocity of an edge is computed once, for both of its rings.
pub(super) struct VortexRings {
    /// Ends of the edges, m; those that fill the last lanes up have no length.
    edges: Vec<[Vector3<Lanes>; 2]>,
    /// Of each ring: its edges, and 1 along them or -1 against them.
    rings: Vec<Vec<(u32, f64)>>,
}

impl VortexRings {
    /// Along these `outlines` of oriented edges between nodes at `positions`.
    pub fn new(positions: &[Vec3], outlines: &[Vec<[u32; 2]>]) -> Self {
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut ends = Vec::new();
        let mut ring = |outline: &Vec<[u32; 2]>| -> Vec<(u32, f64)> {
            let place = |&[a, b]: &[u32; 2]| {
                let key = [a.min(b), a.max(b)];
                let edge = *known.entry(key).or_insert_with(|| {
                    ends.push(key);
                    ends.len() as u32 - 1
                });
                (edge, if a < b { 1.0 } else { -1.0 })
            };
            outline.iter().map(place).collect()
        };
        let rings = outlines.iter().map(&mut ring).collect();
        let edges = (0..ends.len().div_ceil(LANES)).map(|group| {
            let last = ends.len() - 1;
            let end = |side: usize, lane: usize| {
                let edge = (LANES * group + lane).min(last);
                // Both ends in one place: no length.
                let side = if LANES * group + lane > last { 0 } else { side };
                positions[ends[edge][side] as usize]
            };
            [0, 1].map(|side| Vector3::from_fn(|axis, _| lanes(|lane| end(side, lane)[axis])))
        });
        let edges = edges.collect();
        Self { edges, rings }
    }

    /// Velocity along `normal` at `p` of each ring of unit strength, 1/m.
    pub fn normal_velocities(&self, p: Vec3, normal: Vec3, velocities: &mut [f64]) {
        let [at, n] = [p, normal].map(|v| v.map(Lanes::splat));
        let mut of_edges = Vec::with_capacity(LANES * self.edges.len());
        for [a, b] in &self.edges {
            of_edges.extend(normal_velocity(at - a, at - b, n).into_arr());
        }
        for (ring, velocity) in self.rings.iter().zip(velocities) {
            *velocity = ring.iter().map(|&(edge, sign)| sign * of_edges[edge as usize]).sum();
        }
    }
}

/// Velocity along `n` of straight vortices of unit strength, at the distances `r1` and `r2` (m) from their ends
/// (Biot-Savart; Katz and Plotkin, section 10.4.5):
/// $`n\cdot(r_1\times r_2)\,(r_0\cdot r_1/|r_1| - r_0\cdot r_2/|r_2|)/(4\pi\,|r_1\times r_2|^2)`$, 1/m.
#[inline(always)]
fn normal_velocity(r1: Vector3<Lanes>, r2: Vector3<Lanes>, n: Vector3<Lanes>) -> Lanes {
    let (r0, cross) = (r1 - r2, r1.cross(&r2));
    let square = cross.dot(&cross);
    let (l1, l2) = (r1.dot(&r1).simd_sqrt(), r2.dot(&r2).simd_sqrt());
    let along = r0.dot(&r1) * l2 - r0.dot(&r2) * l1;
    // No induced velocity on the line of the segment itself.
    let apart = square.simd_gt(Lanes::splat(1e-12) * r0.dot(&r0) * l1 * l2);
    let velocity = n.dot(&cross) * along / (Lanes::splat(4.0 * PI) * square * l1 * l2);
    velocity.select(apart, Lanes::splat(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_at_the_centre_of_a_square_ring_is_exact() {
        // Centre of a square ring with side 1: w = 2 sqrt(2) / pi. Its neighbour, in the other sense, shares an edge.
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0));
        let rings = VortexRings::new(
            &corners,
            &[vec![[0, 1], [1, 2], [2, 3], [3, 0]], vec![[1, 2], [2, 5], [5, 4], [4, 1]]],
        );
        assert_eq!(rings.edges.len(), 2);
        let exact = 2.0 * 2f64.sqrt() / PI;
        let mut found = [0.0; 2];
        rings.normal_velocities(Vec3::new(0.5, 0.5, 0.0), Vec3::z(), &mut found);
        assert!((found[0] - exact).abs() < 1e-12, "{found:?}");
        rings.normal_velocities(Vec3::new(1.5, 0.5, 0.0), Vec3::z(), &mut found);
        assert!((found[1] + exact).abs() < 1e-12, "{found:?}");
        // Across the plane nothing flows in it; on an edge and at its ends that edge induces nothing.
        rings.normal_velocities(Vec3::new(0.5, 0.5, 0.0), Vec3::x(), &mut found);
        assert!(found.iter().all(|v| v.abs() < 1e-15), "{found:?}");
        rings.normal_velocities(Vec3::new(1.0, 1.0, 0.0), Vec3::z(), &mut found);
        assert!(found.iter().all(|v| v.is_finite()), "{found:?}");
    }
}
