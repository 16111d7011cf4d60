//! Orders of accuracy: manufactured and exact solutions on refined grids.

#![allow(clippy::needless_range_loop)]

use std::f64::consts::PI;

use crate::common::{isothermal, settings, solver_of};
use flow_solver::geometry::Metrics;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{Gas, IdealGas, Inviscid, Isothermal, Laminar};
use flow_solver::{Solver, Step};
use mesh::{BoxShape, Patch, box_grid, box_grid_of};

const RHO: f64 = 1.225;
/// Dynamic viscosity of the manufactured flow, Pa s: Reynolds number 50.
const MU: f64 = 0.0245;

/// Eddies between walls at rest, growing and shrinking in time, with a pressure that has
/// a slope at the walls.
fn manufactured(x: &[f64; 3], t: f64) -> [f64; 4] {
    let s = |a: f64| (PI * a).sin();
    let f = 1.0 + 0.5 * (3.0 * t).sin();
    let u = f * s(x[0]).powi(2) * s(2.0 * x[1]) * s(x[2]).powi(2);
    let v = -f * s(2.0 * x[0]) * s(x[1]).powi(2) * s(x[2]).powi(2);
    let w = 0.5 * f * s(x[0]).powi(2) * s(x[1]).powi(2) * s(x[2]).powi(2);
    let p = RHO * f * ((PI * x[0]).cos() * (PI * x[1]).cos() + 0.5 * (2.0 * x[2]).sin());
    [p, u, v, w]
}

/// What must be supplied so that `manufactured` solves the equations: all derivatives
/// by central differences of fourth order.
fn supplied(gas: &Isothermal, x: &[f64; 3], t: f64) -> [f64; 4] {
    const H: f64 = 2e-3;
    let slope = |f: &dyn Fn(f64) -> [f64; 4]| -> [f64; 4] {
        let (a, b, c, d) = (f(-2.0 * H), f(-H), f(H), f(2.0 * H));
        std::array::from_fn(|k| (a[k] - 8.0 * b[k] + 8.0 * c[k] - d[k]) / (12.0 * H))
    };
    let at = |x: &[f64; 3], d: usize, h: f64| {
        let mut y = *x;
        y[d] += h;
        y
    };
    let flux = |x: &[f64; 3], d: usize| {
        let q = manufactured(x, t);
        let g: [[f64; 4]; 3] = std::array::from_fn(|e| slope(&|h| manufactured(&at(x, e, h), t)));
        let divergence = g[0][1] + g[1][2] + g[2][3];
        let m = gas.density(&q) * q[1 + d];
        let mut f = [m, m * q[1], m * q[2], m * q[3]];
        f[1 + d] += q[0] + 2.0 / 3.0 * MU * divergence;
        for i in 0..3 {
            f[1 + i] -= MU * (g[d][1 + i] + g[i][1 + d]);
        }
        f
    };
    let mut sum = slope(&|h| {
        let q = manufactured(x, t + h);
        let rho = gas.density(&q);
        [rho, rho * q[1], rho * q[2], rho * q[3]]
    });
    for d in 0..3 {
        let s = slope(&|h| flux(&at(x, d, h), d));
        (0..4).for_each(|k| sum[k] += s[k]);
    }
    sum
}

/// Error of the velocity at t = 0.3 with `n` boxes along each side and `n` steps; `upwind`: smallest upwind share.
fn manufactured_error(shape: BoxShape, n: usize, sway: f64, upwind: f64) -> f64 {
    let grid = box_grid_of(shape, [n, n, n], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
    let mut settings = settings([0.0; 3], 1e-4);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: MU }, settings);
    s.spatial.upwind_share = upwind;
    let gas = s.spatial.gas;
    let start = s.nodes.clone();
    let placed = |t: f64| -> Vec<Vec3> {
        let place = |x: &Vec3| {
            let bump = (PI * x[0]).sin() * (PI * x[1]).sin() * (PI * x[2]).sin();
            let a = sway * bump * (2.0 * PI * (x[0] + 2.0 * x[1])).cos() * (1.0 + (5.0 * t).sin());
            Vec3::new(x[0] + a, x[1] - a, x[2] + 0.5 * a)
        };
        start.iter().map(place).collect()
    };
    let (end, steps) = (0.3, n);
    let dt = end / steps as f64;
    let mut previous = s.previous.clone();
    for (k, p) in previous.iter_mut().enumerate() {
        let t = -(k as f64) * dt;
        p.nodes = placed(t);
        let m = Metrics::new(&s.topology, &s.halo, &p.nodes);
        p.q = m.centre.iter().map(|x| manufactured(x, t)).collect();
    }
    s.restore(previous, dt, 0).unwrap();
    for k in 1..=steps {
        let t = k as f64 * dt;
        s.nodes = placed(t);
        let m = Metrics::new(&s.topology, &s.halo, &s.nodes);
        s.source = m.centre.iter().map(|x| supplied(&gas, x, t)).collect();
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let (mut sum, mut volume) = (0.0, 0.0);
    for i in 0..s.topology.n_owned {
        let e = manufactured(&s.metrics.centre[i], end);
        let v = s.metrics.volume[i];
        sum += v * (1..4).map(|d| (s.q[i][d] - e[d]).powi(2)).sum::<f64>();
        volume += v;
    }
    (sum / volume).sqrt()
}

/// Orders between grids of `coarse` and twice as many boxes.
fn manufactured_order(shape: BoxShape, coarse: usize, sway: f64, upwind: f64) -> f64 {
    let (a, b) = (
        manufactured_error(shape, coarse, sway, upwind),
        manufactured_error(shape, 2 * coarse, sway, upwind),
    );
    let order = (a / b).log2();
    println!("{shape:?}, sway {sway}, upwind {upwind}: {a:.3e} to {b:.3e}, order {order:.2}");
    order
}

#[test]
fn manufactured_on_hexahedra() {
    for upwind in [1.0, 0.0] {
        let order = manufactured_order(BoxShape::Hexahedra, 8, 0.0, upwind);
        assert!(order > 1.8, "upwind {upwind}: {order}");
    }
}

#[test]
fn manufactured_on_a_distorted_moving_grid() {
    for upwind in [1.0, 0.0] {
        let order = manufactured_order(BoxShape::Hexahedra, 8, 0.04, upwind);
        assert!(order > 1.8, "upwind {upwind}: {order}");
    }
}

/// Over their neighbours alone the gradients reached too far for a stable scheme and had to be
/// shortened: the order was 1.26 on tetrahedra and 1.35 on swaying prisms.
#[test]
fn manufactured_on_tetrahedra() {
    let order = manufactured_order(BoxShape::Tetrahedra, 6, 0.0, 1.0);
    assert!(order > 1.9, "{order}");
}

#[test]
fn manufactured_on_swaying_tetrahedra_prisms_and_pyramids() {
    // With gradients as short as those over face neighbours alone, pyramids had 1.44, and 1.32 refined.
    for shape in [BoxShape::Tetrahedra, BoxShape::Prisms, BoxShape::Pyramids] {
        let order = manufactured_order(shape, 6, 0.04, 1.0);
        assert!(order > 1.9, "{shape:?}: {order}");
    }
}

/// `cargo test --release -p flow-solver --test verification orders:: -- --ignored --nocapture`
#[test]
#[ignore = "nightly: 5 minutes"]
fn manufactured_refined_again() {
    for (shape, coarse) in [
        (BoxShape::Hexahedra, 14),
        (BoxShape::Prisms, 12),
        (BoxShape::Pyramids, 8),
        (BoxShape::Tetrahedra, 10),
    ] {
        for sway in [0.0, 0.04] {
            let order = manufactured_order(shape, coarse, sway, 1.0);
            assert!(order > 1.75, "{shape:?}, sway {sway}: {order}");
        }
    }
}

/// Error of the velocity of air that a force drives to and fro, the same everywhere,
/// on a grid that moves, after `steps` steps, of which every second one is `ratio` times as long as the
/// others: only the time steps make an error.
fn driven(shape: BoxShape, steps: usize, ratio: f64) -> f64 {
    let grid = box_grid_of(shape, [3, 3, 3], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
    let velocity = |t: f64| [5.0 + (4.0 * t).sin(), (4.0 * t).cos(), -0.5];
    let force = |t: f64| [0.0, 4.0 * RHO * (4.0 * t).cos(), -4.0 * RHO * (4.0 * t).sin(), 0.0];
    let mut s = isothermal(&grid, Inviscid, settings(velocity(0.0), 1e-9));
    let start = s.nodes.clone();
    let placed = |t: f64| -> Vec<Vec3> {
        start
            .iter()
            .map(|x| Vec3::from_fn(|d, _| x[d] + 0.03 * (5.0 * t + 4.0 * x[d] + 3.0 * x[(d + 1) % 3]).sin()))
            .collect()
    };
    let short = 2.0 / (steps as f64 * (1.0 + ratio));
    let mut previous = s.previous.clone();
    for (k, p) in previous.iter_mut().enumerate() {
        let t = -(k as f64) * ratio * short;
        let v = velocity(t);
        p.nodes = placed(t);
        p.q.fill([0.0, v[0], v[1], v[2]]);
    }
    s.restore(previous, ratio * short, 0).unwrap();
    let mut t = 0.0;
    for k in 1..=steps {
        let dt = if k % 2 == 0 { ratio * short } else { short };
        t += dt;
        s.nodes = placed(t);
        s.settings.wind = velocity(t).into();
        s.source = vec![force(t); s.topology.n_owned];
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let v = velocity(t);
    let apart = |q: &[f64; 4]| (0..3).map(|d| (q[1 + d] - v[d]).powi(2)).sum::<f64>().sqrt();
    s.q.iter().map(apart).fold(0.0, f64::max)
}

#[test]
fn time_integration_on_a_moving_grid_is_second_order() {
    for shape in [BoxShape::Hexahedra, BoxShape::Pyramids] {
        // Windows are halved and doubled.
        for ratio in [1.0, 2.0] {
            let (coarse, fine) = (driven(shape, 20, ratio), driven(shape, 40, ratio));
            let order = (coarse / fine).log2();
            println!(
                "{shape:?}, steps 1 to {ratio}: error in time {coarse:.3e} to {fine:.3e}, order {order:.2}"
            );
            // Both ways: an error that the steps do not make bends the observed order upwards where it cancels a
            // part of theirs. A ratio that is 1 % off gives 2.51 and 2.23 with steps of one and two parts.
            assert!(
                (order - 2.0).abs() < 0.1 && fine < 0.02,
                "{shape:?}: {coarse:.3e} to {fine:.3e}, order {order:.2}"
            );
        }
    }
}

/// Weights over the step of the derivative at `t[0]` of the parabola through values at the times `t` (s):
/// Lagrange's formula, from the times themselves.
fn derivative_weights(t: [f64; 3]) -> [f64; 3] {
    let h = t[0] - t[1];
    let slope = |k: usize| -> f64 {
        let others: Vec<usize> = (0..3).filter(|j| *j != k).collect();
        let below: f64 = others.iter().map(|&j| t[k] - t[j]).product();
        others.iter().map(|&j| t[0] - t[j]).sum::<f64>() / below
    };
    [0, 1, 2].map(|k| h * slope(k))
}

/// Air that a force drives, the same everywhere on a grid that moves as a whole and followed by the far field: each
/// step is the backward difference through three instants, whatever their distances, to the tolerance of the
/// iterations. A ratio of steps that is 1 % off leaves 1e-3 of the velocity.
#[test]
fn unequal_steps_have_variable_step_bdf2_weights() {
    let grid = box_grid_of(BoxShape::Hexahedra, [3, 3, 3], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
    let force = |t: f64| [0.0, 4.0 * RHO * (4.0 * t).cos(), -4.0 * RHO * (4.0 * t).sin(), 2.0 * RHO];
    let start_velocity = [5.0, 1.0, -0.5];
    let mut s = isothermal(&grid, Inviscid, settings(start_velocity, 1e-9));
    let start = s.nodes.clone();
    // As a whole: where cells change their volume, what is the same everywhere stays so to second order only.
    let placed = |t: f64| -> Vec<Vec3> {
        start.iter().map(|x| Vec3::from_fn(|d, _| x[d] + 0.3 * (5.0 * t + d as f64).sin())).collect()
    };
    let first = 0.02;
    let mut times = [0.0, -first];
    let mut velocities = [start_velocity, [4.9, 1.01, -0.55]];
    let mut previous = s.previous.clone();
    for (k, p) in previous.iter_mut().enumerate() {
        p.nodes = placed(times[k]);
        let v = velocities[k];
        p.q.fill([0.0, v[0], v[1], v[2]]);
    }
    s.restore(previous, first, 0).unwrap();
    for ratio in [1.0, 2.0, 0.5, 0.5, 1.7, 0.3, 2.0, 1.0] {
        let dt = ratio * (times[0] - times[1]);
        let t = times[0] + dt;
        let c = derivative_weights([t, times[0], times[1]]);
        let f = force(t);
        let expected: [f64; 3] = std::array::from_fn(|d| {
            (dt * f[1 + d] / RHO - c[1] * velocities[0][d] - c[2] * velocities[1][d]) / c[0]
        });
        s.nodes = placed(t);
        s.settings.wind = expected.into();
        s.source = vec![f; s.topology.n_owned];
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).unwrap();
        for q in &s.q[..s.topology.n_owned] {
            let off = (0..3).map(|d| (q[1 + d] - expected[d]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "ratio {ratio}: {q:?} beside {expected:?}");
        }
        s.accept(dt, true);
        (times, velocities) = ([t, times[0]], [expected, velocities[0]]);
    }
}

/// Without an obstacle the air follows a gust exactly, on a grid at rest.
#[test]
fn gust_accelerates_the_whole_domain_uniformly() {
    let grid = box_grid_of(BoxShape::Prisms, [3, 4, 3], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
    let gust = case::Gust::pulse([2.0, -5.0, 0.0], 0.05, 0.4);
    let wind = case::Wind::uniform([3.0, 0.0, 1.0]).with_gust(gust, 0.0);
    let mut s = isothermal(&grid, Inviscid, settings(wind.steady(), 1e-9));
    let dt = 0.02;
    for k in 0..15 {
        let t = k as f64 * dt;
        s.set_far_field_velocity([t + dt, t, t - dt].map(|t| wind.at(t).into()), dt);
        s.advance(&crate::common::at_rest(dt)).unwrap();
        s.accept(dt, false);
        let v = wind.at(t + dt);
        for q in &s.q {
            let off = (0..3).map(|d| (q[1 + d] - v[d]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-8 && q[0].abs() < 1e-6, "step {k}: {q:?} in a wind of {v:?}");
        }
    }
}

/// Error of an isentropic vortex that a stream of Mach 0.3 carries, n x n cells.
fn vortex(n: usize) -> f64 {
    let grid = box_grid(
        [n, n, 1],
        [-5.0, -5.0, 0.0],
        [5.0, 5.0, 10.0 / n as f64],
        [Patch::FarField, Patch::FarField, Patch::FarField, Patch::FarField, Patch::Slip, Patch::Slip],
    );
    let wind = [100.0, 0.0, 0.0];
    let settings = settings(wind, 1e-4);
    let air = settings.air;
    let mut s: Solver<IdealGas, 5> = solver_of(&grid, IdealGas::new(air), Inviscid, settings);
    let cp = air.gas_constant * air.gamma / (air.gamma - 1.0);
    let strength = 40.0;
    // Crocco: T falls by u^2 / (2 cp) where u = strength r exp((1 - r^2) / 2).
    let exact = |x: &[f64; 3], t: f64| {
        let (a, b) = (x[0] + 1.0 - wind[0] * t, x[1]);
        let r2 = a * a + b * b;
        let e = strength * (0.5 * (1.0 - r2)).exp();
        let dt = -0.5 * strength * strength * (1.0 - r2).exp() / cp;
        let p = air.pressure() * ((1.0 + dt / air.temperature).powf(air.gamma / (air.gamma - 1.0)) - 1.0);
        [p, wind[0] - e * b, wind[1] + e * a, 0.0, dt]
    };
    let end = 0.02;
    let steps = n;
    let dt = end / steps as f64;
    let mut previous = s.previous.clone();
    for (k, p) in previous.iter_mut().enumerate() {
        p.q = s.metrics.centre.iter().map(|x| exact(x, -(k as f64) * dt)).collect();
    }
    s.restore(previous, dt, 0).unwrap();
    for _ in 0..steps {
        s.advance(&crate::common::at_rest(dt)).unwrap();
        s.accept(dt, false);
    }
    let sum: f64 = (0..s.topology.n_owned)
        .map(|i| {
            let e = exact(&s.metrics.centre[i], end);
            (1..3).map(|d| (s.q[i][d] - e[d]).powi(2)).sum::<f64>()
        })
        .sum();
    (sum / s.topology.n_owned as f64).sqrt() / strength
}

#[test]
fn isentropic_vortex_is_advected() {
    let (coarse, fine) = (vortex(32), vortex(64));
    let order = (coarse / fine).log2();
    println!("isentropic vortex: {coarse:.3e} to {fine:.3e} of its speed, order {order:.2}");
    assert!(order > 1.8 && fine < 0.01, "{coarse:.3e} to {fine:.3e}: order {order:.2}");
    // A record of the error itself, for what leaves the order alone: twice the velocity diffusion adds 7 %.
    assert!((fine / 1.450e-3 - 1.0).abs() < 0.03, "{fine:.4e} beside 1.450e-3");
}

/// A slow piston compresses air adiabatically: pressure by the closed form, mass exact.
#[test]
fn piston() {
    let grid = box_grid([20, 1, 1], [0.0; 3], [1.0, 0.1, 0.1], [Patch::Slip; 6]);
    let settings = settings([1.0, 0.0, 0.0], 1e-6);
    let air = settings.air;
    let gas = IdealGas::new(air);
    let mut s = solver_of(&grid, gas, Inviscid, settings);
    s.q.iter_mut().for_each(|q| *q = [0.0; 5]);
    for p in &mut s.previous {
        p.q.iter_mut().for_each(|q| *q = [0.0; 5]);
    }
    let start = s.nodes.clone();
    let mass = |s: &Solver<IdealGas, 5>| -> f64 {
        s.q.iter().zip(&s.metrics.volume).map(|(q, v)| gas.density(q) * v).sum()
    };
    let before = mass(&s);
    // By 2 cm in 0.2 s, gently at both ends; sound crosses the box 70 times.
    let (dt, steps) = (2e-3, 100);
    let travel = |k: usize| 0.01 * (1.0 - (PI * k as f64 / steps as f64).cos());
    for k in 1..=steps {
        let (now, old) = (travel(k), travel(k - 1));
        for (i, x0) in start.iter().enumerate() {
            s.nodes[i][0] = x0[0] * (1.0 - now);
            s.node_velocity[i][0] = -x0[0] * (now - old) / dt;
        }
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let exact = air.pressure() * (0.98f64.powf(-air.gamma) - 1.0);
    let mean = s.q.iter().map(|q| q[0]).sum::<f64>() / 20.0;
    println!("piston: {mean:.2} Pa, closed form {exact:.2} Pa");
    assert!((mean - exact).abs() < 2e-3 * exact, "{mean} Pa, closed form {exact} Pa");
    let lost = (mass(&s) - before).abs() / before;
    assert!(lost < 1e-9, "mass changed by {lost:e}");
}

/// Velocities after one second of a Taylor-Green vortex between slip walls on `n` x `n`
/// cells, in `steps` steps of which the first is of first order (one exact instant does
/// not make two of the discrete flow) and every second is `ratio` times as long as the others; the inner
/// grid lines may sway.
fn vortex_after(n: usize, steps: usize, sway: f64, ratio: f64) -> Vec<[f64; 4]> {
    let grid = box_grid([n, n, 1], [0.0; 3], [PI, PI, PI / n as f64], [Patch::Slip; 6]);
    let mut settings = settings([0.0; 3], 1e-9);
    settings.reference_speed = 0.1;
    let mut s = isothermal(&grid, Laminar { viscosity: 0.05 * RHO }, settings);
    let start = s.nodes.clone();
    let placed = |t: f64| -> Vec<Vec3> {
        let place = |x: &Vec3| {
            let a = sway * (2.0 * x[0]).sin() * (2.0 * x[1]).sin() * (1.0 + (3.0 * t).sin());
            Vec3::new(x[0] + a, x[1] + 0.7 * a, x[2])
        };
        start.iter().map(place).collect()
    };
    let short = 2.0 / (steps as f64 * (1.0 + ratio));
    let mut previous = s.previous.clone();
    for p in &mut previous {
        p.nodes = placed(0.0);
        let m = Metrics::new(&s.topology, &s.halo, &p.nodes);
        let exact = |x: &[f64; 3]| {
            let p = RHO * 0.25 * ((2.0 * x[0]).cos() + (2.0 * x[1]).cos());
            [p, x[0].sin() * x[1].cos(), -x[0].cos() * x[1].sin(), 0.0]
        };
        p.q = m.centre.iter().map(exact).collect();
    }
    s.restore(previous, short, 1).unwrap();
    let mut t = 0.0;
    for k in 1..=steps {
        let dt = if k % 2 == 0 { ratio * short } else { short };
        t += dt;
        s.nodes = placed(t);
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    s.q[..s.topology.n_owned].to_vec()
}

/// Without history of the Rhie-Chow fluxes the orders were 0.56 to 0.8.
#[test]
fn vortex_flow_is_second_order_in_time() {
    for (sway, ratio) in [(0.0, 1.0), (0.06, 1.0), (0.06, 2.0)] {
        let runs = [20, 40, 80].map(|steps| vortex_after(12, steps, sway, ratio));
        // Differences between runs: the order is two up to the share of the next term, which pressure has more of
        // (2.24 at most). A ratio that is 1 % off gives 1.91 in the velocity.
        for (what, k, bound, band) in [("velocity", 1, 1e-5, 0.06), ("pressure", 0, 1e-5, 0.3)] {
            let apart = |a: &[[f64; 4]], b: &[[f64; 4]]| {
                let sum: f64 = a.iter().zip(b).map(|(a, b)| (a[k] - b[k]).powi(2)).sum();
                (sum / a.len() as f64).sqrt()
            };
            let (coarse, fine) = (apart(&runs[0], &runs[1]), apart(&runs[1], &runs[2]));
            let order = (coarse / fine).log2();
            println!(
                "sway {sway}, steps 1 to {ratio}, {what}: {coarse:.2e}, {fine:.2e} from steps to half of them, order {order:.2}"
            );
            assert!(
                (order - 2.0).abs() < band && fine < bound,
                "sway {sway}, steps 1 to {ratio}, {what}: {coarse:.2e}, {fine:.2e}, order {order:.2}"
            );
        }
    }
}
