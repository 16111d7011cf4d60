//! Rigid motion, sums of forces and moments, work, order on a sphere.

use super::*;

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

fn displaced(s: &Surface, f: impl Fn(Vec3) -> Vec3) -> Vec<f64> {
    s.nodes.iter().flat_map(|&x| sub(f(x), x)).collect()
}

/// Sum and moment about the origin of a load.
fn sums(s: &Surface, displacement: &[f64], load: &[f64]) -> [f64; 6] {
    let x = moved(s, displacement);
    let mut all = [0.0; 6];
    for (face, p) in s.faces.iter().zip(load.chunks_exact(LOAD_WIDTH)) {
        let (area, at) = (area_vector(face, &x), middle(face, &x));
        let force: Vec3 = std::array::from_fn(|i| p[0] * area[i] + p[1 + i] * norm(area));
        let moment = cross(at, force);
        (0..3).for_each(|i| {
            all[i] += force[i];
            all[3 + i] += moment[i];
        });
    }
    all
}

fn smooth(s: &Surface) -> Vec<f64> {
    let load = |f: &[u32; 4]| {
        let [x, y, _] = middle(f, &s.nodes);
        [10.0 + 3.0 * x - 2.0 * y * y, 0.3, -0.2 * x, 0.1 * y]
    };
    s.faces.iter().flat_map(load).collect()
}

#[test]
fn rigid_motion_is_exact() {
    let (canopy, own) = (cap(9, false), cap(4, true));
    let t = Transfer::new(canopy.clone(), own.clone()).unwrap();
    assert!(t.feet.iter().any(|f| f.height > 1e-3), "the canopy lies off the coarse surface");
    let (s, c) = 0.7f64.sin_cos();
    let rigid = |x: Vec3| [c * x[0] - s * x[2] + 2.0, x[1] - 1.0, s * x[0] + c * x[2] + 0.5];
    let mut d = vec![0.0; 3 * canopy.nodes.len()];
    t.motion(&displaced(&own, rigid), &mut d);
    let exact = displaced(&canopy, rigid);
    assert!(d.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-14));
}

#[test]
fn forces_and_moments_keep_their_sums_on_any_shape() {
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

/// Forces by the transpose do the work that they did, to first order in the motion.
#[test]
fn nodal_forces_do_the_same_work() {
    let (canopy, own) = (cap(7, false), cap(4, true));
    let t = Transfer::new(canopy.clone(), own.clone()).unwrap();
    let rest = vec![0.0; 3 * own.nodes.len()];
    let wave = |e: f64| {
        displaced(&own, |x| [x[0] + e * x[1] * x[2], x[1] - e * x[0], x[2] + e * (3.0 * x[0]).sin()])
    };
    let foot = t.feet[20];
    let mut forces = vec![[0.0; 3]; own.nodes.len()];
    let force = [1.0, -2.0, 0.5];
    t.push(&foot, &own.nodes, force, &mut forces);
    let e = 1e-6;
    let mut ends = [vec![0.0; 3 * canopy.nodes.len()], vec![0.0; 3 * canopy.nodes.len()]];
    t.motion(&wave(e), &mut ends[1]);
    t.motion(&wave(-e), &mut ends[0]);
    let here = (0..3).map(|i| force[i] * (ends[1][60 + i] - ends[0][60 + i])).sum::<f64>();
    let (after, before) = (wave(e), wave(-e));
    let there: f64 =
        forces.as_flattened().iter().zip(after.iter().zip(&before)).map(|(f, (a, b))| f * (a - b)).sum();
    assert_eq!(rest.len(), after.len());
    assert!((here / there - 1.0).abs() < 1e-8, "{here} {there}");
}

/// Largest errors of motion and of pressure between surfaces with `n` and 3 n / 2 faces along a side.
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
        let size = norm(area_vector(face, &own.nodes));
        square += size * (a[0] - b[0]).powi(2);
        area += size;
    }
    [motion, (square / area).sqrt()]
}

#[test]
fn motion_is_of_second_order_and_loads_converge() {
    let (coarse, fine) = (errors(16), errors(32));
    let order: Vec<f64> = coarse.iter().zip(&fine).map(|(a, b)| (a / b).log2()).collect();
    println!("motion {coarse:.1?} to {fine:.1?}: orders {order:.2?}");
    assert!(order[0] > 1.8, "motion: {coarse:?} {fine:?}");
    assert!(order[1] > 0.8 && fine[1] < 0.3, "pressure: {coarse:?} {fine:?}");
}

#[test]
fn surfaces_that_do_not_fit_are_told() {
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
