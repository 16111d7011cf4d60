//! The common plate case: drag, iterations and cost per cell and step.
//!
//! `cargo run --release -p flow-solver --example plate -- [every] [steps] [drop] [dt] [depth, or -Courant for LU-SGS] [first-order steps]
//! [velocity diffusion] [speed] [equations: 4 or 5] [amplitude] [1: with detached eddies] [smallest upwind share] [1: slip on the plate]`
//!
//! With an amplitude of 0.1 m the plate and the grid around it oscillate at 1 Hz along the
//! stream, in the manner of the peers' case `ale2` but without a mover's cost.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/plate.rs"]
mod plate;

use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{EddyViscosity, Gas, IdealGas, Isothermal, Laminar, Turbulent, WallTreatment};
use flow_solver::turbulence::{SpalartAllmaras, ddes};
use flow_solver::{Loads, Method, Solver, Step};

/// Processor time of this process so far, s: what neighbours on the machine disturb least.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").expect("Linux");
    text.split(' ').next().and_then(|t| t.parse::<f64>().ok()).expect("nanoseconds") * 1e-9
}

/// Memory of this process, as the kernel words it.
fn memory(what: &str) -> String {
    let text = std::fs::read_to_string("/proc/self/status").expect("Linux");
    text.lines().find_map(|l| l.strip_prefix(what)).unwrap_or("?").trim().to_string()
}

fn main() {
    flow_solver::return_large_blocks();
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().expect("a number"));
    let (every, steps, drop, dt) = (arg(1, 2.0) as usize, arg(2, 20.0) as usize, arg(3, 1e-2), arg(4, 0.02));
    let grid = plate::plate(every);
    let speed = arg(8, 4.88);
    let mut settings = common::settings([0.0, 0.0, speed], drop);
    settings.moving = arg(10, 0.0) != 0.0;
    settings.method = match arg(5, if settings.moving { 5.0 } else { 4.0 }) {
        depth if depth >= 0.0 => Method::PressureCorrection { depth: depth as usize },
        courant => Method::LuSgs { courant: -courant },
    };
    settings.max_iterations = 2000;
    settings.velocity_diffusion = arg(7, 0.5);
    let viscosity = Laminar { viscosity: speed / 200.0 * 1.225 };
    let air = settings.air;
    if arg(9, 4.0) == 5.0 {
        let solver = common::solver_on(grid, IdealGas::new(air), viscosity, settings);
        run(solver, steps, dt, speed, arg(6, 2.0), arg(10, 0.0));
    } else if arg(11, 0.0) == 1.0 {
        let modelled = Turbulent {
            viscosity: viscosity.viscosity,
            eddies: EddyViscosity::TransportInput,
            wall: WallTreatment::Automatic,
        };
        let mut solver = common::solver_on(grid, Isothermal::new(air), modelled, settings);
        solver.set_turbulence(SpalartAllmaras::new(&solver.topology, modelled.viscosity, 1.225, ddes));
        run(solver, steps, dt, speed, arg(6, 2.0), arg(10, 0.0));
    } else {
        let solver = common::solver_on(grid, Isothermal::new(air), viscosity, settings);
        run(solver, steps, dt, speed, arg(6, 2.0), arg(10, 0.0));
    }
}

fn run<G: Gas<N>, const N: usize>(
    mut solver: Solver<G, N>,
    steps: usize,
    dt: f64,
    speed: f64,
    first_order: f64,
    amplitude: f64,
) {
    solver.first_order_steps = first_order as u32;
    solver.spatial.upwind_share = std::env::args().nth(12).map_or(1.0, |a| a.parse().expect("a number"));
    if std::env::args().nth(13).is_some_and(|a| a == "1") {
        let walls = std::mem::take(&mut solver.topology.no_slip);
        solver.topology.slip.extend(walls);
    }
    println!("solver made: memory {}, peak {}", memory("VmRSS:"), memory("VmHWM:"));
    let mut loads = Loads::new(&solver);
    let cells = solver.topology.n_owned;
    let dt = dt * 4.88 / speed;
    let (begin, mut iterations) = (cpu(), 0);
    let moved = amplitude != 0.0;
    let start = if moved { solver.nodes.clone() } else { Vec::new() };
    // How far nodes follow the plate: linear along the stream, quadratic across.
    let follow = |x: &Vec3| {
        let along = if x[2] < 0.0 { 1.0 + x[2] / 5.0 } else { 1.0 - x[2] / 10.0 };
        along * (1.0 - (x[0] / 5.0).powi(2)) * (1.0 - (x[1] / 5.0).powi(2))
    };
    let omega = 2.0 * std::f64::consts::PI;
    for k in 1..=steps {
        let now = cpu();
        let t = k as f64 * dt;
        for ((x0, x), v) in start.iter().zip(&mut solver.nodes).zip(&mut solver.node_velocity) {
            let f = amplitude * follow(x0);
            x[2] = x0[2] + f * (omega * t).sin();
            v[2] = f * omega * (omega * t).cos();
        }
        let step = Step { moved, ..common::at_rest(dt) };
        let report = solver.advance(&step).unwrap();
        let cost = (cpu() - now) * 1e6 / cells as f64;
        iterations += report.iterations;
        let total = loads.compute(&solver);
        solver.accept(dt, moved);
        println!(
            "{k:3} Cd {:9.5}  residual {:.2e} -> {:.2e}  iterations {:3} pressure {:4}  {cost:6.2} us/cell",
            total.force[2] / (0.5 * 1.225 * speed * speed),
            report.start,
            report.end,
            report.iterations,
            report.linear_iterations
        );
    }
    let all = (cpu() - begin) * 1e6 / (cells * steps) as f64;
    let mean = iterations as f64 / steps as f64;
    println!(
        "{cells} cells: {mean:.2} iterations and {all:.2} us per cell a step; memory {}, peak {}",
        memory("VmRSS:"),
        memory("VmHWM:")
    );
}
