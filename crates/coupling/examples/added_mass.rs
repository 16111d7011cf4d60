//! Seconds to assemble the added-mass surrogate of a bent square canopy, and of one product with it.
//!
//! `cargo run --release --locked -p coupling --example added_mass -- SIDE [SCREENING]`: `SIDE` x `SIDE` faces, one group
//! each; `SCREENING` in 1/m for compressible air (0).

use std::time::Instant;

use coupling::frame_axes::FrameAxes;
use coupling::schemes::{
    AddedMassRelaxation, AddedMassSurrogate, Air, MassProperties, Relaxation, Unknowns, VortexLattice,
};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let side: usize = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(35);
    let screening: f64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(0.0);
    let place = |k: usize| [(k % (side + 1)) as f64 / side as f64, (k / (side + 1)) as f64 / side as f64];
    let positions: Vec<mesh::Point> = (0..(side + 1).pow(2))
        .map(|k| {
            let [x, y] = place(k);
            [x, y, 0.5 * (x - 0.4).powi(2) + 0.6 * x * y]
        })
        .collect();
    let node = |i: usize, j: usize| (j * (side + 1) + i) as u32;
    let faces: Vec<[u32; 4]> = (0..side * side)
        .map(|k| (k % side, k / side))
        .map(|(i, j)| [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)])
        .collect();
    let air = Air::incompressible(1.2);
    let masses =
        MassProperties { fabric_kg_m2: 0.05, air, response: 0.275, difference: 1.5, falling_kg: 10.0 };
    let unknowns = Unknowns::new(positions.len(), 5e-3, FrameAxes::Vertical);
    let at_rest = vec![0.0; 3 * positions.len()];
    let start = Instant::now();
    let gain = Some(masses.gain());
    let lattice = VortexLattice::with_relaxation(&positions, &faces, usize::MAX, screening, gain)
        .expect("a sound canopy");
    let surrogate = AddedMassSurrogate::new(unknowns, &lattice, &at_rest, [0.0; 3], &faces, air, usize::MAX)
        .expect("a regular matrix");
    let relaxation = AddedMassRelaxation::new(unknowns, &faces, &masses, &lattice).expect("a regular matrix");
    let all = start.elapsed();
    let x: Vec<f64> = (0..unknowns.len()).map(|i| 1e-3 * (0.1 * i as f64).sin()).collect();
    let (mut response, mut step) = (vec![0.0; surrogate.response_len()], vec![0.0; x.len()]);
    let products = 200;
    let start = Instant::now();
    for _ in 0..products {
        surrogate.added_mass_load(&x, 5e-3, &mut response);
        relaxation.apply(&x, &mut step);
    }
    let product = start.elapsed() / products;
    println!(
        "{} groups: lattice with its inverses {:.3} s; load and relaxation {:.3} ms; vertical added mass {:.6} kg",
        faces.len(),
        all.as_secs_f64(),
        1e3 * product.as_secs_f64(),
        relaxation.vertical_added_mass
    );
}
