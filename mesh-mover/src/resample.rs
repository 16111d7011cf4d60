//! The shape of a canopy on another mesh of the same canopy.

use mesh::geometry::{Vec3, at};
use mesh::{Point, StructureMesh};

/// Positions of the canopy nodes of `to` on the shape that `positions` define for the canopy of `from`: linear within
/// the triangles of each face, matched by panel and unstressed position. `None` where a node of `to` has no face on
/// its panel in `from`.
pub fn resample(from: &StructureMesh, positions: &[Point], to: &StructureMesh) -> Option<Vec<Point>> {
    let mut found: Vec<Option<Point>> = vec![None; to.n_canopy];
    for (face, panel) in to.faces.iter().zip(&to.face_panel) {
        for &a in face {
            if found[a as usize].is_some() {
                continue;
            }
            let p = at(&to.coords, a);
            let faces = from.faces.iter().zip(&from.face_panel).filter(|(_, q)| *q == panel);
            let triangles = faces.flat_map(|([a, b, c, d], _)| [[*a, *b, *c], [*a, *c, *d]]);
            // The triangle with the largest smallest coordinate: on seams and with round-off none may have all positive.
            let mut best: Option<(f64, Vec3)> = None;
            for t in triangles.filter(|t| t[1] != t[2]) {
                let w = shares(p, t.map(|n| at(&from.coords, n)));
                let depth = w.into_iter().fold(f64::INFINITY, f64::min);
                if best.is_none_or(|(d, _)| depth > d) {
                    let x = w.into_iter().zip(t).fold(Vec3::zeros(), |x, (w, n)| x + at(positions, n) * w);
                    best = Some((depth, x));
                }
            }
            found[a as usize] = best.filter(|(depth, _)| *depth > -0.05).map(|(_, x)| x.into());
        }
    }
    found.into_iter().collect()
}

/// Barycentric coordinates of the projection of `p` on a triangle.
fn shares(p: Vec3, t: [Vec3; 3]) -> [f64; 3] {
    let n = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let area = n.dot(&n);
    let part = |a: Vec3, b: Vec3| n.dot(&(a - p).cross(&(b - p))) / area;
    [part(t[1], t[2]), part(t[2], t[0]), part(t[0], t[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example_grid::{plate_in_box, plate_structure};

    #[test]
    fn linear_map_is_reproduced_and_a_missing_panel_is_detected() {
        let of = |n| plate_structure(&plate_in_box(n, 0.0, 1.0, true));
        let (from, mut to) = (of(8), of(12));
        let map = |p: &Point| [p[0] - 0.5 * p[1], 2.0 * p[1] + 0.1, 0.3 * p[0] + p[1]];
        let positions: Vec<Point> = from.coords.iter().map(map).collect();
        let found = resample(&from, &positions, &to).unwrap();
        // Plates of 8 and 12 cells a side are both 1 wide.
        for (x, p) in found.iter().zip(&to.coords) {
            (0..3).for_each(|i| assert!((x[i] - map(p)[i]).abs() < 1e-12, "{x:?} {p:?}"));
        }
        to.face_panel.fill(7);
        assert!(resample(&from, &positions, &to).is_none());
    }
}
