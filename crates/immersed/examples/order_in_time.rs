//! Order in time by halving the step on one grid: vortices without a surface, and a square plate that starts smoothly in still air.
//!
//! `cargo run --release -p immersed --example order_in_time -- [cells across the plate] [Reynolds number]`
//!
//! Printed is the difference of the velocity from that with half the step, root mean square and largest, at the end of each case.

use std::f64::consts::{PI, TAU};

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::flow::{Flow, Settings};
use immersed::free_edges::EdgeFluxes;
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid, Velocity};
use immersed::momentum::Momentum;
use immersed::shapes;
use nalgebra::Vector3;

const SLIP: Ends = Ends::Open([End::Slip, End::Slip]);

/// What the plate does.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    /// No slip on the plate.
    friction: bool,
    /// Largest velocity, m/s: it rises and falls as a sine squared.
    velocity: Vector3<f64>,
    /// The plate moves through the grid; else its position is held and the velocity is that of its points.
    moves: bool,
}

fn argument(k: usize, default: f64) -> f64 {
    std::env::args().nth(k).map_or(default, |a| a.parse().expect("a number"))
}

fn settings(viscosity: f64) -> Settings {
    let momentum = Momentum { upwind_share: 0.0, viscosity };
    Settings { density: 1.0, far: Vector3::zeros(), momentum, tolerance: 1e-10 }
}

/// Taylor-Green vortex on 32 x 32 cells at time 1; no force.
fn vortex(steps: usize) -> (Velocity, f64) {
    let side = || Axis::even(0.0, TAU, 32);
    let grid = Grid::new([side(), side(), Axis::even(0.0, 1.0, 3)], [Ends::Periodic, Ends::Periodic, SLIP]);
    let mut flow = Flow::new(grid, settings(0.02));
    for c in 0..2 {
        for (j, i) in (0..32).flat_map(|j| (0..32).map(move |i| (j, i))) {
            let [x, y]: [f64; 2] = [flow.grid.coordinate(c, 0, i), flow.grid.coordinate(c, 1, j)];
            // A second wave, so that convection does not cancel.
            let value =
                [x.cos() * y.sin() + 0.5 * (2.0 * y).sin(), -x.sin() * y.cos() + 0.5 * (2.0 * x).sin()][c];
            for k in 0..3 {
                let place = flow.grid.at([i as isize, j as isize, k]);
                flow.velocity[c][place] = value;
            }
        }
    }
    flow.fill_ghosts();
    let none = CutFaces::default();
    for _ in 0..steps {
        flow.predict(1.0 / steps as f64, Vector3::zeros());
        let jumps = flow.solve_constraints(&none.rows);
        flow.accept(&none.rows, &jumps);
    }
    (flow.velocity, 0.0)
}

/// Velocity at time 0.6 around a plate whose velocity is that of `case` times sin2(pi t), and the impulse on the plate along z.
fn plate(case: Case, across: f64, viscosity: f64, steps: usize) -> (Velocity, f64) {
    let h = 1.0 / across;
    let axis = || Axis::stretched([-0.65 - 5.0 * h, 0.65 + 5.0 * h], h, [2.0, 2.0], 1.2, 2);
    let grid = Grid::new([axis(), axis(), axis()], [SLIP, SLIP, Ends::Open([End::Inflow, End::Outflow])]);
    let mut flow = Flow::new(grid, settings(viscosity));
    let (start, faces) = shapes::plate(across as usize);
    let offset = Vector3::new(0.07, 0.11, -0.13) * h;
    let end = 0.6;
    let dt = end / steps as f64;
    let speed = |t: f64| (PI * t).sin().powi(2);
    // Integral of the speed.
    let path = |t: f64| 0.5 * t - (TAU * t).sin() / (4.0 * PI);
    let mut impulse = 0.0;
    for k in 1..=steps {
        let t = dt * k as f64;
        let moved = if case.moves { case.velocity * path(t) } else { Vector3::zeros() };
        let nodes: Vec<_> = start.iter().map(|x| x + offset + moved).collect();
        let velocities = vec![case.velocity * speed(t); nodes.len()];
        let mut cut = CutFaces::new(&flow.grid, &nodes, &faces, 0.0).expect("inside");
        cut.set_velocities(&faces, &velocities);
        let mut forces = vec![Vector3::zeros(); nodes.len()];
        if case.friction {
            let mut friction = Friction::new(&flow.grid, &nodes, &faces).expect("inside");
            let before = vec![case.velocity * speed(t - dt); nodes.len()];
            friction.set_velocities_over(&faces, [&before, &velocities]);
            flow.predict_around(dt, Vector3::zeros(), &EdgeFluxes::default(), Some(&mut friction));
            friction.add_node_forces(&faces, &mut forces);
        } else {
            flow.predict(dt, Vector3::zeros());
        }
        let jumps = flow.solve_constraints(&cut.rows);
        flow.accept(&cut.rows, &jumps);
        cut.add_forces(&faces, &jumps.jump, &mut forces);
        impulse += dt * forces.iter().map(|f| f.z).sum::<f64>();
    }
    (flow.velocity, impulse)
}

/// Root mean square and largest difference.
fn difference(a: &Velocity, b: &Velocity) -> [f64; 2] {
    let (mut sum, mut largest, mut count) = (0.0, 0.0f64, 0);
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        let d = (a - b).abs();
        (sum, largest, count) = (sum + d * d, largest.max(d), count + 1);
    }
    [(sum / f64::from(count)).sqrt(), largest]
}

/// Differences of runs whose steps are halved, with their orders.
fn halve(name: &str, first: usize, levels: u32, run: impl Fn(usize) -> (Velocity, f64)) {
    let runs: Vec<_> = (0..levels).map(|l| run(first << l)).collect();
    let mut before: Option<[f64; 3]> = None;
    for (l, pair) in runs.windows(2).enumerate() {
        let [rms, largest] = difference(&pair[0].0, &pair[1].0);
        let now = [rms, largest, (pair[0].1 - pair[1].1).abs()];
        let orders = before.map(|b| [0, 1, 2].map(|i| (b[i] / now[i]).log2()));
        println!(
            "{name}: {} steps: rms {rms:.3e}, largest {largest:.3e}, impulse {:.3e} of {:.5}; orders {}",
            first << l,
            now[2],
            pair[1].1,
            orders.map_or("-".into(), |o| format!("{o:.2?}"))
        );
        before = Some(now);
    }
}

fn main() {
    let (across, reynolds) = (argument(1, 16.0), argument(2, 200.0));
    halve("vortices, no surface", 16, 6, vortex);
    let [across_grid, along] = [Vector3::new(0.0, 0.0, 0.5), Vector3::new(0.4, 0.0, 0.3)];
    let cases = [
        Case { name: "plate, position held, slip", friction: false, velocity: across_grid, moves: false },
        Case { name: "plate, position held, no slip", friction: true, velocity: along, moves: false },
        Case { name: "plate that moves, slip", friction: false, velocity: across_grid, moves: true },
        Case { name: "plate that moves, no slip", friction: true, velocity: along, moves: true },
    ];
    for case in cases {
        halve(case.name, 24, 6, |steps| plate(case, across, 1.0 / reynolds, steps));
    }
}
