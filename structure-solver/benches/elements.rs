//! What an element costs: `cargo bench -p structure-solver --bench elements [-- n]`
//!
//! Nanoseconds per triangle for the forces of the element loop, and for the whole
//! assembly of residual and matrix, on the air bag with 2 n^2 triangles, for each law
//! in each state. `blend`: stresses from averaged strains, as generalized-alpha asks.

mod support;

use std::hint::black_box;

use structure_solver::loops::{Configuration, FaceLoad};

/// Processor seconds that one measurement takes at least.
const ENOUGH: f64 = 0.3;

/// Seconds of one call of `f`: the least of three samples, each long enough.
fn cost(mut f: impl FnMut()) -> f64 {
    f();
    let mut calls = 1;
    let mut best = f64::INFINITY;
    let mut samples = 0;
    while samples < 3 {
        let start = support::seconds_run();
        (0..calls).for_each(|_| f());
        let seconds = support::seconds_run() - start;
        if seconds < ENOUGH / 3.0 {
            calls *= 2;
        } else {
            best = best.min(seconds / f64::from(calls));
            samples += 1;
        }
    }
    best
}

fn main() {
    let n = std::env::args().find_map(|a| a.parse().ok()).unwrap_or(100);
    println!("{:>9} {:>9} {:>6} {:>12} {:>14}", "law", "state", "blend", "forces ns", "assembly ns");
    for wrinkling in [false, true] {
        let mut d = support::air_bag(n, wrinkling, "");
        let reference = d.system.model.reference.clone();
        let triangles = d.system.model.triangles.len() as f64;
        let pressure = vec![23.94; d.system.model.n_faces];
        let load = FaceLoad { pressure: &pressure, traction: &[] };
        let mut out = vec![0.0; reference.len()];
        // Stretches along x and y, and what the nodes are moved about by, as a share of
        // an element: neighbours in different states defeat the branch prediction.
        let mixed = ("mixed", [1.0, 1.0], 0.05);
        let states = [
            ("taut", [1.02, 1.01], 0.0),
            ("wrinkled", [1.02, 0.97], 0.0),
            ("slack", [0.98, 0.97], 0.0),
            mixed,
        ];
        for (name, stretch, shake) in if wrinkling { &states[..] } else { &states[..1] } {
            let size = 0.1524 / n as f64;
            let noise = |i: usize| ((i as f64 * 12.9898).sin() * 43758.5453).fract() * shake * size;
            let x: Vec<f64> = reference
                .iter()
                .enumerate()
                .map(|(i, x)| x * if i % 3 < 2 { stretch[i % 3] } else { 1.0 } + noise(i))
                .collect();
            let middle: Vec<f64> = x.iter().zip(&reference).map(|(a, b)| 0.5 * (a + b)).collect();
            d.system.anchor(&reference);
            for blend in [false, true] {
                let configuration = if blend {
                    Configuration { at: &middle, end: &x, weight: 0.5 }
                } else {
                    Configuration::only(&x)
                };
                let forces = cost(|| {
                    d.system.forces(black_box(configuration), load, &mut out);
                });
                let assembly = cost(|| {
                    d.system.tangent(black_box(configuration), load, 1.0, 1e8, &mut out);
                });
                println!(
                    "{:>9} {name:>9} {blend:>6} {:>12.1} {:>14.1}",
                    if wrinkling { "tension" } else { "elastic" },
                    1e9 * forces / triangles,
                    1e9 * assembly / triangles
                );
            }
        }
    }
}
