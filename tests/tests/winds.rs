//! Gusts across stage boundaries, measured by probes of the flow.

use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

use ripstop_tests::{program, ripstop_run, sheet, succeed};

const SHEET: &str = concat!(
    sheet!("windy", 4, 8, "wrinkling = true\n"),
    r#"[flow]
[flow.solver]
residual_drop = 1e-3
[flow.grid]
layers_inside = 2
layers_outside = 5
first_layer_m = 0.2
[[flow.probe]]
name = "far"
position_m = [0.0, 0.0, -9.0]
[output]
surface_every_windows = 0
volume_every_windows = 0
[descent]
payload_mass_kg = 5.0
initial_speed_m_s = 4.0
reference_area_m2 = 4.0
[ranks]
flow = 1
mesh = 1
[[stage]]
name = "inflation"
kind = "pre-inflation"
solve = "static"
pressure_pa = 12.0
[[stage]]
name = "flow"
kind = "flow-only"
duration_s = 0.1
window_s = 2e-2
[[stage]]
name = "fall"
kind = "coupled"
duration_s = 0.04
window_s = 5e-3
substeps = 4
"#
);

/// From 0.06 to 0.14 s: the release at 0.1 s is its peak.
fn gusty(folder: &Path, name: &str, clock: &str) -> PathBuf {
    let gust = format!(
        "[flow.gust]\nvelocity_m_s = [0, 1, 0]\nstart_s = 0.06\nduration_s = 0.08\nclock = \"{clock}\"\n"
    );
    let file = folder.join(format!("{name}.toml"));
    fs::write(&file, SHEET.replacen("[[flow.probe]]", &format!("{gust}[[flow.probe]]"), 1)).expect("written");
    file
}

/// Times of a stage and the velocity along y at its probe, m/s.
fn probe(out: &Path, stage: &str) -> Vec<(f64, f64)> {
    let text = fs::read_to_string(out.join(stage).join("probes.csv")).expect("a table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at =
        |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{name}: {names:?}"));
    let (time, v) = (at("time_s"), at("far_v_m_s"));
    lines
        .map(|l| l.split(',').map(|x| x.parse().expect("a number")).collect::<Vec<f64>>())
        .map(|row| (row[time], row[v]))
        .collect()
}

fn gust_at(run_time: f64) -> f64 {
    let phase = (run_time - 0.06) / 0.08;
    if (0.0..=1.0).contains(&phase) { 0.5 * (1.0 - (TAU * phase).cos()) } else { 0.0 }
}

/// The air 9 m below the canopy follows the gust on the clock of the run, in both stages; `release` is the time of
/// the run at which the second one starts.
fn follows(out: &Path, release: f64) {
    for (stage, origin) in [("flow", 0.0), ("fall", release)] {
        for (time, v) in probe(out, stage) {
            let expected = gust_at(origin + time);
            println!("{stage} at {:.3} s of the run: {v:.5} of {expected:.5} m/s", origin + time);
            // Deflection by the canopy at a distance of 9 m: (width / (4 distances))^2.
            assert!((v - expected).abs() < 3e-3, "{stage}, {time} s: {v} instead of {expected} m/s");
        }
    }
}

#[test]
fn gust_is_continuous_across_stages_of_actual_length() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = gusty(folder.path(), "run", "run");
    let out = folder.path().join("whole");
    let run = succeed(ripstop_run(&scene, &out, &[]));
    assert!(!String::from_utf8_lossy(&run.stderr).contains("a jump of"), "{run:?}");
    follows(&out, 0.1);
    // The flow stops after four of its five windows: the release is 0.02 s earlier.
    let short = folder.path().join("short");
    succeed(ripstop_run(&scene, &short, &["--quiet", "--stop-after-windows", "4"]));
    assert_eq!(probe(&short, "flow").len(), 4);
    follows(&short, 0.08);
}

#[test]
fn truncated_gust_is_reported_by_check_and_before_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = gusty(folder.path(), "stage", "stage");
    let check =
        std::process::Command::new(program("ripstop")).arg("check").arg(&scene).output().expect("starts");
    let text = String::from_utf8_lossy(&check.stdout).into_owned();
    for part in ["a jump of 1.000 m/s", "end of stage `flow`", "start of stage `fall`", "clock = \"run\""] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let out = folder.path().join("out");
    let run = succeed(ripstop_run(&scene, &out, &["--stop-after-windows", "1"]));
    assert!(String::from_utf8_lossy(&run.stderr).contains("a jump of 1.000 m/s"), "{run:?}");
    assert!(fs::read_to_string(out.join("summary.json")).expect("a summary").contains("a jump of 1.000 m/s"));
}

/// A train of pulses in one stage is the list of stages with one pulse each: the same air at the probe, to the tolerance
/// of the solves.
#[test]
fn periodic_stage_equals_stages_of_one_pulse() {
    let folder = tempfile::tempdir().expect("a folder");
    let (base, _) = SHEET.split_once("[[stage]]\nname = \"fall\"").expect("a stage");
    let stage = |name: &str, duration: f64, period: &str| {
        format!(
            "[[stage]]\nname = \"{name}\"\nkind = \"flow-only\"\nduration_s = {duration}\nwindow_s = 1e-2\n\
             [stage.gust]\nvelocity_m_s = [0, 1, 0]\nduration_s = 0.08\n{period}"
        )
    };
    let run = |name: &str, stages: &str| {
        let file = folder.path().join(format!("{name}.toml"));
        fs::write(&file, format!("{base}{stages}")).expect("written");
        let out = folder.path().join(name);
        succeed(ripstop_run(&file, &out, &["--quiet"]));
        out
    };
    let names = ["one", "two", "three"];
    let list: String = names.iter().map(|name| stage(name, 0.08, "")).collect();
    let (list, whole) = (run("list", &list), run("whole", &stage("all", 0.24, "period_s = 0.08\n")));
    let periodic = probe(&whole, "all");
    let parts: Vec<f64> = names.iter().flat_map(|name| probe(&list, name)).map(|row| row.1).collect();
    assert_eq!((periodic.len(), parts.len()), (24, 24));
    for ((time, whole), part) in periodic.iter().zip(&parts) {
        let expected = 0.5 * (1.0 - (TAU * time / 0.08).cos());
        println!("{time:.3} s: {whole:.6} of one stage, {part:.6} of three, wind {expected:.6} m/s");
        assert!((whole - part).abs() < 1e-5, "{time} s: {whole} and {part} m/s");
        assert!((whole - expected).abs() < 3e-3, "{time} s: {whole} instead of {expected} m/s");
    }
}

/// The air 9 m below the canopy has the pulse of a perturbation, on any number of ranks; the same seed gives the same
/// files, another seed another force.
#[test]
fn perturbation_is_reproducible_by_its_seed() {
    let folder = tempfile::tempdir().expect("a folder");
    let (base, _) = SHEET.split_once("[[stage]]\nname = \"fall\"").expect("a stage");
    let run = |name: &str, seed: u32, ranks: &str| {
        let file = folder.path().join(format!("{name}.toml"));
        let keys = format!("[stage.perturbation]\nspeed_share = 0.25\nduration_s = 0.08\nseed = {seed}\n");
        fs::write(&file, format!("{base}{keys}")).expect("written");
        let out = folder.path().join(name);
        succeed(ripstop_run(&file, &out, &["--quiet", "--ranks", ranks]));
        let scene = case::load(&file).unwrap_or_else(|e| panic!("{e}"));
        let wind = scene.wind(1, &case::StageTimes::planned(&scene));
        for (time, v) in probe(&out, "flow") {
            let expected = wind.at(time)[1];
            println!("{name} at {time:.3} s: {v:.5} of {expected:.5} m/s");
            assert!((v - expected).abs() < 3e-3, "{name}, {time} s: {v} instead of {expected} m/s");
        }
        fs::read_to_string(out.join("flow/probes.csv")).expect("a table")
    };
    let first = run("first", 1, "flow=1");
    assert!(first == run("again", 1, "flow=1"), "not the same twice");
    assert!(first != run("other", 2, "flow=1"), "two seeds give one wake");
    run("parts", 1, "flow=2");
}
