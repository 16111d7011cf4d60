//! Drag of rigid bluff shapes of zero thickness in inviscid flow, at any angle to the grid, by the forces normal to their faces.
//!
//! `cargo run --release -p immersed --example bluff -- [plate|disk|cup-open|cup-away|sphere] [cells across] [end, D/U] [Courant number of the stream; 0: the
//! longest stable step]
//! [upwind share] [tilt, degrees] [Reynolds number of the air without walls] [perturbation, share of the stream]`; on a GPU with `DEVICE=gpu`

use std::time::Instant;

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::face_transfer::FaceTransfer;
use immersed::flow::{Flow, Settings};
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes::{self, Surface};
use immersed::slabs::Alone;
use nalgebra::{Rotation3, Vector3};

/// Lines of the history that are printed.
const LINES: u32 = 8;

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

/// Largest sum over the axes of Courant numbers of a step whose length is not given, as in the flow-solver.
const MAX_COURANT: f64 = 0.4;

/// A step: its end and length in D/U, and drag coefficients by the forces normal to the faces and by all forces at cut faces.
#[derive(Clone, Copy)]
struct Step {
    time: f64,
    dt: f64,
    drag: [f64; 2],
    side: f64,
}

/// Means over time of some steps.
fn means(steps: &[Step]) -> ([f64; 2], f64) {
    let time: f64 = steps.iter().map(|s| s.dt).sum();
    let of = |value: &dyn Fn(&Step) -> f64| steps.iter().map(|s| s.dt * value(s)).sum::<f64>() / time;
    ([of(&|s| s.drag[0]), of(&|s| s.drag[1])], of(&|s| s.side))
}

/// Half of the 95 % interval of the mean drag, from five batches.
fn interval(steps: &[Step]) -> f64 {
    let batches: Vec<f64> = steps.chunks(steps.len().div_ceil(5)).map(|batch| means(batch).0[0]).collect();
    let mean = batches.iter().sum::<f64>() / 5.0;
    let variance = batches.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / 4.0;
    2.776 * (variance / 5.0).sqrt()
}

/// All steps to `end`, D/U, of `dt`, or as long as [`MAX_COURANT`] allows; seconds of the three parts of a step, and iterations in all.
fn run(
    flow: &mut Flow,
    (nodes, faces): &Surface,
    (end, dt): (f64, Option<f64>),
    area: f64,
) -> (Vec<Step>, [f64; 3], usize) {
    let cut = CutFaces::new(&flow.grid, nodes, faces, 0.0).expect("a surface in the even core");
    println!("# {} constraints of {} cut faces", cut.rows.len(), cut.crossings().len());
    let own: Vec<u32> = (0..faces.len() as u32).collect();
    let transfer =
        FaceTransfer::new(&flow.grid, nodes, faces, &own, &cut, &Alone).expect("a surface in the even core");
    let stream = flow.settings.far;
    let (mut steps, mut parts, mut iterations, mut time) = (Vec::<Step>::new(), [0.0; 3], 0, 0.0);
    let (mut printed, mut lines) = (0, 1);
    while time < end - 1e-9 {
        let clock = Instant::now();
        let dt = dt.unwrap_or_else(|| MAX_COURANT / flow.largest_rate(Vector3::zeros()));
        time += dt;
        flow.predict(dt, Vector3::zeros());
        parts[0] += clock.elapsed().as_secs_f64();
        let jumps = flow.solve_constraints(&cut.rows);
        parts[1] += clock.elapsed().as_secs_f64();
        flow.accept(&cut.rows, &jumps);
        parts[2] += clock.elapsed().as_secs_f64();
        iterations += jumps.iterations;
        let mut forces = vec![Vector3::zeros(); faces.len()];
        transfer.add_forces(&jumps.jump, &mut forces);
        let all = jumps.jump.iter().enumerate().map(|(r, jump)| cut.rows.weight_by_axis(r) * *jump);
        let [force, all]: [Vector3<f64>; 2] = [forces.iter().sum(), all.sum()];
        let coefficient = |force: f64| force / (0.5 * area);
        let drag = [force, all].map(|f| coefficient(f.dot(&stream)));
        steps.push(Step { time, dt, drag, side: coefficient(force.cross(&stream).norm()) });
        if time >= end * f64::from(lines) / f64::from(LINES) - 1e-9 {
            let ([drag, _], side) = means(&steps[printed..]);
            println!("{time:8.2} D/U: drag {drag:.4}, side force {side:.4}");
            (printed, lines) = (steps.len(), lines + 1);
        }
        assert!(drag[0].is_finite() && drag[0].abs() < 1e6, "the flow diverged at {time:.2} D/U");
    }
    (steps, [parts[0], parts[1] - parts[0], parts[2] - parts[1]], iterations)
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
    let dt = (courant > 0.0).then(|| end / (end * across / courant).round());
    let momentum = Momentum { upwind_share: share, viscosity: 1.0 / reynolds };
    let settings = Settings { density: 1.0, far: stream, momentum, tolerance: 1e-3 };
    let (cells, extents) = (grid.count(), grid.cells());
    println!("# {shape}: {cells} cells {extents:?}");
    let mut flow = Flow::new(grid, settings);
    flow.perturb(perturbation);
    if std::env::var("DEVICE").as_deref() == Ok("gpu") {
        let device = gpu::open().unwrap_or_else(|e| panic!("{e}"));
        println!("# on {}", device.name());
        flow.set_device(Some(device)).unwrap_or_else(|e| panic!("{e}"));
    }
    let area = if shape == "plate" { 1.0 } else { std::f64::consts::FRAC_PI_4 };
    let surface = surface(&shape, across as usize, turn);
    let (steps, parts, iterations) = run(&mut flow, &surface, (end, dt), area);
    flow.gather();
    let count = steps.len();
    let late = &steps[steps.partition_point(|s| s.time < end / 2.0)..];
    let quarters: Vec<f64> = late.chunks(late.len().div_ceil(4)).map(|q| means(q).0[0]).collect();
    let per_cell = 1e6 / (cells * count) as f64;
    let ([drag, all], side) = means(late);
    println!(
        "second half {drag:.4} +- {:.4} (at cut faces {all:.4}), quarters {quarters:.3?}, side force {side:.4}; {count} steps, {:.1} iterations; {:.4} us a \
         cell and step: prediction {:.4}, constraints {:.4}, projection {:.4}; divergence {:.0e}",
        interval(late),
        iterations as f64 / count as f64,
        parts.iter().sum::<f64>() * per_cell,
        parts[0] * per_cell,
        parts[1] * per_cell,
        parts[2] * per_cell,
        flow.largest_divergence()
    );
}
