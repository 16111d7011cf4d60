//! The text of `ripstop watch` on folders with fixed files.

use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::page::page;
use super::view::Watched;
use super::{WatchArgs, watch};

const SCENE: &str = include_str!("../../../cases/square-drop/scene.toml");
const COMPLETE: &str = r#"{"ended": "complete", "exit_code": 0, "wall_s": 17.5}"#;

/// A folder with a summary and `rows` windows of the descent.
fn folder(summary: &str, rows: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("scene.toml"), SCENE).expect("written");
    std::fs::write(at("summary.json"), summary).expect("written");
    let log = "2026-01-31 23:59:58 info    stage `descent`\n2026-01-31 23:59:59 warning it jumps\n";
    std::fs::write(at("ripstop.log"), log).expect("written");
    std::fs::create_dir(at("descent")).expect("created");
    std::fs::write(at("descent/history.csv"), history(rows)).expect("written");
    folder
}

fn history(rows: u32) -> String {
    let mut text = String::from(
        "window,time_s,descent_speed_m_s,drag_n,coupling_iterations,coupling_residual,coupling_converged,window_s\n",
    );
    for i in 0..rows {
        let t = 5e-3 * f64::from(i + 1);
        let (speed, drag) = (4.0 + 0.1 * (60.0 * t).sin(), 55.0 - 20.0 * (60.0 * t).cos());
        writeln!(text, "{i},{t},{speed},{drag},3,1.25e-3,1,5e-3").expect("text");
    }
    text
}

fn text(run: &Path, columns: &[&str]) -> String {
    let mut watched = Watched::open(run).expect("a run");
    watched.update().expect("read");
    let columns: Vec<String> = columns.iter().map(|c| (*c).to_owned()).collect();
    page(&watched.view(), &columns, 80, None).expect("a page")
}

fn once(run: &Path, columns: &[&str]) -> Result<(), coupling::error::RunError> {
    let columns = columns.iter().map(|c| (*c).to_owned()).collect();
    watch(&WatchArgs { run: run.into(), once: true, columns, interval: 1.0 }, &AtomicBool::new(false))
}

#[test]
fn complete_run_has_exactly_this_text() {
    let run = folder(COMPLETE, 20);
    let text = text(run.path(), &[]);
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        std::fs::write(
            concat!(env!("CARGO_MANIFEST_DIR"), "/src/watch_command/complete.txt"),
            format!("{text}\n"),
        )
        .expect("written");
    }
    assert_eq!(text.trim_end(), include_str!("complete.txt").trim_end());
    assert!(text.lines().all(|line| line.chars().count() <= 80));
    assert!(once(run.path(), &[]).is_ok());
}

/// The last line is in the middle of being written.
#[test]
fn half_a_row_is_left_out() {
    let run = folder(COMPLETE, 12);
    let whole = text(run.path(), &["drag_n"]);
    let half = history(12) + "12,0.065,4.1";
    std::fs::write(run.path().join("descent/history.csv"), half).expect("written");
    assert_eq!(text(run.path(), &["drag_n"]), whole);
    assert!(whole.contains("window 12/20 | t 0.0600/0.1000 s"), "{whole}");
}

#[test]
fn state_and_exit_code_are_those_of_the_run() {
    for (summary, words, code) in [
        (r#"{"ended": "running"}"#, ["square-drop: killed |", "without writing a summary"], 1),
        (r#"{"ended": "the grid fails", "exit_code": 1}"#, ["square-drop: failed |", "the grid fails"], 1),
        (
            r#"{"ended": "interrupted in stage `descent`"}"#,
            ["square-drop: interrupted |", "interrupted in stage"],
            130,
        ),
    ] {
        let run = folder(summary, 3);
        let text = text(run.path(), &[]);
        assert!(words.iter().all(|word| text.contains(word)), "{summary}: {text}");
        assert_eq!(once(run.path(), &[]).expect_err("it ended early").exit_code(), code, "{summary}");
    }
    // A process that holds the lock is running, before and after its first window.
    let run = folder(r#"{"ended": "running"}"#, 0);
    let _lock = results::lock::lock(run.path()).expect("the lock");
    assert!(text(run.path(), &[]).contains("square-drop: running | stage 3 of 3: descent\nstarting"));
    assert!(once(run.path(), &[]).is_ok());
}

#[test]
fn unknown_columns_and_folders_without_a_run_are_refused() {
    let run = folder(COMPLETE, 3);
    let error = once(run.path(), &["drag"]).expect_err("unknown");
    assert!(
        error.exit_code() == 2 && error.to_string().contains("no history has a column `drag`"),
        "{error}"
    );
    // A column of other stages is left out, so that the run can be followed through them.
    assert!(!text(run.path(), &["projected_area_m2"]).contains("projected_area_m2"));
    assert_eq!(once(&run.path().join("nowhere"), &[]).expect_err("no run").exit_code(), 2);
}

#[test]
fn width_follows_the_terminal() {
    let run = folder(COMPLETE, 20);
    let mut watched = Watched::open(run.path()).expect("a run");
    watched.update().expect("read");
    for (columns, lines) in [(40, 10), (100, 50), (500, 24), (10, 5), (80, 14)] {
        let text = page(&watched.view(), &[], columns, Some(lines)).expect("a page");
        // The cursor is below the text. State and progress have five lines.
        assert!(text.lines().count() < lines.max(6), "{lines}: {text}");
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap_or(0);
        assert!(widest <= columns.clamp(40, 160), "{columns}: {widest}");
    }
}
