//! The small coupled descent, from scene to results.

use std::path::{Path, PathBuf};

use ripstop_tests::{History, changed_scene, ripstop_run, scene, succeed};

fn run_to_end(scene: &Path, out: &Path, options: &[&str]) -> History {
    succeed(ripstop_run(scene, out, options));
    History::read(out, "descent")
}

fn exists(out: &Path, names: &[&str]) {
    for name in names {
        let file: PathBuf = out.join(name);
        let size = std::fs::metadata(&file).map(|m| m.len()).unwrap_or(0);
        assert!(size > 0, "{} is missing or empty", file.display());
    }
}

#[test]
fn descent_is_complete_consistent_and_reproducible() {
    let folder = tempfile::tempdir().expect("a folder");
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let first = run_to_end(&scene("square-drop"), &a, &[]);
    let second = run_to_end(&scene("square-drop"), &b, &["--log-level", "debug"]);
    assert_eq!(first.without_wall_times(), second.without_wall_times(), "two runs differ");
    assert_eq!(
        History::read(&a, "pre-inflation").without_wall_times(),
        History::read(&b, "pre-inflation").without_wall_times()
    );

    logs_say_what_programs_did(&a, &b, &first);

    // 0.1 s in windows of 5 ms.
    assert_eq!(first.len(), 20);
    let time = first.column("time_s");
    assert!(time.iter().enumerate().all(|(i, &t)| (t - (i + 1) as f64 * 5e-3).abs() < 1e-12));

    // The descent equation, from its columns: m a = R - m g with the mean force R of the lines, v' = v + a dt.
    // Mass: payload 5 kg, fabric 4 m2, 24 lines of 2.4 m.
    let mass = 5.0 + 4.0 * 3.048e-5 * 1223.5093 + 24.0 * 2.4 * 3.11e-6 * 1223.50932;
    let (speed, drag, acceleration) =
        (first.column("descent_speed_m_s"), first.column("drag_n"), first.column("acceleration_m_s2"));
    let support = first.column("support_force_n");
    let mut before = 4.0;
    for i in 0..first.len() {
        // Values are written with nine digits.
        let a = support[i] / mass - 9.80665;
        assert!((a - acceleration[i]).abs() < 1e-6, "row {i}: {a} {}", acceleration[i]);
        assert!((before - acceleration[i] * 5e-3 - speed[i]).abs() < 1e-6, "row {i}");
        before = speed[i];
    }
    assert!(drag.iter().all(|&d| d > 0.0), "an open canopy is slowed by the air");
    assert!(first.column("coupling_converged").iter().all(|&c| c == 1.0));
    assert!(first.column("mesh_min_quality").iter().all(|&q| q > 0.0));

    exists(
        &a,
        &[
            "descent/history.csv",
            "descent/descent.svg",
            "summary.json",
            "descent/logs/flow.log",
            "descent/state/flow.bin",
        ],
    );
    // Warnings of the inspection are repeated at the end.
    let text = std::fs::read_to_string(a.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let found = &summary["inspection"][0];
    assert_eq!(
        (&found["severity"], &found["check"]),
        (&"warning".into(), &"descent.drag-coefficient".into())
    );

    let series: Vec<_> = walk(&a).into_iter().filter(|f| f.extension().is_some_and(|e| e == "pvd")).collect();
    assert!(series.len() >= 2, "surface and volume series: {series:?}");
}

/// Demands that each program's log has what it computes and its totals, and with `debug` a line for each solve.
fn logs_say_what_programs_did(plain: &Path, debug: &Path, history: &History) {
    let read = |out: &Path, role: &str| {
        let file = out.join("descent/logs").join(role).with_extension("log");
        std::fs::read_to_string(file).expect("a log")
    };
    let iterations: f64 = history.column("coupling_iterations").iter().sum();
    for (role, word) in [("structure", "structure of "), ("flow", "fitted grid of "), ("mesh", "grid of ")] {
        let (plain, debug) = (read(plain, role), read(debug, role));
        let lines = |log: &str, level: &str, word: &str| {
            log.lines().filter(|l| l.contains(level) && l.contains(word)).count()
        };
        for log in [&plain, &debug] {
            assert_eq!(lines(log, " info ", word), 1, "{role}: {log}");
        }
        assert_eq!(lines(&plain, " debug ", ""), 0, "{role}: {plain}");
        let solves = lines(&debug, " debug ", ", solve ");
        // The structure is solved more often than the flow.
        assert!(role == "structure" || solves as f64 == iterations, "{role}: {debug}");
        assert_eq!(lines(&debug, " debug ", " accepted"), 20, "{role}: {debug}");
        let end = format!("end: {solves} solves in 20 accepted windows");
        assert!(plain.contains(&end) && debug.contains(&end), "{role}, {end}: {plain}");
    }
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() { files.extend(walk(&path)) } else { files.push(path) }
    }
    files
}

fn copy(from: &Path, to: &Path) {
    for file in walk(from) {
        let target = to.join(file.strip_prefix(from).expect("below"));
        std::fs::create_dir_all(target.parent().expect("a folder")).expect("a folder");
        std::fs::copy(&file, &target).expect("a copy");
    }
}

#[test]
fn results_depend_on_rank_counts_within_solver_tolerance() {
    let folder = tempfile::tempdir().expect("a folder");
    // Tight tolerances, so that only the rank counts differ.
    let tight = [
        ("[structure]", "[structure]\nnewton_tolerance = 1e-9\ngmres_tolerance = 1e-6"),
        ("residual_drop = 1e-3", "residual_drop = 1e-5\nmax_iterations = 400"),
        ("[flow.grid]", "[mesh]\ntolerance = 1e-8\n\n[flow.grid]"),
        ("[coupling]\ntolerance = 5e-3", "[coupling]\ntolerance = 1e-6"),
        ("duration_s = 0.1\n", "duration_s = 0.02\n"),
    ];
    let scene = changed_scene("square-drop", folder.path(), &tight);
    // All start from the same state, because the wrinkling of the flat fabric depends on round-off.
    let run = |n: usize, options: &[&str]| {
        let ranks = format!("structure={n},flow={n},mesh={n}");
        let options = [&["--ranks", &ranks], options].concat();
        run_to_end(&scene, &folder.path().join(n.to_string()), &options)
    };
    let mut runs = vec![run(1, &[])];
    for n in [2, 3] {
        for stage in ["pre-inflation", "developed-flow"] {
            copy(&folder.path().join("1").join(stage), &folder.path().join(n.to_string()).join(stage));
        }
        runs.push(run(n, &["--stage", "descent"]));
    }
    for other in &runs[1..] {
        for (name, tolerance) in [("descent_speed_m_s", 1e-5), ("drag_n", 1e-3), ("projected_area_m2", 1e-4)]
        {
            let (a, b) = (runs[0].column(name), other.column(name));
            for (i, (x, y)) in a.iter().zip(&b).enumerate() {
                assert!((x - y).abs() <= tolerance * x.abs(), "{name}, row {i}: {x} and {y}");
            }
        }
    }
    // Each program reports what its ranks waited for each other, within its computing time.
    for n in [1, 2, 3] {
        let text = std::fs::read_to_string(folder.path().join(n.to_string()).join("summary.json"));
        let summary: serde_json::Value = serde_json::from_str(&text.expect("a summary")).expect("JSON");
        let stage = summary["stages"].as_array().and_then(|s| s.last()).expect("a stage");
        for (role, busy) in ["structure_busy_s", "flow_busy_s", "mesh_busy_s"].into_iter().enumerate() {
            let waited = stage["rank_waiting_s"][role].as_f64().expect("a number");
            let busy = stage[busy].as_f64().expect("a number");
            assert!(
                if n == 1 { waited == 0.0 } else { waited > 0.0 && waited < busy },
                "{n} ranks: {waited} of {busy}"
            );
        }
    }
}
