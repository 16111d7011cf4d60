//! Multigrid on a cube of trilinear hexahedra: counts, bounds on their growth.

mod common;

use std::time::Instant;

use comm::Comm;
use linalg::{Amg, AmgParams, Cg, KrylovParams, Operator, Real};

fn iterations<T: Real>(cells: [usize; 3], size: [f64; 3], stiffness: impl Fn([f64; 3]) -> f64) -> usize {
    let comm = Comm::solo();
    let p = common::box_problem(&comm, cells, size, stiffness);
    let start = Instant::now();
    let amg = Amg::<T>::new(&p.a, &p.coords, AmgParams::default()).unwrap();
    let setup = start.elapsed().as_secs_f64();
    let mut x = vec![0.0; p.a.n_local()];
    let params = KrylovParams { rel_tol: 1e-8, max_iterations: 200, ..Default::default() };
    let start = Instant::now();
    let info = Cg::new(&comm).solve(&p.a, &amg, &p.b, &mut x, params).unwrap();
    println!(
        "{cells:?}: {} iterations, levels {:?}, hierarchy {:.2} of the matrix, set-up {setup:.2} s, solve {:.2} s",
        info.iterations,
        amg.nodes(),
        amg.bytes() as f64 / p.a.bytes() as f64,
        start.elapsed().as_secs_f64()
    );
    info.iterations
}

#[test]
fn counts_hardly_grow_with_the_grid() {
    let small = iterations::<f32>([12; 3], [1.0; 3], |_| 1.0);
    let large = iterations::<f32>([30; 3], [1.0; 3], |_| 1.0);
    // 16 times the nodes; a one-level method would need 2.5 times the iterations.
    assert!(small <= 16 && large <= small + 6, "{small} {large}");
}

#[test]
fn storage_in_single_precision_costs_no_iterations() {
    let double = iterations::<f64>([14; 3], [1.0; 3], |_| 1.0);
    let single = iterations::<f32>([14; 3], [1.0; 3], |_| 1.0);
    assert!(single <= double + 1, "{single} {double}");
}

#[test]
fn stretched_cells_and_graded_stiffness_are_bearable() {
    let graded = |x: [f64; 3]| 10f64.powf(4.0 * (1.0 - x[0] - x[1]).abs());
    let stretched = iterations::<f32>([16; 3], [1.0, 1.0, 0.25], |_| 1.0);
    let graded = iterations::<f32>([16; 3], [1.0; 3], graded);
    assert!(stretched <= 45 && graded <= 25, "{stretched} {graded}");
}
