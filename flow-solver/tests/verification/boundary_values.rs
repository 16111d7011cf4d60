//! Data of single patches: channel, flow rate, moving walls, an inlet that changes in time, a free stream.

use std::f64::consts::{PI, TAU};

use crate::common::{Noise, at_rest, isothermal, settings, solver_of};
use case::{InletValues, MovingWall, OutletValues, ProfileTable, TimeFactor, WallRotation};
use flow_solver::boundary_values::{BoundaryValueError, BoundaryValues};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{Gas, IdealGas, Inviscid, Isothermal, Laminar};
use flow_solver::topology::Side;
use flow_solver::{FlowError, Solver, Step};
use mesh::{BoxShape, FaceTable, FlowGrid, HEX_FACES, Patch, box_grid, box_grid_of};

const RHO: f64 = 1.225;

#[derive(Default)]
struct Data {
    inlets: Vec<InletValues>,
    outlets: Vec<OutletValues>,
    walls: Vec<MovingWall>,
}

fn give<G: Gas<N>, const N: usize>(
    s: &mut Solver<G, N>,
    grid: &FlowGrid,
    data: &Data,
) -> Result<(), FlowError> {
    let faces = FaceTable::new(grid).unwrap();
    let values =
        BoundaryValues::new(&data.inlets, &data.outlets, &data.walls, grid, &faces, &s.topology).unwrap();
    s.set_boundary_values(values.expect("there are data"))
}

fn inlet(patch: &str, velocity: [f64; 3], profile: Option<&str>) -> InletValues {
    InletValues {
        patch: patch.into(),
        velocity_m_s: Some(velocity),
        profile: profile.map(String::from),
        ..InletValues::default()
    }
}

fn outlet(patch: &str, pressure_pa: f64) -> OutletValues {
    OutletValues { patch: patch.into(), pressure_pa, factor: None }
}

fn slide(patch: &str, velocity: [f64; 3]) -> MovingWall {
    MovingWall { patch: patch.into(), velocity_m_s: Some(velocity), ..MovingWall::default() }
}

fn rotate(patch: &str, rate: f64) -> MovingWall {
    let rotation = WallRotation { axis: [0.0, 0.0, 2.0], point_m: [0.0; 3], angular_velocity_rad_s: rate };
    MovingWall { patch: patch.into(), rotation: Some(rotation), ..MovingWall::default() }
}

/// Mass that leaves through the faces of `patch`, kg/s.
fn leaving<G: Gas<N>, const N: usize>(s: &Solver<G, N>, patch: Patch) -> f64 {
    s.topology.sides_of(patch).map(|side| f64::from(s.face_flux()[side.face as usize].mass)).sum()
}

/// Velocity that the air outside of a face has, m/s.
fn outside<G: Gas<N>, const N: usize>(s: &Solver<G, N>, side: &Side) -> Vec3 {
    s.domain().scheme_at(&s.scheme, side).wind
}

/// Volume that enters through `patch` by the velocities of its faces, m3/s.
fn entering<G: Gas<N>, const N: usize>(s: &Solver<G, N>, patch: Patch) -> f64 {
    let sides = s.topology.sides_of(patch);
    sides.map(|side| -side.sign * outside(s, side).dot(&s.metrics.faces[side.face as usize].area)).sum()
}

fn steady<G: Gas<N>, const N: usize>(s: &mut Solver<G, N>, dt: f64, steps: usize) {
    for _ in 0..steps {
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
    }
}

const RE: f64 = 20.0;
const LENGTH: f64 = 4.0;

/// A plane channel of height 1 m with `n` cells across and the mean velocity `speed`, at Reynolds number 20.
fn channel(n: usize, speed: f64, first: Patch, data: &Data) -> Solver<Isothermal, 4> {
    let (w, slip) = (Patch::Wall, Patch::Slip);
    let patches = [first, Patch::Outlet, w, w, slip, slip];
    let grid = box_grid([4 * n, n, 1], [0.0; 3], [LENGTH, 1.0, 1.0 / n as f64], patches);
    let wind = if first == Patch::FarField { speed } else { 0.0 };
    let mut settings = settings([wind, 0.0, 0.0], 1e-7);
    settings.reference_speed = 0.1 * speed;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO * speed / RE }, settings);
    if !data.inlets.is_empty() {
        give(&mut s, &grid, data).unwrap();
    }
    steady(&mut s, 1.0 / speed, 40);
    s
}

/// Mean of `value` over the cells of a channel whose centres are at `x` within half a cell, weighted by volume.
fn mean_at(s: &Solver<Isothermal, 4>, n: usize, x: f64, v: usize) -> f64 {
    let near = |c: &[f64; 3]| (c[0] - x).abs() < 0.5 / n as f64;
    let all: Vec<f64> =
        s.q.iter().zip(&s.metrics.centre).filter(|(_, c)| near(c)).map(|(q, _)| q[v]).collect();
    assert_eq!(all.len(), n, "{x}");
    all.iter().sum::<f64>() / n as f64
}

/// Errors of a channel with a parabolic inlet: largest of the profile over the mean velocity, relative of the pressure
/// gradient.
fn poiseuille(n: usize, pressure: f64) -> [f64; 2] {
    let data = Data {
        inlets: vec![inlet("left", [1.0, 0.0, 0.0], Some("6*y*(1 - y)"))],
        outlets: vec![outlet("right", pressure)],
        ..Data::default()
    };
    let s = channel(n, 1.0, Patch::Inlet, &data);
    let given: f64 = s
        .topology
        .sides_of(Patch::Inlet)
        .map(|side| {
            let (f, c) = (&s.metrics.faces[side.face as usize], side.cell as usize);
            let d = s.metrics.border(side.face) - s.metrics.centre(c);
            let q = flow_solver::gradient::extrapolated(&s.q[c], &s.gradient[c], &d);
            let y = s.metrics.border(side.face)[1];
            f.magnitude() * s.spatial.gas.density(&q) * 6.0 * y * (1.0 - y)
        })
        .sum();
    let (entering, out) = (-leaving(&s, Patch::Inlet), leaving(&s, Patch::Outlet));
    println!("n = {n}: {entering} of {given} kg/s enter, {out} leave");
    assert!((entering / given - 1.0).abs() < 1e-6 && (out / given - 1.0).abs() < 1e-5);
    let half = 0.5 / n as f64;
    let (a, b) = (2.0 + half, 3.0 + half);
    let slope = (mean_at(&s, n, b, 0) - mean_at(&s, n, a, 0)) / (b - a);
    let exact = -12.0 * RHO / RE;
    let level = mean_at(&s, n, a, 0) - slope * (a - LENGTH) - pressure;
    println!("n = {n}: pressure gradient {slope:.6} of {exact:.6} Pa/m, {level:.2e} Pa off at the outlet");
    assert!(level.abs() < 0.05 * RHO, "the outlet holds its pressure: off by {level}");
    let profile = |q: &[f64; 4], c: &[f64; 3]| (q[1] - 6.0 * c[1] * (1.0 - c[1])).abs();
    let line = s.q.iter().zip(&s.metrics.centre).filter(|(_, c)| (c[0] - b).abs() < half);
    let off = line.map(|(q, c)| profile(q, c)).fold(0.0, f64::max);
    println!("n = {n}: profile off by {off:.2e} of the mean velocity");
    [off, (slope / exact - 1.0).abs()]
}

#[test]
fn channel_keeps_the_parabola_and_its_pressure_gradient() {
    let [coarse, fine] = [8, 16].map(|n| poiseuille(n, 10.0));
    for v in 0..2 {
        let order = (coarse[v] / fine[v]).log2();
        println!("{v}: {:.2e}, {:.2e}, order {order:.2}", coarse[v], fine[v]);
        assert!(fine[v] < 0.012 && order > 1.6, "{coarse:?} {fine:?}");
    }
}

/// A far field yields to the pressure that drives the channel, an inlet does not.
#[test]
fn far_field_is_slow_where_an_inlet_holds_its_velocity() {
    let mach = 0.02;
    let speed = mach * (287.05f64 * 288.15).sqrt();
    let data = Data { inlets: vec![inlet("left", [speed, 0.0, 0.0], None)], ..Data::default() };
    let [held, far] = [Patch::Inlet, Patch::FarField].map(|first| {
        let s = channel(8, speed, first, &data_of(first, &data));
        leaving(&s, Patch::Outlet) * 8.0 / (RHO * speed) - 1.0
    });
    println!("Mach {mach}: mass flow off by {held:.2e} with an inlet, {far:.2e} with a far field");
    assert!(far < -0.015, "{far}");
    // Only the density at the inlet's pressure differs from that of the undisturbed air: 2.4 rho U^2 over R T.
    assert!((0.0..3.5 * mach * mach).contains(&held), "{held}");
}

fn data_of(first: Patch, data: &Data) -> Data {
    let inlets = if first == Patch::Inlet { data.inlets.clone() } else { Vec::new() };
    Data { inlets, ..Data::default() }
}

#[test]
fn flow_rate_is_the_integral_over_the_faces() {
    let (i, o, slip) = (Patch::Inlet, Patch::Outlet, Patch::Slip);
    let table = ProfileTable {
        y_m: vec![0.0, 0.4, 0.8],
        z_m: vec![0.0, 1.1],
        value: vec![vec![0.0, 1.0], vec![2.0, 2.5], vec![-0.5, 1.0]],
        ..ProfileTable::default()
    };
    for shape in [BoxShape::Hexahedra, BoxShape::Tetrahedra] {
        let grid = box_grid_of(shape, [3, 4, 5], [0.0; 3], [1.0, 0.8, 1.1], [i, o, slip, i, slip, slip]);
        let mut s = isothermal(&grid, Inviscid, settings([0.3, 0.0, 0.0], 1e-6));
        let rate = |patch: &str, rate, profile: Option<&str>, table| InletValues {
            patch: patch.into(),
            flow_rate_m3_s: Some(rate),
            profile: profile.map(String::from),
            profile_table: table,
            ..InletValues::default()
        };
        let inlets =
            vec![rate("left", 2.0, None, Some(table.clone())), rate("back", -0.5, Some("1 + x^2*z"), None)];
        give(&mut s, &grid, &Data { inlets, ..Data::default() }).unwrap();
        s.advance(&at_rest(1e-2)).unwrap();
        let total = entering(&s, i);
        assert!((total - 1.5).abs() < 1e-12, "{shape:?}: {total}");
        let mut scales = [Vec::new(), Vec::new()];
        for side in s.topology.sides_of(i) {
            let (x, f) = (s.metrics.border(side.face), &s.metrics.faces[side.face as usize]);
            let inward = outside(&s, side).dot(&f.area) * -side.sign / f.magnitude();
            if x[0] < 1e-9 {
                // Bilinear by hand: along z first, then along y.
                let z = x[2] / 1.1;
                let at = |row: [f64; 2]| row[0] + z * (row[1] - row[0]);
                let rows = [[0.0, 1.0], [2.0, 2.5], [-0.5, 1.0]].map(at);
                let k = usize::from(x[1] > 0.4);
                let shape = rows[k] + (x[1] / 0.4 - k as f64) * (rows[k + 1] - rows[k]);
                scales[0].push(inward / shape);
            } else {
                scales[1].push(inward / (1.0 + x[0] * x[0] * x[2]));
            }
        }
        // The rate over the integral is one number on a patch.
        for scales in scales {
            let first = scales[0];
            assert!(scales.iter().all(|s| (s / first - 1.0).abs() < 1e-12), "{scales:?}");
        }
        // The same rate through faces that have grown, by the profile where they are now.
        s.accept(1e-2, false);
        s.nodes.iter_mut().for_each(|x| x[2] *= 1.01);
        s.advance(&Step { moved: true, ..at_rest(1e-2) }).unwrap();
        let total = entering(&s, i);
        assert!((total - 1.5).abs() < 1e-12, "{shape:?}, grown: {total}");
    }
}

/// A ring of hexahedra between the radii 1 and 2 m: patches `inner`, `outer` and slip `ends`.
fn ring(nr: usize, na: usize) -> FlowGrid {
    let node = |i: usize, j: usize, k: usize| (i + (nr + 1) * ((j % na) + na * k)) as u32;
    let mut grid = FlowGrid {
        patch_names: ["inner", "outer", "ends"].map(String::from).to_vec(),
        ..FlowGrid::default()
    };
    for k in 0..2 {
        for j in 0..na {
            for i in 0..=nr {
                let (r, a) = (1.0 + i as f64 / nr as f64, TAU * j as f64 / na as f64);
                grid.coords.push([r * a.cos(), r * a.sin(), 0.1 * k as f64]);
            }
        }
    }
    for j in 0..na {
        for i in 0..nr {
            let quad = |k| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
            let (low, high) = (quad(0), quad(1));
            let cell = [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]];
            let wall = Patch::Wall;
            let all = [
                (i == 0, 5, wall, 0),
                (i + 1 == nr, 3, wall, 1),
                (true, 0, Patch::Slip, 2),
                (true, 1, Patch::Slip, 2),
            ];
            for (_, face, patch, name) in all.into_iter().filter(|a| a.0) {
                grid.boundary.push((patch, HEX_FACES[face].map(|v| cell[v])));
                grid.boundary_patch.push(name);
            }
            grid.cells.push(cell);
        }
    }
    grid
}

/// Relative errors of circular Couette flow with the angular velocities of the walls `rates`: largest of the velocity,
/// torque on the inner wall.
fn couette(nr: usize, rates: [f64; 2]) -> [f64; 2] {
    let mu = 0.2 * RHO;
    let grid = ring(nr, 6 * nr);
    let mut settings = settings([0.0; 3], 1e-6);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: mu }, settings);
    let walls = vec![rotate("inner", rates[0]), rotate("outer", rates[1])];
    give(&mut s, &grid, &Data { walls, ..Data::default() }).unwrap();
    steady(&mut s, 0.5, 24);
    let (a, b) = ((4.0 * rates[1] - rates[0]) / 3.0, 4.0 * (rates[0] - rates[1]) / 3.0);
    let off = s.q.iter().zip(&s.metrics.centre).map(|(q, x)| {
        let r = x[0].hypot(x[1]);
        let speed = a * r + b / r;
        let exact = Vec3::new(-x[1], x[0], 0.0) * (speed / r);
        (Vec3::new(q[1], q[2], q[3]) - exact).norm()
    });
    let off = off.fold(0.0, f64::max);
    let domain = s.domain();
    let torque: f64 = s
        .topology
        .no_slip
        .iter()
        .map(|side| (side, s.metrics.border(side.face)))
        .filter(|(_, x)| x.norm() < 1.5)
        .map(|(side, x)| {
            let shear = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side);
            x.cross(&shear)[2] * s.metrics.faces[side.face as usize].magnitude()
        })
        .sum();
    let exact = -4.0 * PI * mu * b * 0.1;
    println!("ring, {nr} cells, {rates:?}: velocity off by {off:.2e}, torque {torque:.6} of {exact:.6} N m");
    [off, (torque / exact - 1.0).abs()]
}

#[test]
fn rotating_walls_drive_circular_couette_flow() {
    let [coarse, fine] = [8, 16].map(|n| couette(n, [1.0, 0.0]));
    for v in 0..2 {
        let order = (coarse[v] / fine[v]).log2();
        println!("{v}: order {order:.2}");
        assert!(fine[v] < 0.01 && order > 1.4, "{coarse:?} {fine:?}");
    }
    // The other wall too, against the first.
    assert!(couette(8, [1.0, -0.5])[0] < 0.02);
}

/// Largest difference from the values of Ghia, Ghia and Shin (1982), table I, Re 100: y and u on the middle line.
const GHIA: [(f64, f64); 15] = [
    (0.0547, -0.03717),
    (0.0625, -0.04192),
    (0.0703, -0.04775),
    (0.1016, -0.06434),
    (0.1719, -0.10150),
    (0.2813, -0.15662),
    (0.4531, -0.21090),
    (0.5000, -0.20581),
    (0.6172, -0.13641),
    (0.7344, 0.00332),
    (0.8516, 0.23151),
    (0.9531, 0.68717),
    (0.9609, 0.73722),
    (0.9688, 0.78871),
    (0.9766, 0.84123),
];

fn cavity(n: usize, steps: usize, by_nodes: bool) -> Solver<Isothermal, 4> {
    let (w, slip) = (Patch::Wall, Patch::Slip);
    let grid = box_grid([n, n, 1], [0.0; 3], [1.0, 1.0, 1.0 / n as f64], [w, w, w, w, slip, slip]);
    let mut settings = settings([0.0; 3], 1e-3);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO / 100.0 }, settings);
    if by_nodes {
        for (x, v) in s.nodes.iter().zip(&mut s.node_velocity) {
            if x[1] > 1.0 - 1e-9 {
                *v = Vec3::x();
            }
        }
    } else {
        let walls = vec![slide("back", [1.0, 0.0, 0.0])];
        give(&mut s, &grid, &Data { walls, ..Data::default() }).unwrap();
    }
    for _ in 0..steps {
        s.advance(&Step { moved: true, ..at_rest(0.1) }).unwrap();
        s.accept(0.1, true);
    }
    s
}

#[test]
fn sliding_lid_drives_the_cavity_of_ghia() {
    let n = 32;
    let s = cavity(n, 300, false);
    // Between the two columns of cells beside the middle line, linear in y, no slip at the walls.
    let mut u = vec![(0.0, 0.0)];
    for j in 0..n {
        let y = (j as f64 + 0.5) / n as f64;
        let near = |c: &[f64; 3]| (c[0] - 0.5).abs() < 0.75 / n as f64 && (c[1] - y).abs() < 1e-9;
        let pair: Vec<f64> =
            s.q.iter().zip(&s.metrics.centre).filter(|(_, c)| near(c)).map(|(q, _)| q[1]).collect();
        assert_eq!(pair.len(), 2);
        u.push((y, 0.5 * (pair[0] + pair[1])));
    }
    u.push((1.0, 1.0));
    let at = |y: f64| {
        let k = u.partition_point(|p| p.0 <= y).min(u.len() - 1);
        let ((y0, u0), (y1, u1)) = (u[k - 1], u[k]);
        u0 + (u1 - u0) * (y - y0) / (y1 - y0)
    };
    let off = GHIA.map(|(y, exact)| at(y) - exact);
    println!("cavity, Re 100, {n} x {n}: differences from Ghia et al. {off:.4?}");
    println!("u at y = 0.4531: {:.5} of -0.21090", at(0.4531));
    assert!(off.iter().all(|d| d.abs() < 0.012), "{off:?}");
    // The same lid as velocities of nodes, bit by bit.
    let (by_wall, by_nodes) = (cavity(8, 3, false), cavity(8, 3, true));
    assert_eq!(by_wall.q, by_nodes.q);
}

/// Nodes oscillate along walls at rest: the air between stays at rest. Where the walls move with the nodes it does not.
#[test]
fn nodes_that_slide_along_a_wall_at_rest_do_not_drag_the_air() {
    let (n, dt) = (8, 0.1);
    let fastest = |at_rest: bool| {
        let grid = box_grid([n, n, 1], [0.0; 3], [1.0, 1.0, 0.1], [Patch::Wall; 6]);
        let mut settings = settings([0.0; 3], 1e-8);
        settings.reference_speed = 0.1;
        let mut s = isothermal(&grid, Laminar { viscosity: RHO / 100.0 }, settings);
        if at_rest {
            s.set_walls_at_rest(|_| true);
        }
        let start = s.nodes.clone();
        for k in 1..=5 {
            let phase = TAU * f64::from(k) / 10.0;
            for (i, x0) in start.iter().enumerate() {
                let bend = (PI * x0[0]).sin() * (0.5 * PI * x0[1]).cos();
                s.nodes[i][0] = x0[0] + 0.05 * phase.sin() * bend;
                s.node_velocity[i] = Vec3::x() * (0.05 * TAU * phase.cos() * bend);
            }
            s.advance(&Step { moved: true, ..crate::common::at_rest(dt) }).unwrap();
            s.accept(dt, true);
        }
        s.q.iter().map(|q| q[1].hypot(q[2])).fold(0.0, f64::max)
    };
    let (at_rest, dragged) = (fastest(true), fastest(false));
    println!("fastest air: {at_rest:.1e} m/s, dragged {dragged:.1e} m/s");
    assert!(at_rest < 1e-13 && dragged > 1e-3, "{at_rest} {dragged}");
}

/// Between walls of which one slides, far from the ends of the channel.
#[test]
fn sliding_wall_keeps_the_linear_profile_of_couette_flow() {
    let n = 8;
    let (w, slip) = (Patch::Wall, Patch::Slip);
    let grid =
        box_grid([6 * n, n, 1], [0.0; 3], [6.0, 1.0, 0.1], [Patch::Inlet, Patch::Outlet, w, w, slip, slip]);
    let mut settings = settings([0.0; 3], 1e-8);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO / 5.0 }, settings);
    let data = Data {
        inlets: vec![inlet("left", [2.0, 0.0, 0.0], Some("y"))],
        walls: vec![MovingWall {
            factor: Some(TimeFactor { formula: Some("0.5".into()), ..TimeFactor::default() }),
            ..slide("back", [4.0, 0.0, 0.0])
        }],
        ..Data::default()
    };
    give(&mut s, &grid, &data).unwrap();
    steady(&mut s, 0.5, 40);
    let middle = |c: &[f64; 3]| (c[0] - 3.0).abs() < 0.1;
    let line = s.q.iter().zip(&s.metrics.centre).filter(|(_, c)| middle(c));
    let off = line.map(|(q, c)| (q[1] - 2.0 * c[1]).abs().max(q[2].abs())).fold(0.0, f64::max);
    println!("plane Couette flow: off by {off:.2e} m/s of 2 m/s");
    assert!(off < 2e-4, "{off}");
}

#[test]
fn inlet_and_outlet_follow_their_factors_of_time() {
    let slip = Patch::Slip;
    let grid = box_grid(
        [10, 2, 2],
        [0.0; 3],
        [1.0, 0.2, 0.2],
        [Patch::Inlet, Patch::Outlet, slip, slip, slip, slip],
    );
    let mut s = isothermal(&grid, Inviscid, settings([0.0, 0.0, 0.0], 1e-9));
    let of = |formula: &str| TimeFactor { formula: Some(formula.into()), ..TimeFactor::default() };
    let table = TimeFactor { time_s: vec![0.0, 0.5], value: vec![0.0, 1.0], ..TimeFactor::default() };
    let data = Data {
        inlets: vec![InletValues {
            factor: Some(of("1 + 0.5*sin(2*pi*t)")),
            ..inlet("left", [2.0, 0.0, 0.0], None)
        }],
        outlets: vec![OutletValues { factor: Some(table), ..outlet("right", 40.0) }],
        ..Data::default()
    };
    give(&mut s, &grid, &data).unwrap();
    let dt = 0.02;
    for k in 1..=50 {
        let t = f64::from(k) * dt;
        s.set_boundary_time(t);
        // A repeated step takes the values of the same time.
        for repeat in [false, true] {
            s.advance(&Step { repeat, ..at_rest(dt) }).unwrap();
        }
        let given = 2.0 * (1.0 + 0.5 * (TAU * t).sin());
        assert!((entering(&s, Patch::Inlet) - 0.04 * given).abs() < 1e-14, "{t} s");
        let speed = leaving(&s, Patch::Outlet) / (0.04 * RHO);
        let pressure =
            s.q.iter().zip(&s.metrics.centre).filter(|(_, c)| c[0] > 0.9).map(|(q, _)| q[0]).sum::<f64>()
                / 4.0;
        // The air is pushed by the acceleration of the inlet: half a cell before the outlet.
        let push = RHO * 2.0 * 0.5 * TAU * (TAU * t).cos() * 0.05;
        let level = 40.0 * (t / 0.5).min(1.0);
        if k % 10 == 0 {
            println!("{t:.2} s: {speed:.4} of {given:.4} m/s leave, {pressure:.3} of {:.3} Pa", level + push);
        }
        // After the first steps, which start the air at once: the acoustic waves in 1 m have left.
        if k > 10 {
            assert!((speed - given).abs() < 0.01, "{t} s: {speed} {given}");
            assert!((pressure - level - push).abs() < 0.3, "{t} s: {pressure} {level}");
        }
        s.accept(dt, false);
    }
}

const STREAM: [f64; 3] = [3.0, -2.0, 4.0];

/// Largest deviation from a uniform stream that single inlets hold while the wind is another, nodes moving at random.
fn drift<G: Gas<N>, const N: usize>(shape: BoxShape, gas: G) -> f64 {
    let (i, o) = (Patch::Inlet, Patch::Outlet);
    let mut grid = box_grid_of(shape, [4, 3, 5], [0.0; 3], [1.0, 0.8, 1.1], [i, o, o, i, i, o]);
    let mut noise = Noise(7);
    grid.coords.iter_mut().flatten().for_each(|x| *x += 0.02 * noise.next());
    let mut s = solver_of(&grid, gas, Inviscid, settings([0.0, 1.0, 0.0], 1e-10));
    let inlets = ["left", "back", "bottom"].map(|side| inlet(side, STREAM, None)).to_vec();
    give(&mut s, &grid, &Data { inlets, ..Data::default() }).unwrap();
    let mut stream = gas.undisturbed(STREAM.into());
    stream[0] = 0.0;
    for k in 0..2 {
        s.previous[k].q.fill(stream);
    }
    s.q.fill(stream);
    let start = s.nodes.clone();
    for _ in 0..8 {
        for (x, x0) in s.nodes.iter_mut().zip(&start) {
            // So little that no air flows back through an outlet: that would have the velocity of the wind.
            *x = x0.map(|x| x + 0.002 * noise.next());
        }
        s.advance(&Step { dt: 4e-3, frame: Vec3::new(0.3, 1.0, -4.9), repeat: false, moved: true }).unwrap();
        s.accept(4e-3, true);
    }
    let off = |q: &[f64; N]| {
        (1..4).map(|d| (q[d] - stream[d]).abs() / 5.4).fold((q[0] - stream[0]).abs() / 18.0, f64::max)
    };
    s.q.iter().map(off).fold(0.0, f64::max)
}

#[test]
fn free_stream_is_preserved_with_data_of_inlets() {
    let air = settings(STREAM, 1.0).air;
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        let e = drift(shape, Isothermal::new(air));
        assert!(e < 1e-12, "{shape:?}: {e:e}");
        let e = drift(shape, IdealGas::new(air));
        assert!(e < 1e-10, "{shape:?}, energy: {e:e}");
    }
}

#[test]
fn unusable_data_are_refused_with_patch_and_place() {
    let (i, o, w) = (Patch::Inlet, Patch::Outlet, Patch::Wall);
    let grid = box_grid([3, 2, 2], [0.0; 3], [1.0; 3], [i, o, w, w, w, w]);
    let of = |data: &Data| {
        let mut s = isothermal(&grid, Laminar { viscosity: 0.1 }, settings([1.0, 0.0, 0.0], 1e-3));
        let given = give(&mut s, &grid, data);
        match given.and_then(|()| s.advance(&at_rest(0.1)).map(|_| ())) {
            Err(FlowError::BoundaryValue(error)) => error,
            other => panic!("{other:?}"),
        }
    };
    let inlets = |inlet: InletValues| Data { inlets: vec![inlet], ..Data::default() };
    let walls = |wall: MovingWall| Data { walls: vec![wall], ..Data::default() };
    let error = of(&inlets(inlet("left", [1.0, 0.0, 0.0], Some("sqrt(y - 0.5)"))));
    let BoundaryValueError::Profile { ref patch, at, .. } = error else { panic!("{error}") };
    assert!(patch == "left" && at[1] == 0.25, "{error}");
    let rate = InletValues {
        velocity_m_s: None,
        flow_rate_m3_s: Some(1.0),
        ..inlet("left", [0.0; 3], Some("y - 0.5"))
    };
    let error = of(&inlets(rate));
    assert!(
        matches!(error, BoundaryValueError::Integral { magnitude, .. } if (magnitude - 0.25).abs() < 1e-12),
        "{error}"
    );
    let error = of(&inlets(inlet("left", [400.0, 0.0, 0.0], None)));
    assert!(matches!(error, BoundaryValueError::Supersonic { speed: 400.0, .. }), "{error}");
    let factor = TimeFactor { formula: Some("1/t".into()), ..TimeFactor::default() };
    let error = of(&inlets(InletValues { factor: Some(factor), ..inlet("left", [1.0, 0.0, 0.0], None) }));
    assert!(matches!(error, BoundaryValueError::Factor { time: 0.0, .. }), "{error}");
    let error = of(&walls(slide("back", [1.0, 0.1, 0.0])));
    assert!(matches!(error, BoundaryValueError::NotTangential { share, .. } if share > 0.09), "{error}");
    assert!(error.to_string().contains("\"back\""), "{error}");
    let error = of(&walls(rotate("back", 1.0)));
    assert!(matches!(error, BoundaryValueError::NotTangential { .. }), "{error}");
}
