//! The number of ranks does not change the answer, nor does a restart.

use std::path::Path;
use std::process::Command;

/// Forces after each step, as `ranks` ranks of the program compute them.
fn forces(ranks: usize, state: &Path, effect: &str) -> Vec<[f64; 3]> {
    let output = Command::new("mpirun")
        .args(["-n", &ranks.to_string(), env!("CARGO_BIN_EXE_flow-solver"), "self-test"])
        .arg(state)
        .arg(effect)
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

fn agree(effect: &str) -> Vec<[f64; 3]> {
    let folder = tempfile::tempdir().unwrap();
    let state = |ranks: usize| folder.path().join(format!("state{ranks}"));
    let one = forces(1, &state(1), effect);
    assert_eq!(one.len(), 4);
    assert!(one[3][2] > 1.0, "the stream pushes the plate along z: {one:?}");
    for ranks in 2..=4 {
        compare(&one, &forces(ranks, &state(ranks), effect), &format!("{effect}: {ranks} ranks"));
    }
    // The state written by one rank continues on three, and the other way around.
    compare(&one[2..], &forces(3, &state(1), effect), &format!("{effect}: restart of 1 on 3"));
    compare(&one[2..], &forces(1, &state(3), effect), &format!("{effect}: restart of 3 on 1"));
    one
}

#[test]
fn results_agree_for_one_to_four_ranks_and_restarts() {
    agree("plain");
}

#[test]
fn data_of_patches_are_independent_of_rank_count() {
    let folder = tempfile::tempdir().unwrap();
    let (data, none) = (agree("patches"), forces(1, &folder.path().join("state"), "plain"));
    assert!((data[3][2] / none[3][2] - 1.0).abs() > 1e-3, "{data:?} {none:?}");
}

#[test]
fn periodic_sides_are_independent_of_rank_count() {
    let folder = tempfile::tempdir().unwrap();
    let (pair, none) = (agree("periodic"), forces(1, &folder.path().join("state"), "plain"));
    assert!((pair[3][2] / none[3][2] - 1.0).abs() > 1e-4, "{pair:?} {none:?}");
}

#[test]
fn permeable_plate_is_independent_of_rank_count() {
    // Less drag than the airtight one, or the cloth is not there.
    let folder = tempfile::tempdir().unwrap();
    let (cloth, tight) = (agree("permeable"), forces(1, &folder.path().join("state"), "plain"));
    assert!(cloth[3][2] < 0.9 * tight[3][2], "{cloth:?} {tight:?}");
}

#[test]
fn transported_turbulence_is_independent_of_rank_count() {
    let folder = tempfile::tempdir().unwrap();
    let (eddies, none) = (agree("turbulent"), forces(1, &folder.path().join("state"), "plain"));
    assert!((eddies[3][2] / none[3][2] - 1.0).abs() > 1e-6, "{eddies:?} {none:?}");
}
