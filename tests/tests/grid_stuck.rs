//! A grid that cannot follow the canopy ends the run with a saved state, from which a later stage resumes.

use std::path::{Path, PathBuf};

use case::Role;
use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// Quality that the initial grid has (0.30), but no grid around the collapsed canopy.
const BOUND: f64 = 0.27;

/// `square-drop` released while its fabric moves inwards: it collapses within ten windows, and shorter windows would only
/// follow it further. One rank per program; the last stage is repeated.
fn scene(folder: &Path) -> PathBuf {
    let scene = changed_scene(
        "square-drop",
        folder,
        &[
            ("layers_outside = 10", "layers_outside = 8"),
            (
                "[coupling]\n",
                "[mesh]\nmin_quality = 0.27\n\n[ranks]\nflow = 1\nmesh = 1\n\n[coupling]\nadaptive = { enabled = false }\n",
            ),
            ("duration_s = 1.0\n", "duration_s = 0.05\n"),
            ("duration_s = 0.2\n", "duration_s = 0.1\n"),
        ],
    );
    let text = std::fs::read_to_string(&scene).expect("just written");
    let last = text[text.rfind("[[stage]]").expect("it has stages")..].replace("\"descent\"", "\"further\"");
    std::fs::write(&scene, text + "\n" + &last).expect("the scene can be written");
    scene
}

#[test]
fn last_valid_state_is_saved_and_resumed() {
    let folder = tempfile::tempdir().expect("a folder");
    let (scene, out) = (scene(folder.path()), folder.path().join("out"));
    let failed = ripstop_run(&scene, &out, &[]).output().expect("starts");
    let text = String::from_utf8_lossy(&failed.stderr).into_owned();
    println!("{text}");
    assert!(!failed.status.success());
    for word in [
        "the grid cannot follow",
        "`descent`",
        "cell ",
        "scaled Jacobian",
        "canopy node",
        "panel",
        "is saved in",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let history = History::read(&out, "descent");
    let quality = history.column("mesh_min_quality");
    println!("accepted: {quality:?}");
    assert!((2..20).contains(&history.len()) && quality.iter().all(|q| *q >= BOUND), "{quality:?}");
    let state = out.join("descent/state");
    for role in [Role::Structure, Role::Flow, Role::Mesh] {
        assert!(case::state_file(&state, role).exists(), "{}", role.name());
    }

    // With a lower bound, a later stage resumes from the last valid window, with shorter windows if necessary.
    let strict = std::fs::read_to_string(&scene).expect("just written");
    let lower = strict
        .replace("min_quality = 0.27", "min_quality = 1e-3")
        .replace("enabled = false", "enabled = true");
    std::fs::write(&scene, lower).expect("a file");
    succeed(ripstop_run(&scene, &out, &["--stage", "further", "--stop-after-windows", "2"]));
    let further = History::read(&out, "further");
    // Two windows of the scene, divided by the rejections.
    let (time, parts) = (further.column("time_s"), further.column("window_s"));
    println!("times {time:?}, windows {parts:?}, rejected {:?}", further.column("rejected_attempts"));
    assert!((time[time.len() - 1] - 2.0 * 5e-3).abs() < 1e-12, "{time:?}");
    let halved = further.column("rejected_attempts").iter().sum::<f64>() > 0.0;
    assert_eq!(parts.iter().any(|w| *w < 5e-3), halved, "{parts:?}");
    assert_eq!(further.len() == 2, !halved, "{parts:?}");
    for (name, most) in [("descent_speed_m_s", 0.15), ("projected_area_m2", 0.2)] {
        let (before, after) = (history.column(name), further.column(name));
        let step = (after[0] - before[before.len() - 1]).abs();
        assert!(step < most * before[before.len() - 1], "{name}: {before:?} {after:?}");
    }
}
