//! `ripstop new participant`: packages that build outside the repository, conform, and replace all programs of a run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use ripstop_tests::skip::skipped;
use ripstop_tests::{History, program, ripstop_run, root, scene, succeed};
// Its library, which `make` links, is built with these tests.
use ripstop_participant_c as _;

const ROLES: [&str; 3] = ["structure", "flow", "mesh"];

/// Writes a package in `folder`; its path.
fn new(folder: &Path, role: &str, language: &str) -> PathBuf {
    let out = folder.join(format!("my-{role}-{}", language.replace('+', "p")));
    let mut new = Command::new(program("ripstop"));
    new.args(["new", "participant", "--role", role, "--lang", language, "--out"]).arg(&out);
    new.arg("--sources").arg(root());
    succeed(new);
    out
}

fn name(package: &Path) -> String {
    package.file_name().expect("a name").to_string_lossy().into_owned()
}

/// A package in Rust, built; its program. Crates that the repository has built need not be compiled again: the package gets its
/// versions, its profile and, below its folder of builds, its flags.
fn rust(folder: &Path, role: &str) -> PathBuf {
    let package = new(folder, role, "rust");
    let target = program("ripstop").parent().and_then(Path::parent).expect("a folder").to_owned();
    let text = |path: PathBuf| std::fs::read_to_string(path).expect("a file");
    let workspace = text(root().join("Cargo.toml"));
    let profile = workspace.find("[profile.release]").expect("the profile");
    let own = text(package.join("Cargo.toml"));
    std::fs::write(package.join("Cargo.toml"), format!("{own}\n{}", &workspace[profile..])).expect("written");
    std::fs::copy(root().join("Cargo.lock"), package.join("Cargo.lock")).expect("copied");
    build(&package, &target);
    target.join("release").join(name(&package))
}

/// Builds a package in Rust.
fn build(package: &Path, target: &Path) {
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--release", "--offline"]).current_dir(package);
    build.env("CARGO_TARGET_DIR", target).env_remove("RUSTFLAGS");
    succeed(build);
}

/// A package in C++ or Fortran, built with the library of this build; its program.
fn compiled(folder: &Path, role: &str, language: &str) -> PathBuf {
    let package = new(folder, role, language);
    let test = std::env::current_exe().expect("a test has a path");
    let library = test.with_file_name("libripstop_participant_c.a");
    assert!(library.exists(), "{} is missing", library.display());
    let mut make = Command::new("make");
    make.arg("-C").arg(&package).arg(format!("LIBRARY={}", library.display()));
    let output = succeed(make);
    let warnings = String::from_utf8_lossy(&output.stderr);
    assert!(!warnings.contains("warning") && !warnings.contains("Warning"), "{warnings}");
    package.join(name(&package))
}

/// A Python that can import what solver programs need.
fn python() -> Option<PathBuf> {
    [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        tried.is_ok_and(|output| output.status.success())
    })
}

fn exists(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}

/// Asserts that all tests of the protocol pass; the relative difference from the recorded reply.
fn conform(role: &str, recording: &Path, command: &str) -> f64 {
    let mut conform = Command::new(program("ripstop"));
    conform.args(["conform", role]).arg(recording).args(["--command", command]);
    conform.env("RIPSTOP", program("ripstop")).env("PYTHONPATH", root().join("python"));
    let table = succeed(conform).stdout;
    let table = String::from_utf8_lossy(&table);
    let passed =
        |test: &str| table.lines().find(|l| l.trim_start().starts_with("passed") && l.contains(test));
    for test in ["repeat", "rollback", "resume"] {
        assert!(passed(test).is_some(), "{command}, {test}: {table}");
    }
    assert!(!table.contains("FAILED"), "{table}");
    let reply = passed("recorded reply").unwrap_or_else(|| panic!("{table}"));
    let number =
        reply.split("differs from the recorded one by ").nth(1).and_then(|rest| rest.split(' ').next());
    number.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{reply}"))
}

/// Two windows of each stage with three programs, recorded; the history of the last stage.
fn together(out: &Path, programs: &[String; 3], options: &[&str]) -> History {
    let mut all = vec!["--stop-after-windows", "2", "--quiet"];
    for (option, command) in ["--structure", "--flow", "--mesh"].into_iter().zip(programs) {
        all.extend([option, command]);
    }
    let mut run = ripstop_run(&scene("square-drop"), out, &[&all[..], options].concat());
    run.arg("--record").arg(out.with_extension("recording"));
    run.env("RIPSTOP", program("ripstop")).env("PYTHONPATH", root().join("python"));
    succeed(run);
    let history = History::read(out, "descent");
    assert_eq!(history.column("coupling_converged"), [1.0, 1.0]);
    history
}

/// Asserts that the programs conform to a recording of their own, whose states they read.
fn conform_all(recording: &Path, programs: &[String; 3]) {
    for (role, command) in ROLES.iter().zip(programs) {
        assert_eq!(conform(role, recording, command), 0.0, "{command}");
    }
}

/// Asserts that two runs have the same results to `tolerance`.
fn compare(found: &History, expected: &History, tolerance: f64) {
    for column in
        ["descent_speed_m_s", "vertical_load_n", "structure_kinetic_energy_j", "mesh_min_volume_ratio"]
    {
        for (found, expected) in found.column(column).iter().zip(expected.column(column)) {
            let difference = (found / expected - 1.0).abs();
            assert!(difference < tolerance, "{column} is {found}, in Rust {expected}");
        }
    }
}

/// Packages in Rust and a run of all three on one process each, which the other languages are compared with.
struct RustRun {
    folder: PathBuf,
    programs: [String; 3],
    history: History,
}

/// Made by the test that comes first; the other one waits for it.
fn rust_run() -> &'static RustRun {
    static RUN: OnceLock<RustRun> = OnceLock::new();
    RUN.get_or_init(|| {
        // A folder of the build, as nothing removes what a static value holds.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("participants");
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        let programs = ROLES.map(|role| text(rust(&folder, role)));
        let history = together(&folder.join("one"), &programs, &[]);
        RustRun { folder, programs, history }
    })
}

fn text(path: PathBuf) -> String {
    path.display().to_string()
}

#[test]
fn packages_in_rust_conform_and_run_together() {
    let RustRun { folder: at, programs, history } = rust_run();
    // All three at once, on one and on two processes of flow and mesh: the same results.
    let two = together(&at.join("two"), programs, &["--ranks", "flow=2,mesh=2"]);
    assert_eq!(history.column("descent_speed_m_s"), two.column("descent_speed_m_s"));
    conform_all(&at.join("one.recording"), programs);
}

/// The same models in other languages. Those in C++ add in the same order, so that only a compiler that fuses multiplications and
/// additions changes a digit; Fortran adds in another one.
#[test]
fn packages_in_compiled_languages_conform_and_agree_with_rust() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let cpp = ROLES.map(|role| text(compiled(at, role, "c++")));
    let history = together(&at.join("cpp"), &cpp, &["--ranks", "flow=2,mesh=2"]);
    for role in [0, 1] {
        assert_eq!(conform(ROLES[role], &at.join("cpp.recording"), &cpp[role]), 0.0, "{}", cpp[role]);
    }
    if exists("gfortran") {
        let mesh = text(compiled(at, "mesh", "fortran"));
        let difference = conform("mesh", &at.join("cpp.recording"), &mesh);
        assert!(difference < 1e-12, "the mesh-mover in Fortran differs by {difference:e}");
    } else {
        skipped("there is no gfortran: the package in Fortran was not built");
    }
    compare(&history, &rust_run().history, 1e-8);
}

/// As a user builds it: in a folder of its own, without what the repository has built.
#[test]
#[ignore = "nightly: 2 minutes"]
fn a_package_in_rust_builds_outside_the_repository() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = new(folder.path(), "flow", "rust");
    build(&package, &package.join("target"));
    assert!(package.join("target/release").join(name(&package)).exists());
}

#[test]
#[ignore = "nightly: 1 minute"]
fn packages_in_python_conform() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let Some(python) = python() else {
        return skipped("no Python can import iceoryx2 and numpy: the packages in Python were not tried");
    };
    let py = ROLES.map(|role| {
        let package = new(at, role, "python");
        let file = package.join(format!("{}.py", name(&package).replace('-', "_")));
        format!("'{}' '{}'", python.display(), file.display())
    });
    // No digits are compared: the net in Python states the force on the payload and averages the velocity of accepted windows, that in
    // Rust does neither. Their descent speeds differ by 0.2 %.
    together(&at.join("py"), &py, &[]);
    conform_all(&at.join("py.recording"), &py);
}
