//! Bodies whose forces are published. The short tests run with the others; the refined
//! ones, and those that take thousands of steps, by name:
//! `cargo test --release -p flow-solver --test verification published:: -- --ignored --nocapture`

use std::f64::consts::PI;

use crate::bodies::{channel, quarter_shell, ring};
use crate::common::{at_rest, isothermal, settings};
use flow_solver::Solver;
use flow_solver::monitors::Probes;
use flow_solver::physics::{Isothermal, Laminar};
use flow_solver::shear::{Profile, WindShear};
use mesh::Patch;

const RHO: f64 = 1.225;

type Flow = Solver<Isothermal, 4>;

/// Force on the no-slip walls whose middles `on` picks: by pressure, by shear.
fn wall_force(s: &Flow, on: impl Fn(&[f64; 3]) -> bool) -> [[f64; 3]; 2] {
    let domain = s.domain();
    let mut force = [[0.0; 3]; 2];
    for side in &s.topology.no_slip {
        let f = &s.metrics.faces[side.face as usize];
        if !on(&s.metrics.border(side.face).into()) {
            continue;
        }
        let p = s.spatial.wall_pressure(&domain, &s.q, &s.gradient, side);
        let t = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side);
        for d in 0..3 {
            force[0][d] += p * side.sign * f.area[d];
            force[1][d] += f.magnitude() * t[d];
        }
    }
    force
}

/// DFG 2D-1: drag and lift coefficients and the pressure difference over rho, m2/s2 at
/// a mean speed of 0.2 m/s.
fn dfg(n: usize, steps: usize) -> [f64; 3] {
    // The same Reynolds number at a tenth of the speed: the inflow holds its rate against
    // a back pressure of p / (rho c), which falls with the Mach number.
    let (speed, mu) = (0.02, RHO * 1e-4);
    let grid = channel(n);
    let cells = grid.cells.len();
    let mut settings = settings([0.0; 3], 1e-2);
    settings.reference_speed = 0.1 * speed;
    settings.max_iterations = 400;
    let mut s = isothermal(&grid, Laminar { viscosity: mu }, settings);
    // The parabola, so fine a table that its corners are below the grid's error.
    let heights: Vec<f64> = (0..=820).map(|k| 0.41 * f64::from(k) / 820.0).collect();
    let winds = heights.iter().map(|z| [6.0 * speed * z * (0.41 - z) / (0.41 * 0.41), 0.0, 0.0]).collect();
    s.set_shear(WindShear::new(Profile::Table { heights, winds }, 0.0));
    let scale = 0.5 * RHO * speed * speed * 0.1 * 0.02;
    let mut last = [0.0; 3];
    for k in 1..=steps {
        // A mean stream passes the diameter in 5 s and the channel in 110 s.
        let dt = if k <= 10 { 0.5 } else { 4.0 };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
        if k % 20 == 0 || k == steps {
            let [p, t] = wall_force(&s, |x| (x[0] - 0.2).hypot(x[2] - 0.2) < 0.051);
            let points = [0.149_99, 0.250_01].map(|x| [x, -0.01, 0.2]);
            let list: Vec<case::Probe> = points
                .iter()
                .enumerate()
                .map(|(k, x)| case::Probe { name: k.to_string(), position_m: *x })
                .collect();
            let mut probes = Probes::new(&list, &s).unwrap();
            let v = probes.sample(&s);
            let square = (0.2f64 / speed).powi(2);
            last = [(p[0] + t[0]) / scale, (p[2] + t[2]) / scale, (v[0] - v[5]) / RHO * square];
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
fn dfg_channel() {
    let [cd, cl, dp] = dfg(16, 120);
    assert!((cd - DFG[0]).abs() < 0.01 * DFG[0], "{cd}");
    assert!((cl - DFG[1]).abs() < 0.005, "{cl}");
    assert!((dp - DFG[2]).abs() < 0.02 * DFG[2], "{dp}");
}

#[test]
#[ignore = "nightly: 5 minutes"]
fn dfg_channel_refined() {
    let [a, b] = [16, 32].map(|n| dfg(n, 120));
    println!("DFG 2D-1: {a:?} {b:?}");
    let off = |v: [f64; 3]| [0, 1, 2].map(|k| (v[k] - DFG[k]).abs());
    assert!(off(b)[0] < 0.003 * DFG[0] && off(b)[2] < 0.008 * DFG[2], "{b:?}");
    assert!(off(b)[1] < 0.002 && off(b)[1] < off(a)[1], "{a:?} {b:?}");
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
            let x = s.metrics.border(side.face);
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
#[ignore = "nightly: 5 minutes"]
fn sphere_at_reynolds_100_refined() {
    let runs = [(12, 30), (18, 45), (24, 60)].map(|(n, nr)| sphere(100.0, n, nr, 12.0));
    println!("sphere Re 100: {runs:.4?}");
    let (drag, angle) = runs[2];
    // The last grid is still 0.3 % above the published range, and falling.
    assert!((1.075..1.092).contains(&drag) && drag < runs[1].0, "{runs:?}");
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
    for previous in &mut s.previous {
        for (q, x) in previous.q.iter_mut().zip(&s.metrics.centre) {
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
#[ignore = "nightly: 5 minutes"]
fn cylinder_at_reynolds_100() {
    let runs = [(64, 0.0125), (96, 0.0125), (144, 0.0125), (96, 0.006_25)];
    let [_, _, fine, _] = runs.map(|(n, dt)| cylinder_100(n, n, dt, 80.0, 120.0));
    let [drag, lift, _, strouhal] = fine;
    assert!((1.325..1.35).contains(&drag), "{drag}");
    assert!((0.325..0.345).contains(&lift), "{lift}");
    assert!((0.163..0.167).contains(&strouhal), "{strouhal}");
}

/// Solution of Blasius's equation f''' + f f'' / 2 = 0: f' at steps of 0.01 of
/// eta = y sqrt(U / (nu x)), by Runge-Kutta from f''(0) = 0.332057.
fn blasius() -> Vec<f64> {
    let slope = |s: [f64; 3]| [s[1], s[2], -0.5 * s[0] * s[2]];
    let h = 0.01;
    let mut s = [0.0, 0.0, 0.332_057];
    let mut speed = vec![0.0];
    for _ in 0..1200 {
        let step = |k: [f64; 3], a: f64| [s[0] + a * k[0], s[1] + a * k[1], s[2] + a * k[2]];
        let a = slope(s);
        let b = slope(step(a, 0.5 * h));
        let c = slope(step(b, 0.5 * h));
        let d = slope(step(c, h));
        s = std::array::from_fn(|i| s[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        speed.push(s[1]);
    }
    speed
}

/// Boundary layer on a flat plate of 1 m at 1e5 of its length's Reynolds number, on `n`
/// cells across 0.5 m and 2 n along: cf sqrt(Re_x) at x = 0.3, 0.5, 0.7, and the largest
/// error of u / U over the layer at x = 0.5.
#[expect(clippy::too_many_lines, reason = "one case: grid, flow, friction, profile")]
fn plate_layer(n: usize) -> ([f64; 3], f64) {
    let speed = 4.0;
    let nu = speed / 1e5;
    // Lines along the stream, with the leading edge at 0: finer there.
    let ahead = n / 2;
    let spread = |k: usize, m: usize, length: f64, power: f64| length * (k as f64 / m as f64).powf(power);
    let mut x: Vec<f64> = (1..=ahead).rev().map(|k| -spread(k, ahead, 0.5, 2.0)).collect();
    x.extend((0..=3 * n / 2).map(|k| spread(k, 3 * n / 2, 1.1, 1.6)));
    let (growth, h) = (1.0 + 6.0 / n as f64, 0.016 / n as f64);
    let mut y = vec![0.0];
    while y[y.len() - 1] < 0.5 {
        y.push(y[y.len() - 1] + h * growth.powi(y.len() as i32 - 1));
    }
    let (nx, ny) = (x.len() - 1, y.len() - 1);
    let side = Patch::Symmetry;
    let patches = [Patch::FarField, Patch::Outlet, Patch::Wall, Patch::Outlet, side, side];
    let mut grid = mesh::box_grid([nx, ny, 1], [0.0; 3], [nx as f64, ny as f64, 0.01], patches);
    for p in &mut grid.coords {
        *p = [x[p[0].round() as usize], y[p[1].round() as usize], p[2]];
    }
    let coords = &grid.coords;
    for (patch, f) in grid.boundary.iter_mut().filter(|b| b.0 == Patch::Wall) {
        if f.iter().all(|n| coords[*n as usize][0] < 1e-9) {
            *patch = Patch::Slip;
        }
    }
    let mut settings = settings([speed, 0.0, 0.0], 1e-3);
    settings.max_iterations = 300;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO * nu }, settings);
    for k in 0..60 {
        let dt = if k < 10 { 0.005 } else { 0.05 };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
    }
    let domain = s.domain();
    let mut friction: Vec<(f64, f64)> = s
        .topology
        .no_slip
        .iter()
        .map(|side| {
            let x = s.metrics.border(side.face)[0];
            let t = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side)[0];
            (x, t / (0.5 * RHO * speed * speed) * (speed * x / nu).sqrt())
        })
        .collect();
    friction.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |x: f64| {
        let w = friction.windows(2).find(|w| w[0].0 <= x && w[1].0 > x).expect("on the plate");
        w[0].1 + (w[1].1 - w[0].1) * (x - w[0].0) / (w[1].0 - w[0].0)
    };
    let exact = blasius();
    let points: Vec<[f64; 3]> =
        (1..=60).map(|k| [0.5, 0.1 * f64::from(k) * (nu * 0.5 / speed).sqrt(), 0.005]).collect();
    let list: Vec<case::Probe> =
        points.iter().enumerate().map(|(k, x)| case::Probe { name: k.to_string(), position_m: *x }).collect();
    let mut probes = Probes::new(&list, &s).unwrap();
    let rows = probes.sample(&s);
    let off = (1..=60).map(|k| (rows[5 * (k - 1) + 1] / speed - exact[10 * k]).abs()).fold(0.0, f64::max);
    let found = ([at(0.3), at(0.5), at(0.7)], off);
    println!(
        "flat plate, {} cells: cf sqrt(Re_x) {:.4?}, profile off by {off:.4}",
        grid.cells.len(),
        found.0
    );
    found
}

/// Blasius: cf sqrt(Re_x) = 0.664115. At this Reynolds number the leading edge adds less
/// than a hundredth.
#[test]
fn blasius_layer() {
    let coarse = plate_layer(24);
    assert!(blasius_error(&coarse.0) < 0.02 && coarse.1 < 0.02, "{coarse:?}");
}

#[test]
#[ignore = "nightly: 1 minute"]
fn blasius_layer_refined() {
    let (coarse, fine) = (plate_layer(24), plate_layer(48));
    assert!(blasius_error(&fine.0) < 0.006 && fine.1 < 0.01 && fine.1 < coarse.1, "{coarse:?} {fine:?}");
}

fn blasius_error(found: &[f64; 3]) -> f64 {
    found.iter().map(|c| (c / 0.664_115 - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn grid_cells_are_closed() {
    use mesh::{FaceTable, quality};
    for (grid, wanted) in [
        (ring(10, 24, 20.0), 0.1 * 24.0 / 2.0 * (2.0 * PI / 24.0).sin() * (400.0 - 0.25)),
        (channel(8), 0.02 * (2.2 * 0.41 - 16.0 * 0.05 * 0.05 * (2.0 * PI / 32.0).sin())),
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
