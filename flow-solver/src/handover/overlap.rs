//! Exact overlap of the cells of a fitted grid with the boxes of a rectilinear one.
//!
//! A cell is the closed surface of the triangles of its faces; a quadrilateral stands for four triangles about the mean of its
//! corners, as in [`crate::geometry`], so that cells fill space without gaps and have the volumes of the flow-solver. Planes across the axes
//! divide it: a part is closed by triangles in the plane, from one point there to each edge of the cut. Their orientation makes this right for
//! cuts of any shape, and the parts on both sides share them, so that volumes add up to round-off.

use mesh::{HEX_FACES, clean_face};
use nalgebra::Vector3;

type Point = Vector3<f64>;
/// Corners in the cycle that is right-handed about the normal out of the cell, m.
type Triangle = [Point; 3];

/// Planes across x, y and z, ascending, m. They divide space into boxes: number `i` along an axis lies between plane `i - 1` and plane `i`, number 0 below
/// the first plane, the last number above the last one.
pub type Planes = [Vec<f64>; 3];

/// Volume within a closed surface, m3.
fn volume(surface: &[Triangle]) -> f64 {
    let Some([origin, ..]) = surface.first() else { return 0.0 };
    let signed = |[a, b, c]: &Triangle| (a - origin).cross(&(b - origin)).dot(&(c - origin));
    surface.iter().map(signed).sum::<f64>() / 6.0
}

/// Calls `visit` with the box and the volume (m3) of the parts of a cell with these `corners` (m, in VTK order, repeated in degenerate cells). The volumes
/// add up to that of the cell; where a cell is inverted they are negative.
pub fn of_cell(corners: &[Point; 8], planes: &Planes, visit: &mut dyn FnMut([usize; 3], f64)) {
    divide(&surface(corners), 0, [0; 3], planes, visit);
}

/// Volume of a cell with these `corners`, m3.
pub fn cell_volume(corners: &[Point; 8]) -> f64 {
    volume(&surface(corners))
}

/// Triangles of the faces of a cell.
fn surface(corners: &[Point; 8]) -> Vec<Triangle> {
    // Corners of degenerate cells share a node: they count as the first of them.
    let first = |i: usize| (0..=i).find(|&j| corners[j] == corners[i]).unwrap_or(i) as u32;
    let mut triangles = Vec::with_capacity(24);
    for face in HEX_FACES {
        let Some(face) = clean_face(face.map(first)) else { continue };
        let p = face.map(|i| corners[i as usize]);
        if face[2] == face[3] {
            triangles.push([p[0], p[1], p[2]]);
        } else {
            let centre = p.iter().sum::<Point>() * 0.25;
            triangles.extend((0..4).map(|k| [p[k], p[(k + 1) % 4], centre]));
        }
    }
    triangles
}

/// Least and largest coordinate of a surface along `axis`, m.
fn extent(surface: &[Triangle], axis: usize) -> [f64; 2] {
    let along = surface.iter().flatten().map(|p| p[axis]);
    along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// Divides the volume within a closed surface by the planes across `axis` and those after it; `at`: its box along the axes before. Visits boxes and volumes.
fn divide(
    surface: &[Triangle],
    axis: usize,
    mut at: [usize; 3],
    planes: &Planes,
    visit: &mut dyn FnMut([usize; 3], f64),
) {
    if surface.is_empty() {
        return;
    }
    if axis == 3 {
        return visit(at, volume(surface));
    }
    let [low, high] = extent(surface, axis);
    let between = planes[axis].partition_point(|p| *p <= low)..planes[axis].partition_point(|p| *p < high);
    if between.is_empty() {
        at[axis] = between.start;
        return divide(surface, axis + 1, at, planes, visit);
    }
    for part in cut(surface, axis, planes[axis][between.start + between.len() / 2]) {
        divide(&part, axis, at, planes, visit);
    }
}

/// The closed surfaces of the parts below and above a plane across `axis`.
fn cut(surface: &[Triangle], axis: usize, plane: f64) -> [Vec<Triangle>; 2] {
    let mut parts = [Vec::with_capacity(surface.len()), Vec::with_capacity(surface.len())];
    let mut apex = None;
    for triangle in surface {
        let above = triangle.map(|x| x[axis] > plane);
        let count = above.iter().filter(|a| **a).count();
        if count % 3 == 0 {
            parts[count / 3].push(*triangle);
            continue;
        }
        // The corner that is alone on its side comes first; the cycle stays.
        let alone = (0..3).find(|&i| above[i] == (count == 1)).unwrap_or(0);
        let [a, b, c] = [0, 1, 2].map(|i| triangle[(alone + i) % 3]);
        let [ab, ac] = [crossing(a, b, axis, plane), crossing(a, c, axis, plane)];
        let [own, other] = if count == 1 { [1, 0] } else { [0, 1] };
        let apex = *apex.get_or_insert(ab);
        let mut add = |part: usize, triangle: Triangle| {
            let [a, b, c] = &triangle;
            // One that is collapsed encloses nothing.
            if a != b && b != c && c != a {
                parts[part].push(triangle);
            }
        };
        add(own, [a, ab, ac]);
        add(own, [ac, ab, apex]);
        add(other, [ab, b, c]);
        add(other, [ab, c, ac]);
        add(other, [ab, ac, apex]);
    }
    parts
}

/// Where an edge crosses a plane: the same point for both triangles at the edge.
fn crossing(a: Point, b: Point, axis: usize, plane: f64) -> Point {
    let [low, high] = if a[axis] <= b[axis] { [a, b] } else { [b, a] };
    let mut x = low + (high - low) * ((plane - low[axis]) / (high[axis] - low[axis]));
    // Exactly, so that no later cut finds it on the other side.
    x[axis] = plane;
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in -1..1 that are the same in every run.
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    fn planes() -> Planes {
        let spaced = |h: f64| (-6..=6).map(|i| h * f64::from(i)).collect();
        [spaced(0.21), spaced(0.17), spaced(0.4)]
    }

    fn point(next: &mut impl FnMut() -> f64) -> Point {
        Point::new(next(), next(), next())
    }

    /// The unit cube with corners moved by at most 0.2, and collapsed to a prism where asked.
    fn cell(next: &mut impl FnMut() -> f64, collapsed: bool) -> [Point; 8] {
        let at = |i: usize| [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| [x, y, i32::from(i > 3)])[i % 4];
        let mut corners = [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|i| Point::from(at(i).map(|x| f64::from(x) - 0.5)) + 0.2 * point(next));
        if collapsed {
            (corners[3], corners[7]) = (corners[2], corners[6]);
        }
        corners
    }

    /// Box of a point.
    fn box_of(x: &Point, planes: &Planes) -> [usize; 3] {
        [0, 1, 2].map(|d| planes[d].partition_point(|p| *p <= x[d]))
    }

    /// Surface of a tetrahedron, right-handed.
    fn tetrahedron([a, b, c, d]: [Point; 4]) -> Vec<Triangle> {
        let faces = vec![[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
        if volume(&faces) > 0.0 { faces } else { faces.into_iter().map(|[a, b, c]| [b, a, c]).collect() }
    }

    #[test]
    fn tetrahedron_within_a_box_stays_whole() {
        let corners = [[0.01, 0.02, 0.1], [0.2, 0.02, 0.1], [0.05, 0.15, 0.2], [0.1, 0.1, 0.3]];
        let t = tetrahedron(corners.map(Point::from));
        let mut found = Vec::new();
        divide(&t, 0, [0; 3], &planes(), &mut |at, part| found.push((at, part)));
        assert_eq!(found, [(box_of(&t[0][0], &planes()), volume(&t))]);
    }

    /// Volumes of the parts of random tetrahedra add up, and every part lies in its box.
    #[test]
    fn parts_of_tetrahedra_add_up() {
        let (mut next, planes) = (numbers(1), planes());
        for _ in 0..500 {
            let t = tetrahedron([0; 4].map(|_| point(&mut next)));
            let (mut sum, mut count) = (0.0, 0);
            divide(&t, 0, [0; 3], &planes, &mut |at, part| {
                (sum, count) = (sum + part, count + 1);
                assert!(part > -1e-15 && (0..3).all(|d| at[d] <= planes[d].len()));
            });
            let whole = volume(&t);
            assert!((sum - whole).abs() < 1e-13 && count > 1, "{sum} {whole}");
        }
    }

    /// A tetrahedron with corners at 0 and the unit vectors: the part below the plane x = h has the volume (1 - (1 - h)^3) / 6.
    #[test]
    fn parts_have_the_volumes_of_the_closed_form() {
        let t = tetrahedron([Point::zeros(), Point::x(), Point::y(), Point::z()]);
        let planes = [vec![0.1, 0.45, 0.8], Vec::new(), Vec::new()];
        let mut found = [0.0; 4];
        divide(&t, 0, [0; 3], &planes, &mut |at, part| found[at[0]] += part);
        let below = |h: f64| (1.0 - (1.0 - h).powi(3)) / 6.0;
        let ends = [0.0, 0.1, 0.45, 0.8, 1.0].map(below);
        for (i, part) in found.iter().enumerate() {
            assert!((part - (ends[i + 1] - ends[i])).abs() < 1e-15, "{i}: {part}");
        }
        // In two directions: the corner of the square 0.5 x 0.5 keeps 1/6 - 2 (1/2)^3 / 6.
        let planes = [vec![0.5], vec![0.5], Vec::new()];
        let mut corner = 0.0;
        divide(&t, 0, [0; 3], &planes, &mut |at, part| corner += if at == [0; 3] { part } else { 0.0 });
        assert!((corner - 0.125).abs() < 1e-15, "{corner}");
    }

    /// Overlaps of random cells, with warped faces and collapsed ones, add up to their volumes.
    #[test]
    fn overlaps_of_cells_add_up() {
        let (mut next, planes) = (numbers(2), planes());
        for trial in 0..200 {
            let corners = cell(&mut next, trial % 2 == 1);
            let mut sum = 0.0;
            of_cell(&corners, &planes, &mut |_, part| sum += part);
            let whole = cell_volume(&corners);
            assert!(whole > 0.0 && (sum / whole - 1.0).abs() < 1e-12, "{trial}: {sum} {whole}");
        }
        // In one box.
        let small = cell(&mut next, false).map(|x| 0.01 * x + Point::new(0.1, 0.08, 0.2));
        let mut found = Vec::new();
        of_cell(&small, &planes, &mut |at, part| found.push((at, part)));
        assert_eq!((found.len(), found[0].0), (1, box_of(&small[0], &planes)));
        assert!((found[0].1 / cell_volume(&small) - 1.0).abs() < 1e-12);
    }

    /// Two cells that share a warped face fill a box without gap: what they overlap of each box inside is its volume.
    #[test]
    fn neighbours_fill_boxes_without_gap() {
        let mut next = numbers(3);
        let far = |x: f64, y: f64, z: f64| Point::new(2.0 * x, y, z);
        let shared = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let shared = shared.map(|(y, z)| Point::new(0.6 * next(), y, z));
        let outer = |x: f64| [far(x, -1.0, -1.0), far(x, 1.0, -1.0), far(x, 1.0, 1.0), far(x, -1.0, 1.0)];
        let between = |[p, q]: [[Point; 4]; 2]| [p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]];
        let planes = [vec![-1.5, -0.5, 0.1, 0.7, 1.5], vec![-0.8, 0.3, 0.9], vec![-0.7, 0.0, 0.8]];
        let mut found = std::collections::HashMap::new();
        for corners in [between([outer(-1.0), shared]), between([shared, outer(1.0)])] {
            assert!(cell_volume(&corners) > 0.0);
            of_cell(&corners, &planes, &mut |at, part| *found.entry(at).or_insert(0.0) += part);
        }
        for (at, volume) in
            found.iter().filter(|(at, _)| (0..3).all(|d| (1..planes[d].len()).contains(&at[d])))
        {
            let side = |d: usize| planes[d][at[d]] - planes[d][at[d] - 1];
            let whole = side(0) * side(1) * side(2);
            assert!((volume / whole - 1.0).abs() < 1e-12, "{at:?}: {volume} {whole}");
        }
        assert!((found.values().sum::<f64>() - 16.0).abs() < 1e-12);
    }

    /// Moments: with many planes the sum over volumes times centres of boxes is the integral of a linear field.
    #[test]
    fn linear_field_is_integrated() {
        let mut next = numbers(4);
        let corners = cell(&mut next, false);
        let field = |x: &Point| 0.3 + x.dot(&Point::new(1.0, -2.0, 0.7));
        // Of the tetrahedra from one point to the surface: the mean of the corners.
        let origin = corners[0];
        let mut exact = 0.0;
        for [a, b, c] in surface(&corners) {
            let own = (a - origin).cross(&(b - origin)).dot(&(c - origin)) / 6.0;
            exact += own * [origin, a, b, c].iter().map(field).sum::<f64>() / 4.0;
        }
        let errors = [8, 16].map(|n| {
            let h = 2.0 / f64::from(n);
            let axis: Vec<f64> = (0..=n).map(|i| -1.0 + h * f64::from(i)).collect();
            let mut sum = 0.0;
            of_cell(&corners, &[axis.clone(), axis.clone(), axis.clone()], &mut |at, part| {
                let centre = Point::from(at.map(|i| -1.0 + h * (i as f64 - 0.5)));
                sum += part * field(&centre);
            });
            (sum - exact).abs()
        });
        assert!(errors[0] < 0.02 && errors[1] < 0.4 * errors[0], "{errors:?}");
    }
}
