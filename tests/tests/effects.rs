//! Effects of a scene: an inactive effect changes nothing bitwise, an active one changes the results as predicted, and
//! programs that are not needed are not started.

use std::fs;
use std::path::{Path, PathBuf};

use ripstop_tests::{History, ripstop_run, root, sheet, succeed};

/// Expected change of a result.
enum Moves {
    Up,
    Down,
    /// By this amount, with a relative tolerance.
    By(f64, f64),
    Anyhow,
}
use Moves::{Anyhow, By, Down, Up};

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(format!("{name}.toml"));
    fs::write(&file, text).expect("written");
    file
}

/// Runs the scene `text`; returns the results folder.
fn run_to_end(folder: &Path, name: &str, text: &str) -> PathBuf {
    let out = folder.join(name);
    succeed(ripstop_run(&write(folder, name, text), &out, &["--quiet", "--ranks", "flow=1,mesh=1"]));
    out
}

/// The history of a stage without its wall times.
fn bytes(out: &Path, stage: &str) -> String {
    let history = History::read(out, stage);
    history.without_wall_times().iter().map(|r| r.join(",") + "\n").collect()
}

/// A value of the last window; `hang_n`: load on the payload in addition to the pressure load.
fn last(out: &Path, stage: &str, column: &str) -> f64 {
    let history = History::read(out, stage);
    let value = |name: &str| *history.column(name).last().expect("a window");
    if column == "hang_n" { value("riser_force_n") - value("vertical_load_n") } else { value(column) }
}

fn first(out: &Path, stage: &str, column: &str) -> f64 {
    History::read(out, stage).column(column)[0]
}

/// Programs that ran in a stage, by their logs.
fn programs(out: &Path, stage: &str) -> Vec<String> {
    let logs = fs::read_dir(out.join(stage).join("logs")).expect("logs");
    let mut names: Vec<String> = logs
        .flatten()
        .map(|e| e.path().file_stem().expect("a name").to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn compare(what: &str, moves: &Moves, before: f64, after: f64) {
    println!("{what}: {before:.6e} -> {after:.6e}");
    let good = match moves {
        Up => after > before,
        Down => after < before,
        By(d, share) => ((after - before) / d - 1.0).abs() < *share,
        Anyhow => after != before && (after / before - 1.0).abs() < 0.2,
    };
    assert!(good, "{what}: {before} -> {after}");
}

/// Inserts a line below a table header: `put(text, "fabric", "wrinkling = true")`.
fn put(text: &str, table: &str, line: &str) -> String {
    let header = format!("[{table}]\n");
    assert!(text.contains(&header), "no {header}");
    text.replacen(&header, &format!("{header}{line}\n"), 1)
}

const SHEET: &str = concat!(
    sheet!("family", 8, 16, ""),
    r#"[structure]
[flow]
[flow.solver]
residual_drop = 1e-3
[flow.grid]
layers_inside = 4
layers_outside = 8
first_layer_m = 0.12
[output]
surface_every_windows = 0
volume_every_windows = 0
[descent]
payload_mass_kg = 5.0
initial_speed_m_s = 4.0
reference_area_m2 = 4.0
"#
);

/// A static shape under 12 Pa.
fn at_rest() -> String {
    format!(
        "{SHEET}[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nsolve = \"static\"\n"
    )
    .replace("[fabric]\n", "[fabric]\nwrinkling = true\n")
}

/// A motion over 20 ms.
fn in_time() -> String {
    format!(
        "{SHEET}[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nduration_s = 0.02\nwindow_s = 2e-3\nsubsteps = 4\n"
    )
    .replace("[structure]\n", "[structure]\nspectral_radius = 0.8\n")
}

/// Structure effects that are set to off give bitwise the results without the keys.
#[test]
fn inactive_structure_effects_change_nothing_bitwise() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let base = in_time();
    let plain = bytes(&run_to_end(folder, "plain", &base), "one");
    let stage = |line: &str| base.replacen("name = \"one\"\n", &format!("name = \"one\"\n{line}\n"), 1);
    let off = [
        ("again", base.clone()),
        ("wrinkling", put(&base, "fabric", "wrinkling = false")),
        ("integration", put(&base, "structure", "integration = \"implicit\"")),
        ("damping", stage("stiffness_damping_s = 0.0\nmass_damping_per_s = 0.0")),
        ("retardation", put(&base, "lines", "retardation_time_s = 0.0")),
        ("hysteresis", put(&put(&base, "lines", "hysteresis = 0.0"), "fabric", "hysteresis = 0.0")),
        ("reefing", format!("reefing = []\npoint_mass = []\n{base}")),
        ("prestress", put(&base, "lines", "prestress_pa = 0.0\ntension_only = true")),
        // Acts only with flow, not in the stage of the structure alone.
        ("permeability", format!("{base}\n[fabric.permeability]\ncloth = \"mil-c7020-type3\"\n")),
        ("payload drag", format!("{base}\n[descent.payload_drag]\ndrag_area_m2 = 0.5\n")),
    ];
    for (name, text) in off {
        assert!(bytes(&run_to_end(folder, name, &text), "one") == plain, "{name}: the history differs");
    }
}

/// Each structure effect alone changes the results as predicted.
#[test]
fn structure_effects_change_the_results_as_predicted() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let rest = at_rest();
    let plain = run_to_end(folder, "rest", &rest);
    assert_eq!(programs(&plain, "one"), ["structure"], "a pre-inflation needs the structure alone");
    // Half of the line weight acts on the fixed node of the payload.
    let mass = 4.0 * 3.048e-5 * 1223.5093 + 0.5 * 16.0 * 2.4 * 3.11e-6 * 1223.50932;
    let unwrinkled = rest.replace("wrinkling = true\n", "");
    let stage =
        |text: &str, line: &str| text.replacen("name = \"one\"\n", &format!("name = \"one\"\n{line}\n"), 1);
    let force = format!("{rest}[[stage.force]]\nat_m = [0, 0, 0]\nforce_n = [0, 0, 3.0]\n");
    // Half of the line drag, some hundredths of a newton, acts on the nodes of the canopy.
    let cases = [
        ("no wrinkling", unwrinkled, "volume_m3", Down),
        (
            "weft",
            format!("{rest}[fabric.orthotropic]\nyoungs_modulus_2_pa = 2e7\nshear_modulus_pa = 2e7\n"),
            "volume_m3",
            Up,
        ),
        ("gravity", format!("{rest}[fabric_gravity]\n"), "hang_n", By(-mass * 9.80665, 1e-3)),
        ("line drag", format!("{rest}[lines.drag]\n"), "hang_n", Up),
        ("reefing", format!("{rest}[[reefing]]\nlength_m = 4.0\n"), "projected_area_m2", Down),
        ("force", force, "hang_n", By(3.0, 1e-5)),
    ];
    for (name, text, column, moves) in cases {
        let out = run_to_end(folder, name, &text);
        compare(name, &moves, last(&plain, "one", column), last(&out, "one", column));
    }
    let time = in_time();
    let plain = run_to_end(folder, "time", &time);
    let cases = [
        ("mass damping", stage(&time, "mass_damping_per_s = 50.0"), "structure_kinetic_energy_j", Down),
        ("stiffness damping", stage(&time, "stiffness_damping_s = 1e-3"), "structure_kinetic_energy_j", Down),
        ("hysteresis", put(&time, "fabric", "hysteresis = 0.3"), "structure_kinetic_energy_j", Down),
        (
            "retardation of the fabric",
            put(&time, "fabric", "retardation_time_s = 1e-3"),
            "structure_kinetic_energy_j",
            Down,
        ),
        (
            "point mass",
            format!("{time}[[point_mass]]\nnodes = \"rim\"\nmass_kg = 0.05\n"),
            "structure_load_work_j",
            Down,
        ),
        (
            "explicit",
            time.replace("spectral_radius = 0.8", "integration = \"explicit\""),
            "structure_load_work_j",
            Anyhow,
        ),
    ];
    for (name, text, column, moves) in cases {
        let out = run_to_end(folder, name, &text);
        compare(name, &moves, last(&plain, "one", column), last(&out, "one", column));
    }
}

/// Each flow effect alone, around the fixed canopy: only the flow-solver runs.
#[test]
fn flow_effects_change_the_results_as_predicted() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = "[[stage]]\nname = \"one\"\nkind = \"flow-only\"\nduration_s = 0.06\nwindow_s = 2e-2\n";
    let base = format!("{SHEET}{stage}");
    let plain = run_to_end(folder, "plain", &base);
    assert_eq!(programs(&plain, "one"), ["flow"], "a rigid canopy needs the flow alone");
    let text = bytes(&plain, "one");
    assert!(bytes(&run_to_end(folder, "again", &base), "one") == text, "not the same twice");
    for (name, more) in [("line drag", "[lines.drag]\n"), ("gravity", "[fabric_gravity]\n")] {
        // Structure effects change nothing if the structure-solver does not run.
        let out = run_to_end(folder, name, &format!("{base}{more}"));
        assert!(bytes(&out, "one") == text, "{name}");
    }
    let viscous = "[flow.viscosity]\ndynamic_viscosity_pa_s = 0.05\n";
    // Impulsive start: the first window is compared, because the later ones oscillate.
    type See = fn(&Path, &str, &str) -> f64;
    let cases: [(&str, String, See, Moves); 7] = [
        ("viscosity", viscous.to_owned(), last, Up),
        ("turbulence", format!("{viscous}turbulence = \"smagorinsky\"\n"), last, Up),
        ("permeability", "[fabric.permeability]\nviscous_pa_s_m = 50.0\n".into(), first, Down),
        ("gust", "[flow.gust]\nvelocity_m_s = [0, 0, 2]\nduration_s = 0.1\n".into(), first, Up),
        ("energy", "[flow.energy]\n".into(), first, Anyhow),
        ("limiter", "[flow.limiter]\nk = 0.5\n".into(), first, Anyhow),
        ("convection", "[flow.convection]\nupwind_share = 0\n".into(), last, Anyhow),
    ];
    for (name, more, see, moves) in cases {
        let out = run_to_end(folder, name, &format!("{base}{more}"));
        compare(name, &moves, see(&plain, "one", "drag_n"), see(&out, "one", "drag_n"));
    }
    // With the energy equation from here on: an isothermal stage ends with the undisturbed temperature.
    let second = stage.replace("one", "two");
    let two = run_to_end(folder, "two stages", &format!("{base}{second}"));
    let with = write(folder, "with energy", &format!("{base}[flow.energy]\n{second}"));
    let before = first(&two, "two", "drag_n");
    let flags = ["--quiet", "--ranks", "flow=1,mesh=1", "--stage", "two"];
    succeed(ripstop_run(&with, &two, &flags));
    let after = first(&two, "two", "drag_n");
    println!("energy from the second stage on: {before:.6e} -> {after:.6e}");
    assert!(after != before && (after / before - 1.0).abs() < 1e-2, "energy moves {before} to {after}");
    // Wind along x that increases with height.
    let wind = put(&base, "flow", "wind_m_s = [1, 0, 0]");
    let out = run_to_end(folder, "wind", &wind);
    let shear = "[flow.shear]\nstart_height_m = 10.0\nprofile = \"linear\"\nslope_per_m = 0.2\n";
    let sheared = run_to_end(folder, "shear", &format!("{wind}{shear}"));
    compare("shear", &Anyhow, first(&out, "one", "drag_n"), first(&sheared, "one", "drag_n"));
}

/// A canopy with prescribed motion needs mesh and flow, but no structure. An upward motion in the falling frame reduces
/// the air speed.
#[test]
fn prescribed_motion_runs_without_structure_solver() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let still = format!(
        "{SHEET}[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.1\nwindow_s = 2e-2\n"
    );
    let motion = |v: f64| {
        format!(
            "{still}[[stage]]\nname = \"move\"\nkind = \"prescribed\"\nduration_s = 0.06\nwindow_s = 2e-2\n\
             [[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0, 1]\ndisplacement_m = [[0, 0, 0], [0, 0, {v}]]\n"
        )
    };
    let held = run_to_end(folder, "held", &motion(0.0));
    assert_eq!(programs(&held, "move"), ["flow", "mesh"]);
    let up = run_to_end(folder, "up", &motion(1.0));
    compare("moving up", &Down, last(&held, "move", "drag_n"), last(&up, "move", "drag_n"));
    // The grid follows: cell volumes change only if the canopy moves.
    let ratio = |out: &Path| last(out, "move", "mesh_min_volume_ratio");
    assert!(ratio(&held) == 1.0 && ratio(&up) < 1.0, "{} {}", ratio(&held), ratio(&up));
}

/// The descent with effects of lines and payload.
#[test]
fn descent_effects_change_the_results_as_predicted() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let base = put(&in_time(), "fabric", "wrinkling = true").replace(
        "duration_s = 0.02\nwindow_s = 2e-3\n",
        "duration_s = 0.4\nwindow_s = 1e-2\nmass_damping_per_s = 20.0\n",
    );
    let base = base.replace("[output]\n", "[coupling]\ntolerance = 5e-3\n[output]\n");
    let developed = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.1\nwindow_s = 2e-2\n";
    let fall =
        "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = 0.02\nwindow_s = 5e-3\nsubsteps = 4\n";
    let base = format!("{base}{developed}{fall}");
    let plain = run_to_end(folder, "plain", &base);
    assert_eq!(programs(&plain, "fall"), ["flow", "mesh", "structure"]);
    assert!(!plain.join("fall/payload.csv").exists());
    let speed = |out: &Path| last(out, "fall", "descent_speed_m_s");
    // Line drag adds drag and reduces the mouth area; which effect dominates depends on the canopy.
    for (name, more, moves) in [
        ("payload drag", "[descent.payload_drag]\ndrag_area_m2 = 0.5\n", Down),
        ("line drag", "[lines.drag]\ndiameter_m = 0.01\n", Anyhow),
    ] {
        let out = run_to_end(folder, name, &format!("{base}{more}"));
        compare(name, &moves, speed(&plain), speed(&out));
    }
    let heavy = format!("{base}[fabric_gravity]\n");
    let body = "[descent.body]\ninertia_kg_m2 = [0.1, 0.1, 0.1]\nattachments_m = [[0, 0, 0.2]]\ninitial_velocity_m_s = [0.5, 0, 0]\n";
    let point = run_to_end(folder, "heavy", &heavy);
    // The frame falls; the payload moves sideways in it.
    let heavy = put(&heavy, "descent", "motion = \"vertical\"");
    let swung = run_to_end(folder, "body", &format!("{heavy}{body}"));
    compare("body", &Anyhow, speed(&point), speed(&swung));
    let log = fs::read_to_string(swung.join("fall/payload.csv")).expect("the payload's motion");
    let rows: Vec<Vec<f64>> =
        log.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().expect("a number")).collect()).collect();
    assert_eq!(rows.len(), 4);
    // 20 ms at 0.5 m/s; the lateral line force is still small.
    assert!((rows[3][1] - 0.01).abs() < 1e-4, "{:?}", rows[3]);
    // Released at an attitude, to which its attachment was turned before: the lines turn it back.
    let turned = "[descent.body]\ninertia_kg_m2 = [0.1, 0.1, 0.1]\nattachments_m = [[0, 0, 0.2]]\ninitial_rotation_deg = [0, 10, 0]\n";
    let out = run_to_end(folder, "turned", &format!("{heavy}{turned}"));
    let log = fs::read_to_string(out.join("fall/payload.csv")).expect("the payload's motion");
    let tilt: Vec<f64> = log
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(14).expect("a tilt").parse::<f64>().expect("a number").to_degrees())
        .collect();
    println!("tilt after the release at 10 degrees: {tilt:.4?}");
    assert!(tilt.iter().all(|a| (9.0..10.0).contains(a)) && tilt.is_sorted_by(|a, b| a > b), "{tilt:?}");
    // The lines carry it.
    assert!(rows[3][17] > 0.0 && rows[3][17] < 2000.0, "{:?}", rows[3]);
    assert!(swung.join("fall/state/payload.bin").exists());
}

/// Drag of lines and of the payload in a wind by height. A table of one wind is that wind, for all programs. A payload with much drag takes
/// the wind of its own height, m dv/dt = 1/2 rho C A |w| w: 0.4 m below the start of the flow, which is 3.6 m/s less wind, and 0.02 m lower in each
/// window. The first agrees to the tolerance of the coupling; then the lines begin to hold it, by 1 % in the second window.
#[test]
fn drag_of_lines_and_payload_is_that_of_their_height() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (area, windows, dt) = (2.0, 3, 5e-3);
    let flow = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.1\nwindow_s = 2e-2\n";
    let fall = format!(
        "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = {}\nwindow_s = {dt}\nsubsteps = 4\n",
        f64::from(windows) * dt
    );
    let base = put(&in_time(), "descent", "motion = \"three-dimensional\"").replace(
        "duration_s = 0.02\nwindow_s = 2e-3\n",
        "duration_s = 0.4\nwindow_s = 1e-2\nmass_damping_per_s = 20.0\n",
    );
    let lines = "[lines.drag]\ndiameter_m = 0.01\n";
    let drag = format!("{lines}[descent.payload_drag]\ndrag_area_m2 = {area}\n");
    let base = base.replace("[output]\n", "[coupling]\ntolerance = 5e-3\n[output]\n");
    let scene = |more: &str| format!("{base}{flow}{fall}{more}");
    let table = |low: f64, high: f64| {
        format!(
            "[flow.shear]\nstart_height_m = 10.0\nprofile = \"table\"\nheight_m = [9.3, 9.7]\n\
             table_m_s = [[{low}, 0, 0], [{high}, 0, 0]]\n"
        )
    };
    let same = put(&scene(&drag), "flow", "wind_m_s = [3.0, 0, 0]");
    let same = run_to_end(folder, "same", &same);
    let one = run_to_end(folder, "one", &scene(&format!("{drag}{}", table(3.0, 3.0))));
    for column in ["frame_vx_m_s", "descent_speed_m_s", "drag_n"] {
        let [a, b] = [&same, &one].map(|out| last(out, "fall", column));
        println!("{column}: {a:.9} in a wind, {b:.9} in a table of it");
        // They are the same to nine digits; the subtraction of the wind leaves round-off.
        assert!((a - b).abs() < 1e-7 * a.abs(), "{column}: {a} {b}");
    }
    // Without payload drag, canopy and lines alone move the payload.
    let sheared = |drag: &str, name: &str| {
        let out = run_to_end(folder, name, &scene(&format!("{drag}{}", table(0.0, 12.0))));
        ["frame_vx_m_s", "frame_z_m", "descent_speed_m_s"]
            .map(|c| History::read(&out, "fall").column(c).to_vec())
    };
    let [vx, z, fall] = sheared(&drag, "sheared");
    let [without, ..] = sheared(lines, "sheared-without-drag");
    let scene = case::load(&folder.join("sheared.toml")).expect("a scene");
    let suspended = coupling::interface::CanopyInterface::new(&scene).expect("a canopy").masses.suspended();
    let mass = scene.descent.as_ref().expect("a descent").payload_mass_kg + suspended;
    let release = scene.release_height().expect("a height");
    for (k, share) in [(0, 0.005), (1, 0.015)] {
        let w = 12.0 * (release + z[k] - 9.3) / 0.4 - vx[k];
        let exact = dt * 0.5 * 1.225 * area * w.hypot(fall[k]) * w / mass;
        let before = k.checked_sub(1).map_or(0.0, |k| vx[k] - without[k]);
        let found = vx[k] - without[k] - before;
        println!(
            "at {:.3} m, wind past it {w:.3} m/s: {found:.6} m/s by drag in a window, {exact:.6} by the law",
            release + z[k]
        );
        assert!((found / exact - 1.0).abs() < share, "{k}: {found} {exact}");
    }
}

/// Contradictory effects, and effects that a program does not support, are refused by name.
#[test]
fn contradictory_effects_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = "[[stage]]\nname = \"one\"\nkind = \"flow-only\"\nduration_s = 0.06\nwindow_s = 2e-2\n";
    let refused = |name: &str, text: &str| {
        let out =
            ripstop_run(&write(folder, name, text), &folder.join(name), &[]).output().expect("it starts");
        assert_eq!(out.status.code(), Some(2), "{name}");
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    let windy = put(SHEET, "flow", "wind_m_s = [1, 0, 0]");
    let shear = "[flow.shear]\nstart_height_m = 10.0\nprofile = \"linear\"\n";
    let fall =
        "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = 0.02\nwindow_s = 5e-3\nsubsteps = 4\n";
    let text = refused("shear", &format!("{windy}{fall}{stage}[lines.drag]\n{shear}"));
    assert!(text.contains("lines.drag") && text.contains("not known after stage \"one\""), "{text}");
    let body = "[descent.body]\ninertia_kg_m2 = [0.1, 0.1, 0.3]\nattachments_m = [[0, 0, 0.2]]\n";
    let text = refused("body", &format!("{SHEET}{stage}{body}"));
    assert!(text.contains("no body has the moments") && text.contains("add [fabric_gravity]"), "{text}");
    assert!(text.contains("free in coupled stages only"), "{text}");
    let held = "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nduration_s = 0.1\nwindow_s = 0.1\n\
                [[stage.motion]]\nnodes = \"payload\"\ntime_s = [0]\ndisplacement_m = [[0, 0, 0.1]]\n";
    let turned = body.replace("0.3]", "0.1]") + "initial_rotation_deg = [0, 150, 150]\n";
    let text = refused("attitude", &format!("{SHEET}{held}{turned}"));
    assert!(
        text.contains("initial_rotation_deg` is 212") && text.contains("moves the attachments"),
        "{text}"
    );
    let text =
        refused("reefing", &format!("{SHEET}{stage}[[reefing]]\nlength_m = 4.0\nrelease_stage = \"two\"\n"));
    assert!(text.contains("no stage \"two\""), "{text}");
    let text = refused(
        "order",
        &format!("{SHEET}[[stage]]\nname = \"a\"\nkind = \"prescribed\"\nduration_s = 0.1\nwindow_s = 0.1\n"),
    );
    assert!(text.contains("prescribes nothing"), "{text}");
}

/// `ripstop effects`: the table, a scene with its ranking, and a measurement of a scene.
#[test]
fn effects_are_listed_ranked_and_measured() {
    let ripstop = |args: &[&str]| {
        let mut command = std::process::Command::new(ripstop_tests::program("ripstop"));
        command.args(args).current_dir(root());
        String::from_utf8_lossy(&succeed(command).stdout).into_owned()
    };
    let table = ripstop(&["effects"]);
    for key in ["fabric.wrinkling", "flow.energy", "reefing", "descent.body", "lines.drag"] {
        assert!(table.contains(&format!("{key}: ")), "{key}");
    }
    let ranking = ripstop(&["effects", "cases/atps-descent/scene.toml"]);
    assert!(ranking.contains("Mach 0.0143") && ranking.contains("not needed"), "{ranking}");
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write(folder.path(), "scene", &at_rest());
    let text =
        ripstop(&["effects", scene.to_str().expect("a path"), "--measure", "--only", "fabric.wrinkling"]);
    let rows = |title: &str| {
        let lines = text.lines().skip_while(|l| !l.starts_with(title)).skip(1);
        lines
            .filter(|l| l.trim_start().starts_with("fabric.wrinkling"))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    // Load of a stage without flow, and riser force; then the costs.
    let changes = rows("relative change of the quantities");
    assert!(changes[0].contains(" drag ") && changes[1].contains(" tension "), "{text}");
    let cost = rows("cost of each effect").pop().expect("a row");
    let ratio: f64 = cost.split_whitespace().nth(2).expect("a ratio").parse().expect("a number");
    assert!(ratio > 0.0, "{text}");
    let mut wrong = std::process::Command::new(ripstop_tests::program("ripstop"));
    wrong.args(["effects", scene.to_str().expect("a path"), "--measure", "--only", "fabric.wrinkle"]);
    let out = wrong.output().expect("it starts");
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stderr).contains("--only fabric.wrinkle"), "{out:?}");
}
