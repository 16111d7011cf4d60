//! Fluxes of single faces, metrics and heights, by hand.

#![allow(clippy::needless_range_loop)]

use crate::common::{Noise, isothermal, settings};
use flow_solver::geometry::vec3::{Mat3, Vec3};
use flow_solver::geometry::{FaceMetric, Metrics};
use flow_solver::physics::{
    self, Air, Blending, BoundaryFace, FaceFlux, FarField, FluxParameters, Gas, IdealGas, Inviscid,
    Isothermal, OpenBoundary, Outlet,
};
use flow_solver::shear::{Profile, WindShear};
use mesh::{BoxShape, FlowGrid, Patch, box_grid, box_grid_of};

/// `M x`: a box becomes a parallelepiped.
const SKEW: Mat3 = Mat3::new(1.0, 0.4, -0.2, 0.1, 0.8, 0.3, 0.2, -0.1, 1.3);

fn skew(x: impl Into<Vec3>) -> Vec3 {
    SKEW * x.into()
}

/// Two cells that share a slanted face; what the ends are.
fn pair(patch: Patch) -> FlowGrid {
    let mut grid = box_grid([2, 1, 1], [0.0; 3], [2.0, 1.5, 0.7], [patch; 6]);
    grid.coords.iter_mut().for_each(|x| *x = skew(*x).into());
    grid
}

/// The slanted face between two cells and the distance of their centres along its normal, which pass through the
/// cells' own vectors.
fn slanted(grid_flux: f64) -> (FaceMetric, f64) {
    let s = isothermal(&pair(Patch::FarField), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let mut face = s.metrics.faces[0];
    face.grid_flux = grid_flux;
    let step = skew([1.0, 0.0, 0.0]);
    (face, step.dot(&face.area) / face.area.norm())
}

fn scheme() -> FluxParameters {
    FluxParameters {
        rate: 100.0,
        rhie_chow: [150.0, -200.0, 50.0],
        frame: Vec3::new(0.5, -1.0, 1.0),
        wind: Vec3::new(1.0, 2.0, -0.5),
        floor_squared: 0.25,
        velocity_diffusion: 0.5,
        pressure_diffusion: 3.0,
        renews_blending: false,
        kinematic_viscosity: 0.0,
    }
}

const PAST: [f32; 2] = [0.25, -0.125];

/// `delta (t0 e + t1 e' + t2 e'') + 2 (U + 10 floor) e = push`, solved for `e`.
fn rhie_chow(spacing: f64, push: f64, speed: f64) -> f64 {
    let history = -200.0 * 0.25 + 50.0 * -0.125;
    (push - spacing * history) / (spacing * 150.0 + 2.0 * (speed + 10.0 * 0.5))
}

fn against(u: Vec3) -> f64 {
    let d = u - scheme().frame;
    (d.dot(&d) + 0.25).sqrt()
}

fn near<const N: usize>(a: &[f64; N], b: &[f64; N]) {
    for v in 0..N {
        assert!((a[v] - b[v]).abs() < 1e-6 * b[v].abs().max(1e-2), "{v}: {a:?} {b:?}");
    }
}

/// Mass by the mean velocity, the half jump of pressure without its resolved part and what history holds; carried by the
/// side that it comes from and, in the central share, by the mean; a pressure that lacks a quarter of rho U times the jump of
/// the normal velocity, in the upwind share.
fn between_two_states<G: Gas<N>, const N: usize>(gas: G) {
    for blending in [Blending::UPWIND, Blending { upwind: 0.25, resolved: 16.0 }] {
        blended_states(&gas, blending);
    }
}

fn blended_states<G: Gas<N>, const N: usize>(gas: &G, blending: Blending) {
    let kept = FaceFlux { previous: PAST, blending, ..FaceFlux::default() };
    let share = f64::from(blending.upwind);
    for (grid_flux, turn) in [(0.3, false), (-9.0, false), (0.3, true), (12.0, true)] {
        let (face, spacing) = slanted(grid_flux);
        assert!((face.spacing() - spacing).abs() < 1e-6);
        let (mut l, mut r): ([f64; N], [f64; N]) = (
            std::array::from_fn(|v| [30.0, 3.0, 1.0, -2.0, 4.0][v]),
            std::array::from_fn(|v| [-50.0, 1.0, 2.5, 0.7, -2.0][v]),
        );
        if turn {
            std::mem::swap(&mut l, &mut r);
        }
        let found = physics::interface(gas, &scheme(), &l, &r, &face.geometry(), &kept.history());
        let unit = face.area * (1.0 / face.area.norm());
        let mean: Vec3 = Vec3::from_fn(|d, _| 0.5 * (l[1 + d] + r[1 + d]));
        let volume = mean.dot(&face.area) - grid_flux;
        let from = if volume > 0.0 { &l } else { &r };
        let (rho, c) = (gas.density(from), gas.sound_speed_squared(from).sqrt());
        let half = 0.5 * (l[0] - r[0]);
        let e = rhie_chow(spacing, 3.0 * (half - f64::from(blending.resolved)), against(mean));
        assert!((found.rhie_chow - e).abs() < 1e-6 * e.abs(), "{} {e}", found.rhie_chow);
        let mass = rho * volume + face.area.norm() * (e + half / c);
        assert!((found.mass - mass).abs() < 1e-6 * mass.abs(), "{} {mass}", found.mass);
        let jump: f64 = (0..3).map(|d| (r[1 + d] - l[1 + d]) * unit[d]).sum();
        let p = 0.5 * (l[0] + r[0]) - share * 0.25 * rho * against(mean) * jump;
        let (upwind, push) =
            (gas.carried(if mass > 0.0 { &l } else { &r }), gas.pressure_flux(p, face.area, grid_flux));
        let (left, right) = (gas.carried(&l), gas.carried(&r));
        let carried = |v: usize| share * upwind[v] + (1.0 - share) * 0.5 * (left[v] + right[v]);
        near(&found.flux, &std::array::from_fn(|v| mass * carried(v) + push[v]));
        let wall: physics::Interface<f64, N> = physics::wall(gas, p, face.area, grid_flux);
        near(&wall.flux, &push);
        assert_eq!((wall.mass, wall.rhie_chow), (0.0, 0.0));
    }
}

#[test]
fn interior_face_flux_matches_closed_form() {
    let air = Air::new(1.225, 288.15);
    between_two_states(Isothermal::new(air));
    between_two_states(IdealGas::new(air));
}

/// The far field at the angles of entering, leaving and mixed streams. Where the stream enters, the invariant of
/// the wave that leaves, p + rho c u, is that of the cell, that of the one that enters is the stream's; where it leaves,
/// gauge pressure is zero and pressure pulls at the mass flux as between two cells.
fn far<G: Gas<N>, const N: usize>(gas: G) {
    let mut seen = [0; 3];
    for sign in [1.0, -1.0] {
        for grid_flux in [0.4, -20.0, 20.0] {
            for wind in
                [[9.0, 2.0, -0.5], [-9.0, 2.0, -0.5], [1.4, 2.5, -0.5], [-0.3, -3.5, 1.5]].map(Vec3::from)
            {
                let (face, spacing) = slanted(grid_flux);
                let scheme = FluxParameters { wind, ..scheme() };
                let q: [f64; N] = std::array::from_fn(|v| [30.0, 3.0, 1.0, -2.0, 4.0][v]);
                let cell: [f64; N] = std::array::from_fn(|v| [45.0, 2.0, 1.5, -2.5, 3.0][v]);
                let at = BoundaryFace { scheme: &scheme, metric: &face, sign, pressure: 0.0 };
                let found = FarField.flux(&gas, &at, &q, &cell, PAST);
                let area = face.area.norm();
                let unit = face.area * (sign / area);
                let stream = wind - scheme.frame;
                let leaving = (2.0 * stream.dot(&unit) / (stream.dot(&stream) + 0.25).sqrt()).clamp(0.0, 1.0);
                assert!((FarField.leaving(&at) - leaving).abs() < 1e-12);
                seen[if leaving == 0.0 {
                    0
                } else if leaving < 1.0 {
                    1
                } else {
                    2
                }] += 1;
                let (rho, c) = (gas.density(&q), gas.sound_speed_squared(&q).sqrt());
                let normal = |q: &[f64; N]| Vec3::new(q[1], q[2], q[3]).dot(&unit);
                // p + rho c u = plus, p - rho c u = minus.
                let (plus, minus) = (cell[0] + rho * c * normal(&cell), -rho * c * wind.dot(&unit));
                let (p, u) = (0.5 * (plus + minus), 0.5 * (plus - minus) / (rho * c));
                let e = rhie_chow(spacing, q[0], (u * u + 0.25).sqrt());
                assert!((found.rhie_chow - e).abs() < 1e-6 * e.abs(), "{} {e}", found.rhie_chow);
                let momentum = leaving * (rho * normal(&q) + e + q[0] / c) + (1.0 - leaving) * rho * u;
                let mass = momentum * area - rho * sign * grid_flux;
                assert!((found.mass - mass).abs() < 1e-6 * mass.abs(), "{} {mass}", found.mass);
                let far = gas.undisturbed(wind);
                let carried = gas.carried(if mass > 0.0 { &q } else { &far });
                let push = gas.pressure_flux((1.0 - leaving) * p, unit * area, sign * grid_flux);
                near(&found.flux, &std::array::from_fn(|v| mass * carried[v] + push[v]));

                let found = Outlet.flux(&gas, &at, &q, &cell, PAST);
                let e = rhie_chow(spacing, q[0], (normal(&q).powi(2) + 0.25).sqrt());
                assert!((found.rhie_chow - e).abs() < 1e-6 * e.abs(), "{} {e}", found.rhie_chow);
                let mass = (rho * normal(&q) + e + q[0] / c) * area - rho * sign * grid_flux;
                assert!((found.mass - mass).abs() < 1e-6 * mass.abs(), "{} {mass}", found.mass);
                let carried = gas.carried(if mass > 0.0 { &q } else { &far });
                let push = gas.pressure_flux(0.0, unit * area, sign * grid_flux);
                near(&found.flux, &std::array::from_fn(|v| mass * carried[v] + push[v]));
            }
        }
    }
    assert!(seen.iter().all(|n| *n > 0), "{seen:?}");
}

#[test]
fn open_boundary_fluxes_match_characteristics() {
    let air = Air::new(1.225, 288.15);
    far(Isothermal::new(air));
    far(IdealGas::new(air));
}

/// Parallelepipeds: the corners' mean is the centre, volumes and areas are those of the vectors, and heights are the
/// distances of parallel planes.
#[test]
fn parallelepiped_metrics_are_exact() {
    let mut grid = box_grid([3, 2, 4], [0.0; 3], [1.5, 0.8, 1.2], [Patch::FarField; 6]);
    grid.coords.iter_mut().for_each(|x| *x = skew(*x).into());
    let s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let edges = [[0.5, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.3]].map(skew);
    let areas: [Vec3; 3] = std::array::from_fn(|d| edges[(d + 1) % 3].cross(&edges[(d + 2) % 3]));
    let volume = edges[0].dot(&areas[0]);
    let middle =
        |nodes: &[u32]| nodes.iter().map(|&n| s.nodes[n as usize]).sum::<Vec3>() * (1.0 / nodes.len() as f64);
    let close = |a: Vec3, b: Vec3| assert!((a - b).norm() < 1e-7, "{a:?} {b:?}");
    let (t, m) = (&s.topology, &s.metrics);
    for c in 0..t.n_owned {
        assert!((m.volume[c] - volume).abs() < 1e-14 && (m.size[c] - volume.cbrt()).abs() < 1e-14);
        close(m.centre(c), middle(&t.cell_nodes[c]));
    }
    // Which of the three directions a face belongs to, and which way it points.
    let of = |area: Vec3| {
        let d = (0..3).find(|&d| areas[d].cross(&area).norm() < 1e-12).expect("a face of a parallelepiped");
        (d, areas[d].dot(&area).signum())
    };
    for (k, f) in m.faces.iter().enumerate() {
        let (d, sign) = of(f.area);
        close(f.area, areas[d] * sign);
        close(m.face_centre(t, k), middle(&t.face_nodes[k]));
        assert!((f.magnitude() - areas[d].norm()).abs() < 1e-14);
        let height = volume / areas[d].norm();
        if let Some(&[i, _]) = t.cells.get(k) {
            assert!((f.spacing() - height).abs() < 1e-7, "{} {height}", f.spacing());
            close(f.offset(), middle(&t.face_nodes[k]) - m.centre(i as usize));
        } else {
            close(m.border(k as u32), middle(&t.face_nodes[k]));
            assert!((f.spacing() - 0.5 * height).abs() < 1e-7);
        }
    }
    for side in t.sides() {
        assert!((m.height(side) - 0.5 * volume / m.faces[side.face as usize].area.norm()).abs() < 1e-14);
    }
}

/// A cell that is skewed beyond measure keeps a fifth of the distance of the centres.
#[test]
fn skewed_cells_have_positive_spacing() {
    let mut grid = box_grid([2, 1, 1], [0.0; 3], [2.0, 1.0, 1.0], [Patch::FarField; 6]);
    grid.coords.iter_mut().for_each(|x| x[1] += 20.0 * x[0]);
    let s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    // Centres lie (1, 20, 0) apart, the face has its normal along x; a border is half as far.
    let far = 401.0f64.sqrt();
    assert!((s.metrics.faces[0].spacing() - 0.2 * far).abs() < 1e-6);
    let across = |area: Vec3| area[0].abs() > 0.5 && area[1].abs() < 1e-12;
    let ends =
        s.topology.sides_of(Patch::FarField).filter(|side| across(s.metrics.faces[side.face as usize].area));
    for side in ends.clone() {
        assert!((s.metrics.height(side) - 0.1 * far).abs() < 1e-12);
    }
    assert_eq!(ends.count(), 2);
}

/// Tetrahedra anywhere: a sixth of the determinant, the mean of the corners.
#[test]
fn tetrahedron_volume_is_its_determinant() {
    let mut grid = box_grid_of(BoxShape::Tetrahedra, [2, 3, 2], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
    let mut noise = Noise(7);
    grid.coords.iter_mut().flatten().for_each(|x| *x += 10.0 + 0.03 * noise.next());
    let s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    for (c, nodes) in s.topology.cell_nodes.iter().enumerate() {
        let [a, b, c0, d] = [nodes[0], nodes[1], nodes[2], nodes[4]].map(|n| s.nodes[n as usize]);
        let volume = (b - a).dot(&((c0 - a).cross(&(d - a)))).abs() / 6.0;
        assert!((s.metrics.volume[c] - volume).abs() < 1e-13, "{} {volume}", s.metrics.volume[c]);
        let mean: Vec3 = Vec3::from_fn(|k, _| 0.25 * (a[k] + b[k] + c0[k] + d[k]));
        assert!((s.metrics.centre(c) - mean).norm() < 1e-12);
    }
}

/// A cell between two faces that are not plane sweeps what its volume changes by, and a volume by the formula of a
/// bilinear roof: the mean height of its corners.
#[test]
fn nonplanar_face_has_the_mean_height_of_its_corners() {
    let mut grid = box_grid([1, 1, 1], [0.0; 3], [2.0, 3.0, 1.0], [Patch::FarField; 6]);
    let heights = [0.3, -0.2, 0.25, 0.4];
    for (k, x) in grid.coords[4..].iter_mut().enumerate() {
        x[2] += heights[k];
    }
    let s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let exact = 6.0 * (1.0 + heights.iter().sum::<f64>() / 4.0);
    assert!((s.metrics.volume[0] - exact).abs() < 1e-14, "{} {exact}", s.metrics.volume[0]);
    let (mut swept, old) = (vec![0.0; 6], s.nodes.clone());
    let flat: Vec<Vec3> =
        old.iter().map(|x| Vec3::new(x[0], x[1], if x[2] > 0.5 { 1.0 } else { 0.0 })).collect();
    Metrics::swept(&s.topology, &flat, &old, &mut swept);
    let sum: f64 = swept.iter().sum();
    assert!((sum - 6.0 * heights.iter().sum::<f64>() / 4.0).abs() < 1e-14, "{swept:?}");
}

/// The wind of faces follows from their height in the sinking frame.
#[test]
fn sheared_wind_is_evaluated_at_face_height() {
    let profile = Profile::Linear { wind: [6.0, 2.0, 0.0], reference: 10.0, slope: 0.02 };
    let s = isothermal(&pair(Patch::FarField), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let at = |z: f64| Vec3::from(profile.at(z));
    let mut sheared = WindShear::new(profile.clone(), 40.0);
    let close = |a: Vec3, b: Vec3| assert!((a - b).norm() < 1e-13, "{a:?} {b:?}");
    close(sheared.base(), at(40.0));
    close(sheared.excess(-7.0), at(33.0) - at(40.0));
    assert!(sheared.excess(-7.0).norm() > 0.1);
    let between = s.topology.cells.len();
    let mut excess = vec![Vec3::zeros(); s.metrics.faces.len() - between];
    for rise in [-2.5, -1.0] {
        let before = sheared.height;
        sheared.advance(rise, &s.topology, &s.metrics, &mut excess);
        for (k, e) in excess.iter().enumerate() {
            let z = s.metrics.border((between + k) as u32)[2];
            close(*e, at(before + rise + z) - at(40.0));
        }
        assert_eq!(sheared.height, before);
        sheared.accept();
        assert!((sheared.height - (before + rise)).abs() < 1e-13);
    }
    sheared.restore(12.0);
    close(sheared.excess(1.0), at(13.0) - at(40.0));
}
