//! Distance of cells from the canopy: the pseudo-solid is stiffer near it.

use mesh::FlowGrid;
use mesh::geometry::{Vec3, at, quad_area_vector};

/// Distance of each of `cells` (centres, in the start grid) from the nearest canopy node, plus a third of a canopy
/// face's mean width, relative to the canopy's radius and limited to that radius. All ones without a canopy.
pub fn canopy_distances<'a>(grid: &FlowGrid, cells: impl Iterator<Item = &'a [u32; 8]>) -> Vec<f32> {
    let canopy: Vec<Vec3> = grid.canopy_nodes.iter().map(|&a| at(&grid.coords, a)).collect();
    let area = |f: &[u32; 4]| quad_area_vector(f.map(|a| at(&grid.coords, a))).norm();
    let area: f64 = grid.canopy_faces.iter().map(area).sum();
    let nearest = Nearest::new(&canopy);
    let radius = ball(&canopy).1;
    if !(radius > 0.0 && area > 0.0) {
        return cells.map(|_| 1.0).collect();
    }
    let floor = (area / grid.canopy_faces.len() as f64).sqrt() / 3.0;
    cells
        .map(|cell| {
            let centre = cell.iter().map(|&a| at(&grid.coords, a) / 8.0).fold(Vec3::zeros(), |s, x| s + x);
            ((nearest.distance(&centre, radius) + floor) / radius) as f32
        })
        .collect()
}

/// Mean of some points and the largest distance from it.
fn ball(points: &[Vec3]) -> (Vec3, f64) {
    let n = points.len().max(1) as f64;
    let centre = points.iter().fold(Vec3::zeros(), |s, p| s + p / n);
    (centre, points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max))
}

/// Points in groups of neighbours (in their order), each in a bounding sphere.
struct Nearest<'a> {
    groups: Vec<(Vec3, f64, &'a [Vec3])>,
}

impl<'a> Nearest<'a> {
    fn new(points: &'a [Vec3]) -> Self {
        let groups = points.chunks(32).map(|g| {
            let (centre, radius) = ball(g);
            (centre, radius, g)
        });
        Self { groups: groups.collect() }
    }

    /// Distance of `p` from the nearest point, at most `most`.
    fn distance(&self, p: &Vec3, most: f64) -> f64 {
        let mut best = most;
        for (centre, radius, _) in &self.groups {
            best = best.min((p - centre).norm() + radius);
        }
        for (centre, radius, points) in &self.groups {
            if (p - centre).norm() - radius < best {
                best = points.iter().map(|q| (p - q).norm()).fold(best, f64::min);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_is_to_the_nearest_node_and_limited() {
        let grid = crate::example_grid::plate_in_box(8, 0.1, 0.8, true);
        let canopy_distances = canopy_distances(&grid, grid.cells.iter());
        let canopy: Vec<Vec3> = grid.canopy_nodes.iter().map(|&a| at(&grid.coords, a)).collect();
        let radius = 0.5f64.sqrt();
        let floor = (1.0 / grid.canopy_faces.len() as f64).sqrt() / 3.0;
        let mut capped = 0;
        for (cell, depth) in grid.cells.iter().zip(canopy_distances) {
            let p = cell.iter().map(|&a| at(&grid.coords, a)).sum::<Vec3>() / 8.0;
            let d = canopy.iter().map(|q| (p - q).norm()).fold(radius, f64::min);
            capped += usize::from(d == radius);
            assert!((f64::from(depth) * radius - d - floor).abs() < 1e-6);
        }
        assert!(capped > 0 && capped < grid.cells.len() / 2);
    }
}
