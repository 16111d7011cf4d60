//! The folder of a release (`scripts/package`) runs by itself, away from the sources.

use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::{History, program, root, succeed};

/// Makes the folder of a release in `folder`.
fn package(folder: &Path) -> PathBuf {
    let built = program("ripstop");
    let target = built.parent().and_then(Path::parent).expect("target/release/ripstop");
    let mut command = Command::new(root().join("scripts/package"));
    command.arg("--folder").env("OUT", folder).env("CARGO_TARGET_DIR", target);
    let printed = String::from_utf8(succeed(command).stdout).expect("a path in UTF-8");
    PathBuf::from(printed.trim())
}

#[test]
fn package_runs_without_the_sources() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = package(folder.path());
    let ripstop = made.join("bin/ripstop");
    let home = folder.path().join("home");
    std::fs::create_dir(&home).expect("a folder can be made");

    // The default scene is that of the package, as the folder of the call has none.
    let mut check = Command::new(&ripstop);
    check.arg("check").current_dir(&home).env_remove("RIPSTOP");
    let text = String::from_utf8_lossy(&succeed(check).stdout).into_owned();
    assert!(text.contains("atps-descent"), "{text}");

    let mut run = Command::new(&ripstop);
    let scene = made.join("cases/square-drop/scene.toml");
    run.arg("run").arg(&scene).args([
        "--stop-after-windows",
        "2",
        "--ranks",
        "flow=1,mesh=1",
        "--quiet",
        "--out",
        "result",
    ]);
    succeed({
        run.current_dir(&home).env_remove("RIPSTOP");
        run
    });
    let history = History::read(&home.join("result"), "descent");
    assert_eq!(history.len(), 2, "windows of the descent");
    let log = std::fs::read_to_string(home.join("result/ripstop.log")).expect("the log of the run");
    assert!(!log.contains(&root().display().to_string()), "the run uses the sources: {log}");
}

#[test]
fn package_has_pages_completions_and_licences() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = package(folder.path());
    let help = succeed({
        let mut command = Command::new(made.join("bin/ripstop"));
        command.arg("--help");
        command
    });
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    let page = |name: &str| made.join("share/man/man1").join(name);
    assert!(page("ripstop.1").is_file());
    for command in ["run", "check", "new", "regression", "report"] {
        assert!(help.contains(command) && page(&format!("ripstop-{command}.1")).is_file(), "{command}");
    }
    for file in [
        "share/bash-completion/completions/ripstop",
        "share/zsh/site-functions/_ripstop",
        "share/fish/vendor_completions.d/ripstop.fish",
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "docs/README.md",
        "python/pyproject.toml",
        "cases/scene.schema.json",
    ] {
        let size = std::fs::metadata(made.join(file)).map_or(0, |m| m.len());
        assert!(size > 0, "{file}");
    }
    // Results of runs beside the cases stay out.
    assert!(!made.join("cases/square-drop/runs").exists() && !made.join("runs").exists());
}
