//! The fault matrix: each fault, at each moment, in each program (first and middle rank) and in the coupler. See docs/records/fault-matrix.md, which `scripts/fault-matrix` writes.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use ripstop_tests::load::{Limit, deadline_s};
use ripstop_tests::tiny::{Base, RANKS, WINDOWS, contents};
use ripstop_tests::{
    History, Signal, processes_naming, program, ripstop_run, session_memory, signal, succeed,
};

/// Time within which all other processes end (for a stall: after the deadline).
const GONE: Duration = Duration::from_secs(5);
/// Deadline of runs with a stall, on an idle machine.
const DEADLINE_S: u64 = 8;
/// Limit for start-up and computation.
const DEADLINE: Duration = Duration::from_secs(180);
/// Limit for the window that the coupler completes after a request to end.
const WINDOW: Duration = Duration::from_secs(30);
/// Polling interval.
const LOOK: Duration = Duration::from_millis(10);

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

    /// Whether the coupler gets a request to end within a window.
    fn finishes_window(&self) -> bool {
        self.victim.is_none() && self.fault == "term" && matches!(self.moment, "window" | "iteration")
    }

    /// Whether the run survives the fault with the same results.
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

macro_rules! demand {
    ($condition:expr, $($words:tt)+) => {
        if !$condition {
            return Err(format!($($words)+));
        }
    };
}

/// A run of the last stage with an injected fault.
struct Try<'a> {
    base: &'a Base,
    cell: &'a Cell,
    folder: tempfile::TempDir,
    run: Child,
    /// States of the run before it.
    before: BTreeMap<PathBuf, Vec<u8>>,
    deadline_s: u64,
}

/// Reason why a cell was not completed.
enum Failure {
    /// The machine missed the deadline before the fault.
    TooSlow,
    Wrong(String),
}

impl From<String> for Failure {
    fn from(why: String) -> Self {
        Self::Wrong(why)
    }
}

impl<'a> Try<'a> {
    fn start(base: &'a Base, cell: &'a Cell, deadline_s: u64) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("out");
        fs::create_dir_all(folder.path().join("tmp")).expect("a folder");
        base.copy(&out);
        let before = contents(&out);
        let options = [
            ["--stage", "descent"],
            ["--ranks", RANKS],
            ["--checkpoint-every", "1"],
            ["--deadline", &deadline_s.to_string()],
        ];
        let file = fs::File::create(folder.path().join("errors")).expect("a file");
        let run = ripstop_run(&base.scene, &out, &options.concat())
            .args(program_of(cell))
            .env("FAULTY_NOTE", folder.path().join("note"))
            .env("TMPDIR", folder.path().join("tmp"))
            .stdout(Stdio::null())
            .stderr(file)
            .spawn()
            .expect("it starts");
        Self { base, cell, folder, run, before, deadline_s }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    fn text(&self) -> String {
        fs::read_to_string(self.folder.path().join("errors")).expect("text")
    }

    /// Lines of the history.
    fn rows(&self) -> usize {
        fs::read_to_string(self.out().join("descent/history.csv")).map_or(0, |t| t.lines().count())
    }

    fn processes(&self) -> Vec<(u32, String)> {
        processes_naming(&self.out().display().to_string())
    }

    /// Ends a run that did not end by itself; returns the message.
    fn give_up(&mut self, why: &str) -> String {
        let (rows, left) = (self.rows(), self.processes());
        signal(self.run.id(), Signal::KILL);
        let _ = self.run.wait();
        format!("{why}: {rows} lines of history, {left:?}\n{}", self.text())
    }

    /// Waits for the moment of the fault in a rank, or injects the fault into the coupler.
    fn reach_moment(&mut self) -> Result<(), Failure> {
        let note = self.folder.path().join("note");
        let came = Limit::new(DEADLINE)
            .until(LOOK, || note.exists() || self.run.try_wait().is_ok_and(|s| s.is_some()));
        if let Err(late) = came {
            return Err(Failure::Wrong(self.give_up(&format!("the moment did not come: {late}"))));
        }
        if !note.exists() {
            let text = self.text();
            let slow = self.cell.stalls() && text.contains(&format!("for {} s", self.deadline_s));
            return Err(if slow {
                Failure::TooSlow
            } else {
                format!("it ended before its moment: {text}").into()
            });
        }
        if self.cell.victim.is_none() {
            let harm = match self.cell.fault {
                "kill" => Signal::KILL,
                "stop" => Signal::STOP,
                _ => Signal::TERM,
            };
            signal(self.run.id(), harm);
        }
        Ok(())
    }

    /// Waits until all processes have ended. Returns the exit status of the coupler and the wall time since the fault.
    fn await_end(&mut self) -> Result<(ExitStatus, Duration), String> {
        let begin = Instant::now();
        let deadline = Duration::from_secs(self.deadline_s);
        if self.cell.victim.is_none() && self.cell.fault == "stop" {
            // The programs end after their deadline; the coupler reports the error when it continues.
            let coupler = self.run.id();
            let others = || self.processes().iter().any(|(pid, _)| *pid != coupler && alive(*pid));
            let took = Limit::new(deadline + GONE).until(LOOK, || !others());
            let took =
                took.map_err(|e| format!("programs of a stopped coupler: {e}: {:?}", self.processes()))?;
            signal(self.run.id(), Signal::CONT);
            let (status, _) = self.gone(Limit::new(GONE))?;
            return Ok((status, took));
        }
        let limit = match self.cell.fault {
            "late" | "twice" => DEADLINE,
            _ if self.cell.stalls() => deadline + GONE,
            _ => GONE,
        };
        if self.cell.finishes_window() {
            // The window is completed first.
            let rows = self.rows();
            let done = Limit::new(WINDOW)
                .until(LOOK, || self.rows() > rows || self.run.try_wait().is_ok_and(|s| s.is_some()));
            done.map_err(|late| self.give_up(&format!("its window: {late}")))?;
        }
        let (status, _) = self.gone(Limit::new(limit))?;
        Ok((status, begin.elapsed()))
    }

    fn gone(&mut self, limit: Limit) -> Result<(ExitStatus, Duration), String> {
        let mut status = None;
        let ended = limit.until(LOOK, || {
            status = self.run.try_wait().expect("it can be waited for");
            status.is_some()
        });
        ended.map_err(|late| self.give_up(&format!("the run continues: {late}")))?;
        let took = limit.until(LOOK, || self.processes().is_empty());
        let took =
            took.map_err(|e| format!("processes are left: {e}: {:?}\n{}", self.processes(), self.text()))?;
        Ok((status.expect("it ended"), took))
    }

    /// No leftovers, valid earlier states, and accepted windows as in a run without fault.
    fn check_files(&self) -> Result<(), String> {
        let text = self.text();
        // A killed coupler cannot clean up: the next run does (tested below).
        let tidied = self.cell.victim.is_some() || self.cell.fault != "kill";
        let mut left = session_memory("square-drop", self.run.id(), 2);
        left.extend(contents(&self.folder.path().join("tmp")).into_keys());
        demand!(!tidied || left.is_empty(), "files left: {left:?}\n{text}");
        let panicked = text.lines().filter(|l| l.contains("panicked at") && !l.contains("faulty.rs")).count();
        demand!(panicked == 0, "another one panicked: {text}");
        // Accepted windows are bitwise identical: no stale data were used.
        if self.rows() > 1 {
            let (here, there) =
                (History::read(&self.out(), "descent"), History::read(&self.base.out(), "descent"));
            let (here, there) = (here.without_wall_times(), there.without_wall_times());
            demand!(there.starts_with(&here), "other numbers than without harm");
        }
        // The initial states are valid and were not replaced by incomplete ones.
        let after = contents(&self.out());
        demand!(
            self.before.iter().all(|(name, bytes)| after.get(name) == Some(bytes)),
            "states were changed"
        );
        Ok(())
    }

    /// Checks a run that survives the fault.
    fn check_survival(&self, status: ExitStatus) -> Result<(), String> {
        let (text, rows) = (self.text(), self.rows());
        demand!(status.code() == Some(0), "ended with {status}: {text}");
        demand!(rows == WINDOWS + 1, "{} windows of {WINDOWS}", rows.saturating_sub(1));
        if self.cell.moment == "end" && !matches!(self.cell.fault, "late" | "twice") {
            let role = self.cell.victim.map_or("", |(role, _)| role);
            let said = text.contains("did not exit normally after the stage") && text.contains(role);
            demand!(said, "no word of it: {text}");
        }
        Ok(())
    }

    /// Checks a run that ends with one error naming program, rank and window.
    fn check_error(&self, status: ExitStatus) -> Result<(), String> {
        let (cell, text) = (self.cell, self.text());
        let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error")).collect();
        let wanted = match (cell.victim, cell.fault) {
            (None, "kill") => None,
            (None, "term") => Some(130),
            _ => Some(1),
        };
        // The coupler had completed its work and may have ended successfully.
        let over = cell.victim.is_none() && cell.moment == "end";
        demand!(status.code() == wanted || (over && status.code() == Some(0)), "ended with {status}: {text}");
        if over || (cell.victim.is_none() && cell.fault != "term") {
            return Ok(());
        }
        demand!(errors.len() == 1, "{} messages: {text}", errors.len());
        demand!(errors[0].contains("stage `descent`"), "it does not say where: {}", errors[0]);
        if matches!(cell.moment, "window" | "iteration") {
            demand!(errors[0].contains("window 2"), "it does not say in which window: {}", errors[0]);
        }
        if let Some((role, rank)) = cell.victim {
            demand!(errors[0].contains(role), "{role} is not named: {}", errors[0]);
            // A rank that did not start cannot be distinguished from those that wait in MPI_Init.
            let unknown = cell.stalls() && matches!(cell.moment, "start" | "handshake");
            demand!(unknown || errors[0].contains(&format!("rank {rank}")), "the wrong rank: {text}");
        }
        Ok(())
    }
}

/// Option that runs the faulty program instead of the solver. For faults of the coupler, a rank delays at the moment.
fn program_of(cell: &Cell) -> [String; 2] {
    let (role, rank) = cell.victim.unwrap_or(("flow", 1));
    let fault = if cell.victim.is_some() { cell.fault } else { "late" };
    let faulty = format!("{} {role} {fault} {} {rank}", program("faulty").display(), cell.moment);
    [format!("--{role}"), faulty]
}

/// Runs the last stage with the fault. Returns the wall time from the fault to the end of all processes.
fn try_cell(base: &Base, cell: &Cell, thorough: fn(&Cell) -> bool) -> Result<Duration, String> {
    // Solves before the fault must meet the deadline, which grows with the load and on a repetition.
    for times in [1, 2, 4, 8] {
        let free = if cell.stalls() { DEADLINE_S } else { DEADLINE.as_secs() };
        let mut run = Try::start(base, cell, times * deadline_s(free));
        match run.reach_moment() {
            Ok(()) => {}
            Err(Failure::TooSlow) => continue,
            Err(Failure::Wrong(why)) => return Err(why),
        }
        let (status, took) = run.await_end()?;
        run.check_files()?;
        if cell.harmless() {
            run.check_survival(status)?;
            return Ok(took);
        }
        if thorough(cell) {
            resumes(base, &run.out(), &program_of(cell))?;
        }
        run.check_error(status)?;
        return Ok(took);
    }
    Err("no answer within the deadline, four times".into())
}

/// The last saved state is valid: the resumed run completes.
fn resumes(base: &Base, out: &Path, program: &[String; 2]) -> Result<(), String> {
    // Before the first save there is no state to resume from.
    if !out.join("descent/state").exists() {
        return Ok(());
    }
    let options = ["--resume", "--ranks", RANKS, "--quiet", &program[0], &program[1]];
    // A resumed run needs the same program, now without fault.
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

/// Whether a process is alive and not a zombie.
fn alive(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|t| !t.contains(") Z "))
}

/// Tests `cells`, `at_once` in parallel; returns the times in order.
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
    // Leftovers of killed couplers do not affect the next run, which removes them.
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

/// One cell for each fault, with alternating moments, programs and ranks, and the coupler within a window. All cells: `scripts/fault-matrix`.
#[test]
fn sample_of_the_fault_matrix() {
    let all = cells();
    let victims = [("structure", 1), ("mesh", 0), ("flow", 1), ("structure", 0), ("mesh", 1), ("flow", 0)];
    let mut chosen = Vec::new();
    for (i, fault) in FAULTS.into_iter().enumerate() {
        let wanted: Vec<_> =
            all.iter().filter(|c| c.fault == fault && c.victim == Some(victims[i % 6])).collect();
        chosen.push(wanted[(i + 2) % wanted.len()].clone());
    }
    chosen.extend(all.into_iter().filter(|c| c.victim.is_none() && c.moment == "window"));
    // An additional run per cell would double the time.
    try_all(&chosen, 3, |cell| cell.moment == "save" || cell.fault == "kill");
}

/// Appends a passed cell to the file `FAULT_MATRIX_CELLS`, from which `scripts/fault-matrix` generates the table of
/// docs/records/fault-matrix.md.
fn record(cell: &Cell, took: Duration) {
    let Ok(file) = std::env::var("FAULT_MATRIX_CELLS") else { return };
    let who = cell.victim.map_or("coupler".into(), |(role, rank)| format!("{role}, rank {rank}"));
    let seconds = match cell.fault {
        "late" | "twice" => "goes on".into(),
        _ => format!("{:.1}", took.as_secs_f64()),
    };
    let mut file = fs::File::options().create(true).append(true).open(file).expect("a file");
    // A single write, because cells run in parallel.
    let line = format!("{who}\t{}\t{}\t{seconds}\n", cell.fault, cell.moment);
    file.write_all(line.as_bytes()).expect("written");
}

/// The full matrix: `scripts/fault-matrix`.
#[test]
#[ignore = "nightly: by scripts/fault-matrix"]
fn full_fault_matrix() {
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

/// Check of the helpers of this file: a run without fault is detected.
#[test]
fn harness_detects_a_run_without_fault() {
    let base = Base::new();
    let cell = Cell { victim: Some(("flow", 7)), fault: "kill", moment: "window" };
    let why = try_cell(&base, &cell, |_| false).expect_err("rank 7 does not exist");
    assert!(why.contains("ended before its moment"), "{why}");
}
