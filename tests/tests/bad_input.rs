//! Invalid input gives one clear message before any program starts.

use std::process::Output;

use ripstop_tests::{changed_scene, ripstop_run};

/// Message for a changed scene; no program may have started.
fn refused(changes: &[(&str, &str)], options: &[&str]) -> (Output, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), changes);
    let out = folder.path().join("out");
    let output = ripstop_run(&scene, &out, options).output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "bad input ends with 2: {text}");
    assert!(!out.join("pre-inflation/logs").exists(), "a solver was started");
    assert!(!text.contains("panicked"), "{text}");
    (output, text)
}

#[test]
fn invalid_scenes_are_refused_before_any_solver_starts() {
    for (from, to, wanted) in [
        ("thickness_m = 3.048e-5\n", "", "missing key `thickness_m`"),
        ("thickness_m = 3.048e-5", "thickness_m = -3e-5", "fabric.thickness_m"),
        ("thickness_m = 3.048e-5", "thickness_m = 1.5", "is the value in metres?"),
        ("wrinkling", "wrinklin", "did you mean `wrinkling`?"),
    ] {
        let (_, text) = refused(&[(from, to)], &[]);
        assert!(text.contains(wanted), "{to}: {text}");
        assert!(text.contains("scene.toml:"), "{text}");
    }
}

#[test]
fn more_ranks_than_elements_are_refused() {
    let (_, text) = refused(&[], &["--ranks", "structure=5000"]);
    assert!(text.contains("5000") && text.contains("structure"), "{text}");
}

#[test]
fn missing_scene_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("nowhere.toml");
    let output = ripstop_run(&scene, &folder.path().join("out"), &[]).output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(text.contains("nowhere.toml") && text.contains("cannot be read"), "{text}");
}

#[test]
fn missing_program_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let output = ripstop_run(&ripstop_tests::scene("square-drop"), &out, &["--structure", "/no/such-solver"])
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(text.contains("such-solver"), "{text}");
}
