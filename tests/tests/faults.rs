//! After the failure of one program, all processes end within 5 s, report the reason and leave no files.

use std::io::Read;
use std::path::Path;
use std::process::Child;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ripstop_tests::load::Limit;
use ripstop_tests::{
    History, Signal, changed_scene, processes_naming, ripstop_run, session_memory, signal, start,
};

/// Serialises the tests, because they inspect the shared memory of the machine.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Time within which all processes end.
const GONE: Duration = Duration::from_secs(5);
/// Ranks of the runs: programs of two ranks, which one fault must end all.
const RANKS: [&str; 2] = ["--ranks", "flow=2,mesh=2"];
/// Polling interval.
const PAUSE: Duration = Duration::from_millis(50);

/// A descent of several minutes, for fault injection.
fn long_run(folder: &Path) -> (Child, std::path::PathBuf) {
    let scene = changed_scene("square-drop", folder, &[("duration_s = 0.1\n", "duration_s = 50.0\n")]);
    let out = folder.join("out");
    (start(ripstop_run(&scene, &out, &RANKS)), out)
}

fn wait_for_windows(out: &Path, windows: usize) {
    let file = out.join("descent/history.csv");
    let reached = || std::fs::read_to_string(&file).is_ok_and(|t| t.lines().count() > windows);
    Limit::new(Duration::from_secs(240)).until(PAUSE, reached).expect("the run reaches the descent");
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

/// Waits at most `limit` for the end of the run. Returns its exit code and message.
fn end_of(mut run: Child, limit: &Limit) -> (Option<i32>, String) {
    let mut status = None;
    let ended = limit.until(Duration::from_millis(20), || {
        status = run.try_wait().expect("the run can be waited for");
        status.is_some()
    });
    if let Err(late) = ended {
        let _ = run.kill();
        panic!("the run was still there: {late}");
    }
    let mut text = String::new();
    run.stderr.take().expect("captured").read_to_string(&mut text).expect("text");
    (status.expect("it ended").code(), text)
}

/// Asserts that no files or processes of the run remain; `coupler` is its process.
fn nothing_left(out: &Path, coupler: u32) {
    let left = processes_naming(&out.display().to_string());
    assert!(left.is_empty(), "processes left: {left:?}");
    // Other runs may be active: only files of this run are checked.
    let files: Vec<_> = (0..3).flat_map(|stage| session_memory("square-drop", coupler, stage)).collect();
    assert!(files.is_empty(), "shared memory left: {files:?}");
}

#[test]
fn killed_program_ends_the_run_and_is_named() {
    let _alone = alone();
    for (program, rank) in [("structure-solver", 0), ("flow-solver", 1), ("mesh-mover", 0)] {
        let folder = tempfile::tempdir().expect("a folder");
        let (run, out) = long_run(folder.path());
        let coupler = run.id();
        wait_for_windows(&out, 2);
        let ranks = ranks_of(program, &out);
        assert!(ranks.len() > rank, "{program}: {ranks:?}");
        let limit = Limit::new(GONE);
        signal(ranks[rank], Signal::KILL);
        let (code, text) = end_of(run, &limit);
        assert_eq!(code, Some(1), "{program}: {text}");
        assert!(text.contains(program), "{program} is not named: {text}");
        // Whichever rank died.
        assert!(text.contains("signal 9 SIGKILL"), "{program}, rank {rank}: the signal is not named: {text}");
        nothing_left(&out, coupler);
        // Results are kept.
        assert!(History::read(&out, "descent").len() >= 2);
    }
}

#[test]
fn interrupt_ends_all_processes() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let (run, out) = long_run(folder.path());
    let coupler = run.id();
    wait_for_windows(&out, 1);
    let limit = Limit::new(GONE);
    signal(run.id(), Signal::INT);
    let (code, text) = end_of(run, &limit);
    assert_eq!(code, Some(130), "{text}");
    nothing_left(&out, coupler);
}

#[test]
fn killed_coupler_ends_its_programs_and_the_next_run_succeeds() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let (mut run, out) = long_run(folder.path());
    wait_for_windows(&out, 1);
    signal(run.id(), Signal::KILL);
    let _ = run.wait();
    let mark = out.display().to_string();
    let gone = Limit::new(GONE).until(PAUSE, || processes_naming(&mark).is_empty());
    assert!(gone.is_ok(), "left: {:?}: {gone:?}", processes_naming(&mark));
    let scene = changed_scene("square-drop", folder.path(), &[("duration_s = 0.1\n", "duration_s = 0.01\n")]);
    ripstop_tests::succeed(ripstop_run(&scene, &folder.path().join("again"), &RANKS));
}

#[test]
fn waiting_ranks_use_no_processor_time() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let (run, out) = long_run(folder.path());
    wait_for_windows(&out, 2);
    // With the structure stopped, all other programs wait for it.
    let stopped = ranks_of("structure-solver", &out);
    stopped.iter().for_each(|&pid| signal(pid, Signal::STOP));
    let waiting: Vec<u32> = [ranks_of("flow-solver", &out), ranks_of("mesh-mover", &out)].concat();
    assert_eq!(waiting.len(), 4, "two ranks each");
    // 50 wake-ups per second to check the coupler use some milliseconds.
    ripstop_tests::load::asleep(&waiting, 0.02, Duration::from_secs(30));
    stopped.iter().for_each(|&pid| signal(pid, Signal::CONT));
    signal(run.id(), Signal::INT);
    end_of(run, &Limit::new(Duration::from_secs(30)));
}
