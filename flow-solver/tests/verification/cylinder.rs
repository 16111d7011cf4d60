//! Flow around half a circular cylinder, cut along its symmetry plane.

#![allow(clippy::needless_range_loop)]

use std::f64::consts::PI;

use crate::common::{at_rest, isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{Inviscid, Isothermal, Laminar};
use flow_solver::steady::March;
use flow_solver::{Method, Solver};
use mesh::{FlowGrid, Patch, box_grid};

const SPEED: f64 = 4.0;
const RHO: f64 = 1.225;

/// `nr` x `na` cells from radius 0.5 m to `far`, growing outwards, one cell deep.
fn half_ring(nr: usize, na: usize, far: f64, wall: Patch) -> FlowGrid {
    let side = Patch::Symmetry;
    // Indices run radially, then from the rear stagnation point to the front.
    let patches = [wall, Patch::FarField, side, side, Patch::Slip, Patch::Slip];
    let mut grid = box_grid([nr, na, 1], [0.0; 3], [nr as f64, na as f64, 0.1], patches);
    for x in &mut grid.coords {
        let r = 0.5 * (2.0 * far).powf(x[0] / nr as f64);
        let a = PI * x[1] / na as f64;
        *x = [r * a.cos(), r * a.sin(), x[2]];
    }
    grid
}

/// Drag coefficient (of the diameter, both halves), and the pressure coefficient on the
/// wall by angle from the front, degrees.
fn on_wall(s: &Solver<Isothermal, 4>) -> (f64, Vec<(f64, f64)>) {
    let on = s.domain();
    let t = on.topology;
    let dynamic = 0.5 * RHO * SPEED * SPEED;
    let (mut force, mut coefficients) = (0.0, Vec::new());
    for side in t.slip.iter().chain(&t.no_slip) {
        let f = &on.metrics.faces[side.face as usize];
        let [x, y, _] = on.metrics.border(side.face).into();
        if x.hypot(y) > 0.51 || f.area[2].abs() > 0.5 * f.magnitude() {
            continue;
        }
        let p = s.spatial.wall_pressure(&on, &s.q, &s.gradient, side);
        force += p * f.area[0];
        if s.spatial.viscosity.is_active() {
            force += f.magnitude() * s.spatial.wall_traction(&on, &s.scheme, &s.q, side)[0];
        }
        coefficients.push((180.0 - y.atan2(x).to_degrees(), p / dynamic));
    }
    coefficients.sort_by(|a, b| a.0.total_cmp(&b.0));
    (2.0 * force / (dynamic * 0.1), coefficients)
}

/// Largest difference of the pressure coefficient from potential flow up to 120 degrees
/// from the front, and the drag coefficient,
/// after the stream has gone eight diameters.
fn inviscid(nr: usize, na: usize) -> (f64, f64) {
    let grid = half_ring(nr, na, 20.0, Patch::Slip);
    let mut s = isothermal(&grid, Inviscid, settings([SPEED, 0.0, 0.0], 1e-4));
    for _ in 0..40 {
        s.advance(&at_rest(0.05)).unwrap();
        s.accept(0.05, false);
    }
    let (drag, wall) = on_wall(&s);
    assert_eq!(wall.len(), na);
    let off = |&(angle, found): &(f64, f64)| (found - 1.0 + 4.0 * angle.to_radians().sin().powi(2)).abs();
    // Behind, the loss of total pressure along the wall has gathered: see the next test.
    (wall.iter().filter(|w| w.0 < 120.0).map(off).fold(0.0, f64::max), drag)
}

#[test]
fn inviscid_flow_converges_to_potential_flow() {
    let (coarse, fine) = (inviscid(30, 48), inviscid(60, 96));
    println!("inviscid cylinder: pressure coefficient and drag off by {coarse:.4?}, refined {fine:.4?}");
    assert!(fine.0 < 0.08 && fine.0 < 0.4 * coarse.0, "{coarse:?} {fine:?}");
    assert!(fine.1.abs() < 0.03, "d'Alembert: {}", fine.1);
}

/// The march ends at the drag that the run in time (below) approaches: 1.5311, 1.5264 after 180 and
/// 220 steps, 440 corrections; half a per cent is what that still has to go.
#[test]
fn steady_march_converges_to_the_steady_wake() {
    let grid = half_ring(72, 64, 40.0, Patch::Wall);
    let viscosity = Laminar { viscosity: RHO * SPEED / 40.0 };
    let mut set = settings([SPEED, 0.0, 0.0], 1e-2);
    set.method = Method::PressureCorrection { depth: 10 };
    let mut s = isothermal(&grid, viscosity, set);
    let march = March { residual_drop: 1e-5, force_change: 1e-5, max_steps: 300, max_courant: 1e3 };
    let marched = march.run(&mut s, Vec3::zeros(), |s| Vec3::x() * on_wall(s).0).unwrap();
    let drag = on_wall(&s).0;
    println!("march: drag coefficient {drag:.4}, {marched:?}");
    assert!((drag / 1.527 - 1.0).abs() < 5e-3, "{drag}");
    assert!(marched.iterations < 250, "{marched:?}");
}

/// Where the wall behind 120 degrees goes wrong: largest error of the pressure coefficient
/// and least total-pressure coefficient (1 in potential flow) of the cells along the wall,
/// by sector, in time and with refinement.
/// `cargo test --release -p flow-solver --test verification rear -- --ignored --nocapture`
#[test]
#[ignore = "nightly: 1 minute"]
fn inviscid_rear_of_the_cylinder() {
    let mut ends = Vec::new();
    for (nr, na) in [(30, 48), (60, 96), (120, 192)] {
        let grid = half_ring(nr, na, 20.0, Patch::Slip);
        let mut s = isothermal(&grid, Inviscid, settings([SPEED, 0.0, 0.0], 1e-4));
        let mut end = [0.0f64; 2];
        for k in 1..=40 {
            s.advance(&at_rest(0.05)).unwrap();
            s.accept(0.05, false);
            if ![2, 5, 10, 20, 40].contains(&k) {
                continue;
            }
            let (drag, wall) = on_wall(&s);
            let dynamic = 0.5 * RHO * SPEED * SPEED;
            let mut rows = String::new();
            // Of the last time: the impulsive start is an error of its own.
            end = [0.0; 2];
            for (k, (from, to)) in
                [(0.0, 90.0), (90.0, 120.0), (120.0, 150.0), (150.0, 180.0)].into_iter().enumerate()
            {
                let off = |w: &(f64, f64)| (w.1 - 1.0 + 4.0 * w.0.to_radians().sin().powi(2)).abs();
                let error = wall.iter().filter(|w| w.0 >= from && w.0 < to).map(off).fold(0.0, f64::max);
                let near = s.metrics.centre.iter().zip(&s.q).filter(|(x, _)| {
                    let a = 180.0 - x[1].atan2(x[0]).to_degrees();
                    x[0].hypot(x[1]) < 0.5 * (40f64).powf(1.0 / nr as f64) && a >= from && a < to
                });
                let total = near
                    .map(|(_, q)| (q[0] + 0.5 * RHO * (q[1] * q[1] + q[2] * q[2])) / dynamic)
                    .fold(f64::INFINITY, f64::min);
                rows += &format!("  {from:.0}-{to:.0}: {error:.4} (total {total:.4})");
                if k == 3 {
                    end[1] = error;
                }
                end[0] = end[0].max(if k < 2 { error } else { 0.0 });
            }
            println!("{nr} x {na}, {:.1} diameters: drag {drag:.4}{rows}", f64::from(k) * 0.05 * SPEED);
        }
        ends.push(end);
    }
    // No separation: the flow stands still after two diameters. The air next to the wall
    // loses total pressure all along it, and this truncation falls to about second order.
    assert!(ends[1][1] < 0.5 * ends[0][1] && ends[2][1] < 0.35 * ends[1][1], "{ends:?}");
    assert!(ends[2][1] < 0.08 && ends[2][0] < 0.02, "{ends:?}");
}

/// Published: drag coefficient 1.50 to 1.62, wake 2.1 to 2.35 diameters long.
#[test]
fn steady_wake_at_reynolds_40() {
    let grid = half_ring(72, 64, 40.0, Patch::Wall);
    let viscosity = Laminar { viscosity: RHO * SPEED / 40.0 };
    let mut s = isothermal(&grid, viscosity, settings([SPEED, 0.0, 0.0], 1e-2));
    let (mut last, mut iterations) = (0.0, 0);
    for k in 1..=220 {
        let dt = if k <= 20 { 0.01 } else { 0.05 };
        iterations += s.advance(&at_rest(dt)).unwrap().iterations;
        s.accept(dt, false);
        if k % 40 == 20 {
            last = on_wall(&s).0;
            println!("step {k}: drag coefficient {last:.4}, {iterations} iterations so far");
        }
    }
    // Length of the bubble behind the cylinder: where u along the axis changes sign.
    let mut axis: Vec<(f64, f64)> = s
        .metrics
        .centre
        .iter()
        .zip(&s.q)
        .filter(|(x, _)| x[0] > 0.5 && x[1] < 0.06 * x[0])
        .map(|(x, q)| (x[0] - 0.5, q[1]))
        .collect();
    axis.sort_by(|a, b| a.0.total_cmp(&b.0));
    let turn = axis.windows(2).find(|w| w[0].1 < 0.0 && w[1].1 >= 0.0).expect("a wake");
    let length = turn[0].0 - turn[0].1 * (turn[1].0 - turn[0].0) / (turn[1].1 - turn[0].1);
    println!("Re 40: drag coefficient {last:.4}, wake length {length:.3} diameters");
    assert!((1.50..1.62).contains(&last), "{last}");
    assert!((2.1..2.35).contains(&length), "{length}");
}
