//! Areas of the openings of a canopy.

use mesh::Point;
use mesh::geometry::{Vec3, at};

/// Area vector of a closed polygon, m2: half the sum of the cross products of consecutive points. Its norm is the
/// area of a plane polygon, and the maximum projected area of a non-planar one.
pub(super) fn area_vector(points: &[Point], row: &[u32]) -> Vec3 {
    // Relative to the first point, to avoid cancellation far from the origin.
    let Some(origin) = row.first().map(|&n| at(points, n)) else { return Vec3::zeros() };
    let from = |n: u32| at(points, n) - origin;
    let pairs = row.iter().zip(row.iter().cycle().skip(1));
    pairs.map(|(&a, &b)| from(a).cross(&from(b)) * 0.5).sum()
}

/// Norm of [`area_vector`], m2.
pub(super) fn area(points: &[Point], row: &[u32]) -> f64 {
    area_vector(points, row).norm()
}

/// The skirt, which is the opening with the longest boundary, and the vents, which are the others.
pub(super) fn skirt_and_vents<'a>(
    points: &[Point],
    loops: &'a [Vec<u32>],
) -> Option<(&'a [u32], Vec<&'a [u32]>)> {
    let skirt =
        (0..loops.len()).max_by(|&a, &b| length(points, &loops[a]).total_cmp(&length(points, &loops[b])))?;
    let vents = loops.iter().enumerate().filter(|(i, _)| *i != skirt).map(|(_, l)| &l[..]).collect();
    Some((&loops[skirt], vents))
}

/// Length of a closed polygon, m.
fn length(points: &[Point], row: &[u32]) -> f64 {
    let pairs = row.iter().zip(row.iter().cycle().skip(1));
    pairs.map(|(&a, &b)| (at(points, b) - at(points, a)).norm()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_of_regular_polygon_is_exact_at_any_position() {
        // n-gon of radius 2 in a plane tilted by 0.7, far away: n/2 r^2 sin(2 pi / n).
        let n = 9;
        let (s, c) = 0.7f64.sin_cos();
        let points: Vec<Point> = (0..n)
            .map(|i| {
                let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
                [2.0 * x + 900.0, 2.0 * y * c - 70.0, 2.0 * y * s + 33.0]
            })
            .collect();
        let row: Vec<u32> = (0..n as u32).collect();
        let exact = 0.5 * f64::from(n) * 4.0 * (std::f64::consts::TAU / f64::from(n)).sin();
        assert!((area(&points, &row) - exact).abs() < 1e-10);
        assert!((area_vector(&points, &row)[2] - exact * c).abs() < 1e-10);
        let small = vec![0, 1, 2];
        let loops = [small, row];
        let (skirt, vents) = skirt_and_vents(&points, &loops).unwrap();
        assert_eq!((skirt.len(), vents.len()), (9, 1));
    }
}
