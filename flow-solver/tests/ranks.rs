//! The number of ranks does not change the answer, nor does a restart.

use std::path::Path;
use std::process::Command;

/// Forces after each step, as `ranks` ranks of the program compute them.
fn forces(ranks: usize, state: &Path) -> Vec<[f64; 3]> {
    let output = Command::new("mpirun")
        .args(["-n", &ranks.to_string(), env!("CARGO_BIN_EXE_flow-solver"), "self-test"])
        .arg(state)
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
        .env("OMPI_MCA_hwloc_base_binding_policy", "none")
        .env("OMPI_MCA_mpi_yield_when_idle", "1")
        .output()
        .expect("mpirun is on the PATH");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|l| {
            let v: Vec<f64> = l.split_whitespace().map(|w| w.parse().expect("a number")).collect();
            [v[0], v[1], v[2]]
        })
        .collect()
}

fn compare(a: &[[f64; 3]], b: &[[f64; 3]], what: &str) {
    assert_eq!(a.len(), b.len());
    for (x, y) in a.iter().zip(b) {
        let size = x.iter().map(|v| v * v).sum::<f64>().sqrt();
        for d in 0..3 {
            // Residuals have fallen by 1e-11; forces inherit that with a margin for conditioning.
            assert!((x[d] - y[d]).abs() < 1e-8 * size, "{what}: {x:?} and {y:?}");
        }
    }
}

#[test]
fn one_to_four_ranks_and_restarts_agree() {
    let folder = tempfile::tempdir().unwrap();
    let one = forces(1, &folder.path().join("state1"));
    assert_eq!(one.len(), 4);
    assert!(one[3][2] > 1.0, "the stream pushes the plate along z: {one:?}");
    for ranks in 2..=4 {
        let state = folder.path().join(format!("state{ranks}"));
        compare(&one, &forces(ranks, &state), &format!("{ranks} ranks"));
    }
    // The state written by one rank continues on three, and the other way around.
    compare(&one[2..], &forces(3, &folder.path().join("state1")), "restart of 1 on 3");
    compare(&one[2..], &forces(1, &folder.path().join("state3")), "restart of 3 on 1");
}
