//! Recordings: replay of each program, comparison, damaged files; manually started programs.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use ripstop_tests::{changed_scene, program, ripstop_run, scene, succeed};

fn ripstop(words: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command.args(words);
    command
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Records two windows of each stage of `scene`.
/// Two ranks of flow and mesh: their replies are replayed on other numbers of ranks.
const RANKS: [&str; 2] = ["--ranks", "flow=2,mesh=2"];

fn record(scene: &Path, folder: &Path, name: &str) -> PathBuf {
    let (out, recording) = (folder.join(format!("{name}-out")), folder.join(name));
    let words =
        ["--stop-after-windows", "2", "--record", recording.to_str().expect("UTF-8"), RANKS[0], RANKS[1]];
    succeed(ripstop_run(scene, &out, &words));
    recording
}

fn path(p: &Path) -> &str {
    p.to_str().expect("UTF-8")
}

/// Tests that a fault fails, each with a part of what it says.
type Sentences = &'static [(&'static str, &'static str)];

const LATE: Sentences = &[("own input", "one window late"), ("recorded reply", "one window late")];
const OPPOSITE: Sentences =
    &[("recorded reply", "is the opposite of the recorded one, where other faces agree")];
/// Role, fault of `faulty`, and what must be said of it.
const WRONG: [(&str, &str, Sentences); 11] = [
    ("structure", "late", LATE),
    (
        "structure",
        "thousand",
        &[
            ("recorded reply", "millimetres instead of metres"),
            ("response", "times as far as free fabric"),
            ("statistics", "VERTICAL_LOAD differs"),
        ],
    ),
    ("structure", "reversed", &[("response", "moves against the pressure")]),
    ("structure", "normal", &[("faces", "face 72 moves against a pressure on it")]),
    ("mesh", "late", LATE),
    (
        "mesh",
        "thousand",
        &[("recorded reply", "millimetres instead of metres"), ("response", "those on the canopy follow it")],
    ),
    ("mesh", "still", &[("response", "positions and velocities do not agree")]),
    ("flow", "late", LATE),
    ("flow", "thousand", &[("recorded reply", "kilopascals instead of pascals")]),
    (
        "flow",
        "reversed",
        &[
            ("recorded reply", "inside minus outside"),
            ("response", "air must resist"),
            ("statistics", "FORCE differs"),
        ],
    ),
    ("flow", "normal", OPPOSITE),
];

/// `ripstop conform` names what is wrong with a program that keeps the protocol, from a recording of sound programs alone.
#[test]
fn conform_names_wrong_answers() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = record(&scene("square-drop"), folder.path(), "sound");
    let mut unnamed = Vec::new();
    for (role, fault, says) in WRONG {
        let command = format!("{} {role} {fault} always 0", program("faulty").display());
        let mut words = vec!["conform", role, path(&recording), "--command", &command];
        says.iter().for_each(|(test, _)| words.extend(["--only", test]));
        let output = ripstop(&words).output().expect("it starts");
        let said = text(&output);
        for (test, sentence) in says {
            let line = said.lines().find(|l| l.contains(&format!("FAILED   {test} "))).unwrap_or_default();
            println!("{role} {fault}: {}", line.trim());
            if output.status.code() != Some(3) || !line.contains(sentence) {
                unnamed.push(format!("{role} {fault}: `{test}` does not say `{sentence}`:\n{said}"));
            }
        }
    }
    assert!(unnamed.is_empty(), "{}", unnamed.join("\n"));
    let words = ["conform", "flow", path(&recording), "--only", "answer"];
    let output = ripstop(&words).output().expect("it starts");
    assert!(
        output.status.code() == Some(2) && text(&output).contains("the tests are handshake"),
        "{}",
        text(&output)
    );
}

/// Each program of this build, replayed with the recording of its partners, reproduces its results bitwise; the flow on
/// another number of ranks within the effect of its solver tolerance on the pressure (at most 6.3e-5 relative, on 1 and 3
/// ranks). Each passes all conformance checks.
#[test]
fn each_program_reproduces_its_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = record(&scene("square-drop"), folder.path(), "a");
    for role in ["--structure", "--mesh", "--flow"] {
        let output = succeed(ripstop(&[
            "replay",
            path(&recording),
            role,
            "--tolerance",
            "0",
            "--iteration-tolerance",
            "0",
        ]));
        assert!(text(&output).contains("no deviation above 0e0"), "{}", text(&output));
        succeed(ripstop(&["conform", role.trim_start_matches('-'), path(&recording)]));
    }
    let words = ["replay", path(&recording), "--flow", "--ranks", "1", "--tolerance", "2e-4"];
    succeed(ripstop(&words));
    // The pre-inflation by name.
    let words = ["replay", path(&recording), "--structure", "--stage", "pre-inflation", "--tolerance", "0"];
    succeed(ripstop(&words));

    // A stage without the program, and a folder that is not a recording.
    for (words, says) in [
        (
            ["replay", path(&recording), "--mesh", "--stage", "pre-inflation"],
            "contains no stage `pre-inflation`",
        ),
        (["replay", path(folder.path()), "--mesh", "--stage", "descent"], "scene.toml"),
    ] {
        let output = ripstop(&words).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(says), "{}", text(&output));
    }

    // A damaged byte is detected and located by the checksum.
    let file = recording.join("descent/exchange.rec");
    let mut bytes = std::fs::read(&file).expect("a recording");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&file, &bytes).expect("it can be written");
    let output = ripstop(&["diff", path(&recording), path(&recording)]).output().expect("it starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("is damaged at byte"), "{}", text(&output));
}

/// With a fabric stiffer by 1e-6, the comparison reports the response of the structure in the first window as first
/// deviation, and a run with this baseline ends there.
#[test]
fn first_deviation_is_reported_by_channel_and_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let reference = record(&scene("square-drop"), folder.path(), "a");
    let changed = changed_scene(
        "square-drop",
        folder.path(),
        &[("thickness_m = 3.048e-5", "thickness_m = 3.04800305e-5")],
    );
    let other = record(&changed, folder.path(), "b");
    let out = folder.path().join("difference");
    let output =
        ripstop(&["diff", path(&reference), path(&other), "--out", path(&out)]).output().expect("it starts");
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    let first = "first deviation: window 0, iteration 0, displacement from the structure";
    assert!(text(&output).contains(first), "{}", text(&output));
    for file in ["descent-difference.csv", "descent-difference.svg"] {
        assert!(out.join(file).metadata().is_ok_and(|m| m.len() > 100), "{file}");
    }

    let words = ["--baseline", path(&reference), "--stop-at-deviation", "--stop-after-windows", "2"];
    let output = ripstop_run(&changed, &folder.path().join("c"), &[&words[..], &RANKS].concat())
        .output()
        .expect("it starts");
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    let says = "stage `pre-inflation`, window 0, coupling iteration 0: the run deviates from its baseline";
    assert!(text(&output).contains(says), "{}", text(&output));
    // Without that option the run is complete, and says so with the same code.
    let words = ["--baseline", path(&reference), "--stop-after-windows", "2"];
    let output = ripstop_run(&changed, &folder.path().join("e"), &[&words[..], &RANKS].concat())
        .output()
        .expect("it starts");
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    let said = text(&output);
    assert!(said.contains("deviates from its baseline") && said.contains("descent: "), "{said}");
    assert!(folder.path().join("e/descent/history.csv").is_file());
    // The unchanged scene agrees bitwise.
    let words = [
        "--baseline",
        path(&reference),
        "--tolerance",
        "0",
        "--stop-at-deviation",
        "--stop-after-windows",
        "2",
    ];
    succeed(ripstop_run(&scene("square-drop"), &folder.path().join("d"), &[&words[..], &RANKS].concat()));
}

/// The coupler prints the commands to start, waits, reports the ranks that have joined, and runs.
#[test]
fn programs_can_be_started_manually() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut attach =
        ripstop(&["attach", path(&scene("air-bag")), "--out", path(&out), "--stop-after-windows", "1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it starts");
    let mut lines = BufReader::new(attach.stderr.take().expect("a pipe")).lines().map_while(Result::ok);
    let line = lines.find(|l| l.trim_start().starts_with("env ")).expect("the command to start");
    assert!(line.contains("structure-solver --scene"), "{line}");
    let started = Command::new("sh").args(["-c", line.trim()]).output().expect("a shell");
    assert!(started.status.success(), "{}", text(&started));
    let rest: Vec<String> = lines.collect();
    assert!(attach.wait().expect("it ends").success(), "{rest:?}");
    assert!(rest.iter().any(|l| l.contains("joined: structure rank 0")), "{rest:?}");
    assert!(out.join("inflation/history.csv").is_file());
}
