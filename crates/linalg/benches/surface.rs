//! Times on the stiffness pattern of a surface mesh: product, factorisation, solve.
//!
//! `cargo bench -p linalg --bench surface [-- nodes_per_side ...]`

use std::rc::Rc;
use std::time::Instant;

use comm::{Comm, Halo};
use linalg::{BlockCsr, Gmres, KrylovParams, Operator, Preconditioner, Real, SchwarzLu};

/// A triangulated square of `n x n` nodes: springs along the edges of random directions
/// plus a mass, and a nonsymmetric part like that of a follower pressure.
fn sheet(n: usize) -> BlockCsr<3> {
    let at = |i: usize, j: usize| (i * n + j) as u32;
    let triangles: Vec<[u32; 3]> = (0..n - 1)
        .flat_map(|i| (0..n - 1).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect();
    let mut a = BlockCsr::<3>::from_elements(Rc::new(Halo::solo(n * n)), triangles.iter().map(|t| &t[..]));
    for t in &triangles {
        for (p, q) in [(0, 1), (1, 2), (2, 0)] {
            let (i, j) = (t[p] as usize, t[q] as usize);
            let angle = (i * 31 + j * 17) as f64;
            let d = [angle.cos(), angle.sin(), 0.3 * (2.0 * angle).sin()];
            for (row, col, sign) in [(i, i, 1.0), (i, j, -1.0), (j, j, 1.0), (j, i, -1.0)] {
                let s = a.slot(row, col).unwrap();
                for r in 0..3 {
                    for c in 0..3 {
                        a.values[s][r][c] += sign * d[r] * d[c];
                    }
                    a.values[s][r][r] += if row == col { 1e-2 } else { 0.0 };
                    a.values[s][r][(r + 1) % 3] += sign * 0.03;
                }
            }
        }
    }
    a
}

fn time<R>(repeats: usize, mut f: impl FnMut() -> R) -> f64 {
    (0..repeats)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(f());
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn factor<T: Real>(name: &str, a: &BlockCsr<3>) {
    let start = Instant::now();
    let mut lu = SchwarzLu::<3, T>::plan(a);
    let plan = start.elapsed().as_secs_f64();
    let refactor = time(3, || lu.refactor(a).unwrap());
    let n = a.n_owned();
    let exact: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let mut b = vec![0.0; n];
    a.apply(&mut exact.clone(), &mut b);
    let mut z = vec![0.0; n];
    let solve = time(5, || lu.apply(&b, &mut z));
    let mut gmres = Gmres::new(&Comm::solo());
    let mut x = vec![0.0; n];
    let params = KrylovParams { rel_tol: 1e-9, ..Default::default() };
    let info = gmres.solve(a, &lu, &b, &mut x, params).unwrap();
    println!(
        "  {name}: plan {:.1} ms, refactor {:.1} ms, solve {:.2} ms, factor {:.1} MB, GMRES {} iterations to 1e-9",
        plan * 1e3,
        refactor * 1e3,
        solve * 1e3,
        lu.bytes() as f64 / 1e6,
        info.iterations
    );
}

fn main() {
    let sizes: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    for n in if sizes.is_empty() { vec![38, 100] } else { sizes } {
        let a = sheet(n);
        let mut x: Vec<f64> = (0..a.n_local()).map(|i| i as f64).collect();
        let mut y = vec![0.0; a.n_owned()];
        let product = time(20, || a.apply(&mut x, &mut y));
        println!(
            "{} nodes: product {:.3} ms ({:.1} MB, {:.1} GB/s)",
            n * n,
            product * 1e3,
            a.bytes() as f64 / 1e6,
            a.bytes() as f64 / product / 1e9
        );
        factor::<f64>("f64", &a);
        factor::<f32>("f32", &a);
    }
}
