//! One, two and three ranks give the same answers. This program starts itself again
//! under `mpirun` and compares what the runs print.

mod common;
#[path = "../../../tests/src/harness.rs"]
mod harness;

use std::process::{Command, ExitCode};

use comm::Comm;
use linalg::{
    Amg, AmgParams, BlockCsr, BlockJacobi, Cg, CondensedLu, FactorError, Gmres, KrylovInfo, KrylovParams,
    Operator, Preconditioner, SchwarzLu,
};

const MARK: &str = "RIPSTOP_LINALG_RANKS";

fn main() -> ExitCode {
    match std::env::var(MARK) {
        Ok(n) => {
            check(&Comm::init(n.parse().ok()).expect("MPI starts"));
            ExitCode::SUCCESS
        }
        Err(_) => harness::run(&[("answers_do_not_depend_on_the_ranks", &compare)]),
    }
}

/// Lines `name iterations value...`: values must agree between rank counts.
fn check(comm: &Comm) {
    let graded = |x: [f64; 3]| 1.0 + 20.0 * x[0];
    let p = common::box_problem(comm, [12, 7, 6], [2.0, 1.0, 1.0], graded);
    let (n, n_local) = (p.a.n_owned(), p.a.n_local());

    // Operator: a smooth vector, checked by moments of the product.
    let mut x: Vec<f64> = p.coords.iter().flat_map(|x| [x[0] * x[1], x[2].sin(), x[0] - x[2]]).collect();
    x[n..].fill(f64::NAN); // ghosts must be refreshed by the operator
    let mut y = vec![0.0; n];
    p.a.apply(&mut x, &mut y);
    report(comm, "product", 0, &p.global, &y);

    let params = KrylovParams { rel_tol: 1e-10, max_iterations: 900, ..Default::default() };
    let jacobi: BlockJacobi<3> = BlockJacobi::new(&p.a).unwrap();
    let schwarz = SchwarzLu::<3, f64>::new(&p.a).unwrap();
    let cg = |name: &str, pre: &dyn Preconditioner| {
        let mut x = vec![0.0; n_local];
        let info = Cg::new(comm).solve(&p.a, pre, &p.b, &mut x, params).unwrap();
        solved(comm, name, info, &p.global, &x[..n]);
    };
    cg("cg_jacobi", &jacobi);
    // A low limit makes three levels of this small problem.
    let dials = AmgParams { coarsest_nodes: 12, ..Default::default() };
    cg("cg_amg_f64", &Amg::<f64>::new(&p.a, &p.coords, dials).unwrap());
    cg("cg_amg_f32", &Amg::<f32>::new(&p.a, &p.coords, dials).unwrap());
    let gmres = |name: &str, pre: &dyn Preconditioner| {
        let mut x = vec![0.0; n_local];
        let info = Gmres::new(comm).solve(&p.a, pre, &p.b, &mut x, params).unwrap();
        solved(comm, name, info, &p.global, &x[..n]);
    };
    gmres("gmres_schwarz", &schwarz);
    gmres("gmres_schwarz_f32", &SchwarzLu::<3, f32>::new(&p.a).unwrap());
    let mut parts = SchwarzLu::<3, f32>::plan_parts(&p.a, 100, 2);
    parts.refactor(&p.a).unwrap();
    gmres("gmres_parts", &parts);
    condensed(comm, params);
}

/// Factors of all ranks together: a matrix that is not symmetric, and its symmetric part alone.
fn condensed(comm: &Comm, params: KrylovParams) {
    // Long, so that the interfaces are small.
    let mut p = common::box_problem(comm, [30, 3, 3], [10.0, 1.0, 1.0], |x| 1.0 + x[0]);
    let gmres = |name: &str, a: &BlockCsr<3>, pre: &dyn Preconditioner| {
        let mut x = vec![0.0; a.n_local()];
        let info = Gmres::new(comm).solve(a, pre, &p.b, &mut x, params).unwrap();
        solved(comm, name, info, &p.global, &x[..a.n_owned()]);
    };
    let mut lu = CondensedLu::<3, f64>::plan_symmetric(&p.a).expect("small interfaces");
    // The second factorisation reuses the storage of the first.
    lu.refactor(&p.a).unwrap();
    lu.refactor(&p.a).unwrap();
    gmres("gmres_condensed_symmetric", &p.a, &lu);
    let mut lu = CondensedLu::<3, f32>::plan_symmetric(&p.a).expect("small interfaces");
    lu.refactor(&p.a).unwrap();
    gmres("gmres_condensed_f32", &p.a, &lu);
    for i in 0..p.a.n_rows() {
        for slot in p.a.row(i) {
            let j = p.a.cols()[slot] as usize;
            let skew = 0.2 * (p.global[i] as f64 - p.global[j] as f64).signum();
            p.a.values[slot].iter_mut().flatten().for_each(|v| *v += skew);
        }
    }
    let mut lu = CondensedLu::<3, f64>::plan(&p.a).expect("small interfaces");
    lu.refactor(&p.a).unwrap();
    gmres("gmres_condensed_whole", &p.a, &lu);
    // A node without stiffness, inside a rank or between ranks: every rank has an error, and one at least names a row of its own.
    let most = comm.max(*p.global.iter().max().unwrap() as f64) as u64;
    for node in 0..=most {
        let mut a = p.a.clone();
        for i in 0..a.n_rows() {
            for slot in a.row(i) {
                if [i, a.cols()[slot] as usize].iter().any(|&k| p.global[k] == node) {
                    a.values[slot] = [[0.0; 3]; 3];
                }
            }
        }
        let error = lu.refactor(&a).expect_err("a singular matrix");
        let row = match error {
            FactorError::Singular { row } => Some(row),
            FactorError::OtherRank => None,
        };
        assert!(row.is_none_or(|row| row < a.n_rows()), "node {node}: {error}");
        assert!(comm.sum(f64::from(u8::from(row.is_some()))) > 0.0, "node {node}: no rank names a row");
    }
}

fn solved(comm: &Comm, name: &str, info: KrylovInfo, global: &[u64], x: &[f64]) {
    assert!(info.final_residual <= 1e-10 * info.rhs_norm);
    report(comm, name, info.iterations, global, x);
}

/// Prints moments of a distributed vector that do not depend on the partition.
fn report(comm: &Comm, name: &str, iterations: usize, global: &[u64], x: &[f64]) {
    let mut sums = [0.0; 4];
    for (x, &g) in x.chunks(3).zip(global) {
        for (c, x) in x.iter().enumerate() {
            let weight = ((3 * g + c as u64) as f64 * 0.11).sin();
            sums[0] += x;
            sums[1] += x * x;
            sums[2] += weight * x;
            sums[3] += weight * x * x * x;
        }
    }
    comm.sum_slice(&mut sums);
    if comm.is_root() {
        println!("{name} {iterations} {}", sums.map(|s| format!("{s:e}")).join(" "));
    }
}

fn run(ranks: usize) -> Result<Vec<(String, usize, Vec<f64>)>, String> {
    let me = std::env::current_exe().map_err(|e| e.to_string())?;
    let output = Command::new("mpirun")
        .args(["-n", &ranks.to_string()])
        .arg(me)
        .env(MARK, ranks.to_string())
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
        .env("OMPI_MCA_hwloc_base_binding_policy", "none")
        .env("OMPI_MCA_mpi_yield_when_idle", "1")
        .output()
        .map_err(|e| format!("mpirun does not start: {e}"))?;
    if !output.status.success() {
        return Err(format!("{ranks} ranks failed: {}", String::from_utf8_lossy(&output.stderr)));
    }
    Ok(String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| {
            let mut words = line.split_whitespace();
            let name = words.next().unwrap_or_default().to_string();
            let iterations = words.next().and_then(|w| w.parse().ok()).unwrap_or(usize::MAX);
            (name, iterations, words.map(|w| w.parse().unwrap_or(f64::NAN)).collect())
        })
        .collect())
}

fn compare() {
    let mut faults = Vec::new();
    let runs: Vec<_> = [1, 2, 3].map(run).into_iter().collect();
    let mut results = Vec::new();
    for run in runs {
        match run {
            Ok(lines) => results.push(lines),
            Err(fault) => faults.push(fault),
        }
    }
    if let Some((one, rest)) = results.split_first() {
        if one.len() != LINES {
            faults.push(format!("{} lines printed, {LINES} expected", one.len()));
        }
        for lines in rest {
            for ((name, few, a), (other, many, b)) in one.iter().zip(lines) {
                let scale = a.iter().fold(1e-30f64, |s, v| s.max(v.abs()));
                // Solutions agree to the condition number times the tolerance of the solve.
                let agree = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * scale);
                println!("{name}: {few} iterations on one rank, {many} on several, agree: {agree}");
                if name != other || a.len() != b.len() || !agree {
                    faults.push(format!("{name} / {other}: {a:?} and {b:?}"));
                }
                if name.starts_with("cg_amg") && *many > few + 5 {
                    faults.push(format!("{name}: {few} iterations grow to {many} with the ranks"));
                }
                // A factor in single precision leaves 1e-7 of a residual that is to fall to 1e-10.
                let most = if name.ends_with("f32") { 4 } else { 2 };
                // A solid at rest has no inertia to keep errors local, the hard case for parts:
                // twice the 60 iterations that one subdomain for each of 3 ranks takes.
                if name == "gmres_parts" && *few.max(many) > 120 {
                    faults.push(format!("{name}: {few} and {many} iterations are too many"));
                }
                // The long box is conditioned worse: five on one rank.
                let direct = if name.ends_with("f32") { 5 } else { 2 };
                if name.starts_with("gmres_condensed") && *few.max(many) > direct {
                    faults
                        .push(format!("{name}: {few} and {many} iterations, but the factor is of the whole"));
                }
                if name.starts_with("gmres_schwarz") && (*few > most || *many > 30) {
                    faults.push(format!("{name}: {few} and {many} iterations are too many"));
                }
            }
            if lines.len() != one.len() {
                faults.push("runs print different numbers of lines".into());
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Checks that `check` makes.
const LINES: usize = 10;
