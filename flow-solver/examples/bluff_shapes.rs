//! Drag of shapes of zero thickness in a stream at Reynolds number 1e5.
//!
//! `cargo run --release -p flow-solver --example bluff_shapes -- <disk|plate|cup-open|cup-away> <inviscid|laminar|wale|ddes>
//! <cells across> <end, U/D> <seed of the push> [smallest upwind share] [time step times cells across, U/D] [half width of the box, D; cups]`
//!
//! Mean drag coefficient of the second half with a 95 % interval by batch means, means of quarters, root mean square of the side
//! force (flat shapes: of the moment about the centre by the diameter), Strouhal number, cells and iterations per step. The default upwind share is that of a scene with the model.

#[path = "../tests/common/mod.rs"]
mod common;
#[allow(dead_code, reason = "the plate of the peers is for another example")]
#[path = "../tests/common/plate.rs"]
mod plate;
#[path = "../tests/common/shapes.rs"]
mod shapes;
#[path = "../tests/common/wake.rs"]
mod wake;

use shapes::Shape;
use wake::{Case, Model, statistics};

fn main() {
    flow_solver::return_large_blocks();
    let text: Vec<String> = std::env::args().collect();
    let number = |k: usize, d: f64| text.get(k).map_or(d, |a| a.parse().expect("a number"));
    let name = |k: usize, d: &'static str| text.get(k).map_or(d, |a| a);
    let model = Model::named(name(2, "inviscid")).expect("a model: inviscid, laminar, wale or ddes");
    let case = Case {
        shape: Shape::named(name(1, "cup-open")).expect("a shape: disk, plate, cup-open or cup-away"),
        model,
        across: number(3, 8.0) as usize,
        end: number(4, 100.0),
        seed: number(5, 1.0) as u64,
        upwind: number(6, model.upwind_share()),
        courant: number(7, 0.8),
        half: number(8, 5.0),
    };
    let begin = std::time::Instant::now();
    let wake = case.run(|[t, drag, x, y]| {
        let eta = begin.elapsed().as_secs_f64() * (case.end / t - 1.0);
        eprintln!("t {t:.1} of {} U/D: cd {drag:.4}, side {x:.3} {y:.3}; ETA {eta:.0} s", case.end);
    });
    let s = statistics(&wake.rows);
    println!("{case:?}: {} cells, {:.2} iterations per step", wake.cells, wake.iterations);
    println!(
        "cd {:.4} +- {:.4} ({} batches, correlation {:.2}), quarters {:.3?}, side rms {:.4}, St {:.3} (resolution {:.3}), {:.0} s",
        s.drag,
        s.interval,
        s.batches,
        s.correlation,
        s.quarters,
        s.side,
        s.strouhal,
        s.resolution,
        begin.elapsed().as_secs_f64()
    );
}
