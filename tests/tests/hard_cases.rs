//! Cases that partitioned coupling is known to fail on, each with the defaults of its scene.
//! What the numbers mean and how they were measured: docs/stability.md.

use std::path::Path;
use std::process::Command;

use ripstop_tests::{History, changed_scene, program, ripstop_run, root, scene, succeed};

/// A hard case flown to its end.
struct Flown {
    history: History,
    iterations: f64,
}

impl Flown {
    fn new(history: History) -> Self {
        let column = history.column("coupling_iterations");
        let iterations = column.iter().sum::<f64>() / column.len() as f64;
        Self { history, iterations }
    }

    fn last(&self, column: &str) -> f64 {
        *self.history.column(column).last().expect("a window")
    }

    fn most(&self, column: &str) -> f64 {
        self.history.column(column).into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Flies `case` and demands what all cases must show: every window converged, only numbers,
/// a valid grid, no energy from the coupling beyond `created` of the work done.
fn fly(case: &str, stage: &str, created: f64) -> Flown {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    succeed(ripstop_run(&scene(&format!("hard/{case}")), &out, &["--quiet"]));
    let flown = Flown::new(History::read(&out, stage));
    let column = |name: &str| flown.history.column(name);
    assert!(column("coupling_converged").iter().all(|c| *c == 1.0), "{case}: windows above the tolerance");
    assert!(column("mesh_min_quality").iter().all(|q| *q > 0.0), "{case}");
    for name in ["structure_kinetic_energy_j", "structure_strain_energy_j", "volume_m3", "flow_max_pressure_pa"] {
        assert!(column(name).iter().all(|v| v.is_finite()), "{case}: {name}");
    }
    let share = flown.last("interface_energy_error_share");
    assert!(share < created, "{case}: the coupling created {share} of the work");
    eprintln!("{case}: {:.1} iterations a window, energy {share:+.4} of the work", flown.iterations);
    flown
}

/// The same case with the paper's staggered sequence must end with an error that says where,
/// and leave only numbers behind.
fn staggered_fails(case: &str, stage: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let change = [("[flow]", "[coupling]\nscheme = \"staggered\"\n\n[flow]")];
    let plain = [("[flow.solver]", "[coupling]\nscheme = \"staggered\"\n\n[flow.solver]")];
    let text = std::fs::read_to_string(scene(&format!("hard/{case}"))).expect("a scene");
    let change = if text.contains("[flow]\n") { change } else { plain };
    let file = changed_scene(&format!("hard/{case}"), folder.path(), &change);
    let output = ripstop_run(&file, &out, &["--quiet"]).output().expect("ripstop starts");
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{case} with the staggered sequence: {words}");
    assert!(words.contains(&format!("stage `{stage}`, window")), "{case}: {words}");
    let history = History::read(&out, stage);
    for name in ["structure_kinetic_energy_j", "volume_m3", "drag_n"] {
        assert!(history.column(name).iter().all(|v| v.is_finite()), "{case}: {name}");
    }
    eprintln!("{case}, staggered: {} windows, then {}", history.len(), words.lines().next().unwrap_or_default());
}
