//! Unconverged windows are errors, or accepted with warnings.

use std::path::Path;

use ripstop_tests::tiny::SMALLER;
use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// The small descent up to the developed flow, solved by LU-SGS with at most `iterations` (`None`: default) iterations to
/// the residual drop `drop`.
fn lu_sgs(folder: &Path, iterations: Option<u32>, drop: &str) -> std::path::PathBuf {
    let allowed = iterations.map_or(String::new(), |n| format!("max_iterations = {n}\n"));
    let solver = format!("method = \"lu-sgs\"\n{allowed}residual_drop = {drop}");
    let changes = [("residual_drop = 1e-3", solver.as_str())];
    let text = changed_scene("square-drop", folder, &[&SMALLER[..], &changes].concat());
    let all = std::fs::read_to_string(&text).expect("a scene");
    let end = all.find("[[stage]]\nname = \"descent\"").expect("a stage");
    std::fs::write(&text, &all[..end]).expect("a scene");
    text
}

fn summary(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    serde_json::from_str(&text).expect("JSON")
}

/// 30 iterations of LU-SGS reduce the residual too little: an error with window, values and remedies. With
/// `--accept-unconverged`: warnings, their repetition with the count, and columns and counts in the results.
#[test]
fn unconverged_flow_is_an_error_unless_accepted() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = lu_sgs(folder.path(), Some(30), "1e-4");
    let out = folder.path().join("refused");
    let failed = ripstop_run(&scene, &out, &["--quiet"]).output().expect("starts");
    let words = String::from_utf8_lossy(&failed.stderr);
    assert_eq!(failed.status.code(), Some(1), "{words}");
    for word in ["stage `developed-flow`, window 0", "residual", "flow.solver.max_iterations"] {
        assert!(words.contains(word), "{word}: {words}");
    }

    let out = folder.path().join("accepted");
    let done = succeed(ripstop_run(&scene, &out, &["--accept-unconverged"]));
    let words = String::from_utf8_lossy(&done.stderr);
    let warnings = words.lines().filter(|l| l.starts_with("warning: stage `developed-flow`")).count();
    assert_eq!(warnings, 2, "at the first occurrence and at the end of the stage: {words}");
    let history = History::read(&out, "developed-flow");
    let excess = history.column("flow_residual_end").into_iter().zip(history.column("flow_residual_target"));
    let above = excess.filter(|(end, target)| end > target).count();
    assert!(above >= 3, "{above} of {} windows", history.len());
    assert_eq!(history.column("flow_unconverged_solves").iter().sum::<f64>(), above as f64);
    let flow = &summary(&out)["stages"][1]["convergence"]["flow"];
    assert_eq!(flow["windows"].as_u64(), Some(above as u64), "{flow}");
    assert!(flow["worst"].as_f64().is_some_and(|w| w > 10.0), "{flow}");
    let table = String::from_utf8_lossy(&done.stdout);
    assert!(table.contains("accepted above the target: flow"), "the summary for people says so: {table}");
}

/// The default of `flow.solver.max_iterations` is sufficient; the former name of the option works.
#[test]
fn lu_sgs_converges_with_its_default() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = lu_sgs(folder.path(), None, "1e-2");
    let out = folder.path().join("out");
    let done = succeed(ripstop_run(&scene, &out, &["--keep-going"]));
    let words = String::from_utf8_lossy(&done.stderr);
    assert!(words.contains("option --keep-going is now --accept-unconverged"), "{words}");
    let history = History::read(&out, "developed-flow");
    let most = history.column("flow_iterations").into_iter().fold(0.0, f64::max);
    let pairs = history.column("flow_residual_end").into_iter().zip(history.column("flow_residual_target"));
    assert!(pairs.clone().all(|(end, target)| end <= target), "{:?}", pairs.collect::<Vec<_>>());
    eprintln!("LU-SGS: {most} iterations at most in a step");
    assert!(!words.contains("accepted unconverged"), "{words}");
}
