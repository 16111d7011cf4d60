//! The fault matrix: each program, on its first and its middle rank, and the coupler, come to
//! harm in each way at each moment. See docs/faults.md, which `scripts/fault-matrix` writes.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Mutex;
use std::time::{Duration, Instant, SystemTime};

use ripstop_tests::tiny::{Base, RANKS, WINDOWS, contents};
use ripstop_tests::{History, processes_naming, program, ripstop_run, succeed};

/// Everybody else is gone after this time (a stall: after the deadline and this time).
const GONE: Duration = Duration::from_secs(5);
/// Deadline of the runs in which something stalls.
const DEADLINE: Duration = Duration::from_secs(8);
/// For what takes as long as it takes: starting, working.
const PATIENCE: Duration = Duration::from_secs(180);

const MOMENTS: [&str; 6] = ["start", "handshake", "window", "iteration", "save", "end"];
const FAULTS: [&str; 10] =
    ["kill", "stop", "term", "exit0", "exit1", "panic", "stall", "nan", "late", "twice"];

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Cell {
    /// `None`: the coupler.
    victim: Option<(&'static str, usize)>,
    fault: &'static str,
    moment: &'static str,
}

impl Cell {
    fn stalls(&self) -> bool {
        matches!(self.fault, "stop" | "stall")
    }

    /// A fault that a run survives, with the same results.
    fn harmless(&self) -> bool {
        matches!(self.fault, "late" | "twice") || (self.victim.is_some() && self.moment == "end")
    }
}

fn cells() -> Vec<Cell> {
    let mut all = Vec::new();
    for role in ["structure", "mesh", "flow"] {
        for rank in [0, 1] {
            for fault in FAULTS {
                let possible = |moment: &&str| match fault {
                    "nan" => matches!(*moment, "window" | "iteration" | "save"),
                    "twice" => *moment == "handshake",
                    _ => true,
                };
                let moments = MOMENTS.into_iter().filter(possible);
                all.extend(moments.map(|moment| Cell { victim: Some((role, rank)), fault, moment }));
            }
        }
    }
    for fault in ["kill", "stop", "term"] {
        all.extend(MOMENTS.into_iter().map(|moment| Cell { victim: None, fault, moment }));
    }
    all
}

fn signal(pid: u32, signal: i32) {
    // SAFETY: sends a signal to a process of this test; no memory is involved.
    unsafe { libc::kill(pid as i32, signal) };
}

/// Waits for a condition; how long it took since `start`.
fn until(
    what: &str,
    start: Instant,
    limit: Duration,
    mut done: impl FnMut() -> bool,
) -> Result<Duration, String> {
    while !done() {
        if start.elapsed() > limit {
            return Err(format!("{what}: not within {limit:?}"));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(start.elapsed())
}

macro_rules! demand {
    ($condition:expr, $($words:tt)+) => {
        if !$condition {
            return Err(format!($($words)+));
        }
    };
}

/// Flies the last stage with harm; the time from the harm until all are gone.
fn try_cell(base: &Base, cell: &Cell, thorough: fn(&Cell) -> bool) -> Result<Duration, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, temporary) = (folder.path().join("out"), folder.path().join("tmp"));
    let (note, errors) = (folder.path().join("note"), folder.path().join("errors"));
    fs::create_dir_all(&temporary).expect("a folder");
    base.copy(&out);
    let before = contents(&out);
    // The coupler comes to harm while a rank takes its time at the moment.
    let (role, rank) = cell.victim.unwrap_or(("flow", 1));
    let fault = if cell.victim.is_some() { cell.fault } else { "late" };
    let faulty = format!("{} {role} {fault} {} {rank}", program("faulty").display(), cell.moment);
    let deadline = if cell.stalls() { DEADLINE } else { PATIENCE };
    let option = format!("--{role}");
    let seconds = deadline.as_secs().to_string();
    let options = [
        ["--stage", "descent"],
        ["--ranks", RANKS],
        ["--checkpoint-every", "1"],
        ["--deadline", &seconds],
        [&option, &faulty],
    ];
    let file = fs::File::create(&errors).expect("a file");
    let mut run = ripstop_run(&base.scene, &out, &options.concat())
        .env("FAULTY_NOTE", &note)
        .env("TMPDIR", &temporary)
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .expect("it starts");
    let session = format!("square-drop-{}-2", run.id());
    let mark = out.display().to_string();
    let text = || fs::read_to_string(&errors).expect("text");

    let began = Instant::now();
    let came = until("the moment did not come", began, PATIENCE, || {
        note.exists() || run.try_wait().is_ok_and(|s| s.is_some())
    });
    if let Err(late) = came {
        let left = format!("{:?}", processes_naming(&mark));
        let rows = fs::read_to_string(out.join("descent/history.csv")).map_or(0, |t| t.lines().count());
        signal(run.id(), libc::SIGKILL);
        let _ = run.wait();
        return Err(format!("{late}: {rows} lines of history, {left}\n{}", text()));
    }
    demand!(note.exists(), "it ended before its moment: {}", text());
    if cell.victim.is_none() {
        signal(
            run.id(),
            match cell.fault {
                "kill" => libc::SIGKILL,
                "stop" => libc::SIGSTOP,
                _ => libc::SIGTERM,
            },
        );
    }
    let written = fs::metadata(&note).and_then(|m| m.modified()).expect("a time");
    let since = Instant::now() - SystemTime::now().duration_since(written).unwrap_or_default();
    let mut took = Duration::ZERO;
    if cell.victim.is_none() && cell.fault == "stop" {
        // Its programs do not wait for ever; the coupler says what happened when it goes on.
        let others = || processes_naming(&mark).iter().any(|(pid, _)| *pid != run.id() && alive(*pid));
        took = until("programs of a stopped coupler", since, deadline + GONE, || !others())?;
        signal(run.id(), libc::SIGCONT);
    }
    let limit = if cell.harmless() { PATIENCE } else { deadline.min(DEADLINE) + 3 * GONE };
    let mut status = None;
    let ended = until("the run goes on", since, limit.max(took + GONE), || {
        status = run.try_wait().expect("it can be waited for");
        status.is_some()
    });
    if let Err(late) = ended {
        let left = format!("{:?}", processes_naming(&mark));
        signal(run.id(), libc::SIGKILL);
        let _ = run.wait();
        return Err(format!("{late} {left}\n{}", text()));
    }
    let gone = until("processes are left", since, limit, || processes_naming(&mark).is_empty())
        .map_err(|e| format!("{e}: {:?}", processes_naming(&mark)))?;
    if took.is_zero() {
        took = gone;
    }
    let (status, text) = (status.expect("it ended"), text());
    let rows = fs::read_to_string(out.join("descent/history.csv")).map_or(0, |t| t.lines().count());

    // The coupler, killed, can tidy nothing: the next run does (tested below).
    let tidied = cell.victim.is_some() || cell.fault != "kill";
    let mut left: Vec<PathBuf> = channel::session_files(&session).map_err(|e| e.to_string())?;
    left.extend(Some(Path::new("/dev/shm").join(format!("ripstop-mpi-{session}"))).filter(|p| p.exists()));
    left.extend(contents(&temporary).into_keys());
    demand!(!tidied || left.is_empty(), "files left: {left:?}\n{text}");
    let panicked = text.lines().filter(|l| l.contains("panicked at") && !l.contains("faulty.rs")).count();
    demand!(panicked == 0, "another one panicked: {text}");

    // What was accepted before is the same to the last digit: nothing stale was consumed.
    if rows > 1 {
        let (here, there) = (History::read(&out, "descent"), History::read(&base.out(), "descent"));
        let (here, there) = (here.without_wall_times(), there.without_wall_times());
        demand!(there.starts_with(&here), "other numbers than without harm");
    }
    // The states that it started from are whole, and nothing half-saved took their place.
    let after = contents(&out);
    demand!(before.iter().all(|(name, bytes)| after.get(name) == Some(bytes)), "states were changed");
    if !cell.harmless() && thorough(cell) {
        goes_on(base, &out, [&option, &faulty])?;
    }

    if cell.harmless() {
        demand!(status.code() == Some(0), "ended with {status}: {text}");
        demand!(rows == WINDOWS + 1, "{} windows of {WINDOWS}", rows.saturating_sub(1));
        if cell.moment == "end" && !matches!(cell.fault, "late" | "twice") {
            demand!(
                text.contains("did not end well after its work") && text.contains(role),
                "no word of it: {text}"
            );
            let limit = if cell.stalls() { DEADLINE + GONE } else { GONE };
            demand!(took <= limit, "took {took:?}: {text}");
        }
        return Ok(took);
    }
    let limit = if cell.stalls() { DEADLINE + GONE } else { GONE };
    demand!(took <= limit, "took {took:?}: {text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error")).collect();
    let wanted = match (cell.victim, cell.fault) {
        (None, "kill") => None,
        (None, "term") => Some(130),
        _ => Some(1),
    };
    // The coupler's last work was done: it may have ended well.
    let over = cell.victim.is_none() && cell.moment == "end";
    demand!(status.code() == wanted || (over && status.code() == Some(0)), "ended with {status}: {text}");
    if over || (cell.victim.is_none() && cell.fault != "term") {
        return Ok(took);
    }
    demand!(errors.len() == 1, "{} messages: {text}", errors.len());
    demand!(errors[0].contains("stage `descent`"), "it does not say where: {}", errors[0]);
    if matches!(cell.moment, "window" | "iteration") {
        demand!(errors[0].contains("window 2"), "it does not say in which window: {}", errors[0]);
    }
    if cell.victim.is_some() {
        demand!(errors[0].contains(role), "{role} is not named: {}", errors[0]);
        // A rank that never began is like those that wait for it in MPI_Init.
        let unknown = cell.stalls() && matches!(cell.moment, "start" | "handshake");
        demand!(unknown || errors[0].contains(&format!("rank {rank}")), "the wrong rank: {text}");
    }
    Ok(took)
}

/// The last saved state is usable: gone on with, the run comes to its end.
fn goes_on(base: &Base, out: &Path, program: [&str; 2]) -> Result<(), String> {
    // Before the first save there is nothing to go on with.
    if !out.join("descent/state").exists() {
        return Ok(());
    }
    let options = ["--resume", "--ranks", RANKS, "--quiet", program[0], program[1]];
    // The same program, as a run must have that is gone on with, now without harm.
    let mut run = ripstop_run(&base.scene, out, &options);
    let output = run.env("FAULTY_OFF", "1").output().expect("it starts");
    let text = String::from_utf8_lossy(&output.stderr);
    demand!(output.status.success(), "it cannot be gone on with: {text}");
    let (here, there) = (History::read(out, "descent"), History::read(&base.out(), "descent"));
    demand!(here.len() == WINDOWS && there.len() == WINDOWS, "{} windows after it went on", here.len());
    let same = here.without_wall_times() == there.without_wall_times();
    demand!(same, "gone on with, its windows are others");
    Ok(())
}

/// Whether a process is more than an entry in the table.
fn alive(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|t| !t.contains(") Z "))
}

/// Tries `cells`, `at_once` of them side by side; times in their order.
fn try_all(cells: &[Cell], at_once: usize, thorough: fn(&Cell) -> bool) -> Vec<(Cell, Duration)> {
    let base = Base::new();
    let next = Mutex::new(cells.iter());
    let (good, bad) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..at_once {
            scope.spawn(|| {
                loop {
                    let Some(cell) = next.lock().expect("no panic").next() else { return };
                    match try_cell(&base, cell, thorough) {
                        Ok(took) => {
                            println!("{cell:?}: {:.1} s", took.as_secs_f64());
                            record(cell, took);
                            good.lock().expect("no panic").push((cell.clone(), took));
                        }
                        Err(why) => {
                            println!("{cell:?}: {why}");
                            bad.lock().expect("no panic").push(format!("{cell:?}: {why}"));
                        }
                    }
                }
            });
        }
    });
    // Whatever was left by couplers that were killed does not hinder the next run, which removes it.
    let again = base.folder.path().join("again");
    base.copy(&again);
    let options = ["--stage", "descent", "--ranks", RANKS, "--quiet"];
    succeed(ripstop_run(&base.scene, &again, &options));
    let (here, there) = (History::read(&again, "descent"), History::read(&base.out(), "descent"));
    assert_eq!(here.without_wall_times(), there.without_wall_times());
    let bad = bad.into_inner().expect("no panic");
    assert!(bad.is_empty(), "{} of {} cells:\n{}", bad.len(), cells.len(), bad.join("\n"));
    let mut good = good.into_inner().expect("no panic");
    good.sort();
    good
}

/// One cell of each fault and of each moment, on programs and ranks in turn.
#[test]
fn a_part_of_the_fault_matrix() {
    let all = cells();
    let victims = [("structure", 1), ("mesh", 0), ("flow", 1), ("structure", 0), ("mesh", 1), ("flow", 0)];
    let mut chosen = Vec::new();
    for (i, fault) in FAULTS.into_iter().enumerate() {
        for k in 0..2 {
            let wanted =
                all.iter().filter(|c| c.fault == fault && c.victim == Some(victims[(i + 3 * k) % 6]));
            let wanted: Vec<_> = wanted.collect();
            chosen.push(wanted[(i + 2 + 3 * k) % wanted.len()].clone());
        }
    }
    chosen.extend(all.into_iter().filter(|c| c.victim.is_none() && c.moment == "window"));
    // A run more for each would take twice the time.
    try_all(&chosen, 3, |cell| cell.moment == "save" || cell.fault == "kill");
}

/// Notes a cell that is as documented in the file `FAULT_MATRIX_CELLS`, of which `scripts/fault-matrix`
/// makes the table of docs/faults.md.
fn record(cell: &Cell, took: Duration) {
    let Ok(file) = std::env::var("FAULT_MATRIX_CELLS") else { return };
    let who = cell.victim.map_or("coupler".into(), |(role, rank)| format!("{role}, rank {rank}"));
    let seconds = match cell.fault {
        "late" | "twice" => "goes on".into(),
        _ => format!("{:.1}", took.as_secs_f64()),
    };
    let mut file = fs::File::options().create(true).append(true).open(file).expect("a file");
    // One write: cells are tried side by side.
    let line = format!("{who}\t{}\t{}\t{seconds}\n", cell.fault, cell.moment);
    file.write_all(line.as_bytes()).expect("written");
}

/// All of it: `scripts/fault-matrix`.
#[test]
#[ignore = "about 300 runs: scripts/fault-matrix"]
fn the_whole_fault_matrix() {
    let filter = std::env::var("FAULT_MATRIX").unwrap_or_default();
    let at_once = std::env::var("FAULT_MATRIX_AT_ONCE").ok().and_then(|n| n.parse().ok()).unwrap_or(3);
    let wanted = |c: &Cell| {
        let name = format!(
            "{} {} {}",
            c.victim.map_or("coupler".into(), |(r, n)| format!("{r} {n}")),
            c.fault,
            c.moment
        );
        filter.split(' ').all(|word| name.split(' ').any(|w| w == word || word.is_empty()))
    };
    let chosen: Vec<Cell> = cells().into_iter().filter(wanted).collect();
    let times = try_all(&chosen, at_once, |_| true);
    println!("{} cells tried, all as documented", times.len());
}

/// The reference of this file's helpers: a command that fails is told.
#[test]
fn the_harness_notices_a_run_that_is_not_harmed() {
    let base = Base::new();
    let cell = Cell { victim: Some(("flow", 7)), fault: "kill", moment: "window" };
    let why = try_cell(&base, &cell, |_| false).expect_err("rank 7 does not exist");
    assert!(why.contains("ended before its moment"), "{why}");
}
