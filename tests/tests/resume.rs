//! Restart: an interrupted and resumed run gives the results of an uninterrupted one.

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

use ripstop_tests::load::Limit;
use ripstop_tests::skip::skipped;
use ripstop_tests::{
    History, Signal, changed_scene, processes_naming, ripstop_run, root, sheet, start, succeed,
};
use rustix::process::{Pid, Resource, Rlimit, prlimit};

/// A short version of the small descent: 12 windows of inflation, 3 of flow, 8 coupled, with all kinds of tables and
/// series.
const SHORT: [(&str, &str); 5] = [
    ("duration_s = 1.0\n", "duration_s = 0.06\n"),
    ("duration_s = 0.2\nwindow_s = 2e-2", "duration_s = 0.03\nwindow_s = 1e-2"),
    ("duration_s = 0.1\n", "duration_s = 0.04\n"),
    ("[structure]\n", "[output]\nsurface_every_windows = 3\nvolume_every_windows = 2\n\n[structure]\n"),
    (
        "[flow.grid]\n",
        "[[flow.probe]]\nname = \"below\"\nposition_m = [0.1, 0.2, -0.9]\n\n[flow.forces]\n\n[flow.statistics]\n\n\
         [flow.grid]\n",
    ),
];

const STAGES: [&str; 3] = ["pre-inflation", "developed-flow", "descent"];

fn short(folder: &Path, more: &[(&str, &str)]) -> PathBuf {
    changed_scene("square-drop", folder, &[&SHORT, more].concat())
}

/// Ends a run with `signal` once `stage` has `rows` rows; returns its exit code and output.
fn cut(mut run: Child, out: &Path, stage: &str, rows: usize, signal: Signal) -> (Option<i32>, String) {
    let limit = Limit::new(Duration::from_secs(120));
    let file = out.join(stage).join("history.csv");
    while std::fs::read_to_string(&file).map_or(0, |t| t.lines().count()) <= rows {
        limit.demand(format_args!("the run does not come to row {rows} of {stage}"));
        if run.try_wait().expect("the run can be waited for").is_some() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    ripstop_tests::signal(run.id(), signal);
    let output = run.wait_with_output().expect("an end");
    let mark = out.display().to_string();
    let gone = Limit::new(Duration::from_secs(30))
        .until(Duration::from_millis(50), || processes_naming(&mark).is_empty());
    assert!(gone.is_ok(), "left: {:?}: {gone:?}", processes_naming(&mark));
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// A run that is refused or fails: exit code and output.
fn fails(mut run: Command) -> (Option<i32>, String) {
    let output = run.output().expect("ripstop starts");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn is_wall(key: &str) -> bool {
    let of_the_machine =
        ["coupler_s", "waiting_s", "rank_waiting_s", "rank_advice", "cpu_s", "peak_memory_bytes"];
    key.ends_with("wall_s") || key.ends_with("busy_s") || of_the_machine.contains(&key)
}

/// Asserts that the results of two runs are identical except for wall times.
fn assert_same(a: &Path, b: &Path) {
    let mut files = Vec::new();
    let folders = std::fs::read_dir(a).expect("a folder").flatten().map(|e| e.path());
    for stage in folders.filter(|p| p.join("history.csv").is_file()) {
        let stage = stage.file_name().expect("a name").to_str().expect("UTF-8").to_owned();
        let (x, y) = (History::read(a, &stage), History::read(b, &stage));
        assert_eq!(x.without_wall_times(), y.without_wall_times(), "{stage} in {}", b.display());
        files.extend(std::fs::read_dir(a.join(&stage)).expect("a folder").flatten().map(|e| e.path()));
    }
    let table = |p: &Path| p.extension().is_some_and(|e| e == "csv" || e == "pvd" || e == "svg");
    for file in files.iter().filter(|p| table(p) && !p.ends_with("history.csv")) {
        let other = b.join(file.strip_prefix(a).expect("below"));
        let read = |p: &Path| std::fs::read_to_string(p).unwrap_or_else(|e| panic!("{}: {e}", p.display()));
        assert!(read(file) == read(&other), "{} differs", other.display());
    }
    let summary = |out: &Path| {
        let text = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
        let mut value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let stages = value["stages"].take();
        let mut stages: Vec<_> =
            serde_json::from_value::<Vec<serde_json::Map<_, _>>>(stages).expect("stages");
        stages.iter_mut().for_each(|s| s.retain(|key, _| !is_wall(key)));
        (value["ended"].clone(), stages)
    };
    assert_eq!(summary(a), summary(b), "{}", b.display());
}

#[test]
fn resumed_run_is_bitwise_identical() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = short(folder.path(), &[]);
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    succeed(ripstop_run(&scene, &whole, &[]));

    // Each part is resumed with the command printed by the previous part.
    let mut next = ripstop_run(&scene, &parts, &["--set", "output.checkpoint_every_windows=1000"]);
    for (stage, rows, signal) in
        [("pre-inflation", 4, Signal::INT), ("developed-flow", 1, Signal::TERM), ("descent", 2, Signal::TERM)]
    {
        let (code, text) = cut(start(next), &parts, stage, rows, signal);
        assert_eq!(code, Some(130), "{text}");
        assert!(text.contains(&format!("of stage `{stage}`; resume with: ")), "{text}");
        assert!(!text.contains("the coupler ended the run"), "{text}");
        let summary = std::fs::read_to_string(parts.join("summary.json")).expect("a summary");
        assert!(summary.contains("\"ended\": \"interrupted in stage"), "{summary}");
        let printed = text.split_once("resume with: ").expect("a command").1.lines().next().expect("a line");
        assert!(printed.contains("--set output.checkpoint_every_windows=1000"), "{printed}");
        assert!(printed.ends_with("--resume"), "{printed}");
        next = Command::new("sh");
        next.args(["-c", &format!("exec {printed}")]);
    }
    // Killed: resumes from the last saved state; an incomplete row is removed.
    let run = start(ripstop_run(&scene, &parts, &["--resume", "--checkpoint-every", "2"]));
    let (code, text) = cut(run, &parts, "descent", 5, Signal::KILL);
    assert_eq!(code, None, "{text}");
    // The summary is not that of an earlier run in the folder.
    let summary = std::fs::read_to_string(parts.join("summary.json")).expect("a summary");
    assert!(summary.contains("\n  \"ended\": \"running\""), "{summary}");
    let history = parts.join("descent/history.csv");
    let torn = std::fs::read_to_string(&history).expect("rows") + "7,4.0000";
    std::fs::write(&history, torn).expect("written");
    succeed(ripstop_run(&scene, &parts, &["--resume"]));
    assert_same(&whole, &parts);

    // A complete run is not resumed.
    let again = succeed(ripstop_run(&scene, &parts, &["--resume"]));
    assert!(String::from_utf8_lossy(&again.stderr).contains("this run is complete"), "{again:?}");
    assert_same(&whole, &parts);

    // The save interval does not affect the results.
    let often = folder.path().join("often");
    succeed(ripstop_run(&scene, &often, &["--checkpoint-every", "1"]));
    assert_same(&whole, &often);
}

#[test]
fn damaged_state_is_replaced_by_the_previous_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = short(folder.path(), &[]);
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    succeed(ripstop_run(&scene, &whole, &[]));
    let run = start(ripstop_run(&scene, &out, &["--checkpoint-every", "1"]));
    let (code, text) = cut(run, &out, "descent", 4, Signal::INT);
    assert_eq!(code, Some(130), "{text}");
    let file = out.join("descent/state/flow.bin");
    let bytes = std::fs::read(&file).expect("a state");
    std::fs::write(&file, &bytes[..bytes.len() / 2]).expect("cut in half");
    // As if the run had been killed during a save.
    std::fs::create_dir_all(out.join("descent/state.new")).expect("a folder");
    std::fs::write(out.join("descent/state.new/flow.bin"), &bytes[..100]).expect("half a draft");
    let output = succeed(ripstop_run(&scene, &out, &["--resume"]));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("is incomplete (flow.bin has") && text.contains("is skipped"), "{text}");
    assert!(text.contains("resuming stage `descent` after"), "{text}");
    assert_same(&whole, &out);
}

#[test]
fn full_disk_preserves_the_previous_state() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = short(folder.path(), &[("volume_every_windows = 2", "volume_every_windows = 0")]);
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    succeed(ripstop_run(&scene, &whole, &[]));
    let run = start(ripstop_run(&scene, &out, &[]));
    let (_, text) = cut(run, &out, "descent", 2, Signal::INT);
    assert!(text.contains("saved after"), "{text}");
    // From the next window on, files of the flow-solver are limited to one megabyte, less than its state.
    let before = History::read(&out, "descent").len();
    let run = start(ripstop_run(&scene, &out, &["--resume", "--checkpoint-every", "0"]));
    let limit = Limit::new(Duration::from_secs(120));
    // Complete rows: the last one may be half written when it is read.
    let history = out.join("descent/history.csv");
    let lines = || std::fs::read_to_string(&history).expect("a history").matches('\n').count();
    while lines() <= before + 1 {
        limit.demand("the resumed run computes nothing");
        std::thread::sleep(Duration::from_millis(1));
    }
    let most = || Rlimit { current: Some(1_000_000), maximum: Some(1_000_000) };
    let mark = out.display().to_string();
    for (pid, line) in processes_naming(&mark) {
        if line.split(' ').next().is_some_and(|w| w.ends_with("flow-solver")) {
            prlimit(Pid::from_raw(pid as i32), Resource::Fsize, most())
                .expect("a limit of a process of ours");
        }
    }
    let output = run.wait_with_output().expect("an end");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("flow state: cannot write") && text.contains("File too large"), "{text}");
    assert!(
        text.contains(&format!("saved after {before} windows ")) && text.contains("; resume with: "),
        "{text}"
    );
    assert!(
        !out.join("descent/state.new").exists(),
        "half a state is left: {:?}\n{text}",
        std::fs::read_dir(out.join("descent/state.new"))
            .map(|d| d.flatten().map(|f| f.path()).collect::<Vec<_>>())
    );
    succeed(ripstop_run(&scene, &out, &["--resume"]));
    assert_same(&whole, &out);
}

#[test]
fn resumed_run_is_bitwise_identical_for_every_scheme() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = folder.path().join("base");
    let plain = short(folder.path(), &[("duration_s = 0.04\n", "duration_s = 0.035\n")]);
    succeed(ripstop_run(&plain, &base, &["--stop-after-windows", "3", "--quiet"]));
    let schemes = [
        "acceleration = \"iqn-ils\"",
        "acceleration = \"iqn-imvj\"",
        "acceleration = \"aitken\"\nmax_iterations = 60",
        "order = \"jacobi\"\nacceleration = \"iqn-ils\"\nmax_iterations = 60",
        "scheme = \"staggered\"",
        "scheme = \"staggered\"\nstaggered = { sequence = \"conventional-serial\", predictor = 1 }",
        "scheme = \"staggered\"\nstaggered = { sequence = \"improved-serial\", predictor = 1 }",
        "scheme = \"staggered\"\nstaggered = { sequence = \"relaxed-load\", predictor = 1 }\nrelaxation = 0.4",
        "scheme = \"staggered\"\nstaggered = { sequence = \"added-mass\", predictor = 1 }",
    ];
    for (at, scheme) in schemes.iter().enumerate() {
        let here = folder.path().join(at.to_string());
        std::fs::create_dir_all(&here).expect("a folder");
        let coupling = format!("[coupling]\n{scheme}\n");
        // Staggered schemes are stable if the fabric is heavier than the added mass.
        let heavy = [
            "thickness_m = 3.048e-5\ndensity_kg_m3 = 1223.5093\n",
            "thickness_m = 1e-4\ndensity_kg_m3 = 30000.0\n",
        ];
        let density = if scheme.contains("staggered") { heavy[1] } else { heavy[0] };
        let changes = [
            ("duration_s = 0.04\n", "duration_s = 0.035\n"),
            ("[coupling]\n", coupling.as_str()),
            (heavy[0], density),
        ];
        let scene = short(&here, &changes);
        let (whole, parts) = (here.join("whole"), here.join("parts"));
        let run = |out: &Path, options: &[&str]| {
            for stage in &STAGES[..2] {
                copy(&base.join(stage).join("state"), &out.join(stage).join("state"));
            }
            succeed(ripstop_run(
                &scene,
                out,
                &[&["--stage", "descent", "--accept-unconverged"], options].concat(),
            ));
        };
        run(&whole, &[]);
        // Four windows of seven, then the rest.
        run(&parts, &["--stop-after-windows", "4"]);
        succeed(ripstop_run(&scene, &parts, &["--resume", "--accept-unconverged"]));
        let (a, b) = (History::read(&whole, "descent"), History::read(&parts, "descent"));
        // Only rejected windows were shortened.
        let rejected: f64 = a.column("rejected_attempts").iter().sum();
        assert!(if rejected == 0.0 { a.len() == 7 } else { a.len() > 7 }, "{scheme}: {}", a.len());
        assert_eq!(a.without_wall_times(), b.without_wall_times(), "{scheme}");
    }
}

/// A small canopy with lines; further tables are appended.
const SHEET: &str = concat!(
    sheet!("family", 8, 16, "wrinkling = true\n"),
    r#"[output]
surface_every_windows = 2
volume_every_windows = 2
[descent]
payload_mass_kg = 5.0
initial_speed_m_s = 4.0
reference_area_m2 = 4.0
[coupling]
tolerance = 5e-3
[flow]
wind_m_s = [0.5, 0, 0]
[flow.grid]
layers_inside = 4
layers_outside = 8
first_layer_m = 0.12
[ranks]
flow = 2
mesh = 2
"#
);

const INFLATE: &str = "[[stage]]\nname = \"inflation\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\n\
                       duration_s = 0.4\nwindow_s = 1e-2\nsubsteps = 4\nmass_damping_per_s = 20.0\n";
const DEVELOP: &str = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.1\nwindow_s = 2e-2\n";
const FALL: &str = "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = 0.03\nwindow_s = 5e-3\n\
                    substeps = 4\n";

/// Asserts that a run interrupted at each of `cuts` (stage, rows) gives the results of an uninterrupted one.
fn same_in_parts(folder: &Path, name: &str, text: &str, cuts: &[(&str, usize)]) -> PathBuf {
    let scene = folder.join(format!("{name}.toml"));
    std::fs::write(&scene, text).expect("written");
    let (whole, parts) = (folder.join(format!("{name}-whole")), folder.join(format!("{name}-parts")));
    succeed(ripstop_run(&scene, &whole, &["--accept-unconverged"]));
    for (at, (stage, rows)) in cuts.iter().enumerate() {
        let options: &[&str] =
            if at > 0 { &["--resume", "--accept-unconverged"] } else { &["--accept-unconverged"] };
        let (code, text) =
            cut(start(ripstop_run(&scene, &parts, options)), &parts, stage, *rows, Signal::INT);
        assert_eq!(code, Some(130), "{name}: {text}");
    }
    succeed(ripstop_run(&scene, &parts, &["--resume", "--accept-unconverged"]));
    assert_same(&whole, &parts);
    whole
}

#[test]
fn resumed_run_is_bitwise_identical_for_every_effect() {
    let folder = tempfile::tempdir().expect("a folder");
    let cuts = [("inflation", 6), ("flow", 1), ("fall", 2)];
    let many = "[structure]\nspectral_radius = 0.8\n[flow.viscosity]\ndynamic_viscosity_pa_s = 1.8e-5\nturbulence = \"spalart-allmaras\"\n\
                [flow.shear]\nstart_height_m = 10.0\nprofile = \"linear\"\nslope_per_m = 0.2\n\
                [flow.convection]\nupwind_share = 0\n[flow.gust]\nvelocity_m_s = [0, 0.5, 0]\nstart_s = 0.45\nduration_s = 0.1\nclock = \"run\"\n\
                [[flow.probe]]\nname = \"near\"\nposition_m = [0.3, 0.2, 0.1]\n\
                [flow.statistics]\n[[flow.slice]]\nname = \"cut\"\npoint_m = [0, 0, 0]\nnormal = [1, 0, 0]\nevery_windows = 2\n\
                [fabric.permeability]\nviscous_pa_s_m = 50.0\n\
                [fabric_gravity]\n[lines.drag]\ndiameter_m = 0.01\n[descent.payload_drag]\ndrag_area_m2 = 0.5\n\
                [descent.body]\ninertia_kg_m2 = [0.1, 0.1, 0.1]\nattachments_m = [[0, 0, 0.2]]\n";
    let whole = same_in_parts(
        folder.path(),
        "many",
        &format!(
            "{SHEET}{many}{INFLATE}{DEVELOP}{FALL}stiffness_damping_s = 1e-4\n\
             [stage.perturbation]\nduration_s = 0.025\nseed = 5\n"
        ),
        &cuts,
    );
    for file in ["fall/payload.csv", "fall/probes.csv", "fall/cut.pvd", "fall/flow.pvd", "fall/canopy.pvd"] {
        assert!(whole.join(file).is_file(), "{file} is missing");
    }
    let other = "[lines.drag]\ndiameter_m = 0.01\n[structure]\nintegration = \"explicit\"\n[flow.energy]\n[flow.limiter]\nk = 0.5\n\
                 [flow.gust]\nvelocity_m_s = [0.3, 0.5, 0]\nshape = \"sine\"\nstart_s = 0.41\nperiod_s = 0.11\nclock = \"run\"\n\
                 [flow.solver]\nresidual_drop = 1e-3\n[mesh]\nmover = \"laplacian\"\n";
    let pulse = "[stage.perturbation]\nduration_s = 0.08\n";
    // Sliders of lines and fabric: with central differences, and with friction in implicit steps.
    let hysteretic = |scene: String| {
        scene.replacen("[lines]", "[lines]\nhysteresis = 0.3\nretardation_time_s = 1e-5", 1).replacen(
            "[fabric]",
            "[fabric]\nhysteresis = 0.2",
            1,
        )
    };
    let scene = hysteretic(format!("{SHEET}{other}{INFLATE}{DEVELOP}{pulse}{FALL}"));
    same_in_parts(folder.path(), "other", &scene, &cuts);
    let folds = "[structure]\nspectral_radius = 0.8\n[fabric.contact]\ndistance_m = 0.003\nfriction = 0.3\n[fabric_gravity]\n[[reefing]]\nlength_m = 7.0\ndraw_in_s = 0.3\n";
    let cuts_within = [("inflation", 9), ("inflation", 21)];
    same_in_parts(folder.path(), "folds", &hysteretic(format!("{SHEET}{folds}{INFLATE}")), &cuts_within);
    let moved = "[[stage]]\nname = \"move\"\nkind = \"prescribed\"\nduration_s = 0.08\nwindow_s = 1e-2\n\
                 [[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0, 0.1]\ndisplacement_m = [[0, 0, 0], [0.1, 0, 0.4]]\n";
    let regrid = "[mesh]\nouter = \"sliding\"\n[mesh.regrid]\nbelow = 0.9\n";
    let cuts = [("move", 2), ("move", 4)];
    same_in_parts(folder.path(), "moved", &format!("{SHEET}{regrid}{DEVELOP}{moved}"), &cuts);
}

/// Data of patches are functions of the time of the stage: nothing of them is saved.
#[test]
fn resumed_run_is_bitwise_identical_with_data_of_patches() {
    let folder = tempfile::tempdir().expect("a folder");
    let duct = "name = \"duct\"\n[canopy]\nkind = \"panel\"\nsize_m = [0.5, 0.5]\ncells = [4, 4]\n\
                [fabric]\nyoungs_modulus_pa = 1e6\npoisson_ratio = 0.3\nthickness_m = 1e-3\ndensity_kg_m3 = 1000.0\n\
                [flow]\n[flow.viscosity]\ndynamic_viscosity_pa_s = 0.01\n\
                [flow.box]\nbelow_m = 0.5\nabove_m = 0.5\nlayers_below = 5\nlayers_above = 5\nbehind_m = 1.0\ncells_behind = 8\n\
                [flow.box.sides]\nleft = \"inlet\"\nright = \"outlet\"\nbottom = \"wall\"\n\
                [[flow.inlet]]\npatch = \"left\"\nflow_rate_m3_s = 1.0\nprofile = \"1 + z^2\"\n\
                factor = { formula = \"1 + 0.3*sin(20*t)\" }\n\
                [[flow.outlet]]\npatch = \"right\"\npressure_pa = 5.0\nfactor = { time_s = [0, 1], value = [1, 2] }\n\
                [[flow.moving_wall]]\npatch = \"bottom\"\nvelocity_m_s = [2.0, 0.0, 0.0]\n\
                [[flow.probe]]\nname = \"near\"\nposition_m = [0.3, 0.2, 0.1]\n\
                [ranks]\nstructure = 1\nflow = 2\nmesh = 1\n\
                [[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.2\nwindow_s = 1e-2\n";
    same_in_parts(folder.path(), "duct", duct, &[("flow", 3), ("flow", 9)]);
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder").flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).expect("a copy");
    }
}

#[test]
fn resumed_run_on_other_ranks_agrees_within_solver_tolerance() {
    let folder = tempfile::tempdir().expect("a folder");
    let tight = [
        ("[structure]", "[structure]\nnewton_tolerance = 1e-9\ngmres_tolerance = 1e-6"),
        ("residual_drop = 1e-3", "residual_drop = 1e-5\nmax_iterations = 400"),
        ("[[flow.probe]]", "[mesh]\ntolerance = 1e-8\n\n[[flow.probe]]"),
        ("tolerance = 5e-3", "tolerance = 1e-6"),
        ("duration_s = 0.04\n", "duration_s = 0.025\n"),
    ];
    let scene = short(folder.path(), &tight);
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let first = ["--ranks", "structure=1,flow=2,mesh=2"];
    succeed(ripstop_run(&scene, &whole, &first));
    let run = start(ripstop_run(&scene, &parts, &first));
    cut(run, &parts, "descent", 2, Signal::INT);
    succeed(ripstop_run(&scene, &parts, &["--resume", "--ranks", "structure=2,flow=1,mesh=3"]));
    let (a, b) = (History::read(&whole, "descent"), History::read(&parts, "descent"));
    assert_eq!((a.len(), b.len()), (5, 5));
    for (name, tolerance) in [("descent_speed_m_s", 1e-5), ("drag_n", 1e-3), ("projected_area_m2", 1e-4)] {
        for (i, (x, y)) in a.column(name).iter().zip(&b.column(name)).enumerate() {
            assert!((x - y).abs() <= tolerance * x.abs(), "{name}, row {i}: {x} and {y}");
        }
    }
}

#[test]
fn only_scene_changes_that_affect_results_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let scene = short(folder.path(), &[]);
    let (code, text) = fails(ripstop_run(&scene, &out, &["--resume"]));
    assert!(code == Some(2) && text.contains("there is no run to resume"), "{text}");
    succeed(ripstop_run(&scene, &out, &["--stop-after-windows", "3"]));
    for (from, to, key) in [
        ("poisson_ratio = 0.3", "poisson_ratio = 0.35", "fabric.poisson_ratio"),
        ("tolerance = 5e-3", "tolerance = 4e-3", "coupling.tolerance"),
        ("pressure_pa = 12.0", "pressure_pa = 13.0", "stage[0].pressure_pa"),
        ("duration_s = 0.04\n", "duration_s = 0.01\n", "stage[2].duration_s"),
    ] {
        let scene = short(folder.path(), &[(from, to)]);
        let (code, text) = fails(ripstop_run(&scene, &out, &["--resume"]));
        assert!(
            code == Some(2) && text.contains(&format!("since the start of the run: {key}.")),
            "{key}: {text}"
        );
    }
    // A longer last stage, new grids, snapshots and a further stage.
    let more = [
        ("duration_s = 0.04\n", "duration_s = 0.045\n"),
        ("[coupling]\n", "[mesh.regrid]\nquality_threshold = 0.3\n\n[coupling]\n"),
        ("surface_every_windows = 3", "surface_every_windows = 1\ncheckpoint_every_windows = 2"),
    ];
    succeed(ripstop_run(&short(folder.path(), &more), &out, &["--resume"]));
    assert_eq!(History::read(&out, "descent").len(), 9);
    let longest = [("duration_s = 0.04\n", "duration_s = 0.05\n"), more[2]];
    succeed(ripstop_run(&short(folder.path(), &longest), &out, &["--resume"]));
    let text = std::fs::read_to_string(out.join("descent/history.csv")).expect("rows");
    let windows: Vec<&str> = text.lines().skip(1).map(|l| l.split(',').next().unwrap_or_default()).collect();
    assert_eq!(windows, ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"]);
}

/// A structure program without restart.
const PLAIN: &str = "
import sys
sys.path.insert(0, sys.argv.pop(1))
import mass_spring, ripstop

class Plain(mass_spring.MassSpring):
    effects = ('fabric.wrinkling', 'lines')

ripstop.main(Plain)
";

#[test]
fn program_without_restart_is_named_and_python_program_resumes() {
    let python = [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        tried.is_ok_and(|output| output.status.success())
    });
    let Some(python) = python else {
        skipped("no Python with iceoryx2 and numpy; `scripts/setup --python` installs them");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let examples = root().join("python/examples");
    let plain = folder.path().join("plain.py");
    std::fs::write(&plain, PLAIN).expect("the program can be written");
    let scene = short(folder.path(), &[]);
    let command = |file: &Path| format!("'{}' '{}'", python.display(), file.display());

    let out = folder.path().join("plain");
    let cannot = format!("{} '{}'", command(&plain), examples.display());
    let options = ["--structure", cannot.as_str(), "--checkpoint-every", "2"];
    let run = start(ripstop_run(&scene, &out, &options));
    let (code, text) = cut(run, &out, "pre-inflation", 4, Signal::INT);
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("the run continues but cannot be resumed within this stage"), "{text}");
    let (code, text) = fails(ripstop_run(&scene, &out, &[&options[..], &["--resume"]].concat()));
    assert!(
        code == Some(2) && text.contains("plain.py") && text.contains("saved no state to restart from"),
        "{text}"
    );

    let can = command(&examples.join("mass_spring.py"));
    let options = ["--structure", can.as_str()];
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    succeed(ripstop_run(&scene, &whole, &[&options[..], &["--stop-after-windows", "6"]].concat()));
    succeed(ripstop_run(&scene, &parts, &[&options[..], &["--stop-after-windows", "3"]].concat()));
    succeed(ripstop_run(
        &scene,
        &parts,
        &[&options[..], &["--stop-after-windows", "6", "--resume"]].concat(),
    ));
    // The earlier stages are shortened; the last resumes, with a Python participant.
    assert_eq!(History::read(&parts, "descent").len(), 6);
    assert_eq!(History::read(&whole, "descent").len(), 6);
}
