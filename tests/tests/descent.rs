//! The descent equation with all programs: bounded acceleration, and balance of momentum and energy of payload, fabric,
//! lines and air.

use std::fs;
use std::path::{Path, PathBuf};

use results::settled::SettledMean;
use ripstop_tests::{History, changed_scene, ripstop_run, root, succeed};

/// `square-drop` on a coarse grid from a static shape, with `changes`.
fn small(folder: &Path, changes: &[(&str, &str)]) -> PathBuf {
    let mut all = vec![
        ("cells_across = 12", "cells_across = 6"),
        ("line_count = 24", "line_count = 12"),
        ("layers_inside = 5", "layers_inside = 3"),
        ("layers_outside = 10", "layers_outside = 6"),
        ("first_layer_m = 0.1", "first_layer_m = 0.15"),
        (
            "pressure_pa = 12.0\nduration_s = 1.0\nwindow_s = 5e-3\nsubsteps = 5\nmass_damping_per_s = 10.0\n\
             settled_energy_ratio = 1e-4",
            "pressure_pa = 12.0\nsolve = \"static\"",
        ),
    ];
    all.extend(changes);
    changed_scene("square-drop", folder, &all)
}

/// Released at four times its terminal speed with the shape of 12 Pa: the dynamic pressure of 157 Pa accelerates the
/// canopy upwards, and the payload is almost in free fall until the lines are taut. The equation of the paper applies the
/// force of the air on the canopy at once.
#[test]
fn impulsive_start_accelerates_at_most_with_gravity() {
    let folder = tempfile::tempdir().expect("a folder");
    let speed = ("initial_speed_m_s = 4.0", "initial_speed_m_s = 16.0");
    let file = small(folder.path(), &[speed, ("duration_s = 0.1\n", "duration_s = 0.05\n")]);
    let accelerations = |equation: &str| {
        let out = folder.path().join(equation);
        let set = format!("descent.equation={equation}");
        succeed(ripstop_run(&file, &out, &["--quiet", "--set", &set]));
        let history = History::read(&out, "descent");
        let accelerations = history.column("acceleration_m_s2");
        eprintln!("{equation}: {accelerations:.1?} m/s2, drag {:.0?} N", history.column("drag_n"));
        accelerations
    };
    let momentum = accelerations("momentum");
    // Lines carry tension only, so the force on the payload is at least the inertia of the line mass at its node.
    assert!(momentum.iter().all(|a| *a > -9.80665 * 1.02), "{momentum:?}");
    // In the first window the lines are slack: the acceleration is less than half of that in the equation of the paper.
    let quasi_steady = accelerations("quasi-steady");
    let braked = |a: &[f64]| a[0] + 9.80665;
    assert!(braked(&momentum) < 0.5 * braked(&quasi_steady), "{momentum:?} {quasi_steady:?}");
}

/// Balance over `history`: energy added, relative to the energy exchanged, as maximum and at the end; impulse of the air
/// not accounted for by the force on the payload, relative.
fn balance(history: &History) -> [f64; 3] {
    let created = history.column("system_energy_created_j");
    let (work, drag) = (history.column("system_air_work_j"), history.column("drag_n"));
    let dt = history.column("window_s");
    let mut exchanged = 0.0;
    let mut most = 0.0f64;
    for i in 1..history.len() {
        exchanged += (work[i] - work[i - 1]).abs();
        most = most.max(created[i] / exchanged.max(f64::MIN_POSITIVE));
    }
    let impulse: f64 = drag.iter().zip(&dt).map(|(f, dt)| f.abs() * dt).sum();
    let missing = history.column("system_missing_impulse_n_s");
    let last = history.len() - 1;
    eprintln!(
        "created {:.3e} J of {exchanged:.3e} J, missing {:.2e} of {impulse:.2e} N s",
        created[last], missing[last]
    );
    [most, created[last] / exchanged, missing[last].abs() / impulse]
}

/// In a coupled stage the reaction on the payload, by the element forces, is the support force, by the impulse of the air and the change of the
/// momentum: to 2e-4 of the largest, because the coupling averages velocities (measured: 1.1e-4).
fn reactions_are_the_support_force(out: &Path) {
    let reactions = History::read_file(&out.join("descent/reactions.csv")).column("payload_force_z_n");
    let support = History::read(out, "descent").column("support_force_n");
    let most = support.iter().fold(0.0, |m: f64, f| m.max(f.abs()));
    assert_eq!(reactions.len(), support.len());
    let off = |(r, s): (&f64, &f64)| (r + s).abs() / most;
    let largest = reactions.iter().zip(&support).map(off).fold(0.0, f64::max);
    eprintln!("reactions off by {largest:.1e} of the largest support force");
    for (reaction, support) in reactions.iter().zip(&support) {
        assert!((reaction + support).abs() < 2e-4 * most, "{reaction} {support}");
    }
}

/// 20 windows of `square-drop`. The impulse on the payload equals that of the air: they differ by a second difference of
/// the load in each window, whose sum vanishes. No energy is added; numerical damping (spectral radius 0.9) removes some.
/// The release is a jump of the load, for which the interface velocities are first-order accurate: up to 2 % of the
/// exchanged energy may be added temporarily, as in the hard cases, and none at the end.
#[test]
fn momentum_and_energy_of_a_descent_are_balanced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let reaction = "[[output.reaction]]\nname = \"payload\"\nnodes = \"held\"\n\n[coupling]\n";
    succeed(ripstop_run(&small(folder.path(), &[("[coupling]\n", reaction)]), &out, &["--quiet"]));
    reactions_are_the_support_force(&out);
    let [most, end, missing] = balance(&History::read(&out, "descent"));
    assert!(missing < 0.01, "{missing}");
    assert!(most < 0.02 && (-0.05..0.005).contains(&end), "{most} {end}");
}

/// A node of the canopy is pulled down by 0.2 m within the 20 windows: its work, 5 % of what the air exchanges, is not said to be created (0.6 % are dissipated).
#[test]
fn energy_of_a_canopy_that_is_pulled_is_balanced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let file = small(folder.path(), &[]);
    let motion = "\n[[stage.motion]]\nat_m = [0, 0, 0]\ntime_s = [0, 0.1]\ndisplacement_m = [[0, 0, 0], [0, 0, -0.2]]\n";
    fs::write(&file, fs::read_to_string(&file).expect("a scene") + motion).expect("a scene");
    succeed(ripstop_run(&file, &out, &["--quiet"]));
    let history = History::read(&out, "descent");
    let work: f64 = history.column("structure_prescribed_work_j").iter().skip(1).sum();
    let air = history.column("system_air_work_j");
    let exchanged: f64 = air.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
    let [most, end, _] = balance(&history);
    eprintln!(
        "prescribed {work:.3e} J, {:.2} of the exchange; created {most} at most, {end} at the end",
        work / exchanged
    );
    assert!(work > 0.04 * exchanged, "{work} {exchanged}");
    assert!(most < 0.02 && (-0.05..0.005).contains(&end), "{most} {end}");
}

/// The same over 1000 windows: neither error grows with time.
#[test]
#[ignore = "nightly: 10 minutes"]
fn momentum_and_energy_of_a_long_descent_are_balanced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let file = small(folder.path(), &[("duration_s = 0.1\n", "duration_s = 5.0\n")]);
    succeed(ripstop_run(&file, &out, &["--quiet"]));
    let history = History::read(&out, "descent");
    assert_eq!(history.len(), 1000);
    let [most, end, missing] = balance(&history);
    assert!(missing < 0.01, "{missing}");
    assert!(most < 0.02 && (-0.05..0.005).contains(&end), "{most} {end}");
}

/// Duration of the descent whose settled means are compared, s: 50 U/D.
const DESCENT_S: f64 = 100.0;
/// Settled descent speed of the coarse ATPS descent with a perturbed wake, and the half width of its 95 % interval, m/s: of 200 s with seed 2 and
/// windows of 10 ms, as the two values below (`ripstop statistics`; programs of 03f65ea3). The test has another seed and other windows.
const SPEED_M_S: (f64, f64) = (4.548, 0.031);
/// Settled drag, and the half width of its 95 % interval, N. The weight is 1 045.5 N.
const DRAG_N: (f64, f64) = (1045.6, 1.5);
/// Settled projected area, and the half width of its 95 % interval, m2.
const PROJECTED_AREA_M2: (f64, f64) = (64.82, 0.38);

/// Half width of the band of the difference of two means with these half widths: that of the difference of two independent means at 95 %,
/// times 1.3 for 99 %, so that one of a hundred runs fails by chance.
fn band(a: f64, b: f64) -> f64 {
    1.3 * a.hypot(b)
}

/// The settled means of `studies/atps-descent/coarse.toml` agree with their recorded values within the band of both intervals. Round-off of
/// another build gives another history of the wake with the same means.
#[test]
#[ignore = "nightly: 30 minutes"]
fn settled_means_of_the_coarse_descent_are_reproduced() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let duration = format!("stage.descent.duration_s={DESCENT_S}");
    let options = [
        "--quiet",
        "--ranks",
        "flow=1,mesh=1",
        "--set",
        &duration,
        "--set",
        "stage.descent.perturbation={seed=1}",
    ];
    succeed(ripstop_run(&root().join("studies/atps-descent/coarse.toml"), &out, &options));
    let text = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let stages = summary["stages"].as_array().expect("stages");
    let descent = stages.iter().find(|s| s["name"] == "descent").expect("the descent");
    let settled: Vec<SettledMean> =
        serde_json::from_value(descent["settled"].clone()).expect("settled means");
    for mean in &settled {
        eprintln!("{}", mean.line());
    }
    let share = descent["wake"]["side_force_share"].as_f64().expect("a side force");
    assert!(share > results::wake::SYMMETRIC_SHARE, "the wake is symmetric: side force {share} of the drag");
    for (quantity, (expected, half_width)) in
        [("descent_speed_m_s", SPEED_M_S), ("drag_n", DRAG_N), ("projected_area_m2", PROJECTED_AREA_M2)]
    {
        let found = settled.iter().find(|m| m.quantity == quantity).expect("a settled mean");
        // Batches that are correlated by chance give no interval: then the band uses the recorded one. Drift fails.
        assert!(
            found.stationary != Some(false) || found.drift.is_some_and(|d| d.abs() < 2.0 * half_width),
            "{found:?}"
        );
        let allowed = band(half_width, found.interval_95.unwrap_or(half_width));
        assert!(
            (found.mean - expected).abs() < allowed,
            "{quantity}: {} instead of {expected} ± {allowed}",
            found.mean
        );
    }
}

/// Options of a frame that moves in all directions, with tight tolerances.
const FREE: [&str; 6] = [
    "--set",
    "descent.motion=three-dimensional",
    "--set",
    "coupling.tolerance=1e-6",
    "--set",
    "flow.solver.residual_drop=1e-6",
];

/// A frame that drifts with the wind sees what a frame in still air sees, and its payload the same forces: the motion
/// relative to the wind is the same to the tolerances.
#[test]
fn motion_relative_to_the_wind_is_that_in_still_air() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = small(folder.path(), &[("duration_s = 0.1\n", "duration_s = 0.05\n")]);
    // A push from one side, so that there is motion along all axes.
    let gust = "stage.descent.gust={velocity_m_s=[1.0,0.4,0.0],start_s=0.0,duration_s=0.04}";
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let options = [&["--quiet", "--set", gust], &FREE[..], more].concat();
        succeed(ripstop_run(&file, &out, &options));
        History::read(&out, "descent")
    };
    let still = run("still", &[]);
    let drift = ["--set", "descent.initial_drift_m_s=[3.0,-1.0]", "--set", "flow.wind_m_s=[3.0,-1.0,0.0]"];
    let carried = run("carried", &drift);
    let (time, drag) = (still.column("time_s"), still.column("drag_n"));
    let largest = |values: &[f64]| values.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let compare = |name: &str, shift: &dyn Fn(f64) -> f64, scale: f64| {
        let (a, b) = (still.column(name), carried.column(name));
        let error: Vec<f64> = (0..time.len()).map(|i| b[i] - shift(time[i]) - a[i]).collect();
        eprintln!("{name}: {:.3e} of {:.3e}", largest(&error), largest(&a));
        assert!(largest(&a) > 1e-4 * scale, "{name} vanishes: {a:?}");
        assert!(largest(&error) < 1e-4 * scale, "{name}: {error:?}");
    };
    let none = |_: f64| 0.0;
    for name in ["drag_n", "force_x_n", "force_y_n"] {
        compare(name, &none, largest(&drag));
    }
    compare("descent_speed_m_s", &none, 4.0);
    compare("frame_vx_m_s", &|_| 3.0, 1.0);
    compare("frame_vy_m_s", &|_| -1.0, 1.0);
    compare("frame_x_m", &|t| 3.0 * t, 0.05);
    compare("frame_y_m", &|t| -t, 0.05);
}

/// The run ends in the window in which the payload reaches the ground, and later stages are not run.
#[test]
fn run_ends_at_touch_down() {
    let folder = tempfile::tempdir().expect("a folder");
    let later = "duration_s = 0.1\nwindow_s = 5e-3\nsubsteps = 10";
    let more = format!("{later}\n\n[[stage]]\nname = \"on\"\nkind = \"coupled\"\n{later}");
    let file = small(folder.path(), &[(later, more.as_str())]);
    let out = folder.path().join("out");
    let options = ["--set", "descent.release_height_m=0.21", "--set", "descent.motion=three-dimensional"];
    let output = succeed(ripstop_run(&file, &out, &options));
    let height = History::read(&out, "descent").column("frame_z_m");
    let (last, rest) = height.split_last().expect("windows");
    assert!(*last <= -0.21 && rest.iter().all(|z| *z > -0.21), "{height:?}");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("touch-down after 0.06 s at 4.") && text.contains("`on` is not run"), "{text}");
    assert!(!out.join("on").exists());
    let summary = fs::read_to_string(out.join("summary.json")).expect("a summary");
    assert!(summary.contains("touch-down after") && !summary.contains("above ground"), "{summary}");
    // A run that ended on the ground has nothing to resume.
    let again = succeed(ripstop_run(&file, &out, &[&options[..], &["--resume"]].concat()));
    assert!(!out.join("on").exists(), "{}", String::from_utf8_lossy(&again.stderr));
    // One that did not come down says so: 0.2 s at 4 m/s are 0.8 m.
    let high = folder.path().join("high");
    let output = succeed(ripstop_run(&file, &high, &["--set", "descent.release_height_m=9"]));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("the payload is still 8.2") && text.contains("above ground"), "{text}");
}

/// In a side wind the momentum of canopy and payload changes by the impulse of the air in all axes, and no energy is added. A
/// payload that is held sideways stays.
#[test]
fn momentum_is_balanced_in_a_side_wind() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = small(folder.path(), &[]);
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let options = [&["--quiet", "--set", "flow.wind_m_s=[2.0,0.0,0.0]"], more].concat();
        succeed(ripstop_run(&file, &out, &options));
        History::read(&out, "descent")
    };
    let free = run("free", &FREE);
    let [most, end, missing] = balance(&free);
    assert!(missing < 0.01, "{missing}");
    assert!(most < 0.02 && (-0.05..0.005).contains(&end), "{most} {end}");
    let (speed, position) = (free.column("frame_vx_m_s"), free.column("frame_x_m"));
    let last = free.len() - 1;
    assert!(speed[last].abs() > 1e-3, "{speed:?}");
    // The position is the integral of the velocity by the trapezoidal rule.
    let path = 5e-3 * (speed.iter().sum::<f64>() - 0.5 * speed[last]);
    assert!((position[last] / path - 1.0).abs() < 1e-6, "{} {path}", position[last]);
    run("held", &[]);
    let columns = results::history::read(&folder.path().join("held/descent/history.csv")).expect("a table");
    let (_, held) = columns.iter().find(|(name, _)| name == "frame_vx_m_s").expect("a column");
    assert!(held.len() == free.len() && held.iter().all(|v| v.is_nan()), "{held:?}");
}
