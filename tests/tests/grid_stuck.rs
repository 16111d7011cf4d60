//! A grid that cannot follow the canopy ends the run with everything saved, and a later stage goes on.

use std::path::{Path, PathBuf};

use case::Role;
use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// `square-drop` with a bound on the grid's quality, and its last stage once more behind it.
fn scene(folder: &Path) -> PathBuf {
    let scene = changed_scene(
        "square-drop",
        folder,
        &[("[coupling]\n", "[mesh]\nmin_quality = 0.0\nmax_increments = 1\n\n[coupling]\n")],
    );
    let text = std::fs::read_to_string(&scene).expect("just written");
    let last = text[text.rfind("[[stage]]").expect("it has stages")..].replace("\"descent\"", "\"further\"");
    std::fs::write(&scene, text + "\n" + &last).expect("the scene can be written");
    scene
}

#[test]
fn the_last_good_state_is_saved_and_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let (scene, out) = (scene(folder.path()), folder.path().join("out"));
    let free = std::fs::read_to_string(&scene).expect("just written");
    succeed(ripstop_run(&scene, &out, &["--stop-after-windows", "10"]));
    let quality = History::read(&out, "descent").column("mesh_min_quality");
    // The start grid is far better than this; no optimisation reaches it.
    let bound = 0.9;
    assert!(quality[0] < bound, "{quality:?}");
    let lowest = quality.iter().copied().fold(f64::INFINITY, f64::min);
    println!("quality {:.4} at first, {lowest:.4} at least", quality[0]);

    let strict = free.replace("min_quality = 0.0\n", &format!("min_quality = {bound}\n"));
    std::fs::write(&scene, strict).expect("the scene can be written");
    let failed = ripstop_run(&scene, &out, &["--stage", "descent"]).output().expect("starts");
    let text = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(!failed.status.success());
    println!("{text}");
}
