//! Programs in Python take the place of ours: `python/examples`.

use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::{History, changed_scene, ripstop_run, root, succeed};

/// A Python that has what `python/` needs; `None`, said aloud, where there is none.
fn python() -> Option<PathBuf> {
    let found = [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        eprintln!(
            "skipped: neither target/python nor python3 can import iceoryx2 and numpy; \
             `scripts/setup --python` installs them where there is a network"
        );
    }
    found
}

fn command(python: &Path, file: &Path) -> String {
    format!("'{}' '{}'", python.display(), file.display())
}

fn example(python: &Path, name: &str) -> String {
    command(python, &root().join("python/examples").join(name))
}

fn square(folder: &Path) -> PathBuf {
    changed_scene("square-drop", folder, &[])
}

/// Relative difference of the last rows of a column.
fn departure(a: &History, b: &History, column: &str) -> f64 {
    let last = |h: &History| *h.column(column).last().expect("a window");
    (last(a) - last(b)).abs() / last(b).abs()
}

#[test]
fn a_mass_spring_canopy_and_an_inverse_distance_mover_fly() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let scene = square(folder.path());
    let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
    let two = ["--stop-after-windows", "2", "--quiet"];
    succeed(ripstop_run(&scene, &ours, &two));
    let (structure, mesh) = (example(&python, "mass_spring.py"), example(&python, "inverse_distance.py"));
    let options = [&two[..], &["--structure", &structure, "--mesh", &mesh, "--ranks", "mesh=2"]].concat();
    succeed(ripstop_run(&scene, &theirs, &options));

    // The same masses are pushed by the same pressure from rest. A net and a membrane
    // differ in how the hem starts to flutter: 2.5 % of the energy after two windows.
    let (a, b) = (History::read(&theirs, "pre-inflation"), History::read(&ours, "pre-inflation"));
    assert_eq!(a.len(), 2);
    for (column, tolerance) in
        [("structure_kinetic_energy_j", 0.06), ("structure_load_work_j", 0.03), ("vertical_load_n", 0.005)]
    {
        let found = departure(&a, &b, column);
        assert!(found < tolerance, "{column} differs by {found:.3}");
    }
    // The flow moved with the grid of the Python mover, and each window converged.
    let a = History::read(&theirs, "descent");
    assert_eq!(a.column("coupling_converged"), [1.0, 1.0]);
    let squeezed = a.column("mesh_min_volume_ratio");
    assert!(squeezed.iter().all(|&r| r > 0.3 && r < 0.999), "cells near the canopy change: {squeezed:?}");
}

#[test]
fn an_exception_is_the_error_of_the_run() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("torn.py");
    let text = format!(
        "import sys\nsys.path.insert(0, {:?})\nimport mass_spring, ripstop\n\n\
         class Torn(mass_spring.MassSpring):\n    def accept(self, window):\n        \
         if window.index == 1:\n            raise ValueError('a seam tore')\n        \
         super().accept(window)\n\nripstop.main(Torn)\n",
        root().join("python/examples")
    );
    std::fs::write(&file, text).expect("the program can be written");
    let out = folder.path().join("out");
    let structure = command(&python, &file);
    let output = ripstop_run(&square(folder.path()), &out, &["--structure", &structure])
        .output()
        .expect("ripstop starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let error = text.lines().find(|l| l.starts_with("error: ")).unwrap_or_else(|| panic!("{text}"));
    assert!(error.contains("ValueError: a seam tore (torn.py, line 8, in accept)"), "{error}");
    assert_eq!(History::read(&out, "pre-inflation").len(), 1);
}
