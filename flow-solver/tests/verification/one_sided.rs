//! A canopy with fluid on one side only: loads by the ambient pressure, on grids that move.

use crate::common::{Noise, isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::monitors::Surface;
use flow_solver::physics::{Inviscid, Isothermal, Laminar};
use flow_solver::{Loads, Solver, Step};
use mesh::{FlowGrid, Patch, floor_grid, plate_grid};

type Flow = Solver<Isothermal, 4>;

const CELLS: [usize; 3] = [4, 3, 5];
const TOP: [f64; 3] = [1.0, 0.8, 1.2];

fn floor(patches: [Patch; 6], normal_up: bool) -> FlowGrid {
    floor_grid(CELLS, [0.0; 3], TOP, patches, normal_up)
}

/// Moves the floor to the height `h`, m, in a step of `dt`, and the nodes above it with it, the lid not at all.
fn lift(s: &mut Flow, start: &[Vec3], [before, h]: [f64; 2], dt: f64) {
    let share = |x: &Vec3| 1.0 - x[2].abs() / TOP[2];
    for ((x, v), x0) in s.nodes.iter_mut().zip(&mut s.node_velocity).zip(start) {
        x[2] = x0[2] + h * share(x0);
        v[2] = (h - before) / dt * share(x0);
    }
    s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).expect("a step");
}

/// A uniform and a linear pressure: the load is the pressure inside less that outside to round-off, for both orientations of the
/// faces and for any ambient pressure.
#[test]
fn load_of_a_known_pressure_is_exact_for_both_orientations() {
    for normal_up in [false, true] {
        for ambient in [0.0, 3.5, -20.0] {
            let mut set = settings([1.0, 0.0, 0.0], 1e-3);
            set.ambient_pressure = ambient;
            let mut s = isothermal(&floor([Patch::FarField; 6], normal_up), Inviscid, set);
            let slope = [2.0, -1.5, 7.0];
            let pressure = |x: Vec3| 40.0 + slope[0] * x[0] + slope[1] * x[1] + slope[2] * x[2];
            for (c, q) in s.q.iter_mut().enumerate() {
                *q = [pressure(s.metrics.centre(c)), 0.0, 0.0, 0.0];
            }
            let exact_gradient = slope.map(|d| [d, 0.0, 0.0, 0.0]);
            s.gradient.iter_mut().for_each(|g| *g = exact_gradient);
            let mut loads = Loads::new(&s);
            let total = loads.compute(&s);
            // The fluid is above: the pressure pushes the floor down.
            let middle = Vec3::new(0.5 * TOP[0], 0.5 * TOP[1], 0.0);
            let force = (ambient - pressure(middle)) * TOP[0] * TOP[1];
            assert!((total.force[2] - force).abs() < 1e-12 * force.abs(), "{total:?} {force}");
            let mut surface = Surface::new(1, &s);
            let sides = surface.sides(&s).to_vec();
            for ((load, side), &face) in loads.faces.iter().zip(&sides).zip(&s.topology.canopy_face) {
                let p = pressure(s.metrics.border(face));
                let (inside, outside) = if normal_up { (ambient, p) } else { (p, ambient) };
                assert!((side[0] - inside).abs() < 1e-12 && (side[1] - outside).abs() < 1e-12, "{side:?}");
                assert!((load[0] - (inside - outside)).abs() < 1e-12, "{load:?}");
            }
        }
    }
}

/// The flow above a moving floor is that above a canopy with air on both sides which fills the whole width of a box: the two halves of the
/// box do not meet. Viscous, pressure and shear.
#[test]
fn flow_on_one_side_is_that_beside_a_canopy_with_two() {
    let wall = Patch::Wall;
    let patches = [wall, Patch::Slip, Patch::Symmetry, wall, Patch::Outlet, Patch::Outlet];
    let mut lower = TOP;
    lower[2] = -TOP[2];
    let both = plate_grid(
        [CELLS[0], CELLS[1], 2 * CELLS[2]],
        [0.0, 0.0, lower[2]],
        TOP,
        patches,
        CELLS[2],
        [0..CELLS[0], 0..CELLS[1]],
    );
    let set = || settings([0.0, 0.0, 0.05], 1e-11);
    let gas = Laminar { viscosity: 0.02 };
    for normal_up in [false, true] {
        let mut one = isothermal(&floor(patches, normal_up), gas, set());
        let mut two = isothermal(&both, gas, set());
        let (start, start_two) = (one.nodes.clone(), two.nodes.clone());
        let height = |k: i32| 0.03 * (1.0 - (0.7 * f64::from(k)).cos());
        let (mut largest, dt) = (0.0f64, 0.02);
        for k in 1..6 {
            let way = [height(k - 1), height(k)];
            lift(&mut one, &start, way, dt);
            lift(&mut two, &start_two, way, dt);
            let (mut a, mut b) = (Surface::new(1, &one), Surface::new(1, &two));
            let (a, b) = (a.sides(&one).to_vec(), b.sides(&two).to_vec());
            for (one, two) in a.iter().zip(&b) {
                let p = one[usize::from(normal_up)];
                largest = largest.max(p.abs());
                assert!((p - two[1]).abs() < 1e-7 * largest, "step {k}: {p} beside {}", two[1]);
            }
            let mut loads = Loads::new(&one);
            loads.compute(&one);
            for side in two.topology.no_slip.iter().filter(|s| s.canopy != u32::MAX && s.sign < 0.0) {
                let beside = two.spatial.wall_traction(&two.domain(), &two.scheme, &two.q, side);
                let own = &loads.faces[side.canopy as usize][1..];
                let off = (0..3).map(|d| (own[d] - beside[d]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-7 * beside.norm().max(1e-3), "step {k}: shear {own:?} beside {beside:?}");
            }
            one.accept(dt, true);
            two.accept(dt, true);
        }
        assert!(largest > 10.0, "{largest}");
    }
}

/// A uniform stream along a floor stays uniform to round-off, where the nodes of the floor are shaken in its plane and where the floor
/// rises with the stream; the nodes above are shaken in all directions.
#[test]
fn free_stream_is_preserved_beside_a_moving_floor() {
    for (wind, normal_up) in [([3.0, -2.0, 0.0], false), ([3.0, -2.0, 0.7], true), ([0.0, 0.0, 0.7], false)] {
        let wind = Vec3::from(wind);
        let mut s = isothermal(&floor([Patch::FarField; 6], normal_up), Inviscid, settings(wind, 1e-11));
        let (start, mut noise, dt) = (s.nodes.clone(), Noise(3), 5e-3);
        for k in 1..=12 {
            let h = wind[2] * dt * f64::from(k);
            for ((x, v), x0) in s.nodes.iter_mut().zip(&mut s.node_velocity).zip(&start) {
                let floor = x0[2] == 0.0;
                let fixed = |d: usize| floor && (d == 2 || wind[2] != 0.0);
                let shake = Vec3::from_fn(|d, _| if fixed(d) { 0.0 } else { 0.02 * noise.next() });
                let to = x0 + shake + Vec3::new(0.0, 0.0, h * (1.0 - x0[2] / TOP[2]));
                *v = (to - *x) / dt;
                *x = to;
            }
            s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).expect("a step");
            s.accept(dt, true);
        }
        let speed = wind.norm();
        let off = |q: &[f64; 4]| {
            (q[0].abs() / (speed * speed)).max((Vec3::new(q[1], q[2], q[3]) - wind).norm() / speed)
        };
        let worst = s.q.iter().map(off).fold(0.0, f64::max);
        println!("{wind:?}: {worst:.1e}");
        assert!(worst < 1e-11, "{wind:?}: {worst:e}");
        let total = Loads::new(&s).compute(&s);
        assert!(total.force.norm() < 1e-9, "{total:?}");
    }
}

/// A closed volume under a moving floor keeps its mass to the tolerance of the steps, and its pressure rises as the volume falls.
#[test]
fn closed_volume_beside_a_moving_floor_keeps_its_mass() {
    let mut s = isothermal(&floor([Patch::Slip; 6], false), Inviscid, settings([0.0, 0.0, 0.5], 1e-10));
    s.q.iter_mut().for_each(|q| q[3] = 0.0);
    let air = s.settings.air;
    let sound_squared = air.gas_constant * air.temperature;
    let mass = |s: &Flow| -> f64 {
        let n = s.topology.n_owned;
        (0..n).map(|c| s.metrics.volume[c] * (air.density + s.q[c][0] / sound_squared)).sum()
    };
    let (start, before, dt) = (s.nodes.clone(), mass(&s), 0.05);
    let height = |k: i32| 1e-3 * (1.0 - (0.3 * f64::from(k)).cos());
    for k in 1..=8 {
        lift(&mut s, &start, [height(k - 1), height(k)], dt);
        s.accept(dt, true);
    }
    let drift = mass(&s) / before - 1.0;
    assert!(drift.abs() < 1e-12, "{drift:e}");
    let total = Loads::new(&s).compute(&s);
    // Along the normal -z: the compressed fluid is inside and pushes out.
    let pressure = air.density * sound_squared * height(8) / (TOP[2] - height(8));
    let force = -total.force[2] / (TOP[0] * TOP[1]);
    // Waves of the motion are 9e-5 of it.
    assert!((force / pressure - 1.0).abs() < 5e-4, "{force} {pressure}");
}
