//! `ripstop sweep`: each combination runs once, the table holds all of them, and bad values stop it before it starts.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use ripstop_tests::tiny::SMALLER;
use ripstop_tests::{changed_scene, program, succeed};

fn sweep(scene: &Path, out: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command
        .arg("sweep")
        .arg(scene)
        .arg("--out")
        .arg(out)
        .args(["--set", "ranks={structure=1,flow=1,mesh=1}"]);
    command.args(options);
    command
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Names of columns and rows of the table.
fn table(out: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let text = fs::read_to_string(out.join("sweep.csv")).expect("a table");
    let cells = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    let mut lines = text.lines().map(cells);
    (lines.next().expect("a header"), lines.collect())
}

#[test]
fn combinations_run_once_and_are_collected() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), &SMALLER);
    let out = folder.path().join("sweep");
    let vary = ["--vary", "descent.payload_mass_kg=4..6:2"];
    let output = succeed(sweep(&scene, &out, &vary));
    assert!(text(&output).contains("2 runs in") && text(&output).contains("0 complete"), "{}", text(&output));
    let (names, rows) = table(&out);
    assert_eq!(names[..3], ["run", "descent.payload_mass_kg", "ended"]);
    assert_eq!(rows.iter().map(|r| r[1].as_str()).collect::<Vec<_>>(), ["4", "6"]);
    assert!(rows.iter().all(|r| r[2] == "complete"), "{rows:?}");
    // The heavier payload is decelerated less: its mean speed is larger.
    let at = names.iter().position(|n| n == "descent_speed_m_s").expect("a column");
    let speed = |row: &Vec<String>| row[at].parse::<f64>().expect("a number");
    assert!(speed(&rows[1]) > speed(&rows[0]), "{rows:?}");
    assert!(fs::read_to_string(out.join("sweep.html")).expect("a page").contains("descent.payload_mass_kg"));

    // Complete runs are kept, with another value one run is added, and a share of the runs leaves out the rest.
    let before =
        fs::metadata(out.join("payload_mass_kg=4/summary.json")).expect("a run").modified().expect("a time");
    let more = ["--vary", "descent.payload_mass_kg=4,6,5,3"];
    let output = succeed(sweep(&scene, &out, &[&more[..], &["--part", "1/2", "--jobs", "1"]].concat()));
    assert!(text(&output).contains("2 runs in") && text(&output).contains("1 complete"), "{}", text(&output));
    let after =
        fs::metadata(out.join("payload_mass_kg=4/summary.json")).expect("a run").modified().expect("a time");
    assert_eq!(before, after);
    succeed(sweep(&scene, &out, &[&more[..], &["--table"]].concat()));
    let (names, rows) = table(&out);
    let ended: Vec<&str> = rows.iter().map(|r| r[2].as_str()).collect();
    assert_eq!(ended, ["complete", "complete", "complete", "not run"]);
    // 20 ms are no developed wake.
    let wake = names.iter().position(|n| n == "wake").expect("a column");
    assert_eq!(rows[0][wake], "wake.periods");

    // With other settings the same folders are runs of another scene: they are neither shown nor taken for results.
    let other = [&more[..], &["--set", "fabric.poisson_ratio=0.2", "--table"]].concat();
    succeed(sweep(&scene, &out, &other));
    let (_, rows) = table(&out);
    assert!(rows[..3].iter().all(|r| r.iter().any(|c| c.contains("a run of another scene"))), "{rows:?}");
    let speeds = fs::read_to_string(out.join("sweep.csv")).expect("a table");
    assert!(!speeds.contains("descent_speed_m_s"), "{speeds}");
}

#[test]
fn bad_values_are_refused_before_anything_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), &SMALLER);
    let out = folder.path().join("sweep");
    for (vary, words) in [
        ("fabric.poisson_ratio=0.3,0.9", "fabric.poisson_ratio"),
        ("fabric.poison_ratio=0.3", "poison_ratio"),
        ("fabric.poisson_ratio=0.3,0.3", "same values"),
        ("fabric.poisson_ratio", "KEY=V1,V2"),
    ] {
        let output = sweep(&scene, &out, &["--vary", vary]).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{vary}: {}", text(&output));
        assert!(text(&output).contains(words), "{vary}: {}", text(&output));
        assert!(!out.exists(), "{vary}");
    }
    let plan =
        ["--vary", "fabric.poisson_ratio=0.2,0.3", "--vary", "descent.payload_mass_kg=4,5", "--dry-run"];
    let output = succeed(sweep(&scene, &out, &plan));
    let listed = String::from_utf8_lossy(&output.stdout).lines().count();
    assert!(listed == 4 && !out.exists(), "{}", text(&output));
}
