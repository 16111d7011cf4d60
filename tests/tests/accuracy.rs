//! `ripstop accuracy`: short studies beside their kept errors and counts, and what it refuses.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use ripstop_tests::{program, root, succeed};

fn short(study: &str) -> PathBuf {
    root().join("studies").join(study).join("short.toml")
}

fn accuracy(scene: &Path, out: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command.arg("accuracy").arg(scene).arg("--out").arg(out).args(["--cost", "work"]).args(options);
    command
}

/// Made anew by `scripts/studies --remake`.
fn as_its_reference(study: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let reference = root().join("studies").join(study).join("short.json");
    let kept = reference.to_str().expect("a path in UTF-8");
    let output = accuracy(&short(study), folder.path(), &["--without-check", "--reference", kept])
        .output()
        .expect("it starts");
    assert!(
        output.status.success(),
        "{study} is worse or dearer than studies/{study}/short.json:\n{}{}",
        text(&output).0,
        text(&output).1
    );
    if study == "air-bag" {
        a_dearer_study_fails(&reference, folder.path());
        wishes(folder.path());
    }
}

fn text(output: &Output) -> (String, String) {
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

/// With a reference that was an eighth cheaper, or more accurate, the same study fails.
fn a_dearer_study_fails(reference: &Path, out: &Path) {
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

/// Advice from the study that was flown, and its refusals.
fn wishes(out: &Path) {
    let scene = short("air-bag");
    let advised = succeed(accuracy(&scene, out, &["--without-check", "--want", "60%", "--budget", "1h"]));
    assert!(text(&advised).0.contains("expected error"), "{:?}", text(&advised));
    for file in ["want.toml", "budget.toml"] {
        let mut check = Command::new(program("ripstop"));
        check.arg("check").arg(out.join(file));
        succeed(check);
    }
    let page = std::fs::read_to_string(out.join("accuracy.html")).expect("a page");
    assert!(page.contains("<svg") && page.ends_with("</html>\n"));
    let poor = accuracy(&scene, out, &["--without-check", "--budget", "1e-9s"]).output().expect("it starts");
    assert_eq!(poor.status.code(), Some(2));
    assert!(text(&poor).1.contains("below one run"), "{:?}", text(&poor));
}

#[test]
fn the_air_bag_is_as_accurate_and_as_cheap_as_kept() {
    as_its_reference("air-bag");
}

#[test]
fn the_flow_is_as_accurate_and_as_cheap_as_kept() {
    as_its_reference("flow");
}

#[test]
fn the_mesh_mover_is_as_accurate_and_as_cheap_as_kept() {
    as_its_reference("mesh-mover");
}

#[test]
fn the_square_drop_is_as_accurate_and_as_cheap_as_kept() {
    as_its_reference("square-drop");
}

#[test]
fn the_atps_is_as_accurate_and_as_cheap_as_kept() {
    as_its_reference("atps-descent");
}

#[test]
fn bad_studies_are_refused_before_work() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = std::fs::read_to_string(short("air-bag")).expect("the scene can be read");
    let out = folder.path().join("out");
    let refused = |section: &str| {
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, base.clone() + section).expect("written");
        let output = accuracy(&file, &out, &[]).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{section}");
        assert!(!out.exists(), "{section}: something was begun");
        text(&output).1
    };
    let dial = |name: &str| refused(&format!("\n[[accuracy.dial]]\nname = \"{name}\"\nvalues = [1.0]\n"));
    assert!(dial("coupling-tolerance").contains("no stage is coupled"));
    assert!(dial("gmres-tolerence").contains("there is no dial"));
    let quantity = refused("\n[[accuracy.quantity]]\nname = \"x\"\nof = \"weight\"\n");
    assert!(quantity.contains("weight"), "{quantity}");
    let drag = refused("\n[[accuracy.quantity]]\nname = \"x\"\nof = \"drag\"\n");
    assert!(drag.contains("flow-solver"), "{drag}");
    let plan = succeed(accuracy(&short("square-drop"), &out, &["--dry-run"]));
    assert!(text(&plan).0.contains("to fly: about") && !out.exists());
}

/// A member that fails is shown with its reason; a study that is interrupted goes on.
#[test]
fn gaps_are_shown_and_an_interrupted_study_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = std::fs::read_to_string(short("mesh-mover")).expect("the scene can be read");
    let file = folder.path().join("scene.toml");
    // The start grid is not that good.
    let more = "\n[[accuracy.dial]]\nname = \"mesh.min_quality\"\nvalues = [0.9]\nbase = 1e-3\n";
    std::fs::write(&file, base + more).expect("written");
    let out = folder.path().join("out");
    let options = ["--jobs", "1"];
    let mut first = accuracy(&file, &out, &options)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it starts");
    let results = || {
        let members = std::fs::read_dir(out.join("members")).map(|d| d.flatten().collect::<Vec<_>>());
        members.unwrap_or_default().iter().filter(|m| m.path().join("result.json").exists()).count()
    };
    let start = Instant::now();
    // Members that are under way: their runs, by what names them for `--resume`.
    let under_way = || {
        let members = std::fs::read_dir(out.join("members")).map(|d| d.flatten().collect::<Vec<_>>());
        let members = members.unwrap_or_default().into_iter().map(|m| m.path());
        let open = members.filter(|m| !m.join("result.json").exists()).map(|m| m.join("run/resume.json"));
        open.filter_map(|f| Some((f.clone(), std::fs::read(f).ok()?))).collect::<Vec<_>>()
    };
    while (results() == 0 || under_way().is_empty()) && start.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(5));
    }
    // SAFETY: a signal to a child that has not been waited for.
    unsafe { libc::kill(first.id() as i32, libc::SIGTERM) };
    assert_eq!(first.wait().expect("it ends").code(), Some(130));
    let (before, open) = (results(), under_way());
    assert!(before >= 1 && open.len() == 1, "{before} {open:?}");
    let second = succeed(accuracy(&file, &out, &options));
    let (words, told) = text(&second);
    assert!((words.clone() + &told).contains("runs are there already"), "{words}{told}");
    for (file, run) in open {
        assert_eq!(std::fs::read(&file).expect("a run"), run, "{} was begun anew", file.display());
    }
    assert!(words.contains("gap: `mesh.min_quality 0.9`"), "{words}");
    let page = std::fs::read_to_string(out.join("accuracy.html")).expect("a page");
    assert!(page.contains("class=\"gap\""));
    let table = std::fs::read_to_string(out.join("members.csv")).expect("a table");
    assert!(
        table.lines().any(|l| l.starts_with("mesh.min_quality 0.9,") && l.contains("scaled Jacobian")),
        "{table}"
    );
}
