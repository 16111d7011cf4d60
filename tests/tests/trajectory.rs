//! Stages without programs: the frame falls as a point mass between coupled stages, and in the air of its height.

use std::path::{Path, PathBuf};
use std::process::Output;

use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// Weight of payload, fabric and lines of `square-drop`, N: 5 kg, 4 m2 of fabric, 24 lines of 2.4 m.
const WEIGHT: f64 = 9.80665 * (5.0 + 4.0 * 3.048e-5 * 1223.5093 + 24.0 * LINE);
/// Mass of a line, kg.
const LINE: f64 = 2.4 * 3.11e-6 * 1223.50932;

fn stage(name: &str, keys: &str) -> String {
    format!("\n[[stage]]\nname = \"{name}\"\n{keys}")
}

fn coupled(name: &str, duration: f64) -> String {
    stage(name, &format!("kind = \"coupled\"\nduration_s = {duration}\nwindow_s = 5e-3\nsubsteps = 10\n"))
}

/// `square-drop` with `stages` in place of its descent.
fn drop(folder: &Path, stages: &str) -> PathBuf {
    let text = std::fs::read_to_string(ripstop_tests::scene("square-drop")).expect("the scene");
    let (before, _) = text.split_once("[[stage]]\nname = \"descent\"").expect("a descent");
    let file = folder.join("scene.toml");
    std::fs::write(&file, before.trim_end().to_owned() + "\n" + stages).expect("the scene can be written");
    file
}

fn text(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text)).concat()
}

/// Without wind, in air of one density, a coupled stage after a trajectory is what it is without it: the mean motion went on, and the swing about it
/// waited. Only the height differs.
#[test]
fn coupled_stage_continues_after_a_trajectory() {
    let folder = tempfile::tempdir().expect("a folder");
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    for folder in [&one, &two] {
        std::fs::create_dir(folder).expect("a folder");
    }
    let (first, after) = (coupled("descent", 0.05), coupled("after", 0.05));
    let fall = stage("fall", "kind = \"trajectory\"\nduration_s = 20.0\nwindow_s = 0.5\n");
    let without = drop(&one, &(first.clone() + &after));
    let with = drop(&two, &(first + &fall + &after));
    succeed(ripstop_run(&without, &one.join("out"), &[]));
    let said = text(&succeed(ripstop_run(&with, &two.join("out"), &[])));
    // Half of 0.05 s is no settled mean: the drag area from it is uncertain.
    assert!(
        said.contains("stage `fall`: drag area")
            && said.contains("which is not that of a settled descent: it has fewer than 40 windows"),
        "{said}"
    );
    let [without, with] = [&one, &two].map(|folder| History::read(&folder.join("out"), "after"));
    for column in ["descent_speed_m_s", "drag_n", "projected_area_m2"] {
        for (a, b) in without.column(column).iter().zip(&with.column(column)) {
            // The velocity is put together again from its mean and its swing, to round-off.
            assert!((a / b - 1.0).abs() < 1e-7, "{column}: {a} {b}");
        }
    }
    let (first, fall) = (History::read(&two.join("out"), "descent"), History::read(&two.join("out"), "fall"));
    // The fall continues with the mean speed of the last half of the stage before: its drag is the weight.
    let speeds = first.column("descent_speed_m_s");
    let mean = speeds[5..].iter().sum::<f64>() / 5.0;
    for (speed, drag) in fall.column("descent_speed_m_s").iter().zip(&fall.column("drag_n")) {
        assert!(
            (speed / mean - 1.0).abs() < 1e-7 && (drag / WEIGHT - 1.0).abs() < 1e-7,
            "{speed} {mean} {drag}"
        );
    }
    let height = fall.column("frame_z_m");
    assert!((height[39] - height[0] + 19.5 * mean).abs() < 1e-6, "{height:?}");
}

/// Scene of one trajectory from `altitude` (m) above the sea, with further keys of descent and stage.
fn fall(folder: &Path, altitude: f64, descent: &str, keys: &str) -> PathBuf {
    let file = changed_scene(
        "square-drop",
        folder,
        &[
            ("[flow.solver]", &format!("[flow]\naltitude_m = {altitude}\n[flow.solver]")),
            ("reference_area_m2 = 4.0\n", &format!("reference_area_m2 = 4.0\n{descent}")),
        ],
    );
    let text = std::fs::read_to_string(&file).expect("the scene");
    let (before, _) = text.split_once("[[stage]]").expect("stages");
    let stage = stage("fall", &format!("kind = \"trajectory\"\nwindow_s = 0.5\n{keys}"));
    std::fs::write(&file, before.trim_end().to_owned() + "\n" + &stage).expect("the scene can be written");
    file
}

/// From 3 000 m to 200 m above the sea with a given drag area: the speed is that of equilibrium, but for the inertia, at each height.
/// A run that was stopped on the way gives the same digits.
#[test]
fn fall_through_the_standard_atmosphere() {
    let folder = tempfile::tempdir().expect("a folder");
    let keys = "duration_s = 2000.0\n[stage.trajectory]\ndrag_area_m2 = 3.0\nend_height_m = 200.0\n";
    let scene = fall(folder.path(), 3000.0, "release_height_m = 3000.0\n", keys);
    let out = folder.path().join("out");
    let said = text(&succeed(ripstop_run(&scene, &out, &[])));
    assert!(said.contains("fall: descent speed") && said.contains("m above ground"), "{said}");
    let history = History::read(&out, "fall");
    let (speed, z) = (history.column("descent_speed_m_s"), history.column("frame_z_m"));
    // Equilibrium at two heights: the ratio of the speeds is that of the densities, late by v^2/(4 g H) with H about 9.5 km.
    let air = |z: f64| case::StandardAir::at(3000.0 + z).density_kg_m3;
    let at = |k: usize| speed[k] * speed[k] * air(z[k]);
    let last = speed.len() - 1;
    let early = z.iter().position(|z| *z < -300.0).expect("it falls");
    assert!((at(last) / at(early) - 1.0).abs() < 2e-4, "{} {}", at(last), at(early));
    assert!((0.5 * at(last) * 3.0 / WEIGHT - 1.0).abs() < 2e-4, "{}", at(last));
    assert!(-z[last] >= 2800.0 && -z[last - 1] < 2800.0, "{}", z[last]);
    let stopped = folder.path().join("stopped");
    succeed(ripstop_run(&scene, &stopped, &["--stop-after-windows", "100"]));
    succeed(ripstop_run(&scene, &stopped, &["--resume"]));
    let again = History::read(&stopped, "fall");
    for column in ["descent_speed_m_s", "frame_z_m", "drag_n"] {
        assert_eq!(again.column(column), history.column(column), "{column}");
    }
}

/// Lift makes it glide, wind carries it, and the ground ends it.
#[test]
fn glide_in_a_wind_to_the_ground() {
    let folder = tempfile::tempdir().expect("a folder");
    let keys = "duration_s = 200.0\n[stage.trajectory]\ndrag_area_m2 = 3.0\nlift_area_m2 = 1.5\nlift_direction = [0.0, 2.0]\n";
    let descent = "release_height_m = 60.0\nmotion = \"three-dimensional\"\n";
    let scene = fall(folder.path(), 0.0, descent, keys);
    let out = folder.path().join("out");
    let said = text(&succeed(ripstop_run(&scene, &out, &["--set", "flow.wind_m_s=[3,0,0]"])));
    assert!(said.contains("touch-down after"), "{said}");
    let history = History::read(&out, "fall");
    let last = history.len() - 1;
    let value = |column: &str| history.column(column)[last];
    // The speed falls with the height, so that the inertia is not quite zero: v^2/(4 g H).
    assert!((value("glide_ratio") - 0.5).abs() < 2e-4, "{}", value("glide_ratio"));
    assert!((value("frame_vx_m_s") - 3.0).abs() < 1e-4, "{}", value("frame_vx_m_s"));
    assert!((value("frame_vy_m_s") / value("descent_speed_m_s") - 0.5).abs() < 1e-4);
}

/// A stage at an altitude has the same air as a scene at that altitude.
#[test]
fn air_of_a_stage_is_that_of_its_altitude() {
    let folder = tempfile::tempdir().expect("a folder");
    let histories = [("scene", "2000.0", ""), ("stage", "500.0", "altitude_m = 2000.0\n")].map(
        |(name, altitude, key)| {
            let folder = folder.path().join(name);
            std::fs::create_dir(&folder).expect("a folder");
            let descent =
                ("window_s = 5e-3\nsubsteps = 10", format!("window_s = 5e-3\nsubsteps = 10\n{key}"));
            let flow =
                ("duration_s = 0.2\nwindow_s = 2e-2\n", format!("duration_s = 0.2\nwindow_s = 2e-2\n{key}"));
            let air = ("[flow.solver]", format!("[flow]\naltitude_m = {altitude}\n[flow.solver]"));
            let changes = [&descent, &flow, &air].map(|(from, to)| (*from, to.as_str()));
            let scene = changed_scene("square-drop", &folder, &changes);
            let said =
                text(&succeed(ripstop_run(&scene, &folder.join("out"), &["--stop-after-windows", "8"])));
            // Its height is that of the release.
            assert_eq!(
                said.contains("the air is that of 2000 m, but the frame is at 500 m"),
                name == "stage",
                "{said}"
            );
            History::read(&folder.join("out"), "descent").column("drag_n")
        },
    );
    for (scene, stage) in histories[0].iter().zip(&histories[1]) {
        assert!((scene / stage - 1.0).abs() < 1e-9, "{scene} {stage}");
    }
}
