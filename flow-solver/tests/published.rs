//! Bodies whose forces are published. The short tests run with the others; the refined
//! ones, and those that take thousands of steps, by name:
//! `cargo test --release -p flow-solver --test published -- --ignored --nocapture`

#[path = "common/bodies.rs"]
mod bodies;
mod common;

use std::f64::consts::PI;

use bodies::{channel, quarter_shell, ring};
use common::{at_rest, isothermal, settings};
use flow_solver::Solver;
use flow_solver::monitors::Probes;
use flow_solver::physics::{Isothermal, Laminar};
use mesh::Patch;

const RHO: f64 = 1.225;

type Flow = Solver<Isothermal, Laminar, 4>;

/// Force on the no-slip walls whose middles `on` picks: by pressure, by shear.
fn wall_force(s: &Flow, on: impl Fn(&[f64; 3]) -> bool) -> [[f64; 3]; 2] {
    let domain = s.domain();
    let mut force = [[0.0; 3]; 2];
    for side in &s.topology.no_slip {
        let f = &s.metrics.faces[side.face as usize];
        if !on(&f.centre) {
            continue;
        }
        let p = s.spatial.wall_pressure(&domain, &s.q, &s.gradient, side);
        let t = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side);
        for d in 0..3 {
            force[0][d] += p * side.sign * f.area[d];
            force[1][d] += f.magnitude * t[d];
        }
    }
    force
}

/// DFG 2D-1: drag and lift coefficients and the pressure difference over rho, m2/s2 at
/// a mean speed of 0.2 m/s. The benchmark's parabolic inflow is that of a developed
/// channel: 3 m of walls before the origin make it from an even stream (at 82 of the
/// height's Reynolds number 1.6 m bring it within 1 %).
fn dfg(n: usize, steps: usize) -> [f64; 3] {
    // The same Reynolds number at a tenth of the speed: the inflow holds its rate against
    // a back pressure of p / (rho c), which falls with the Mach number.
    let (speed, mu) = (0.02, RHO * 1e-4);
    let grid = channel(n, 3.0);
    let cells = grid.cells.len();
    let mut settings = settings([speed, 0.0, 0.0], 1e-2);
    settings.max_iterations = 400;
    let mut s = isothermal(&grid, Laminar { viscosity: mu }, settings);
    let scale = 0.5 * RHO * speed * speed * 0.1 * 0.02;
    let mut last = [0.0; 3];
    for k in 1..=steps {
        // A mean stream passes the diameter in 5 s and the channel in 110 s.
        let dt = if k <= 10 { 0.5 } else { 4.0 };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
        if k % 20 == 0 || k == steps {
            let [p, t] = wall_force(&s, |x| (x[0] - 0.2).hypot(x[1] - 0.2) < 0.051);
            let points = [0.149_99, 0.250_01].map(|x| [x, 0.2, 0.01]);
            let list: Vec<case::Probe> = points
                .iter()
                .enumerate()
                .map(|(k, x)| case::Probe { name: k.to_string(), position_m: *x })
                .collect();
            let mut probes = Probes::new(&list, &s).unwrap();
            let v = probes.sample(&s);
            let list: Vec<case::Probe> = [-3.0, -1.5, 0.0]
                .iter()
                .flat_map(|x| (0..41).map(move |k| [*x, 0.005 + 0.01 * f64::from(k), 0.01]))
                .enumerate()
                .map(|(k, x)| case::Probe { name: k.to_string(), position_m: x })
                .collect();
            let mut across = Probes::new(&list, &s).unwrap();
            for row in across.sample(&s).chunks(5 * 41) {
                let u: Vec<f64> = row.chunks(5).map(|p| p[1] / speed).collect();
                println!("  mean {:.5} middle {:.5} lowest {:.5}", u.iter().sum::<f64>() / 41.0, u[20], u[0]);
            }
            let square = (0.2f64 / speed).powi(2);
            last = [(p[0] + t[0]) / scale, (p[1] + t[1]) / scale, (v[0] - v[5]) / RHO * square];
            println!(
                "DFG 2D-1, {cells} cells, step {k}: cd {:.5} cl {:.6} dp {:.6}",
                last[0], last[1], last[2]
            );
        }
    }
    last
}

const DFG: [f64; 3] = [5.579_535, 0.010_619, 0.117_520];

#[test]
#[ignore = "the inflow is being looked into"]
fn dfg_channel() {
    let [cd, cl, dp] = dfg(16, 120);
    assert!((cd - DFG[0]).abs() < 0.03 * DFG[0], "{cd}");
    assert!((cl - DFG[1]).abs() < 0.01, "{cl}");
    assert!((dp - DFG[2]).abs() < 0.05 * DFG[2], "{dp}");
}

#[test]
#[ignore = "minutes"]
fn dfg_channel_refined() {
    let [a, b, c] = [16, 32, 64].map(|n| dfg(n, 120));
    println!("DFG 2D-1: {a:?} {b:?} {c:?}");
    let off = |v: [f64; 3]| [0, 1, 2].map(|k| (v[k] - DFG[k]).abs());
    assert!(off(c)[0] < 0.005 * DFG[0] && off(c)[2] < 0.01 * DFG[2], "{c:?}");
    assert!(off(c)[0] < 0.5 * off(a)[0], "{a:?} {c:?}");
}

/// Sphere at a Reynolds number, as a quarter: drag coefficient and angle of separation
/// from the front, degrees (180: none).
fn sphere(reynolds: f64, n: usize, nr: usize, end: f64) -> (f64, f64) {
    let grid = quarter_shell(n, nr, 20.0);
    let cells = grid.cells.len();
    let speed = 4.0;
    let mut settings = settings([speed, 0.0, 0.0], 1e-2);
    settings.max_iterations = 200;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO * speed / reynolds }, settings);
    let (mut t, mut k, mut drag) = (0.0, 0, 0.0);
    while t < end {
        let dt = if k < 20 { 0.01 } else { 0.05 };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
        t += dt;
        k += 1;
        if k % 40 == 20 || t >= end {
            let [p, v] = wall_force(&s, |_| true);
            let scale = 0.5 * RHO * speed * speed * 0.25 * PI * 0.25;
            drag = (p[0] + v[0]) / scale;
            println!(
                "sphere Re {reynolds}, {cells} cells, t U/D {:.1}: cd {drag:.4} (pressure {:.4})",
                t * speed,
                p[0] / scale
            );
        }
    }
    // Where the shear along the meridian turns, in the row of cells next to z = 0.
    let domain = s.domain();
    let mut row: Vec<(f64, f64)> = s
        .topology
        .no_slip
        .iter()
        .filter_map(|side| {
            let x = s.metrics.faces[side.face as usize].centre;
            let angle = 180.0 - (x[1].hypot(x[2])).atan2(x[0]).to_degrees();
            let tangent =
                [x[1].hypot(x[2]), -x[0] * x[1] / x[1].hypot(x[2]), -x[0] * x[2] / x[1].hypot(x[2])];
            let v = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side);
            let shear = v[0] * tangent[0] + v[1] * tangent[1] + v[2] * tangent[2];
            (x[2] < 0.6 * 0.5 / n as f64 * PI).then_some((angle, shear))
        })
        .collect();
    row.sort_by(|a, b| a.0.total_cmp(&b.0));
    let turn = row.windows(2).find(|w| w[0].0 > 60.0 && w[0].1 > 0.0 && w[1].1 <= 0.0);
    let angle = turn.map_or(180.0, |w| w[0].0 + w[0].1 * (w[1].0 - w[0].0) / (w[0].1 - w[1].1));
    println!("sphere Re {reynolds}, {cells} cells: cd {drag:.4}, separation at {angle:.1} degrees");
    (drag, angle)
}

/// Published: drag coefficient 1.08 to 1.087, separation at 126 to 127 degrees.
#[test]
fn sphere_at_reynolds_100() {
    let (drag, angle) = sphere(100.0, 12, 30, 6.0);
    assert!((drag - 1.084).abs() < 0.04, "{drag}");
    assert!((angle - 126.5).abs() < 4.0, "{angle}");
}

#[test]
#[ignore = "minutes"]
fn sphere_at_reynolds_100_refined() {
    let runs = [(12, 30), (18, 45), (24, 60)].map(|(n, nr)| sphere(100.0, n, nr, 12.0));
    println!("sphere Re 100: {runs:.4?}");
    let (drag, angle) = runs[2];
    assert!((1.075..1.092).contains(&drag), "{drag}");
    assert!((angle - 126.5).abs() < 1.5, "{angle}");
}

/// Cylinder at Re 100: mean drag, amplitude of the lift and its root mean square,
/// Strouhal number, over the whole periods after `from`.
fn cylinder_100(nr: usize, na: usize, dt: f64, from: f64, end: f64) -> [f64; 4] {
    let grid = ring(nr, na, 50.0);
    let speed = 4.0;
    let mut s =
        isothermal(&grid, Laminar { viscosity: RHO * speed / 100.0 }, settings([speed, 0.0, 0.0], 1e-3));
    // A little lift to start with: shedding needs no patience then.
    for past in &mut s.past {
        for (q, x) in past.q.iter_mut().zip(&s.metrics.centre) {
            let r2 = x[0] * x[0] + x[1] * x[1];
            q[2] += speed * 0.3 * x[0] / r2 * (-0.1 * r2).exp();
        }
    }
    let scale = 0.5 * RHO * speed * speed * 0.1;
    let mut series: Vec<[f64; 3]> = Vec::new();
    let steps = (end / speed / dt).round() as usize;
    for k in 1..=steps {
        let dt = if k <= 20 { 0.2 * dt } else { dt };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
        let [p, v] = wall_force(&s, |_| true);
        let t = series.last().map_or(0.0, |l| l[0]) + dt;
        series.push([t, (p[0] + v[0]) / scale, (p[1] + v[1]) / scale]);
        if k % 200 == 0 {
            println!("t U/D {:.1}: cd {:.4} cl {:.4}", t * speed, series[k - 1][1], series[k - 1][2]);
        }
    }
    let late: Vec<&[f64; 3]> = series.iter().filter(|r| r[0] * speed > from).collect();
    // Upward crossings of zero lift.
    let ups: Vec<(usize, f64)> = late
        .windows(2)
        .enumerate()
        .filter(|(_, w)| w[0][2] < 0.0 && w[1][2] >= 0.0)
        .map(|(k, w)| (k, w[0][0] - w[0][2] * (w[1][0] - w[0][0]) / (w[1][2] - w[0][2])))
        .collect();
    assert!(ups.len() >= 2, "no shedding");
    let (a, b) = (ups[0], ups[ups.len() - 1]);
    let periods = (ups.len() - 1) as f64;
    let strouhal = periods / (b.1 - a.1) / speed;
    let whole = &late[a.0..b.0];
    let n = whole.len() as f64;
    let drag = whole.iter().map(|r| r[1]).sum::<f64>() / n;
    let rms = (whole.iter().map(|r| r[2] * r[2]).sum::<f64>() / n).sqrt();
    let amplitude = whole.iter().map(|r| r[2].abs()).fold(0.0, f64::max);
    println!(
        "cylinder Re 100, {nr} x {na}, dt U/D {:.3}: cd {drag:.4}, cl amplitude {amplitude:.4}, rms {rms:.4}, St {strouhal:.4}, {periods} periods",
        dt * speed
    );
    [drag, amplitude, rms, strouhal]
}

/// Published: Strouhal number 0.164 to 0.165, drag 1.33 to 1.35, lift 0.33 to 0.34.
#[test]
#[ignore = "thousands of steps"]
fn cylinder_at_reynolds_100() {
    let coarse = cylinder_100(64, 64, 0.0125, 80.0, 120.0);
    let fine = cylinder_100(96, 96, 0.0125, 80.0, 120.0);
    println!("cylinder Re 100: {coarse:.4?} {fine:.4?}");
    let [drag, lift, _, strouhal] = fine;
    assert!((1.31..1.37).contains(&drag), "{drag}");
    assert!((0.32..0.35).contains(&lift), "{lift}");
    assert!((0.162..0.167).contains(&strouhal), "{strouhal}");
}

#[test]
fn grids_close() {
    use mesh::{FaceTable, quality};
    for (grid, wanted) in [
        (ring(10, 24, 20.0), 0.1 * 24.0 / 2.0 * (2.0 * PI / 24.0).sin() * (400.0 - 0.25)),
        (channel(8, 1.0), 0.02 * (3.2 * 0.41 - 16.0 * 0.05 * 0.05 * (2.0 * PI / 32.0).sin())),
    ] {
        let faces = FaceTable::new(&grid).unwrap();
        let volume: f64 = (0..grid.cells.len()).map(|c| quality::cell_volume(&grid, c)).sum();
        assert!((volume - wanted).abs() < 1e-9 * wanted, "{volume} {wanted}");
        assert!(quality::summary(&grid).min_scaled_jacobian > 0.2);
        assert!(faces.boundary.iter().any(|b| b.0 == Patch::Wall));
    }
    let shell = quarter_shell(8, 6, 5.0);
    FaceTable::new(&shell).unwrap();
    let volume: f64 = (0..shell.cells.len()).map(|c| quality::cell_volume(&shell, c)).sum();
    assert!((volume / (PI / 3.0 * (125.0 - 0.125)) - 1.0).abs() < 0.03, "{volume}");
}
