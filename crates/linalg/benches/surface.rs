//! A kept sparse factor on a membrane: fill, work, and what factorising, applying and a
//! GMRES iteration cost, beside what the memory of this machine allows.
//!
//! `cargo bench -p linalg --bench surface [-- nodes_per_side ...]`, or the built
//! program under `mpirun -n N`: the sheet is cut into N strips. Times are medians of
//! processor time, which other processes on the machine disturb less than the clock's.

use std::rc::Rc;

use comm::{Comm, Halo, Numbering};
use linalg::{BlockCsr, Gmres, KrylovParams, Operator, Preconditioner, SchwarzLu};

/// Seconds of processor time of this process.
fn cpu_seconds() -> f64 {
    let mut t = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: writes the struct it is given.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut t) };
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

/// Median of the processor time of `f`.
fn time<R>(repeats: usize, mut f: impl FnMut() -> R) -> f64 {
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            let start = cpu_seconds();
            std::hint::black_box(f());
            cpu_seconds() - start
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[repeats / 2]
}

type V3 = [f64; 3];
fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// How a membrane stands at one Newton step. Lengths in edges of the mesh, stiffness in
/// that of the fabric, time in what a wave in the fabric takes along an edge.
struct State {
    /// Height of the cap over its radius.
    rise: f64,
    /// Stress over stiffness: what resists out of the surface.
    strain: f64,
    /// Time step (the Courant number of waves in the fabric); infinite for statics.
    courant: f64,
}

/// Tangent matrix of a pressurised cap of `n x n` nodes, linear triangles: membrane
/// stiffness, stiffness of the stress, follower pressure (nonsymmetric at the rim) and
/// the inertia of a Newmark step.
fn membrane(comm: &Comm, n: usize, state: &State) -> BlockCsr<3> {
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

    let radius = 0.5 * n as f64;
    let position = |g: u64| {
        let (x, y) = ((g as usize / n) as f64 - radius, (g as usize % n) as f64 - radius);
        [x, y, state.rise * radius * (1.0 - (x * x + y * y) / (radius * radius))]
    };
    let (lambda, mu, stress) = (0.3, 0.35, state.strain);
    let pressure = 2.0 * stress * 2.0 * state.rise / radius;
    for (t, g) in local.iter().zip(&triangles) {
        let x = g.map(position);
        // Edge opposite to each node; gradients of the shape functions.
        let edge = [0, 1, 2].map(|k| sub(x[(k + 2) % 3], x[(k + 1) % 3]));
        let normal = cross(edge[0], edge[1]);
        let double_area = dot(normal, normal).sqrt();
        let normal = normal.map(|v| v / double_area);
        let gradient = edge.map(|e| cross(normal, e).map(|v| v / double_area));
        let area = 0.5 * double_area;
        for p in (0..3).filter(|&p| (t[p] as usize) < halo.n_owned()) {
            for q in 0..3 {
                let (gp, gq, e) = (gradient[p], gradient[q], edge[q]);
                let d = dot(gp, gq);
                let slot = a.slot(t[p] as usize, t[q] as usize).expect("an element's nodes couple");
                let skew = [[0.0, -e[2], e[1]], [e[2], 0.0, -e[0]], [-e[1], e[0], 0.0]];
                let block = &mut a.values[slot];
                for r in 0..3 {
                    for c in 0..3 {
                        let one = if r == c { 1.0 } else { 0.0 };
                        let tangent = one - normal[r] * normal[c];
                        block[r][c] += area
                            * (lambda * gp[r] * gq[c]
                                + mu * (gq[r] * gp[c] + d * tangent)
                                + stress * d * one)
                            - pressure / 6.0 * skew[r][c];
                    }
                    if p == q {
                        block[r][r] += area / 3.0 * 4.0 / (state.courant * state.courant);
                    }
                }
            }
        }
    }
    a
}

/// What is measured of a factor.
trait Factor: Preconditioner {
    fn refactor(&mut self, a: &BlockCsr<3>);
    /// Bytes, and multiplications with addition of a factorisation.
    fn size(&self) -> (usize, f64);
}

macro_rules! factor {
    ($($factor:ty),*) => {$(
        impl Factor for $factor {
            fn refactor(&mut self, a: &BlockCsr<3>) {
                <$factor>::refactor(self, a).expect("regular");
            }
            fn size(&self) -> (usize, f64) {
                (self.bytes(), self.flops() as f64)
            }
        }
    )*};
}
factor!(SchwarzLu<3, f64>, SchwarzLu<3, f32>);

/// `first` is what the factor is made from, `a` what it then serves for.
fn report(
    comm: &Comm,
    name: &str,
    first: &BlockCsr<3>,
    a: &BlockCsr<3>,
    factor: &mut dyn Factor,
    number: usize,
) {
    factor.refactor(first);
    let refactor = time(5, || factor.refactor(first));
    let b: Vec<f64> = (0..a.n_owned()).map(|i| (i as f64).sin()).collect();
    let mut z = vec![0.0; a.n_local()];
    let apply = time(15, || factor.apply(&b, &mut z));
    let mut gmres = Gmres::new(comm);
    let mut solve = |a: &BlockCsr<3>, rel_tol| {
        let mut iterations = 0;
        let t = time(5, || {
            z.fill(0.0);
            let params = KrylovParams { rel_tol, restart: 60, ..Default::default() };
            iterations = gmres.solve(a, &*factor, &b, &mut z, params).expect("converges").iterations;
        });
        (iterations, t)
    };
    let (fresh, _) = solve(first, 1e-9);
    let (kept, t) = solve(a, 1e-6);
    let mut x = vec![0.0; a.n_local()];
    let mut y = vec![0.0; a.n_owned()];
    let product = time(15, || a.apply(&mut x, &mut y));
    let (bytes, flops) = factor.size();
    if comm.is_root() {
        println!(
            "  {name}: {:.0} blocks, {:.1} MB, refactor {:.1} ms ({:.2} Gflop, {:.1} Gflop/s), \
             apply {:.2} ms ({:.1} GB/s)",
            bytes as f64 / (9 * number) as f64,
            bytes as f64 / 1e6,
            refactor * 1e3,
            2e-9 * flops,
            2e-9 * flops / refactor,
            apply * 1e3,
            bytes as f64 / apply / 1e9,
        );
        println!(
            "    GMRES: fresh {fresh} iterations to 1e-9; kept {kept} to 1e-6 in {:.1} ms, {:.2} ms each, of \
             that {:.2} ms beside factor and product",
            t * 1e3,
            t * 1e3 / kept as f64,
            // One product and no factor is spent on the final residual.
            (t - (kept + 1) as f64 * product) * 1e3 / kept as f64 - apply * 1e3
        );
    }
}

/// Bandwidth of reading `bytes` again and again, with vector instructions.
fn read_bandwidth(bytes: usize) -> f64 {
    let data = vec![1.0f32; bytes / 4];
    let t = time(15, || {
        let mut sums = [0.0f32; 64];
        for chunk in std::hint::black_box(&data).as_chunks::<64>().0 {
            for l in 0..64 {
                sums[l] += chunk[l];
            }
        }
        sums
    });
    bytes as f64 / t / 1e9
}

fn main() {
    let comm = Comm::init(None).expect("MPI starts");
    let sizes: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    if comm.is_root() {
        print!("Reading memory, GB/s:");
        for mb in [1, 5, 20, 50, 100] {
            print!(" {:.1} ({mb} MB)", read_bandwidth(mb * 1_000_000));
        }
        println!();
    }
    for n in if sizes.is_empty() { vec![50, 101, 200] } else { sizes } {
        for courant in [1.0, 27.0, 1000.0] {
            let first = membrane(&comm, n, &State { rise: 0.3, strain: 5e-3, courant });
            let a = membrane(&comm, n, &State { rise: 0.32, strain: 6e-3, courant });
            let mut x: Vec<f64> = (0..a.n_local()).map(|i| i as f64).collect();
            let mut y = vec![0.0; a.n_owned()];
            let product = time(20, || a.apply(&mut x, &mut y));
            if comm.is_root() {
                println!(
                    "{} nodes, Courant number {courant}: product {:.3} ms ({:.1} MB, {:.1} GB/s)",
                    n * n,
                    product * 1e3,
                    a.bytes() as f64 / 1e6,
                    a.bytes() as f64 / product / 1e9
                );
            }
            report(&comm, "Schwarz f64", &first, &a, &mut SchwarzLu::<3, f64>::plan(&first), 8);
            report(&comm, "Schwarz f32", &first, &a, &mut SchwarzLu::<3, f32>::plan(&first), 4);
        }
    }
}
