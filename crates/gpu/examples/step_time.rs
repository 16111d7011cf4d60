//! Time of a step of the immersed flow on a GPU and on this processor.
//!
//!     cargo run --release -p gpu --example step_time -- [STEPS [CELLS...]]
//!
//! A sphere with friction, 40 % of the grid wide, in a stream; CELLS along each axis. With the environment variable `ONLY=gpu` or `ONLY=cpu` one of both. The table
//! has nanoseconds for each cell and step: prediction, constraints, end of the step, all; the time to cut the surface, in which the GPU has no part; and
//! the drag of the last step, the same for both.

use std::time::Instant;

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::flow::{Flow, Settings};
use immersed::free_edges::{EdgeFluxes, free_edges};
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use nalgebra::Vector3;

fn flow(cells: usize) -> Flow {
    let axis = || Axis::even(-1.25, 1.25, cells);
    let slip = Ends::Open([End::Slip; 2]);
    let grid = Grid::new([axis(), axis(), axis()], [slip, slip, Ends::Open([End::Inflow, End::Outflow])]);
    let momentum = Momentum { upwind_share: 0.5, viscosity: 1e-3 };
    let far = Vector3::new(0.0, 0.0, 1.0);
    Flow::new(grid, Settings { density: 1.2, far, momentum, tolerance: 1e-4 })
}

fn steps(mut flow: Flow, name: &str, count: usize) {
    let cells = flow.grid.count();
    let spacing = flow.grid.axes[0].spacing;
    let (nodes, faces) = shapes::sphere(0.5, 5);
    let clock = Instant::now();
    let cut = CutFaces::new(&flow.grid, &nodes, &faces, 1.0).expect("inside");
    let mut friction = Friction::new(&flow.grid, &nodes, &faces).expect("inside");
    let edges = EdgeFluxes::new(&flow.grid, &nodes, &free_edges(&faces)).expect("inside");
    let cutting = clock.elapsed().as_secs_f64();
    let (mut times, mut iterations, mut drag) = ([0.0; 3], 0, 0.0);
    let warm = 3;
    for step in 0..warm + count {
        let clocks = [0; 4].map(|_| std::cell::Cell::new(Instant::now()));
        flow.predict_around(0.2 * spacing, Vector3::zeros(), &edges, Some(&mut friction));
        clocks[1].set(Instant::now());
        let jumps = flow.solve_constraints(&cut.rows);
        clocks[2].set(Instant::now());
        flow.accept(&cut.rows, &jumps);
        // Waits for the device.
        let finite = flow.largest_speed(Vector3::zeros()).is_finite();
        clocks[3].set(Instant::now());
        assert!(finite && flow.device_failure().is_none(), "{:?}", flow.device_failure());
        if step >= warm {
            for (time, pair) in times.iter_mut().zip(clocks.windows(2)) {
                *time += (pair[1].get() - pair[0].get()).as_secs_f64();
            }
            iterations += jumps.iterations;
        }
        let mut forces = vec![Vector3::zeros(); nodes.len()];
        friction.add_node_forces(&faces, &mut forces);
        drag = forces.iter().map(|f| f.z).sum::<f64>()
            + (0..cut.rows.len()).map(|r| cut.rows.weight_by_axis(r).z * jumps.jump[r]).sum::<f64>();
    }
    let per_cell = |time: f64| 1e9 * time / (cells * count) as f64;
    let all: f64 = times.iter().sum();
    println!(
        "| {name} | {cells} | {} | {:.1} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} | {drag:.9} |",
        cut.rows.len(),
        iterations as f64 / count as f64,
        per_cell(times[0]),
        per_cell(times[1]),
        per_cell(times[2]),
        per_cell(all),
        1e9 * cutting / cells as f64,
    );
}

fn main() {
    let arguments: Vec<usize> = std::env::args().skip(1).map(|a| a.parse().expect("a number")).collect();
    let count = arguments.first().copied().unwrap_or(10);
    let sizes = if arguments.len() > 1 { &arguments[1..] } else { &[64, 128] };
    let only = std::env::var("ONLY").unwrap_or_default();
    let device = if only == "cpu" { None } else { Some(gpu::open().unwrap_or_else(|e| panic!("{e}"))) };
    println!("| where | cells | rows | iterations | prediction | constraints | end | all, ns | cut | drag |");
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for cells in sizes {
        if let Some(device) = &device {
            let mut flow = flow(*cells);
            flow.set_device(Some(device.clone())).unwrap_or_else(|e| panic!("{e}"));
            steps(flow, &device.name(), count);
        }
        if only != "gpu" {
            steps(flow(*cells), "processor", count);
        }
    }
}
