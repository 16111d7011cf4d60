//! `ripstop new participant`: packages that build outside the repository, conform, and replace all programs of a run.

use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::{History, program, ripstop_run, root, scene, succeed};

const ROLES: [&str; 3] = ["structure", "flow", "mesh"];

/// A package in `folder`, built; its program. All packages share a target folder below that of this build.
fn package(folder: &Path, role: &str) -> PathBuf {
    let name = format!("my-{role}");
    let mut new = Command::new(program("ripstop"));
    new.args(["new", "participant", "--role", role, "--out"]).arg(folder.join(&name));
    new.arg("--sources").arg(root());
    succeed(new);
    let target = program("ripstop").parent().expect("a folder").join("participants");
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build
        .args(["build", "--release", "--offline", "--manifest-path"])
        .arg(folder.join(&name).join("Cargo.toml"));
    succeed({
        build.env("CARGO_TARGET_DIR", &target).env_remove("RUSTFLAGS");
        build
    });
    target.join("release").join(name)
}

#[test]
fn packages_build_conform_and_run_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let programs = ROLES.map(|role| package(folder.path(), role).display().to_string());
    let together = |name: &str, options: &[&str]| {
        let mut all = vec!["--stop-after-windows", "2", "--quiet"];
        for (option, command) in ["--structure", "--flow", "--mesh"].into_iter().zip(&programs) {
            all.extend([option, command]);
        }
        let out = folder.path().join(name);
        let mut run = ripstop_run(&scene("square-drop"), &out, &[&all[..], options].concat());
        run.env("RIPSTOP", program("ripstop"));
        succeed(run);
        let history = History::read(&out, "descent");
        assert_eq!(history.column("coupling_converged"), [1.0, 1.0]);
        history.column("descent_speed_m_s").to_vec()
    };
    // All three at once, on one and on two processes of flow and mesh: the same results.
    let recording = folder.path().join("recording");
    let one = together("one", &["--record", recording.to_str().expect("UTF-8")]);
    assert_eq!(one, together("two", &["--ranks", "flow=2,mesh=2"]));

    for (role, command) in ROLES.iter().zip(&programs) {
        let mut conform = Command::new(program("ripstop"));
        conform.args(["conform", role]).arg(&recording).args(["--command", command]);
        conform.env("RIPSTOP", program("ripstop"));
        let table = succeed(conform).stdout;
        let table = String::from_utf8_lossy(&table);
        for test in ["repeat", "rollback", "resume"] {
            assert!(
                table.lines().any(|l| l.trim_start().starts_with("passed") && l.contains(test)),
                "{role}, {test}: {table}"
            );
        }
        assert!(!table.contains("FAILED"), "{table}");
    }
}
