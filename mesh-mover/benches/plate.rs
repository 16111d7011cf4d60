//! Cost of the grid motion: `cargo bench -p mesh-mover --bench plate [-- cells_per_side ...]`
//!
//! Grids of one shape with increasing resolution. A plate in a box deforms in small steps, four solves a window,
//! sixty windows, of which the first has no warm start. Times are processor times (Linux), so that the load of the
//! machine has little influence.

use case::MeshMotion;
use channel::{Input, Participant, Window, mesh_stats};
use comm::Comm;
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::{plate_in_box, plate_structure};
use mesh_mover::motion::Limits;
use mesh_mover::mover::Mover;
use mesh_mover::participant::{MeshMover, Setup};

/// Processor seconds of this thread, from the kernel's statistics.
fn seconds_run() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux keeps accounts");
    let nanoseconds = text.split(' ').next().and_then(|w| w.parse::<f64>().ok());
    1e-9 * nanoseconds.expect("three numbers")
}

/// Peak memory of this process so far, bytes.
fn peak_bytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux keeps accounts");
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    1024.0 * line.and_then(|l| l.trim().split(' ').next()?.parse::<f64>().ok()).expect("a number of kB")
}

const WINDOWS: u64 = 60;
const CALLS: u64 = 4;

fn main() {
    let sizes: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    println!(
        "{:>9} {:>12} {:>9} {:>8} {:>8} {:>9} {:>11} {:>15} {:>8}",
        "cells", "mover", "start s", "B/cell", "peak", "cold it", "it a window", "us/cell/window", "quality"
    );
    for n in if sizes.is_empty() { vec![16, 32] } else { sizes } {
        bench(n, "elastic", Box::new(Elastic::new(Solid::from(&MeshMotion::default()))));
    }
}

fn bench(n: usize, name: &str, mover: Box<dyn Mover>) {
    let grid = plate_in_box(n, 0.1, 0.9f64.powf(32.0 / n as f64), false);
    let structure = plate_structure(&grid);
    let cells = grid.cells.len() as f64;
    let owner = vec![0; grid.coords.len()];
    let clock = seconds_run();
    let limits = Limits::from(&MeshMotion::default());
    let setup = Setup {
        grid: &grid,
        structure: &structure,
        owner: &owner,
        mover,
        limits,
        state: None,
        outer: Default::default(),
        regridder: None,
        bodies: Default::default(),
    };
    let mut mover = MeshMover::on_grid(setup, &Comm::solo()).expect("the sample grid is sound");
    let start = seconds_run() - clock;
    let mut output = vec![0.0; 6 * grid.coords.len()];
    let (mut cold, mut warm_start_basis, mut seconds, mut quality) = (0.0, 0.0, 0.0, f64::INFINITY);
    for index in 0..WINDOWS {
        let mut w = Window { index, dt: 5e-3, ..Window::default() };
        for iteration in 0..CALLS {
            w.iteration = iteration;
            let max_error = if iteration + 1 < CALLS { 0.3 * 0.1f64.powi(iteration as i32) } else { 0.0 };
            let t = 0.15 * (index as f64 + 1.0 - max_error);
            let bend = |p: &[f64; 3]| {
                [0.05 * t.sin() * p[0], 0.05 * t.sin() * p[1], 0.1 * t.sin() * (2.0 * p[0] + t).cos()]
            };
            let displacement: Vec<f64> = structure.coords.iter().flat_map(bend).collect();
            let input = Input { canopy: &displacement, grid: Default::default() };
            let clock = seconds_run();
            let v = mover.advance(&w, &input, &mut output).expect("a small motion").values;
            if (index, iteration) == (0, 0) {
                cold = v[mesh_stats::ITERATIONS];
            } else if index > 0 {
                seconds += seconds_run() - clock;
                warm_start_basis += v[mesh_stats::ITERATIONS];
            }
            quality = f64::min(quality, v[mesh_stats::MIN_QUALITY]);
        }
        mover.accept(&w).expect("was answered");
    }
    let windows = (WINDOWS - 1) as f64;
    println!(
        "{cells:>9} {name:>12} {start:>9.2} {:>8.0} {:>8.0} {cold:>9} {:>11.2} {:>15.3} {quality:>8.3}",
        mover.motion().bytes() as f64 / cells,
        peak_bytes() / cells,
        warm_start_basis / windows,
        1e6 * seconds / windows / cells,
    );
}
