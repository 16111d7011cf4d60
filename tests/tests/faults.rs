//! When one program dies, everything ends within 5 s, says why, and leaves nothing behind.

use std::io::Read;
use std::path::Path;
use std::process::Child;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ripstop_tests::{History, changed_scene, processes_naming, ripstop_run, shared_memory, start};

/// These tests look at the machine's shared memory: one at a time.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A descent that would take minutes, so that there is time to break it.
fn long_run(folder: &Path) -> (Child, std::path::PathBuf) {
    let scene = changed_scene("square-drop", folder, &[("duration_s = 0.1\n", "duration_s = 50.0\n")]);
    let out = folder.join("out");
    (start(ripstop_run(&scene, &out, &[])), out)
}

fn wait_for_windows(out: &Path, windows: usize) {
    let begin = Instant::now();
    loop {
        let file = out.join("descent/history.csv");
        if file.exists() && std::fs::read_to_string(&file).is_ok_and(|t| t.lines().count() > windows) {
            return;
        }
        assert!(begin.elapsed() < Duration::from_secs(240), "the run did not reach the descent");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Ranks (not their `mpirun`) of a program of this run.
fn ranks_of(program: &str, out: &Path) -> Vec<u32> {
    let mark = out.display().to_string();
    let found = processes_naming(&mark).into_iter().filter(|(_, line)| {
        let first = line.split(' ').next().unwrap_or("");
        first.ends_with(program)
    });
    found.map(|(pid, _)| pid).collect()
}

fn signal(pid: u32, signal: i32) {
    // SAFETY: sends a signal to a process of this test; no memory is involved.
    unsafe { libc::kill(pid as i32, signal) };
}

/// Waits for the end of the run and returns its message and how long it took.
fn end_of(mut run: Child, since: Instant) -> (Option<i32>, String, Duration) {
    let limit = Duration::from_secs(30);
    let status = loop {
        if let Some(status) = run.try_wait().expect("the run can be waited for") {
            break status;
        }
        if since.elapsed() > limit {
            let _ = run.kill();
            panic!("the run was still there after {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let took = since.elapsed();
    let mut text = String::new();
    run.stderr.take().expect("captured").read_to_string(&mut text).expect("text");
    (status.code(), text, took)
}

fn nothing_left(out: &Path, before: &[String]) {
    let left = processes_naming(&out.display().to_string());
    assert!(left.is_empty(), "processes left: {left:?}");
    let files: Vec<_> = shared_memory().into_iter().filter(|f| !before.contains(f)).collect();
    assert!(files.is_empty(), "shared memory left: {files:?}");
}

#[test]
fn each_program_killed_ends_the_run_and_is_named() {
    let _alone = alone();
    for (program, rank) in [("structure-solver", 0), ("flow-solver", 1), ("mesh-mover", 0)] {
        let folder = tempfile::tempdir().expect("a folder");
        let before = shared_memory();
        let (run, out) = long_run(folder.path());
        wait_for_windows(&out, 2);
        let ranks = ranks_of(program, &out);
        assert!(ranks.len() > rank, "{program}: {ranks:?}");
        let since = Instant::now();
        signal(ranks[rank], libc::SIGKILL);
        let (code, text, took) = end_of(run, since);
        assert_eq!(code, Some(1), "{program}: {text}");
        assert!(text.contains(program), "{program} is not named: {text}");
        assert!(took < Duration::from_secs(5), "{program}: took {took:?}");
        nothing_left(&out, &before);
        // What was computed is still there.
        assert!(History::read(&out, "descent").len() >= 2);
    }
}

#[test]
fn an_interrupt_ends_everything() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let before = shared_memory();
    let (run, out) = long_run(folder.path());
    wait_for_windows(&out, 1);
    let since = Instant::now();
    signal(run.id(), libc::SIGINT);
    let (code, text, took) = end_of(run, since);
    assert_eq!(code, Some(130), "{text}");
    assert!(took < Duration::from_secs(5), "took {took:?}");
    nothing_left(&out, &before);
}

#[test]
fn a_killed_coupler_takes_its_programs_along_and_the_next_run_works() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let (mut run, out) = long_run(folder.path());
    wait_for_windows(&out, 1);
    signal(run.id(), libc::SIGKILL);
    let _ = run.wait();
    let since = Instant::now();
    let mark = out.display().to_string();
    while !processes_naming(&mark).is_empty() {
        assert!(since.elapsed() < Duration::from_secs(5), "left: {:?}", processes_naming(&mark));
        std::thread::sleep(Duration::from_millis(50));
    }
    let scene = changed_scene("square-drop", folder.path(), &[("duration_s = 0.1\n", "duration_s = 0.01\n")]);
    ripstop_tests::succeed(ripstop_run(&scene, &folder.path().join("again"), &[]));
}

/// Processor seconds that a process has used.
fn cpu_seconds(pid: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("the process lives");
    let fields: Vec<&str> = text.rsplit(')').next().expect("fields").split_whitespace().collect();
    let ticks: f64 = fields[11].parse::<f64>().expect("utime") + fields[12].parse::<f64>().expect("stime");
    ticks / 100.0
}

#[test]
fn a_waiting_program_sleeps_on_all_its_ranks() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let (run, out) = long_run(folder.path());
    wait_for_windows(&out, 2);
    // With the structure stopped, everyone else soon waits for it.
    let stopped = ranks_of("structure-solver", &out);
    stopped.iter().for_each(|&pid| signal(pid, libc::SIGSTOP));
    std::thread::sleep(Duration::from_secs(2));
    let waiting: Vec<u32> = [ranks_of("flow-solver", &out), ranks_of("mesh-mover", &out)].concat();
    assert_eq!(waiting.len(), 4, "two ranks each");
    let before: Vec<f64> = waiting.iter().map(|&p| cpu_seconds(p)).collect();
    std::thread::sleep(Duration::from_secs(2));
    for (&pid, before) in waiting.iter().zip(before) {
        let used = cpu_seconds(pid) - before;
        // 50 wake-ups a second for a look at the coupler take some milliseconds.
        assert!(used <= 0.04, "process {pid} used {used} s of 2 s while waiting");
    }
    stopped.iter().for_each(|&pid| signal(pid, libc::SIGCONT));
    let since = Instant::now();
    signal(run.id(), libc::SIGINT);
    end_of(run, since);
}
