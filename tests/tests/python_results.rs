//! Results and scenes in Python: the tests of `python/tests`, and the notebooks of the tutorials.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use ripstop_tests::skip::skipped;
use ripstop_tests::{program, root, succeed};

/// A Python with the requirements of `ripstop.results`; `None` (with a message) without one.
fn python() -> Option<PathBuf> {
    let found = [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import lz4, meshio, numpy, pandas, tomlkit"]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        skipped(
            "neither target/python nor python3 can import lz4, meshio, numpy, pandas and tomlkit; \
             `scripts/setup --python` installs them where there is a network",
        );
    }
    found
}

/// Python with the program `ripstop` of this build, in `folder`.
fn command(python: &Path, folder: &Path) -> Command {
    let mut command = Command::new(python);
    command.env("RIPSTOP", program("ripstop")).env("PYTHONDONTWRITEBYTECODE", "1");
    command.current_dir(folder).stdin(Stdio::null());
    command
}

#[test]
fn unit_tests_of_the_python_package_pass() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut unittest = command(&python, folder.path());
    unittest.args(["-m", "unittest", "discover", "--start-directory"]).arg(root().join("python/tests"));
    let output = succeed(unittest);
    let text = String::from_utf8_lossy(&output.stderr);
    // A suite that finds no tests succeeds too.
    let ran = text.lines().find_map(|line| line.strip_prefix("Ran ")?.split(' ').next()?.parse().ok());
    let ran: usize = ran.unwrap_or_else(|| panic!("{text}"));
    assert!(ran >= 50, "{text}");
}

/// The other notebooks run the scenes of tutorials that `tutorials.rs` tests.
#[test]
fn a_notebook_of_the_tutorials_runs() {
    run_notebooks(&["read-results"]);
}

#[test]
#[ignore = "nightly: 2 minutes"]
fn notebooks_of_the_tutorials_run() {
    run_notebooks(&["first-run", "read-results", "round-canopy"]);
}

fn run_notebooks(notebooks: &[&str]) {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| root().join("docs/tutorials/notebooks").join(name).with_extension("ipynb");
    let mut runner = command(&python, folder.path());
    runner.arg(root().join("python/tests/run_notebook.py")).args(notebooks.iter().map(|name| path(name)));
    let output = succeed(runner);
    let text = String::from_utf8_lossy(&output.stdout);
    for name in notebooks {
        assert!(text.contains(&format!("{name}.ipynb: ")), "{name} is not run: {text}");
    }
}
