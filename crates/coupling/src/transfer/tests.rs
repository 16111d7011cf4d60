//! Rigid motion, sums of forces and moments, orders on a sphere.

use channel::LOAD_WIDTH;

use super::nearest_triangle::{blend, nearest, normal};
use super::surface::{face_area, middle};
use super::surface_transfer::points;
use super::*;
use crate::geometry::{Vec3, face_force};

/// The upper part of a unit sphere above a square of `n` x `n` faces, with diagonals cut where `cut`.
fn cap(n: usize, cut: bool) -> Surface {
    let mut s = Surface::default();
    for j in 0..=n {
        for i in 0..=n {
            let [u, v] = [i, j].map(|k| 1.2 * (k as f64 / n as f64 - 0.5));
            let r = (1.0 + u * u + v * v).sqrt();
            s.nodes.push([u / r, v / r, 1.0 / r]);
        }
    }
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if cut { s.faces.extend([[a, b, c, c], [a, c, d, d]]) } else { s.faces.push([a, b, c, d]) }
        }
    }
    s
}

fn displaced(s: &Surface, f: impl Fn(Vec3) -> [f64; 3]) -> Vec<f64> {
    positions(s).into_iter().flat_map(|x| <[f64; 3]>::from(Vec3::from(f(x)) - x)).collect()
}

fn positions(s: &Surface) -> Vec<Vec3> {
    s.nodes.iter().map(|x| Vec3::from(*x)).collect()
}

/// Sum and moment about the origin of a load.
fn sums(s: &Surface, displacement: &[f64], load: &[f64]) -> [f64; 6] {
    let x = s.moved(displacement);
    let mut all = [0.0; 6];
    for (face, p) in s.faces.iter().zip(load.chunks_exact(LOAD_WIDTH)) {
        let (area, at) = (face_area(face, &x), middle(face, &x));
        let force = face_force(&area, p);
        let moment = at.cross(&force);
        (0..3).for_each(|i| {
            all[i] += force[i];
            all[3 + i] += moment[i];
        });
    }
    all
}

fn smooth(s: &Surface) -> Vec<f64> {
    let load = |f: &[u32; 4]| {
        let [x, y, _]: [f64; 3] = middle(f, &positions(s)).into();
        [10.0 + 3.0 * x - 2.0 * y * y, 0.3, -0.2 * x, 0.1 * y]
    };
    s.faces.iter().flat_map(load).collect()
}

#[test]
fn rigid_motion_is_exact() {
    let (canopy, own) = (cap(9, false), cap(4, true));
    let t = Transfer::new(canopy.clone(), own.clone()).unwrap();
    assert!(t.projections.iter().any(|f| f.height > 1e-3), "the canopy lies off the coarse surface");
    let (s, c) = 0.7f64.sin_cos();
    let rigid = |x: Vec3| [c * x[0] - s * x[2] + 2.0, x[1] - 1.0, s * x[0] + c * x[2] + 0.5];
    let mut d = vec![0.0; 3 * canopy.nodes.len()];
    t.motion(&displaced(&own, rigid), &mut d);
    let exact = displaced(&canopy, rigid);
    assert!(d.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-14));
}

#[test]
fn sums_of_forces_and_moments_are_conserved_in_any_configuration() {
    for (fine, coarse) in [(9, 4), (4, 9), (6, 6)] {
        let (canopy, own) = (cap(fine, false), cap(coarse, true));
        let t = Transfer::new(canopy.clone(), own.clone()).unwrap();
        let bent = displaced(&own, |x| [1.1 * x[0], x[1] + 0.2 * x[0] * x[2], 0.8 * x[2] + 0.3 * x[1]]);
        let mut d = vec![0.0; 3 * canopy.nodes.len()];
        t.motion(&bent, &mut d);
        let from = smooth(&canopy);
        let mut to = vec![f64::NAN; LOAD_WIDTH * own.faces.len()];
        t.load(&bent, &d, &from, &mut to);
        let (a, b) = (sums(&canopy, &d, &from), sums(&own, &bent, &to));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-13 * 12.0), "{a:?} {b:?}");
    }
}

/// Largest error of motion and mean error of the force per area between surfaces with `n` and 3 n / 2 faces per side.
fn errors(n: usize) -> [f64; 2] {
    let (canopy, own) = (cap(3 * n / 2, false), cap(n, true));
    let t = Transfer::new(canopy.clone(), own.clone()).unwrap();
    let bend = |x: Vec3| [x[0] + 0.1 * (2.0 * x[1]).sin(), x[1], x[2] + 0.1 * (3.0 * x[0]).cos()];
    let (mut d, exact) = (vec![0.0; 3 * canopy.nodes.len()], displaced(&canopy, bend));
    t.motion(&displaced(&own, bend), &mut d);
    let motion = d.iter().zip(&exact).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    let rest = [vec![0.0; d.len()], vec![0.0; 3 * own.nodes.len()]];
    let mut to = vec![0.0; LOAD_WIDTH * own.faces.len()];
    t.load(&rest[1], &rest[0], &smooth(&canopy), &mut to);
    let (mut square, mut area) = (0.0, 0.0);
    for ((face, a), b) in own.faces.iter().zip(to.chunks_exact(4)).zip(smooth(&own).chunks_exact(4)) {
        let area_vector = face_area(face, &positions(&own));
        let size = area_vector.norm();
        let unit = area_vector / size;
        // Force per area: the normal part of a traction is transferred as pressure.
        let difference = |i: usize| (a[0] - b[0]) * unit[i] + a[1 + i] - b[1 + i];
        square += size * (0..3).map(|i| difference(i).powi(2)).sum::<f64>();
        area += size;
    }
    [motion, (square / area).sqrt()]
}

#[test]
fn motion_is_second_order_and_loads_converge() {
    let (coarse, fine) = (errors(8), errors(16));
    let order: Vec<f64> = coarse.iter().zip(&fine).map(|(a, b)| (a / b).log2()).collect();
    println!("motion {coarse:?} to {fine:?}: orders {order:.2?}");
    assert!(order[0] > 1.8, "motion: {coarse:?} {fine:?}");
    assert!(order[1] > 0.8 && fine[1] < 0.1, "pressure: {coarse:?} {fine:?}");
}

#[test]
fn mismatched_surfaces_are_errors() {
    let far = Surface {
        nodes: cap(3, true).nodes.iter().map(|x| [x[0], x[1], x[2] + 9.0]).collect(),
        ..cap(3, true)
    };
    let error = Transfer::new(cap(4, false), far).unwrap_err();
    assert!(matches!(error, TransferError::Far { .. }) && error.to_string().contains("another canopy"));
    let mut wrong = cap(3, true);
    wrong.faces[2][1] = 99;
    assert!(matches!(
        Transfer::new(cap(4, false), wrong),
        Err(TransferError::Node { face: 2, node: 99, .. })
    ));
    assert_eq!(Transfer::new(cap(4, false), Surface::default()).unwrap_err(), TransferError::Empty);
}

/// Points away from the interior, the edges and the corners of a triangle, with known projections.
#[test]
fn distances_from_a_triangle_match_known_projections() {
    let corners = [[0.3, -0.2, 0.1], [1.4, 0.3, 0.4], [0.5, 1.1, -0.6]].map(Vec3::from);
    let [a, b, c] = corners;
    let up = normal(&corners).normalize();
    let away = |foot: Vec3, parts: [(f64, Vec3); 2]| -> Vec3 {
        foot + parts[0].0 * parts[0].1 + parts[1].0 * parts[1].1
    };
    for weights in [[0.2, 0.3, 0.5], [0.6, 0.2, 0.2], [0.05, 0.9, 0.05], [0.01, 0.01, 0.98]] {
        let p = away(blend(weights, &corners), [(0.7, up), (0.0, up)]);
        assert!((nearest(p, &corners) - 0.7).abs() < 1e-14, "{weights:?}");
    }
    for (k, [from, to]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
        let out = (to - from).cross(&up).normalize();
        for t in [0.03, 0.4, 0.97] {
            let foot = (1.0 - t) * from + t * to;
            let p = away(foot, [(0.4, out), (-0.3, up)]);
            assert!((nearest(p, &corners) - 0.5).abs() < 1e-14, "edge {k}, {t}");
        }
        // Beyond a corner, away from the two other corners.
        let others = corners.iter().fold(Vec3::zeros(), |s, x| s + (from - x));
        let p = away(from, [(0.3, others.normalize()), (0.4, up)]);
        assert!((nearest(p, &corners) - 0.5).abs() < 1e-14, "corner {k}");
    }
}

/// On a parallelogram the bilinear map is affine: the points are the centres of its ninths.
#[test]
fn sampling_points_of_a_parallelogram_are_the_centres_of_its_ninths() {
    let [a, along, across] = [[1.0, 2.0, 3.0], [3.0, 0.6, -0.3], [0.9, -6.0, 1.5]].map(Vec3::from);
    let at = |u: f64, v: f64| a + u * along + v * across;
    let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
    for (k, p) in points(&corners).iter().enumerate() {
        let expected = at((k % 3) as f64 / 3.0 + 1.0 / 6.0, (k / 3) as f64 / 3.0 + 1.0 / 6.0);
        assert!((p - expected).norm() < 1e-14, "{k}: {p:?} {expected:?}");
    }
}
