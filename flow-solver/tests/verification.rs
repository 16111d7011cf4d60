//! Answers that are known: exact solutions, published tables, other programs.

#![allow(clippy::needless_range_loop)]

mod common;
#[path = "common/plate.rs"]
mod plate;

use std::f64::consts::PI;

use common::{at_rest, isothermal, settings, solver_of};
use flow_solver::physics::{Gas, IdealGas, Inviscid, Isothermal, Laminar, Smagorinsky};
use flow_solver::{Loads, Method, Step};
use mesh::{Patch, box_grid};

/// Error of the velocity of a decaying Taylor-Green vortex on n x n cells
/// between slip walls, where it is exact; the inner grid lines may sway.
fn taylor_green(n: usize, sway: f64) -> f64 {
    let grid = box_grid([n, n, 1], [0.0; 3], [PI, PI, PI / n as f64], [Patch::Slip; 6]);
    let nu = 0.05;
    let mut settings = settings([0.0; 3], 1e-5);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: nu * 1.225 }, settings);
    let exact = |x: &[f64; 3], t: f64| {
        let f = (-2.0 * nu * t).exp();
        let p = 1.225 * 0.25 * f * f * ((2.0 * x[0]).cos() + (2.0 * x[1]).cos());
        [p, f * x[0].sin() * x[1].cos(), -f * x[0].cos() * x[1].sin(), 0.0]
    };
    let start = s.nodes.clone();
    let steps = n;
    let dt = 1.0 / steps as f64;
    let place = |t: f64, x: &[f64; 3]| {
        let a = sway * (2.0 * x[0]).sin() * (2.0 * x[1]).sin() * (1.0 + (3.0 * t).sin());
        [x[0] + a, x[1] + 0.7 * a, x[2]]
    };
    let placed = |t: f64| start.iter().map(|x| place(t, x)).collect::<Vec<_>>();
    // Two exact instants, so that BDF2 starts as BDF2.
    let mut past = s.past.clone();
    for (k, p) in past.iter_mut().enumerate() {
        let t = -(k as f64) * dt;
        p.nodes = placed(t);
        let m = flow_solver::geometry::Metrics::new(&s.topology, &s.halo, &p.nodes);
        p.q = m.centre.iter().map(|x| exact(x, t)).collect();
    }
    s.restore(past, dt, 0).unwrap();
    for k in 1..=steps {
        s.nodes = placed(k as f64 * dt);
        s.advance(&Step { dt, frame: [0.0; 3], again: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let (mut sum, mut volume) = (0.0, 0.0);
    for i in 0..s.topology.n_owned {
        let e = exact(&s.metrics.centre[i], 1.0);
        let v = s.metrics.volume[i];
        sum += v * ((s.q[i][1] - e[1]).powi(2) + (s.q[i][2] - e[2]).powi(2));
        volume += v;
    }
    (sum / volume).sqrt()
}

#[test]
fn taylor_green_is_of_second_order() {
    // (sway, largest error on 32 x 32)
    for (sway, bound) in [(0.0, 1e-3), (0.06, 2e-3)] {
        let (coarse, fine) = (taylor_green(16, sway), taylor_green(32, sway));
        let order = (coarse / fine).log2();
        assert!(order > 1.75, "sway {sway}: {coarse:.3e} to {fine:.3e} is order {order:.2}");
        assert!(fine < bound, "sway {sway}: error {fine:.3e}");
    }
}

/// Largest difference of the lid-driven cavity on `n` x `n` cells from values on the
/// lines through the middle: (y, u on x = 0.5) and (x, v on y = 0.5).
fn cavity(reynolds: f64, n: usize, end: f64, u: &[(f64, f64)], v: &[(f64, f64)]) -> f64 {
    let wall = Patch::Wall;
    let patches = [wall, wall, wall, wall, Patch::Slip, Patch::Slip];
    let grid = box_grid([n, n, 1], [0.0; 3], [1.0, 1.0, 1.0 / n as f64], patches);
    let mut settings = settings([0.0; 3], 1e-3);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: 1.225 / reynolds }, settings);
    for (x, v) in s.nodes.iter().zip(&mut s.node_velocity) {
        if x[1] > 1.0 - 1e-9 {
            *v = [1.0, 0.0, 0.0];
        }
    }
    let dt = 0.5;
    for _ in 0..(end / dt) as usize {
        s.advance(&Step { dt, frame: [0.0; 3], again: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let at = |x: f64, y: f64, v: usize| {
        // From the nearest cell by its gradient.
        let near = |c: &[f64; 3]| (c[0] - x).powi(2) + (c[1] - y).powi(2);
        let i = (0..n * n)
            .min_by(|&a, &b| near(&s.metrics.centre[a]).total_cmp(&near(&s.metrics.centre[b])))
            .unwrap();
        let (c, g) = (&s.metrics.centre[i], &s.gradient[i]);
        s.q[i][v] + g[0][v] * (x - c[0]) + g[1][v] * (y - c[1])
    };
    let u = u.iter().map(|&(y, value)| (at(0.5, y, 1) - value).abs());
    let v = v.iter().map(|&(x, value)| (at(x, 0.5, 2) - value).abs());
    u.chain(v).fold(0.0, f64::max)
}

/// Ghia, Ghia and Shin 1982, Re 100: u on the vertical and v on the horizontal line.
const GHIA_100_U: [(f64, f64); 9] = [
    (0.9531, 0.68717),
    (0.8516, 0.23151),
    (0.7344, 0.00332),
    (0.6172, -0.13641),
    (0.5, -0.20581),
    (0.4531, -0.21090),
    (0.2813, -0.15662),
    (0.1719, -0.10150),
    (0.0703, -0.04775),
];
const GHIA_100_V: [(f64, f64); 4] =
    [(0.9063, -0.16914), (0.8047, -0.24533), (0.5, 0.05454), (0.2344, 0.17527)];

#[test]
fn lid_driven_cavity() {
    let off = cavity(100.0, 32, 30.0, &GHIA_100_U, &GHIA_100_V);
    println!("cavity, Re 100, 32 x 32: off by {off:.4}");
    assert!(off < 0.008, "{off}");
}

/// `cargo test --release -p flow-solver --test verification cavity -- --ignored --nocapture`
#[test]
#[ignore = "minutes, and fails today: off by 0.0081 at Re 100 (docs/verification.md, known gaps)"]
fn lid_driven_cavity_refined() {
    let u400 = [(0.9531, 0.55892), (0.8516, 0.29093), (0.7344, 0.16256), (0.5, -0.11477)];
    let u400 = [&u400[..], &[(0.2813, -0.32726), (0.1719, -0.24299), (0.0703, -0.10338)]].concat();
    let v400 = [(0.8594, -0.44993), (0.8047, -0.38598), (0.5, 0.05186), (0.2344, 0.30174), (0.0781, 0.20920)];
    let u1000 = [(0.9531, 0.46604), (0.8516, 0.33304), (0.7344, 0.18719), (0.5, -0.06080)];
    let u1000 = [&u1000[..], &[(0.2813, -0.27805), (0.1719, -0.38289), (0.0703, -0.22220)]].concat();
    let v1000 =
        [(0.9063, -0.51550), (0.8047, -0.31966), (0.5, 0.02526), (0.2344, 0.32235), (0.0781, 0.30353)];
    for (reynolds, end, u, v, bound) in [
        (100.0, 30.0, &GHIA_100_U[..], &GHIA_100_V[..], 0.004),
        (400.0, 50.0, &u400[..], &v400[..], 0.008),
        (1000.0, 80.0, &u1000[..], &v1000[..], 0.012),
    ] {
        let off = [32, 64, 96].map(|n| cavity(reynolds, n, end, u, v));
        println!("cavity, Re {reynolds}: off by {off:.4?} at most on 32, 64, 96 cells a side");
        assert!(off[2] < bound, "Re {reynolds}: {off:?}");
    }
}

/// Drag coefficient after `steps` steps on the plate at `speed`, with the
/// iterations of all steps.
fn plate_drag<G: Gas<N>, const N: usize>(
    gas: G,
    every: usize,
    steps: usize,
    speed: f64,
    method: Method,
    drop: f64,
) -> (f64, usize) {
    let grid = plate::plate(every);
    let mut settings = settings([0.0, 0.0, speed], drop);
    settings.method = method;
    settings.max_iterations = 2000;
    // Reynolds number 200 and the Courant number of the common case at any speed.
    let viscosity = Laminar { viscosity: speed / 200.0 * 1.225 };
    let dt = 0.02 * 4.88 / speed;
    let mut s = solver_of(&grid, gas, viscosity, settings);
    let mut loads = Loads::new(&s);
    let (mut force, mut iterations) = (0.0, 0);
    for _ in 0..steps {
        iterations += s.advance(&at_rest(dt)).unwrap().iterations;
        force = loads.compute(&s).force[2];
        s.accept(dt, false);
    }
    (force / (0.5 * 1.225 * speed * speed), iterations)
}

const DEFAULT: Method = Method::PressureCorrection { depth: 5 };

#[test]
fn plate_in_a_stream() {
    let air = settings([0.0; 3], 1.0).air;
    let (drag, _) = plate_drag(Isothermal::new(air), 2, 20, 4.88, DEFAULT, 1e-2);
    // OpenFOAM, code_saturne and SU2 span 1.534 to 1.563 on a grid twice as fine.
    assert!((drag - 1.55).abs() < 0.06, "{drag}");
}

#[test]
fn all_methods_and_gases_agree_at_low_speed() {
    let air = settings([0.0; 3], 1.0).air;
    let (drag, _) = plate_drag(Isothermal::new(air), 4, 3, 4.88, DEFAULT, 1e-6);
    let (paper, _) = plate_drag(Isothermal::new(air), 4, 3, 4.88, Method::LuSgs { courant: 1e3 }, 1e-4);
    assert!((drag - paper).abs() < 1e-3 * drag, "LU-SGS: {paper}, pressure correction: {drag}");
    let (single, _) =
        plate_drag(Isothermal::new(air), 4, 3, 4.88, Method::PressureCorrection { depth: 0 }, 1e-6);
    assert!((drag - single).abs() < 1e-5 * drag, "not combined: {single}, combined: {drag}");
    // Sound is faster with the energy equation, which the third step still feels a little.
    let (energy, _) = plate_drag(IdealGas::new(air), 4, 8, 4.88, DEFAULT, 1e-4);
    let (without, _) = plate_drag(Isothermal::new(air), 4, 8, 4.88, DEFAULT, 1e-4);
    assert!((energy - without).abs() < 0.01 * drag, "with energy {energy}, without {without}");
}

#[test]
fn cost_and_drag_do_not_depend_on_the_mach_number() {
    let air = settings([0.0; 3], 1.0).air;
    let sound = (air.gas_constant * air.temperature).sqrt();
    let run = |mach: f64| plate_drag(Isothermal::new(air), 4, 12, mach * sound, DEFAULT, 1e-3);
    let runs = [run(1e-3), run(1e-2), run(1e-1)];
    // At Mach 0.1 sound crosses few cells in a step, which makes it cheaper, not dearer.
    let cost = runs.map(|r| r.1 as f64);
    assert!(cost[0] < 1.5 * cost[1] && cost[1] < 1.5 * cost[0], "iterations: {runs:?}");
    assert!(cost[2] < 1.5 * cost[1], "iterations at Mach 1e-3, 1e-2, 1e-1: {runs:?}");
    // Pressure scales with the square of the Mach number up to the compressibility itself.
    assert!((runs[0].0 - runs[1].0).abs() < 0.01 * runs[0].0, "{runs:?}");
    assert!((runs[0].0 - runs[2].0).abs() < 0.1 * runs[0].0, "{runs:?}");
}

/// Pressure differences over the plate fall with the square of the Mach number, and
/// each iteration takes the same share of the residual away.
#[test]
fn pressure_goes_with_the_square_of_the_mach_number() {
    let air = settings([0.0; 3], 1.0).air;
    let sound = (air.gas_constant * air.temperature).sqrt();
    let grid = plate::plate(4);
    let run = |mach: f64| {
        let speed = mach * sound;
        let mut settings = settings([0.0, 0.0, speed], 1e-5);
        settings.max_iterations = 2000;
        let mut s = isothermal(&grid, Laminar { viscosity: speed / 200.0 * 1.225 }, settings);
        let dt = 0.02 * 4.88 / speed;
        let (mut decades, mut iterations) = (0.0, 0);
        for k in 0..12 {
            let r = s.advance(&at_rest(dt)).unwrap();
            s.accept(dt, false);
            if k >= 4 {
                decades += (r.start / r.end).log10();
                iterations += r.iterations;
            }
        }
        let p = s.q.iter().map(|q| q[0]);
        let range = p.clone().fold(f64::MIN, f64::max) - p.fold(f64::MAX, f64::min);
        (range / air.pressure(), decades / iterations as f64)
    };
    let runs = [1e-3, 1e-2, 1e-1].map(run);
    for w in runs.windows(2) {
        let slope = (w[1].0 / w[0].0).log10();
        println!(
            "pressure range {:.3e} to {:.3e}: slope {slope:.3}; decades an iteration {:.3}, {:.3}",
            w[0].0, w[1].0, w[0].1, w[1].1
        );
        assert!((slope - 2.0).abs() < 0.05, "{runs:?}");
        let rate = w[1].1 / w[0].1;
        assert!((1.0 / 1.5..1.5).contains(&rate), "decades of residual an iteration: {runs:?}");
    }
}

/// A pressure that alternates from cell to cell does not survive.
#[test]
fn checkerboards_die() {
    let n = 8;
    let grid = box_grid([n, n, n], [0.0; 3], [1.0; 3], [Patch::Slip; 6]);
    let mut settings = settings([0.0; 3], 1e-6);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Inviscid, settings);
    for past in &mut s.past {
        for (c, q) in past.q.iter_mut().enumerate() {
            let odd = (c % n + (c / n) % n + c / (n * n)) % 2;
            q[0] = if odd == 1 { 10.0 } else { -10.0 };
        }
    }
    for _ in 0..10 {
        s.advance(&at_rest(5e-3)).unwrap();
        s.accept(5e-3, false);
    }
    let left = s.q.iter().fold(0.0f64, |m, q| m.max(q[0].abs()));
    assert!(left < 0.1, "{left} Pa of 10 are left");
}

/// A wall-bounded box of still air stays still under the sub-grid model too.
#[test]
fn still_air_stays_still() {
    let grid = box_grid([5, 4, 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
    let mut s = isothermal(&grid, Smagorinsky { viscosity: 1.8e-5 }, settings([0.0; 3], 1e-6));
    s.advance(&at_rest(0.01)).unwrap();
    assert!(s.q.iter().flatten().all(|x| x.abs() < 1e-14));
}

/// Repeating a step from its own result gives the same result, and a little work.
#[test]
fn repeated_steps_start_warm() {
    let grid = plate::plate(4);
    let mut s = isothermal(&grid, Inviscid, settings([0.0, 0.0, 4.88], 1e-5));
    let mut loads = Loads::new(&s);
    for _ in 0..4 {
        s.advance(&at_rest(5e-3)).unwrap();
        s.accept(5e-3, false);
    }
    let first = s.advance(&at_rest(5e-3)).unwrap();
    let force = loads.compute(&s).force[2];
    let again = s.advance(&Step { again: true, ..at_rest(5e-3) }).unwrap();
    assert_eq!(again.iterations, 0);
    // A slightly different frame speed, then back: the first answer again.
    let other = Step { again: true, frame: [0.0, 0.0, -0.05], ..at_rest(5e-3) };
    let changed = s.advance(&other).unwrap();
    assert!(changed.iterations <= first.iterations, "{changed:?} after {first:?}");
    s.advance(&Step { again: true, ..at_rest(5e-3) }).unwrap();
    let back = loads.compute(&s).force[2];
    assert!((back - force).abs() < 1e-3 * force.abs(), "{back} and {force}");
}
