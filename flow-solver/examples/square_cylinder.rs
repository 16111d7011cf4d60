//! Square cylinder across a stream at Reynolds number 22 000, four diameters of it between periodic sides, in a tunnel of 14 diameters
//! (Lyn et al. 1995).
//!
//! `cargo run --release -p flow-solver --example square_cylinder -- [refinement] [end, D/U] [time step, D/U] [model: 0 ddes, 1 wale, 2 none]
//! [smallest upwind share]`
//!
//! Mean drag, fluctuation of lift and Strouhal number from 40 D/U on, and of quarters of that time.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{at_rest, growing, isothermal, settings, wall_force};
use flow_solver::Solver;
use flow_solver::physics::{EddyViscosity, Isothermal, Laminar, Turbulent, WallTreatment};
use flow_solver::turbulence::{SpalartAllmaras, ddes};
use mesh::{FlowGrid, Patch, block_grid};

const RHO: f64 = 1.225;
const SPEED: f64 = 10.0;
const SPAN: f64 = 4.0;

/// Ends of cells along a line through the cylinder, which lies from -0.5 to 0.5, and the cells in front of it.
fn line(ahead: (usize, f64), body: usize, behind: (usize, f64), h: f64) -> (Vec<f64>, usize) {
    let half = growing(body / 2, 0.5, h);
    let mut x: Vec<f64> = growing(ahead.0, ahead.1, h).iter().rev().map(|s| -0.5 - s).collect();
    x.extend(half[1..].iter().map(|s| -0.5 + s));
    x.extend(half.iter().rev().skip(1).map(|s| 0.5 - s));
    x.extend(growing(behind.0, behind.1, h)[1..].iter().map(|s| 0.5 + s));
    (x, ahead.0)
}

fn tunnel(refine: f64) -> FlowGrid {
    let n = |cells: f64| (refine * cells).round() as usize;
    let (body, h) = (2 * n(8.0), 0.03 / refine);
    let (x, before) = line((n(20.0), 6.0), body, (n(48.0), 14.5), h);
    let (y, beside) = line((n(22.0), 6.5), body, (n(22.0), 6.5), h);
    let cells = [x.len() - 1, y.len() - 1, n(16.0)];
    let (s, p) = (Patch::Slip, Patch::Periodic);
    let sides = [Patch::Inlet, Patch::Outlet, s, s, p, p];
    let block = [before..before + body, beside..beside + body, 0..cells[2]];
    let mut grid = block_grid(cells, [0.0; 3], cells.map(|n| n as f64), sides, block);
    for c in &mut grid.coords {
        *c = [x[c[0].round() as usize], y[c[1].round() as usize], SPAN * c[2] / cells[2] as f64];
    }
    grid
}

/// Force of the air on the cylinder along x and y, in units of dynamic pressure and frontal area.
fn force(s: &Solver<Isothermal, 4>) -> [f64; 2] {
    let force = wall_force(s) / (0.5 * RHO * SPEED * SPEED * SPAN);
    [force.x, force.y]
}

/// Mean drag, root mean square of the lift, and Strouhal number by upward crossings of its mean, each after a visit well below it.
fn statistics(rows: &[[f64; 3]]) -> [f64; 3] {
    let n = rows.len() as f64;
    let mean = |c: usize| rows.iter().map(|r| r[c]).sum::<f64>() / n;
    let lift = mean(2);
    let square = rows.iter().map(|r| (r[2] - lift).powi(2)).sum::<f64>() / n;
    let (mut up, mut low) = (Vec::new(), false);
    for (k, row) in rows.iter().enumerate() {
        low |= row[2] < lift - 0.5 * square.sqrt();
        if low && row[2] >= lift {
            up.push(k);
            low = false;
        }
    }
    let strouhal = match up[..] {
        [first, .., last] => (up.len() - 1) as f64 / (rows[last][0] - rows[first][0]),
        _ => 0.0,
    };
    [mean(1), square.sqrt(), strouhal]
}

fn main() {
    flow_solver::return_large_blocks();
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().expect("a number"));
    let (refine, end, dt) = (arg(1, 1.0), arg(2, 120.0), arg(3, 0.025));
    let (model, upwind) = (arg(4, 0.0) as usize, arg(5, 0.0));
    let grid = tunnel(refine);
    let viscosity = RHO * SPEED / 22_000.0;
    let mut set = settings([SPEED, 0.0, 0.0], 1e-2);
    set.moving = false;
    let wall = WallTreatment::Automatic;
    let mut s = match model {
        0 => isothermal(&grid, Turbulent { viscosity, eddies: EddyViscosity::TransportInput, wall }, set),
        1 => isothermal(&grid, Turbulent { viscosity, eddies: EddyViscosity::Wale, wall }, set),
        _ => isothermal(&grid, Laminar { viscosity }, set),
    };
    if model == 0 {
        let model = SpalartAllmaras::new(&s.topology, viscosity, RHO, ddes);
        s.set_turbulence(model);
    }
    s.spatial.upwind_share = upwind;
    // A push that differs along the span: neither the street nor its third dimension need wait for round-off.
    let mut noise = common::Noise(7);
    for i in 0..s.topology.n_owned {
        let x = s.metrics.centre[i];
        let near = (-0.25 * (x[0] * x[0] + x[1] * x[1])).exp();
        let push = SPEED * near * (0.3 + 0.1 * noise.next());
        s.previous.iter_mut().for_each(|level| level.q[i][2] += push);
    }
    println!("# {} cells, model {model}, upwind share {upwind}, steps of {dt} D/U", grid.cells.len());
    let (mut rows, mut iterations) = (Vec::new(), 0);
    let steps = (end / dt).round() as usize;
    for k in 1..=steps {
        let length = dt / SPEED;
        iterations += s.advance(&at_rest(length)).expect("a step that converges").iterations;
        s.accept(length, false);
        let [drag, lift] = force(&s);
        rows.push([k as f64 * dt, drag, lift]);
        if k % 200 == 0 {
            println!("t U/D {:.1}: cd {drag:.3} cl {lift:.3}", k as f64 * dt);
        }
    }
    let late: Vec<[f64; 3]> = rows.into_iter().filter(|r| r[0] > 40.0).collect();
    if late.is_empty() {
        return;
    }
    let [drag, lift, strouhal] = statistics(&late);
    println!(
        "# mean cd {drag:.3}, cl rms {lift:.3}, St {strouhal:.4}, {:.2} iterations a step",
        iterations as f64 / steps as f64
    );
    for quarter in late.chunks(late.len().div_ceil(4)) {
        let [drag, lift, strouhal] = statistics(quarter);
        println!(
            "#   to t U/D {:.0}: cd {drag:.3}, cl rms {lift:.3}, St {strouhal:.4}",
            quarter[quarter.len() - 1][0]
        );
    }
}
