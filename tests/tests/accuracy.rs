//! `ripstop accuracy`: short studies compared with their references, and refused input.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use ripstop_tests::load::Limit;
use ripstop_tests::{Signal, program, root, signal, succeed};

fn short(study: &str) -> PathBuf {
    root().join("studies").join(study).join("short.toml")
}

fn accuracy(scene: &Path, out: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command.arg("accuracy").arg(scene).arg("--out").arg(out).args(["--cost", "work"]).args(options);
    command
}

/// Compares a short study with its reference, which `scripts/studies --remake` writes.
fn matches_reference(study: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let reference = root().join("studies").join(study).join("short.json");
    let kept = reference.to_str().expect("a path in UTF-8");
    let output = accuracy(&short(study), folder.path(), &["--without-check", "--reference", kept])
        .output()
        .expect("it starts");
    assert!(
        output.status.success(),
        "{study} is less accurate or costs more than studies/{study}/short.json:\n{}{}",
        text(&output).0,
        text(&output).1
    );
    if study == "air-bag" {
        costlier_study_fails(&reference, folder.path());
        targets(folder.path());
        verification(folder.path());
    }
}

fn text(output: &Output) -> (String, String) {
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

/// The study fails with a reference of lower cost or higher accuracy.
fn costlier_study_fails(reference: &Path, out: &Path) {
    let kept = std::fs::read_to_string(reference).expect("the reference can be read");
    for (key, factor) in [("counts", 1.0 / 1.125), ("errors", 0.5)] {
        let mut json: serde_json::Value = serde_json::from_str(&kept).expect("a reference is JSON");
        for member in json["members"].as_array_mut().expect("members") {
            for number in member[key].as_array_mut().expect("numbers") {
                *number = (number.as_f64().expect("a number") * factor).into();
            }
        }
        let file = out.join("changed.json");
        std::fs::write(&file, json.to_string()).expect("written");
        let changed = file.to_str().expect("a path in UTF-8");
        let output = accuracy(&short("air-bag"), out, &["--without-check", "--reference", changed])
            .output()
            .expect("it starts");
        assert_eq!(output.status.code(), Some(3), "{key}: {:?}", text(&output));
    }
}

/// Recommendations of the completed study, and refused targets.
fn targets(out: &Path) {
    let scene = short("air-bag");
    let options = ["--without-check", "--target-error", "60%", "--budget", "1h"];
    let advised = succeed(accuracy(&scene, out, &options));
    let words = text(&advised).0;
    assert!(words.contains("expected error") && words.contains("not assessed: "), "{words}");
    // A single run gives no spread of costs.
    assert!(!words.contains("± 0.0 s"), "{words}");
    let written = std::fs::read_to_string(out.join("target-error.toml")).expect("the advised scene");
    for name in ["window: not varied in this study", "substeps: not varied in this study"] {
        assert!(written.contains(name), "{written}");
    }
    for file in ["target-error.toml", "budget.toml"] {
        let mut check = Command::new(program("ripstop"));
        check.arg("check").arg(out.join(file));
        succeed(check);
    }
    let page = std::fs::read_to_string(out.join("accuracy.html")).expect("a page");
    assert!(page.contains("<svg") && page.ends_with("</html>\n"));
    assert!(page.contains("<p class=\"s\">commit ") && page.contains("not assessed"));
    // The former option works and warns.
    let former = accuracy(&scene, out, &["--without-check", "--want", "60%"]).output().expect("it starts");
    assert!(former.status.success() && out.join("target-error.toml").exists());
    assert!(text(&former).1.contains("option --want is now --target-error"), "{:?}", text(&former));
    assert!(!out.join("budget.toml").exists(), "recommendation of an earlier study remains");
    let poor = accuracy(&scene, out, &["--without-check", "--budget", "1e-9s"]).output().expect("it starts");
    assert_eq!(poor.status.code(), Some(2));
    assert!(text(&poor).1.contains("below one run"), "{:?}", text(&poor));
}

/// `--verify` compares with a finer run; its exit code shows whether all bounds hold.
fn verification(out: &Path) {
    let options = ["--without-check", "--target-error", "60%", "--verify"];
    let output = accuracy(&short("air-bag"), out, &options).output().expect("it starts");
    let json = std::fs::read_to_string(out.join("target-error.json")).expect("the advice");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let (errors, verified) =
        (json["errors"].as_array().expect("errors"), json["verified"].as_array().expect("verified"));
    assert_eq!((errors.len(), verified.len()), (2, 2));
    let mut all = true;
    for (e, v) in errors.iter().zip(verified) {
        let get = |x: &serde_json::Value, key: &str| x[key].as_f64().expect("a number");
        let far = (get(v, "value") - get(v, "reference")).abs() / get(e, "scale");
        assert!((far - get(v, "true_error")).abs() <= 1e-12 && far > 0.0, "{json}");
        let held = far <= get(e, "error") + get(e, "band") + 1e-9;
        assert_eq!(v["held"].as_bool(), Some(held), "{json}");
        all &= held;
    }
    assert_eq!(output.status.code(), Some(if all { 0 } else { 3 }), "{:?}", text(&output));
}

#[test]
fn air_bag_study_matches_its_reference() {
    matches_reference("air-bag");
}

#[test]
fn flow_study_matches_its_reference() {
    matches_reference("flow");
}

#[test]
fn mesh_mover_study_matches_its_reference() {
    matches_reference("mesh-mover");
}

#[test]
fn square_drop_study_matches_its_reference() {
    matches_reference("square-drop");
}

#[test]
fn methods_study_matches_its_reference() {
    matches_reference("square-drop-methods");
}

#[test]
fn atps_study_matches_its_reference() {
    matches_reference("atps-descent");
}

#[test]
fn invalid_studies_are_refused_before_any_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = std::fs::read_to_string(short("air-bag")).expect("the scene can be read");
    let out = folder.path().join("out");
    let refused = |section: &str| {
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, base.clone() + section).expect("written");
        let output = accuracy(&file, &out, &[]).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{section}");
        assert!(!out.exists(), "{section}: something was started");
        text(&output).1
    };
    let parameter =
        |name: &str| refused(&format!("\n[[accuracy.parameter]]\nname = \"{name}\"\nvalues = [1.0]\n"));
    assert!(parameter("coupling-tolerance").contains("no stage is coupled"));
    assert!(parameter("gmres-tolerence").contains("there is no parameter"));
    let quantity = refused("\n[[accuracy.quantity]]\nname = \"x\"\nof = \"weight\"\n");
    assert!(quantity.contains("weight"), "{quantity}");
    let drag = refused("\n[[accuracy.quantity]]\nname = \"x\"\nof = \"drag\"\n");
    assert!(drag.contains("flow-solver"), "{drag}");
    let plan = succeed(accuracy(&short("square-drop"), &out, &["--dry-run"]));
    assert!(text(&plan).0.contains("to run: ") && text(&plan).0.contains("of wall time") && !out.exists());
    for option in ["--target-error", "--want"] {
        let asked = accuracy(&short("air-bag"), &out, &[option, "5"]).output().expect("it starts");
        assert_eq!(asked.status.code(), Some(2));
        assert!(text(&asked).1.contains("is 5 % meant? Write `5%`"), "{:?}", text(&asked));
    }
}

/// A failed base ends the study with an error: no other sample runs and nothing is recommended.
#[test]
fn study_stops_at_a_failed_base() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = std::fs::read_to_string(short("mesh-mover")).expect("the scene can be read");
    let file = folder.path().join("scene.toml");
    // The initial grid has a lower quality. The former key of parameters is read with a warning.
    let more = "\n[[accuracy.dial]]\nname = \"mesh.min_quality\"\nvalues = [1e-3]\nbase = 0.9\n";
    std::fs::write(&file, base.replace("[[accuracy.parameter]]", "[[accuracy.dial]]") + more)
        .expect("written");
    let out = folder.path().join("out");
    let output = accuracy(&file, &out, &["--want", "60%"]).output().expect("it starts");
    let (words, errors) = text(&output);
    assert_eq!(output.status.code(), Some(1), "{words}{errors}");
    assert!(errors.contains("the base sample failed") && errors.contains("scaled Jacobian"), "{errors}");
    assert!(errors.contains("key `accuracy.dial` is now `accuracy.parameter`"), "{errors}");
    assert!(!words.contains("expected error") && !out.join("target-error.toml").exists(), "{words}");
    assert_eq!(std::fs::read_dir(out.join("samples")).expect("samples").count(), 1, "other samples were run");
    // A failed base is run again.
    let again = accuracy(&file, &out, &[]).output().expect("it starts");
    assert_eq!(again.status.code(), Some(1));
    assert!(text(&again).1.contains("running `base`"), "{:?}", text(&again));
}

/// A failed sample is shown with its reason; an interrupted study resumes.
#[test]
fn failed_samples_are_shown_and_interrupted_study_resumes() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = std::fs::read_to_string(short("mesh-mover")).expect("the scene can be read");
    let file = folder.path().join("scene.toml");
    // The initial grid has a lower quality.
    let more = "\n[[accuracy.parameter]]\nname = \"mesh.min_quality\"\nvalues = [0.9]\nbase = 1e-3\n";
    std::fs::write(&file, base + more).expect("written");
    let out = folder.path().join("out");
    let options = ["--jobs", "1"];
    let mut first = accuracy(&file, &out, &options)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it starts");
    let results = || {
        let samples = std::fs::read_dir(out.join("samples")).map(|d| d.flatten().collect::<Vec<_>>());
        samples.unwrap_or_default().iter().filter(|m| m.path().join("result.json").exists()).count()
    };
    let limit = Limit::new(Duration::from_secs(120));
    // Running samples, by their `resume.json`.
    let running = || {
        let samples = std::fs::read_dir(out.join("samples")).map(|d| d.flatten().collect::<Vec<_>>());
        let samples = samples.unwrap_or_default().into_iter().map(|m| m.path());
        let open = samples.filter(|m| !m.join("result.json").exists()).map(|m| m.join("run/resume.json"));
        open.filter_map(|f| Some((f.clone(), std::fs::read(f).ok()?))).collect::<Vec<_>>()
    };
    while (results() == 0 || running().is_empty()) && !limit.passed() {
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(first.id(), Signal::TERM);
    assert_eq!(first.wait().expect("it ends").code(), Some(130));
    let (before, open) = (results(), running());
    assert!(before >= 1 && open.len() == 1, "{before} {open:?}");
    let second = succeed(accuracy(&file, &out, &options));
    let (words, lines) = text(&second);
    assert!((words.clone() + &lines).contains("runs have results"), "{words}{lines}");
    // Each running sample has a line with its ETA and the number of outstanding runs.
    let running: Vec<&str> = lines.lines().filter(|l| l.contains("running `")).collect();
    assert!(running.iter().any(|l| l.contains("`window 0.5`")), "{lines}");
    assert!(running.iter().all(|l| l.matches("ETA").count() == 2 && l.contains("wall")), "{lines}");
    assert!(running.iter().any(|l| l.contains(" left, ETA")), "{lines}");
    for (file, run) in open {
        assert_eq!(std::fs::read(&file).expect("a run"), run, "{} was started again", file.display());
    }
    assert!(words.contains("failed: `mesh.min_quality 0.9`"), "{words}");
    let page = std::fs::read_to_string(out.join("accuracy.html")).expect("a page");
    assert!(page.contains("class=\"failed\""));
    let table = std::fs::read_to_string(out.join("samples.csv")).expect("a table");
    assert!(
        table.lines().any(|l| l.starts_with("mesh.min_quality 0.9,") && l.contains("scaled Jacobian")),
        "{table}"
    );
}
