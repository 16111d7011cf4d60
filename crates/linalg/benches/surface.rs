//! Times on the stiffness pattern of a surface mesh: product, factorisation, solve.
//!
//! `cargo bench -p linalg --bench surface [-- nodes_per_side ...]`, or the built
//! program under `mpirun -n N`: the sheet is cut into N strips.

use std::rc::Rc;
use std::time::Instant;

use comm::{Comm, Halo, Numbering};
use linalg::{BlockCsr, Gmres, KrylovParams, Operator, Preconditioner, SchurLu, SchwarzLu};

/// A triangulated square of `n x n` nodes: springs along the edges of changing directions,
/// a mass on the diagonal, and a nonsymmetric part like that of a follower pressure.
fn sheet(comm: &Comm, n: usize, mass: f64) -> BlockCsr<3> {
    let owner = |g: u64| (g as usize / n) * comm.size() / n;
    let total = (n * n) as u64;
    let owned: Vec<u64> = (0..total).filter(|&g| owner(g) == comm.rank()).collect();
    let at = |i: usize, j: usize| (i * n + j) as u64;
    let triangles: Vec<[u64; 3]> = (0..n - 1)
        .flat_map(|i| (0..n - 1).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .filter(|t| t.iter().any(|&g| owner(g) == comm.rank()))
        .collect();
    let ghosts = triangles.iter().flatten().filter(|&&g| owner(g) != comm.rank());
    let numbering = Numbering::new(owned, ghosts.map(|&g| (g, owner(g) as u32)).collect());
    let halo = Rc::new(Halo::new(comm, &numbering));
    let local: Vec<[u32; 3]> =
        triangles.iter().map(|t| t.map(|g| numbering.local(g).expect("known") as u32)).collect();
    let mut a = BlockCsr::<3>::from_elements(halo.clone(), local.iter().map(|t| &t[..]));
    for (t, g) in local.iter().zip(&triangles) {
        for (p, q) in [(0, 1), (1, 2), (2, 0)] {
            let angle = (g[p] * 31 + g[q] * 31) as f64;
            let d = [angle.cos(), angle.sin(), 0.3 * (2.0 * angle).sin()];
            for (row, col, sign) in [(p, p, 1.0), (p, q, -1.0), (q, q, 1.0), (q, p, -1.0)] {
                let (row, col) = (t[row] as usize, t[col] as usize);
                if row >= halo.n_owned() {
                    continue;
                }
                let s = a.slot(row, col).expect("an element's nodes couple");
                for r in 0..3 {
                    for c in 0..3 {
                        a.values[s][r][c] += sign * d[r] * d[c];
                    }
                    a.values[s][r][r] += if row == col { mass } else { 0.0 };
                    a.values[s][r][(r + 1) % 3] += sign * 0.3 * mass;
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

fn report(comm: &Comm, name: &str, a: &BlockCsr<3>, pre: &dyn Preconditioner, refactor: f64, bytes: usize) {
    let b: Vec<f64> = (0..a.n_owned()).map(|i| (i as f64).sin()).collect();
    let mut z = vec![0.0; a.n_local()];
    let solve = time(5, || pre.apply(&b, &mut z));
    let params = KrylovParams { rel_tol: 1e-9, ..Default::default() };
    z.fill(0.0);
    let info = Gmres::new(comm).solve(a, pre, &b, &mut z, params).expect("converges");
    if comm.is_root() {
        println!(
            "  {name}: refactor {:.1} ms, apply {:.2} ms, factor {:.1} MB, GMRES {} iterations to 1e-9",
            refactor * 1e3,
            solve * 1e3,
            bytes as f64 / 1e6,
            info.iterations
        );
    }
}

fn main() {
    let comm = Comm::init(None).expect("MPI starts");
    let sizes: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    for n in if sizes.is_empty() { vec![38, 100] } else { sizes } {
        for mass in [1.0, 1e-2, 1e-4] {
            let a = sheet(&comm, n, mass);
            let mut x: Vec<f64> = (0..a.n_local()).map(|i| i as f64).collect();
            let mut y = vec![0.0; a.n_owned()];
            let product = time(20, || a.apply(&mut x, &mut y));
            if comm.is_root() {
                println!(
                    "{} nodes, mass {mass}: product {:.3} ms ({:.1} MB, {:.1} GB/s)",
                    n * n,
                    product * 1e3,
                    a.bytes() as f64 / 1e6,
                    a.bytes() as f64 / product / 1e9
                );
            }
            let mut lu: SchwarzLu = SchwarzLu::new(&a).expect("regular");
            let t = time(3, || lu.refactor(&a).expect("regular"));
            report(&comm, "Schwarz f64", &a, &lu, t, lu.bytes());
            let mut lu = SchwarzLu::<3, f32>::new(&a).expect("regular");
            let t = time(3, || lu.refactor(&a).expect("regular"));
            report(&comm, "Schwarz f32", &a, &lu, t, lu.bytes());
            let mut lu: SchurLu = SchurLu::new(&a).expect("regular");
            let t = time(3, || lu.refactor(&a).expect("regular"));
            report(&comm, "Schur f64", &a, &lu, t, lu.bytes());
        }
    }
}
