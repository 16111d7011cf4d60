//! A grid that cannot follow the canopy ends the run with everything saved, and a later stage goes on.

use case::Role;
use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// The last stage of `square-drop`, once with a bound that its grid comes below, and once more without.
fn scene(folder: &std::path::Path) -> std::path::PathBuf {
    let scene = changed_scene(
        "square-drop",
        folder,
        &[("duration_s = 1.0\n", "duration_s = 0.4\n"), ("[coupling]\n", "[mesh]\nmin_quality = 0.0\n\n[coupling]\n")],
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
    println!("quality {quality:?}");
    // A bound that the start grid keeps, and a later one does not.
    let lowest = quality.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(lowest < quality[0], "{quality:?}");
    let bound = 0.5 * (quality[0] + lowest);
    let passed = quality.iter().position(|q| *q < bound).expect("the lowest is below");
    let strict = free.replace("min_quality = 0.0\n", &format!("min_quality = {bound}\nmax_increments = 1\n"));
    std::fs::write(&scene, strict).expect("the scene can be written");
    let failed = ripstop_run(&scene, &out, &["--stage", "descent"]).output().expect("starts");
    let text = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(!failed.status.success());
    for word in ["cannot follow", "cell ", "nearest canopy node", "panel", "saved in"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let windows = History::read(&out, "descent").len();
    assert!((1..=passed + 1).contains(&windows), "{windows} {passed}");
    let state = out.join("descent/state");
    for role in [Role::Structure, Role::Flow, Role::Mesh] {
        assert!(case::state_file(&state, role).exists(), "{}", role.name());
    }
    // A later stage goes on from there, with the bound that the grid keeps.
    std::fs::write(&scene, free).expect("the scene can be written");
    succeed(ripstop_run(&scene, &out, &["--stage", "further", "--stop-after-windows", "3"]));
    let before = History::read(&out, "descent").column("descent_speed_m_s");
    let after = History::read(&out, "further").column("descent_speed_m_s");
    let step = (after[0] - before[before.len() - 1]).abs();
    assert!(after.len() == 3 && step < 0.1, "{before:?} {after:?}");
}
