//! How far cells are from the canopy: the pseudo-solid is stiff around it.

use mesh::{FlowGrid, Vec3};

use crate::element::{cross, dot, sub};

/// Distance of each of `cells` (centres, in the start grid) from the nearest canopy node, plus
/// a third of a canopy face's mean width, in shares of the canopy's radius; counted up
/// to that radius. All ones without a canopy.
pub fn depths<'a>(grid: &FlowGrid, cells: impl Iterator<Item = &'a [u32; 8]>) -> Vec<f32> {
    let canopy: Vec<Vec3> = grid.canopy_nodes.iter().map(|&a| grid.coords[a as usize]).collect();
    let area: f64 = grid.canopy_faces.iter().map(|f| area(&f.map(|a| grid.coords[a as usize]))).sum();
    let nearest = Nearest::new(&canopy);
    let radius = ball(&canopy).1;
    if !(radius > 0.0 && area > 0.0) {
        return cells.map(|_| 1.0).collect();
    }
    let floor = (area / grid.canopy_faces.len() as f64).sqrt() / 3.0;
    cells
        .map(|cell| {
            let mut centre = [0.0; 3];
            for &a in cell {
                (0..3).for_each(|i| centre[i] += grid.coords[a as usize][i] / 8.0);
            }
            ((nearest.distance(&centre, radius) + floor) / radius) as f32
        })
        .collect()
}

fn area(p: &[Vec3; 4]) -> f64 {
    let n = cross(sub(p[2], p[0]), sub(p[3], p[1]));
    0.5 * dot(n, n).sqrt()
}

/// Mean of some points and the largest distance from it.
fn ball(points: &[Vec3]) -> (Vec3, f64) {
    let n = points.len().max(1) as f64;
    let mut centre = [0.0; 3];
    points.iter().for_each(|p| (0..3).for_each(|i| centre[i] += p[i] / n));
    (centre, points.iter().map(|p| length(p, &centre)).fold(0.0, f64::max))
}

fn length(a: &Vec3, b: &Vec3) -> f64 {
    let d = sub(*a, *b);
    dot(d, d).sqrt()
}

/// Points in groups of neighbours (as their order has them), each in a ball.
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
            best = best.min(length(p, centre) + radius);
        }
        for (centre, radius, points) in &self.groups {
            if length(p, centre) - radius < best {
                best = points.iter().map(|q| length(p, q)).fold(best, f64::min);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_of_all_and_capped() {
        let grid = crate::sample::plate_in_box(8, 0.1, 0.8, true);
        let depths = depths(&grid, grid.cells.iter());
        let canopy: Vec<Vec3> = grid.canopy_nodes.iter().map(|&a| grid.coords[a as usize]).collect();
        let radius = 0.5f64.sqrt();
        let floor = (1.0 / grid.canopy_faces.len() as f64).sqrt() / 3.0;
        let mut capped = 0;
        for (cell, depth) in grid.cells.iter().zip(depths) {
            let at = |i: usize| cell.iter().map(|&a| grid.coords[a as usize][i]).sum::<f64>() / 8.0;
            let p = [at(0), at(1), at(2)];
            let d = canopy.iter().map(|q| length(&p, q)).fold(radius, f64::min);
            capped += usize::from(d == radius);
            assert!((f64::from(depth) * radius - d - floor).abs() < 1e-6);
        }
        assert!(capped > 0 && capped < grid.cells.len() / 2);
    }
}
