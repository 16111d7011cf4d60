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

/// Writes the configurations of preCICE for the structure next to `scene`; their name as an option of the bridge.
fn configurations(python: &Path, scene: &Path) -> String {
    let pattern = scene.with_file_name("precice-{stage}.xml");
    let mut write = Command::new(python);
    write.args(["-m", "ripstop.precice", "structure", "--write-config"]).arg(scene).arg("--config").arg(&pattern);
    write.args(["--exchange-directory", &scene.parent().expect("a folder").display().to_string()]);
    write.env("PYTHONPATH", root().join("python")).env("RIPSTOP", program("ripstop")).stdin(Stdio::null());
    succeed(write);
    assert!(scene.with_file_name("precice-descent.xml").exists());
    format!("structure --config '{}' --effects fabric.wrinkling,lines", pattern.display())
}

/// A program of `python/tests`.
fn test_program(python: &Path, name: &str) -> String {
    format!("'{}' '{}'", python.display(), root().join("python/tests").join(name).display())
}

/// Runs `scene` with the structure `command`: the history of the descent, and the shape of the canopy at its end.
fn descent(scene: &Path, out: &Path, command: &str) -> (History, Vec<u8>) {
    let mut run = ripstop_run(scene, out, &["--quiet", "--structure", command]);
    // preCICE writes its logs into the current folder.
    run.env("PYTHONPATH", root().join("python")).current_dir(scene.parent().expect("a folder"));
    succeed(run);
    let shape = std::fs::read(out.join("descent/state/canopy.bin")).expect("the canopy is saved");
    (History::read(out, "descent"), shape)
}

/// The net behind `bridge` repeats and accepts windows as without preCICE: equal in all digits.
fn assert_equal_to_the_net_alone(python: &Path, bridge: impl Fn(&str) -> String) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(folder.path());
    let options = configurations(python, &scene);
    let alone = descent(&scene, &folder.path().join("alone"), &test_program(python, "net_without_precice.py"));
    let behind = descent(&scene, &folder.path().join("behind"), &bridge(&options));
    // Windows were repeated, so that checkpoints were read.
    let iterations = alone.0.column("coupling_iterations");
    assert!(iterations.len() == 4 && iterations.iter().all(|&n| n > 1.0), "{iterations:?}");
    for column in ["coupling_iterations", "descent_speed_m_s", "drag_n", "interface_work_j"] {
        assert_eq!(alone.0.column(column), behind.0.column(column), "{column}");
    }
    assert!(alone.1 == behind.1, "the shapes of the canopy differ");
    // The bridge reports what it can compute from loads and displacements.
    assert!(behind.0.column("projected_area_m2").iter().all(|&area| area > 1.0));
}

#[test]
fn structure_behind_a_stand_in_for_precice_equals_the_structure_alone() {
    let remedy = "`scripts/setup --python` installs them where there is a network";
    let Some(python) = python("iceoryx2, numpy", remedy) else { return };
    assert_equal_to_the_net_alone(&python, |options| {
        format!("{} {options} --solver pressure", test_program(&python, "precice_in_one_process.py"))
    });
}

#[test]
fn structure_behind_precice_equals_the_structure_alone() {
    let remedy = "install preCICE 3 and `pip install pyprecice` to test the bridge with the library";
    let Some(python) = python("iceoryx2, numpy, precice", remedy) else { return };
    let net = format!("'{}' '{}'", python.display(), root().join("python/examples/precice_mass_spring.py").display());
    assert_equal_to_the_net_alone(&python, |options| {
        format!("'{}' -m ripstop.precice {options} --solver \"{net}\"", python.display())
    });
}
