//! Memory: bandwidth of this machine, bytes an inner iteration asks for, halo of a split grid.
//!
//! `cargo run --release -p flow-solver --example bandwidth`
//!
//! Bytes of an iteration are counted from the arrays that it passes, each once (caches hold what
//! neighbours share); the table of halos splits the plate's 250 880 cells for any number of ranks
//! without running them.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/plate.rs"]
mod plate;

use std::time::Instant;

use flow_solver::Method;
use flow_solver::physics::{Isothermal, Laminar};
use flow_solver::topology::Topology;
use mesh::{FaceTable, Graph};

/// Processor time of this process so far, s.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").expect("Linux");
    text.split(' ').next().and_then(|t| t.parse::<f64>().ok()).expect("nanoseconds") * 1e-9
}

/// STREAM triad `a = b + s c`, GB/s, best of ten: three arrays of 24 bytes an element counted.
fn triad() -> f64 {
    let n = 20_000_000;
    let (mut a, b, c) = (vec![0.0f64; n], vec![1.0f64; n], vec![2.0f64; n]);
    let best = (0..10)
        .map(|k| {
            let start = Instant::now();
            let s = 0.5 + f64::from(k);
            for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
                *a = b + s * c;
            }
            std::hint::black_box(&mut a);
            start.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min);
    24.0 * n as f64 / best * 1e-9
}

fn main() {
    flow_solver::return_large_blocks();
    println!("triad on one core: {:.1} GB/s", triad());
    let mut settings = common::settings([0.0, 0.0, 4.88], 1e-2);
    settings.moving = false;
    let depth = 4;
    settings.method = Method::PressureCorrection { depth };
    let gas = Isothermal::new(settings.air);
    let grid = plate::plate(1);
    let split = split(&grid);
    let viscosity = Laminar { viscosity: 4.88 / 200.0 * 1.225 };
    let mut s = common::solver_on(grid, gas, viscosity, settings);
    let (n, f, e) =
        (s.topology.n_owned as f64, s.topology.cells.len() as f64, s.topology.adjacency.cell.len() as f64);
    let (mut iterations, mut linear, mut time) = (0, 0, 0.0);
    for k in 0..10 {
        let begin = cpu();
        let report = s.advance(&common::at_rest(0.02)).expect("the plate's steps converge");
        if k >= 4 {
            iterations += report.iterations;
            linear += report.linear_iterations;
            time += cpu() - begin;
        }
        s.accept(0.02, false);
    }
    let each = time / iterations as f64;
    let solves = linear as f64 / iterations as f64;
    // q, gradient, residual and what else the residual reads and writes; of four equations.
    let gradients = n * (32.0 + 8.0 + 2.0 * 96.0) + e * (4.0 + 12.0);
    let fluxes = f * (48.0 + 2.0 * 16.0 + 8.0) + n * (24.0 + 32.0 + 96.0 + 2.0 * 32.0 + 32.0);
    let storage = n * (32.0 + 2.0 * 32.0 + 32.0 + 16.0);
    // Two differences written, two products with each kept one, both combinations.
    let kept = 2.0f64;
    let combine = n * (3.0 * 32.0 + 3.0 * 16.0 + kept * (4.0 * 16.0) + 4.0 * 32.0);
    // Transport up and down, mass defect, gradient of the correction, new state.
    let correction = e * (8.0 + 16.0) + f * (48.0 + 8.0) + n * (2.0 * 32.0 + 6.0 * 16.0 + 2.0 * 32.0 + 60.0);
    // A conjugate-gradient step: product, sweeps down and up, residual; coarse levels a seventh more.
    let pressure = solves * (e * (8.0 + 4.0 + 8.0 + 4.0) + n * 15.0 * 4.0) * 8.0 / 7.0;
    let all = gradients + fluxes + storage + combine + correction + pressure;
    println!(
        "{n} cells, {:.2} us a cell and iteration ({solves:.1} steps of the pressure equation each)",
        each * 1e6 / n
    );
    for (what, bytes) in [
        ("gradients", gradients),
        ("fluxes", fluxes),
        ("time derivative", storage),
        ("combination", combine),
        ("correction", correction),
        ("pressure", pressure),
        ("all", all),
    ] {
        println!("  {what:16} {:6.0} bytes a cell", bytes / n);
    }
    println!("  {:.1} GB/s over the time of an iteration", all / each * 1e-9);
    print_split(split, n, solves);
}

/// What the ranks of a split grid of `n` cells send, with `solves` steps of the pressure equation an iteration.
fn print_split(split: Vec<(usize, usize, usize, usize)>, n: f64, solves: f64) {
    println!("ranks  cells/rank  ghosts (most)  neighbours  MB sent a step (3.9 iterations)  messages");
    for (ranks, cells, ghosts, neighbours) in split {
        // q, gradients, transport, response, correction; each pressure step exchanges three times
        // on the finest level and on every coarser one with a quarter of the ghosts or less.
        let bytes = ghosts as f64 * (32.0 + 96.0 + 16.0 + 4.0 + 4.0 + solves * 12.0 * 4.0 / 3.0);
        let levels = (n / ranks as f64).log(8.0).ceil();
        let messages = neighbours as f64 * (5.0 + solves * (1.0 + 2.0 * levels));
        println!(
            "{ranks:5} {cells:11} {ghosts:14} {neighbours:11} {:32.3} {:9.0}",
            3.9 * bytes * 1e-6,
            3.9 * messages
        );
    }
}

/// Ranks, most cells, most ghosts and most neighbours of a rank.
fn split(grid: &mesh::FlowGrid) -> Vec<(usize, usize, usize, usize)> {
    let faces = FaceTable::new(grid).expect("a sound grid");
    let graph = Graph::of_cells(grid.cells.len(), &faces);
    let order: Vec<u32> = (0..grid.cells.len() as u32).collect();
    [2, 4, 8, 16, 32, 64]
        .map(|ranks| {
            let part = graph.partition(ranks, None).expect("more cells than ranks");
            let (mut cells, mut ghosts, mut most) = (0, 0, 0);
            for rank in 0..ranks as u32 {
                let t = Topology::new(grid, &faces, &part, &order, rank, true);
                cells = cells.max(t.n_owned);
                ghosts = ghosts.max(t.n_local() - t.n_owned);
                let mut owners = t.numbering.ghost_owner.clone();
                owners.dedup();
                most = most.max(owners.len());
            }
            (ranks, cells, ghosts, most)
        })
        .to_vec()
}
