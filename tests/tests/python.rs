//! Python programs as participants: `python/examples`.

use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::skip::skipped;
use ripstop_tests::{History, changed_scene, program, ripstop_run, root, succeed};

/// A Python with the requirements of `python/`; `None` (with a message) without one.
fn python() -> Option<PathBuf> {
    let found = [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        skipped(
            "neither target/python nor python3 can import iceoryx2 and numpy; \
             `scripts/setup --python` installs them where there is a network",
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
fn deviation(a: &History, b: &History, column: &str) -> f64 {
    let last = |h: &History| *h.column(column).last().expect("a window");
    (last(a) - last(b)).abs() / last(b).abs()
}

#[test]
fn mass_spring_canopy_and_inverse_distance_mover_complete_a_run() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let scene = square(folder.path());
    let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
    let two = ["--stop-after-windows", "2", "--quiet"];
    succeed(ripstop_run(&scene, &ours, &two));
    let (structure, mesh) = (example(&python, "mass_spring.py"), example(&python, "inverse_distance.py"));
    let recording = folder.path().join("recording");
    let record = recording.to_str().expect("a plain path");
    let replaced = ["--structure", &structure, "--mesh", &mesh, "--ranks", "mesh=2", "--record", record];
    let options = [&two[..], &replaced].concat();
    succeed(ripstop_run(&scene, &theirs, &options));

    // Equal masses under equal pressure from rest. A net and a membrane differ in the initial flutter of the edge: 2.5 % of
    // the energy after two windows.
    let (a, b) = (History::read(&theirs, "pre-inflation"), History::read(&ours, "pre-inflation"));
    assert_eq!(a.len(), 2);
    for (column, tolerance) in
        [("structure_kinetic_energy_j", 0.06), ("structure_load_work_j", 0.03), ("vertical_load_n", 0.005)]
    {
        let found = deviation(&a, &b, column);
        assert!(found < tolerance, "{column} differs by {found:.3}");
    }
    // The flow moved with the grid of the Python mover, and each window converged.
    let a = History::read(&theirs, "descent");
    assert_eq!(a.column("coupling_converged"), [1.0, 1.0]);
    let squeezed = a.column("mesh_min_volume_ratio");
    assert!(squeezed.iter().all(|&r| r > 0.3 && r < 0.999), "cells near the canopy change: {squeezed:?}");

    // All conformance tests: repeatability, rollback, restart from saved states, ...
    for (role, command) in [("structure", &structure), ("mesh", &mesh)] {
        let mut conform = Command::new(program("ripstop"));
        conform.arg("conform").arg(role).arg(&recording).args(["--command", command]);
        let table = succeed(conform).stdout;
        let table = String::from_utf8_lossy(&table);
        assert!(table.contains("passed   rollback") && !table.contains("FAILED"), "{table}");
    }
}

#[test]
fn python_exception_is_the_error_of_the_run() {
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

/// A flow with uniform pressure that checks the moved grid it reads (in its own node order).
const EVEN: &str = "
import numpy as np
import ripstop

class Even(ripstop.Participant):
    role = 'flow'

    def __init__(self, run):
        case = run.case(grid=True)
        mesh = case['structure']
        self.faces, self.canopy_nodes = np.array(mesh['faces']), mesh['n_canopy']
        self.start = np.array(case['grid']['coords'])[::-1]
        self.past = [self.start]
        self.moving = case['scene']['stage'][run.stage]['kind'] == 'coupled'
        self.grid_nodes = len(self.start) if self.moving else 0
        self.share = np.array_split(np.arange(len(self.faces)), run.ranks)[run.rank]

    def output_rows(self):
        return self.share

    def grid_rows(self):
        return np.arange(self.grid_nodes)[::-1]

    def advance(self, window, canopy, grid, output):
        output[:] = [12.0, 0.0, 0.0, 0.0]
        if self.moving:
            self.check(window, grid[:, :3], grid[:, 3:])
        return {'force_z': 48.0}

    def check(self, window, x, v):
        moved = np.abs(x - self.start).max()
        # The first guess of the first window is the start shape.
        if not (window.index == 0 or 1e-6 < moved) or moved > 0.1:
            raise ripstop.Fault(f'the grid moved by {moved} m')
        # First order in the first window, second order in the next.
        x1, x2 = self.past[0], self.past[-1]
        expected = x - x1 if window.index == 0 else 1.5 * x - 2 * x1 + 0.5 * x2
        if not np.allclose(window.dt * v, expected, rtol=0, atol=1e-12):
            raise ripstop.Fault('velocities are not those of the positions')
        self.trial = x

    def accept(self, window):
        if self.moving:
            self.past = [self.trial, self.past[0]]

ripstop.main(Even)
";

#[test]
fn python_flow_reads_the_moved_grids_of_both_movers() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("even.py");
    let head = format!("import sys\nsys.path.insert(0, {:?})\n", root().join("python"));
    std::fs::write(&file, head + EVEN).expect("the program can be written");
    let (flow, mover) = (command(&python, &file), example(&python, "inverse_distance.py"));
    let options = ["--stop-after-windows", "2", "--quiet", "--flow", &flow, "--ranks", "flow=2,mesh=2"];
    for options in [options.to_vec(), [&options[..], &["--mesh", &mover]].concat()] {
        let out = folder.path().join("out");
        succeed(ripstop_run(&square(folder.path()), &out, &options));
        assert_eq!(History::read(&out, "descent").column("drag_n"), [48.0, 48.0]);
    }
}
