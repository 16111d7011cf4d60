//! The bridge to preCICE in a run: `python/ripstop/precice`. preCICE is not needed: a stand-in takes its place.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use ripstop_tests::skip::skipped;
use ripstop_tests::tiny::SMALLER;
use ripstop_tests::{History, changed_scene, program, ripstop_run, root, succeed};

/// A Python that can import `modules`; `None` (with a message) without one.
fn python(modules: &str, remedy: &str) -> Option<PathBuf> {
    let found = [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", &format!("import {modules}")]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        skipped(&format!("neither target/python nor python3 can import {modules}; {remedy}"));
    }
    found
}

/// The smallest coupled descent, all of whose stages take their planned time.
fn scene(folder: &Path) -> PathBuf {
    changed_scene("square-drop", folder, &[&SMALLER[..], &[("settled_energy_ratio = 1e-4\n", "")]].concat())
}

/// Writes the configurations of preCICE for `role` next to `scene`; the options of the bridge.
fn configurations(python: &Path, scene: &Path, role: &str) -> String {
    let pattern = scene.with_file_name(format!("{role}-{{stage}}.xml"));
    let mut write = Command::new(python);
    write.args(["-m", "ripstop.precice", role, "--write-config"]).arg(scene).arg("--config").arg(&pattern);
    write.env("PYTHONPATH", root().join("python")).env("RIPSTOP", program("ripstop")).stdin(Stdio::null());
    succeed(write);
    assert!(scene.with_file_name(format!("{role}-descent.xml")).exists());
    let shorter = scene.with_file_name("shorter.xml");
    let mut write = Command::new(python);
    write.args(["-m", "ripstop.precice", role, "--write-config"]).arg(scene).arg("--config").arg(&shorter);
    write.args(["--only-stage", "descent", "--set", "stage.descent.duration_s=0.04"]);
    write.env("PYTHONPATH", root().join("python")).env("RIPSTOP", program("ripstop")).stdin(Stdio::null());
    succeed(write);
    let text = std::fs::read_to_string(shorter).expect("a configuration");
    assert!(text.contains("<max-time value=\"0.04\"/>"), "{text}");
    let effects = if role == "structure" { "--effects fabric.wrinkling,lines" } else { "" };
    format!("{role} --config '{}' {effects}", pattern.display())
}

/// A program of `python/tests`.
fn test_program(python: &Path, name: &str) -> String {
    format!("'{}' '{}'", python.display(), root().join("python/tests").join(name).display())
}

/// Runs `scene` with `command` in a role: the history of the descent, and the shape of the canopy at its end.
fn descent(scene: &Path, out: &Path, role: &str, command: &str) -> (History, Vec<u8>) {
    let mut run = ripstop_run(scene, out, &["--quiet", &format!("--{role}"), command]);
    // preCICE writes its logs into the current folder.
    run.env("PYTHONPATH", root().join("python")).current_dir(scene.parent().expect("a folder"));
    succeed(run);
    let shape = std::fs::read(out.join("descent/state/canopy.bin")).expect("the canopy is saved");
    (History::read(out, "descent"), shape)
}

/// A solver of `python/examples` in a role.
struct Solver {
    role: &'static str,
    /// It as a program without preCICE, in `python/tests`.
    alone: &'static str,
    /// It as a participant of preCICE, in `python/examples`.
    behind: &'static str,
}

const NET: Solver =
    Solver { role: "structure", alone: "net_without_precice.py", behind: "precice_mass_spring.py" };
const AIR: Solver =
    Solver { role: "flow", alone: "flow_without_precice.py", behind: "precice_stagnation_flow.py" };

/// The solver behind `bridge` repeats and accepts windows as without preCICE: equal in all digits.
fn assert_equal_to_the_solver_alone(python: &Path, solver: &Solver, bridge: impl Fn(&str) -> String) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(folder.path());
    let options = configurations(python, &scene, solver.role);
    let run = |out: &str, command: &str| descent(&scene, &folder.path().join(out), solver.role, command);
    let (alone, shape_alone) = run("alone", &test_program(python, solver.alone));
    let (behind, shape_behind) = run("behind", &bridge(&options));
    // Windows were repeated, so that checkpoints were read.
    let iterations = alone.column("coupling_iterations");
    assert!(iterations.len() == 4 && iterations.iter().all(|&n| n > 1.0), "{iterations:?}");
    for column in ["coupling_iterations", "descent_speed_m_s", "drag_n", "interface_work_j"] {
        assert_eq!(alone.column(column), behind.column(column), "{column}");
    }
    assert!(shape_alone == shape_behind, "the shapes of the canopy differ");
    // The bridge reports what it can compute from loads and displacements.
    assert!(behind.column("projected_area_m2").iter().all(|&area| area > 1.0));
}

#[test]
fn solvers_behind_a_stand_in_for_precice_equal_the_solvers_alone() {
    let remedy = "`scripts/setup --python` installs them where there is a network";
    let Some(python) = python("iceoryx2, numpy", remedy) else { return };
    for solver in [&NET, &AIR] {
        assert_equal_to_the_solver_alone(&python, solver, |options| {
            format!("{} {options} --solver pressure", test_program(&python, "precice_in_one_process.py"))
        });
    }
}

#[test]
fn solvers_behind_precice_equal_the_solvers_alone() {
    let remedy = "install preCICE 3 and `pip install pyprecice` to test the bridge with the library";
    let Some(python) = python("iceoryx2, numpy, precice", remedy) else { return };
    for solver in [&NET, &AIR] {
        let behind = root().join("python/examples").join(solver.behind);
        assert_equal_to_the_solver_alone(&python, solver, |options| {
            let command = format!("'{}' '{}'", python.display(), behind.display());
            format!("'{}' -m ripstop.precice {options} --solver \"{command}\"", python.display())
        });
    }
}
