//! Times on an elasticity matrix of a cube: product, multigrid set-up, cycle, solve.
//!
//! `cargo bench -p linalg --bench volume [-- cells_per_side ...]`

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use comm::Comm;
use linalg::{Amg, AmgParams, BlockJacobi, Cg, KrylovParams, Operator, Preconditioner, Real};

fn time<R>(repeats: usize, mut f: impl FnMut() -> R) -> f64 {
    (0..repeats)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(f());
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn product<T: Real>(name: &str, p: &common::Problem) {
    let a = p.a.cast::<T>();
    let mut x: Vec<f64> = (0..a.n_local()).map(|i| (i as f64).sin()).collect();
    let mut y = vec![0.0; a.n_owned()];
    let t = time(10, || a.apply(&mut x, &mut y));
    println!(
        "  product {name}: {:.2} ms, {:.1} MB, {:.1} GB/s, {:.2} ns a block",
        t * 1e3,
        a.bytes() as f64 / 1e6,
        a.bytes() as f64 / t / 1e9,
        t * 1e9 / a.values.len() as f64
    );
}

fn main() {
    let comm = Comm::solo();
    let sizes: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    for n in if sizes.is_empty() { vec![20, 40] } else { sizes } {
        let p = common::box_problem(&comm, [n; 3], [1.0; 3], |_| 1.0);
        println!("{} nodes", p.coords.len());
        product::<f64>("f64", &p);
        product::<f32>("f32", &p);
        let start = Instant::now();
        let amg = Amg::<f32>::new(&p.a, &p.coords, AmgParams::default()).unwrap();
        let setup = start.elapsed().as_secs_f64();
        let mut z = vec![0.0; p.a.n_owned()];
        let cycle = time(10, || amg.apply(&p.b, &mut z));
        println!(
            "  multigrid: set-up {setup:.2} s, levels {:?}, {:.1} MB, cycle {:.2} ms",
            amg.nodes(),
            amg.bytes() as f64 / 1e6,
            cycle * 1e3
        );
        let jacobi = BlockJacobi::<3>::new(&p.a).unwrap();
        for (name, pre) in [("multigrid", &amg as &dyn Preconditioner), ("block Jacobi", &jacobi)] {
            let mut x = vec![0.0; p.a.n_local()];
            let params = KrylovParams { rel_tol: 1e-6, max_iterations: 2000, ..Default::default() };
            let start = Instant::now();
            let info = Cg::new(&comm).solve(&p.a, pre, &p.b, &mut x, params).unwrap();
            let t = start.elapsed().as_secs_f64();
            println!("  CG with {name} to 1e-6: {} iterations, {t:.2} s", info.iterations);
        }
    }
}
