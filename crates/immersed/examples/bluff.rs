//! Drag of rigid bluff shapes of zero thickness in inviscid flow, at any angle to the grid, by the forces normal to their faces.
//!
//! `cargo run --release -p immersed --example bluff -- [plate|disk|cup-open|cup-away|sphere] [cells across] [end, D/U] [Courant number]
//! [upwind share] [tilt, degrees] [Reynolds number of the air without walls] [perturbation, share of the stream]`

use std::time::Instant;

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::face_transfer::FaceTransfer;
use immersed::flow::{Flow, Settings};
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes::{self, Surface};
use nalgebra::{Rotation3, Vector3};

/// Lines of the history that are printed.
const LINES: usize = 8;

fn argument(k: usize, default: f64) -> f64 {
    std::env::args().nth(k).map_or(default, |a| a.parse().expect("a number"))
}

/// The shape, with a diameter of 1, off the symmetric place in its cell.
fn surface(shape: &str, across: usize, turn: Rotation3<f64>) -> Surface {
    let (nodes, faces) = match shape {
        "plate" => shapes::plate(across),
        "disk" => shapes::disk(across),
        "sphere" => shapes::sphere(0.5, (across as f64 * 1.5).log2().ceil() as u32),
        _ => shapes::hemisphere(across),
    };
    let along = if shape == "cup-away" { -1.0 } else { 1.0 };
    let offset = Vector3::new(0.07, 0.11, -0.13) / across as f64;
    let place = |x: &Vector3<f64>| turn * Vector3::new(x.x, x.y, along * x.z) + offset;
    (nodes.iter().map(place).collect(), faces)
}

/// An even core around the shape and two diameters of its wake, and flanks to 5 diameters across, 10 behind.
fn grid(across: f64, stream: Vector3<f64>) -> Grid {
    let h = 1.0 / across;
    let axis = |d: usize| {
        let reach = |behind: bool| if behind { (2.0, 8.0) } else { (0.5, 4.3) };
        let ((low, below), (high, above)) = (reach(stream[d] < -0.1), reach(stream[d] > 0.1));
        Axis::stretched([-low - 4.0 * h, high + 4.0 * h], h, [below, above], 1.15, 2)
    };
    let ends = |d: usize| {
        Ends::Open(match stream[d] {
            s if s.abs() < 0.1 => [End::Slip, End::Slip],
            s if s > 0.0 => [End::Inflow, End::Outflow],
            _ => [End::Outflow, End::Inflow],
        })
    };
    Grid::new([0, 1, 2].map(axis), [0, 1, 2].map(ends))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Drag coefficient of each step, seconds of its three parts, and iterations in all.
fn run(
    flow: &mut Flow,
    (nodes, faces): &Surface,
    steps: usize,
    dt: f64,
    area: f64,
) -> (Vec<f64>, [f64; 3], usize) {
    let cut = CutFaces::new(&flow.grid, nodes, faces, 0.0).expect("a surface in the even core");
    println!("# {} constraints of {} cut faces", cut.rows.len(), cut.crossings().len());
    let own: Vec<u32> = (0..faces.len() as u32).collect();
    let transfer =
        FaceTransfer::new(&flow.grid, nodes, faces, &own, &cut).expect("a surface in the even core");
    let stream = flow.settings.far;
    let (mut drag, mut parts, mut iterations) = (Vec::new(), [0.0; 3], 0);
    for k in 1..=steps {
        let clock = Instant::now();
        flow.predict(dt, Vector3::zeros());
        parts[0] += clock.elapsed().as_secs_f64();
        let jumps = flow.solve_constraints(&cut.rows);
        parts[1] += clock.elapsed().as_secs_f64();
        flow.accept(&cut.rows, &jumps);
        parts[2] += clock.elapsed().as_secs_f64();
        iterations += jumps.iterations;
        let mut forces = vec![Vector3::zeros(); faces.len()];
        transfer.add_forces(&jumps.jump, &mut forces);
        let force: Vector3<f64> = forces.iter().sum();
        drag.push(force.dot(&stream) / (0.5 * area));
        if k % (steps / LINES).max(1) == 0 {
            let late = mean(&drag[k - (steps / LINES).max(1)..]);
            println!(
                "{:8.2} D/U: drag {late:.4}, side force {:.4}",
                k as f64 * dt,
                force.cross(&stream).norm() / (0.5 * area)
            );
        }
    }
    (drag, [parts[0], parts[1] - parts[0], parts[2] - parts[1]], iterations)
}

fn main() {
    let shape = std::env::args().nth(1).unwrap_or("plate".into());
    let (across, end, courant, share) =
        (argument(2, 16.0), argument(3, 2.0), argument(4, 0.2), argument(5, 1.0));
    let (tilt, reynolds, perturbation) = (argument(6, 0.0).to_radians(), argument(7, 1e7), argument(8, 0.0));
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), tilt)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), 0.7 * tilt);
    let stream = turn * Vector3::z();
    let grid = grid(across, stream);
    let steps = (end * across / courant).round() as usize;
    let momentum = Momentum { upwind_share: share, viscosity: 1.0 / reynolds };
    let settings = Settings { density: 1.0, far: stream, momentum, tolerance: 1e-3 };
    let (cells, extents) = (grid.count(), grid.cells());
    println!("# {shape}: {cells} cells {extents:?}, {steps} steps");
    let mut flow = Flow::new(grid, settings);
    flow.perturb(perturbation);
    let area = if shape == "plate" { 1.0 } else { std::f64::consts::FRAC_PI_4 };
    let surface = surface(&shape, across as usize, turn);
    let (drag, parts, iterations) = run(&mut flow, &surface, steps, end / steps as f64, area);
    let late = &drag[steps / 2..];
    let quarters: Vec<f64> = late.chunks(late.len().div_ceil(4)).map(mean).collect();
    let per_cell = 1e6 / (cells * steps) as f64;
    println!(
        "second half {:.4}, quarters {quarters:.3?}; {:.1} iterations; {:.3} us a cell and step: prediction {:.3}, constraints {:.3}, \
         projection {:.3}; divergence {:.0e}",
        mean(late),
        iterations as f64 / steps as f64,
        parts.iter().sum::<f64>() * per_cell,
        parts[0] * per_cell,
        parts[1] * per_cell,
        parts[2] * per_cell,
        flow.largest_divergence()
    );
}
