//! Movers compared on large motions: `cargo bench -p mesh-mover --bench benchmark_motions [-- cells_per_side] [bare]
//! [Elastic ...]`
//!
//! Each motion continues in windows of a twentieth, at most to twice its nominal size. Printed: the share that was
//! reached, the worst scaled Jacobian up to the nominal size (or to the end), the number of reference grids, and
//! processor time for each cell and window; then 1000 oscillations and their drift.

use std::f64::consts::TAU;

use case::{MeshMotion, MoverKind};
use mesh::FlowGrid;
use mesh_mover::benchmark_motions::{MOTIONS, MotionTrial, Path, plate};
use mesh_mover::motion::Limits;
use mesh_mover::movers::mover;

/// Processor seconds of this thread, from the kernel's statistics.
fn seconds_run() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux keeps accounts");
    let nanoseconds = text.split(' ').next().and_then(|w| w.parse::<f64>().ok());
    1e-9 * nanoseconds.expect("three numbers")
}

const KINDS: [MoverKind; 5] = [
    MoverKind::Elastic,
    MoverKind::PlainElastic,
    MoverKind::Laplacian,
    MoverKind::RadialBasis,
    MoverKind::InverseDistance,
];

/// Repair of bad cells, unless the argument `bare` is given.
fn repair() -> bool {
    std::env::args().all(|a| a != "bare")
}

fn main() {
    let n = std::env::args().find_map(|a| a.parse().ok()).unwrap_or(16);
    let selected = |kind: &MoverKind| std::env::args().any(|a| a == format!("{kind:?}"));
    let some = KINDS.iter().any(selected);
    let kinds: Vec<MoverKind> = KINDS.into_iter().filter(|k| !some || selected(k)).collect();
    let grid = plate(n);
    println!("{} cells", grid.cells.len());
    for (name, path) in MOTIONS {
        println!("{name}");
        kinds.iter().for_each(|&kind| large_motion(&grid, kind, path));
    }
    println!("1000 oscillations of 8 windows, lifted by a sixth of the width and squeezed by a tenth");
    kinds.into_iter().for_each(oscillations);
}

fn large_motion(grid: &FlowGrid, kind: MoverKind, path: Path) {
    let cells = grid.cells.len() as f64;
    let settings = MeshMotion { mover: kind, ..MeshMotion::default() };
    let limits = Limits { repair: repair(), ..Limits::from(&settings) };
    let mut trial = MotionTrial::new(grid, mover(&settings), limits).expect("a sound start grid");
    let (mut worst, mut survived, mut iterations, mut failed) = (f64::INFINITY, 0, 0, String::new());
    let clock = seconds_run();
    for step in 1..=40 {
        match trial.window(|p| path(p, f64::from(step) / 20.0)) {
            Ok(moved) => {
                survived = step;
                iterations += moved.effort.iterations;
                if step <= 20 {
                    worst = f64::min(worst, moved.shape.quality);
                }
            }
            Err(error) => {
                failed = error.to_string();
                break;
            }
        }
    }
    let spent = seconds_run() - clock;
    println!(
        "  {:16} survived {:>4.2} worst {worst:>6.3} iterations {iterations:>4} references {:>2} {:>7.2} us/cell/window {}",
        format!("{kind:?}"),
        f64::from(survived) / 20.0,
        trial.motion.rebased(),
        1e6 * spent / cells / f64::from(survived.max(1)),
        failed.chars().take(60).collect::<String>(),
    );
}

fn oscillations(kind: MoverKind) {
    let settings = MeshMotion { mover: kind, ..MeshMotion::default() };
    let grid = plate(16);
    let mut trial =
        MotionTrial::new(&grid, mover(&settings), Limits::from(&settings)).expect("a sound start grid");
    let (mut iterations, mut worst) = (0, f64::INFINITY);
    let cycles = if kind == MoverKind::Elastic { 1000 } else { 20 };
    for window in 0..8 * cycles {
        let s = (TAU * f64::from((window + 1) % 8) / 8.0).sin();
        let s = if (window + 1) % 8 == 0 { 0.0 } else { s };
        let moved = trial.window(|p| [p[0] * (1.0 - 0.1 * s), p[1] * (1.0 - 0.1 * s), p[2] + 0.125 * s]);
        let moved = moved.expect("a moderate motion");
        iterations += moved.effort.iterations;
        worst = f64::min(worst, moved.shape.quality);
    }
    let drift = trial.at.grid.iter().zip(&trial.start.grid).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!(
        "  {:16} {cycles} cycles: worst {worst:.3}, {iterations} iterations, drift {drift:.1e} m, references {}",
        format!("{kind:?}"),
        trial.motion.rebased()
    );
}
