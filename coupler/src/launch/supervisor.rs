//! Supervision of the programs of a stage.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use case::Role;
use channel::Deadline;
use coupling::error::RunError;
use coupling::partners::Usage;
use rustix::process::Signal;
use terminal::Console;

use super::Program;
use super::process::{self, ProcessEntry};
use super::usage::usage;

/// Time for the error message of a program to arrive over the channel before
/// its exit is reported without one.
const FAULT_MESSAGE_WAIT: Duration = Duration::from_millis(700);
/// Time limit after an exit for reading the remaining output: on a loaded machine the
/// launcher's notice, which names the rank, arrives after the exit status. An orphaned process
/// may keep the pipe open for longer.
const OUTPUT_WAIT: Duration = Duration::from_millis(1500);
/// Time limit for a launcher to start all its ranks or to report a failed one.
const MISSING_RANKS_WAIT: Duration = Duration::from_millis(2000);
/// Interval between counts of ranks.
const RANK_COUNT_INTERVAL: Duration = Duration::from_millis(250);
/// Time between SIGTERM and SIGKILL.
const TERMINATION_WAIT: Duration = Duration::from_millis(1500);
/// Time between SIGTERM to the ranks and SIGTERM to their launchers.
const RANK_TERMINATION_WAIT: Duration = Duration::from_millis(700);
/// Lines of the log in the message of a failed process.
const TAIL_LINES: usize = 12;

/// A program that ended unexpectedly.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessFailure {
    /// Its role.
    pub role: Role,
    /// Name in messages.
    pub name: String,
    /// The rank that ended first, if the launcher reported it.
    pub rank: Option<u64>,
    /// Exit code or signal.
    pub how: String,
    /// The end of its log.
    pub tail: String,
}

struct Running {
    program: Program,
    child: Child,
    status: Option<(ExitStatus, Instant)>,
    readers: Vec<JoinHandle<()>>,
    tail: Arc<Mutex<Tail>>,
    notices: Arc<Mutex<Notices>>,
    /// Time since which ranks are missing.
    missing_since: Option<Instant>,
}

/// Reports of the launcher about its ranks.
#[derive(Clone, Copy, Debug, Default)]
struct Notices {
    /// The rank that failed first.
    failed_rank: Option<u64>,
    /// The first rank that exited normally.
    exited_rank: Option<u64>,
}

/// The running programs of a stage. Dropping it ends all of them.
pub struct Supervisor {
    running: Vec<Running>,
    session: String,
    tracked: Vec<ProcessEntry>,
    /// Time of the last count of ranks.
    counted: Option<Instant>,
    /// Set while the programs are being ended: their output then goes to their logs only.
    muted: Arc<AtomicBool>,
}

impl Supervisor {
    /// Starts all `programs`. Their ranks are identified by `session` on their command line.
    ///
    /// # Errors
    /// A program cannot be started (earlier ones are then ended), or a log
    /// cannot be written.
    pub fn start(programs: Vec<Program>, session: &str, console: &Console) -> Result<Self, RunError> {
        process::adopt_orphans();
        let mut all = Self {
            running: Vec::new(),
            session: session.to_owned(),
            tracked: Vec::new(),
            counted: None,
            muted: Arc::default(),
        };
        for program in programs {
            let started = start(program, console, &all.muted)?;
            all.running.push(started);
        }
        Ok(all)
    }

    /// The first program that has ended, after the time for its error message to
    /// arrive over the channel. Does not block.
    pub fn failure(&mut self) -> Option<ProcessFailure> {
        self.poll();
        let at = self.running.iter().position(|r| r.ended_before(FAULT_MESSAGE_WAIT))?;
        Some(self.running[at].failure())
    }

    /// A program of which a rank has ended while its launcher waits for the others. OpenMPI
    /// accepts a rank that exits normally before `MPI_Init`; the other ranks then wait for it
    /// without limit. For use until all ranks have joined. Does not block.
    pub fn missing_ranks(&mut self) -> Option<ProcessFailure> {
        if self.counted.is_some_and(|t| t.elapsed() < RANK_COUNT_INTERVAL) {
            return None;
        }
        self.counted = Some(Instant::now());
        let roots: Vec<u32> = self.running.iter().map(|r| r.child.id()).collect();
        let found = process::descendants(&roots, &self.session);
        for running in self.running.iter_mut().filter(|r| r.status.is_none() && r.program.on_this_host()) {
            let now = found.iter().filter(|s| s.parent == running.child.id()).count();
            let all = running.program.ranks();
            if now == 0 || now >= all {
                running.missing_since = None;
            } else if running.missing_since.get_or_insert_with(Instant::now).elapsed() > MISSING_RANKS_WAIT {
                let how = format!("{} of its {all} ranks ended before they joined", all - now);
                let rank = running.notices().exited_rank;
                return Some(ProcessFailure { how, rank, ..running.failure() });
            }
        }
        None
    }

    /// Exit status and last output of `role`, if it ends within `timeout`.
    pub fn await_exit(&mut self, role: Role, timeout: Duration) -> Option<ProcessFailure> {
        let at = self.running.iter().position(|r| r.program.role == role)?;
        wait_until(timeout, || {
            self.poll();
            self.running[at].ended_before(Duration::ZERO)
        });
        self.running[at].status.is_some().then(|| self.running[at].failure())
    }

    /// Marks a request to the program of `role`: its last output is what it writes from now on.
    pub fn mark_request(&self, role: Role) {
        let running = self.running.iter().find(|r| r.program.role == role);
        if let Some(mut tail) = running.and_then(|r| r.tail.lock().ok()) {
            tail.since_request = 0;
        }
    }

    /// The last line that the program of `role` wrote since the last request. Waits briefly for one, since output and
    /// replies use different channels. `None`: no line.
    pub fn last_line(&self, role: Role) -> Option<String> {
        let running = self.running.iter().find(|r| r.program.role == role)?;
        let last = || running.tail.lock().ok()?.lines_since_request().last().cloned();
        wait_until(FAULT_MESSAGE_WAIT, || last().is_some());
        last()
    }

    /// The name of the program of `role` in messages.
    pub fn name(&self, role: Role) -> String {
        let found = self.running.iter().find(|r| r.program.role == role);
        found.map_or_else(|| role.program().to_owned(), |r| r.program.name.clone())
    }

    /// Processor time and memory of the programs so far, by role. Requires that they still run.
    pub fn usage(&self) -> Vec<(Role, Usage)> {
        self.running.iter().map(|r| (r.program.role, usage(r.child.id()))).collect()
    }

    /// Waits for all programs to exit, and ends those that do not within
    /// `timeout`. Returns those that did not exit normally.
    pub fn finish(mut self, timeout: Duration) -> Vec<ProcessFailure> {
        let done = wait_until(timeout, || {
            self.poll();
            self.running.iter().all(|r| r.status.is_some())
        });
        let failed = self
            .running
            .iter()
            .filter(|r| !r.status.is_some_and(|(status, _)| status.success()))
            .map(Running::failure)
            .collect();
        if !done {
            self.end();
        }
        failed
    }

    /// Ends all processes: SIGTERM to the ranks, SIGTERM to their launchers, then SIGKILL. Includes
    /// ranks whose launcher has ended. Takes less than 4 s.
    pub fn end(&mut self) {
        self.muted.store(true, Ordering::Relaxed);
        self.track_descendants();
        for seen in self.alive() {
            process::signal(seen.process, Signal::TERM);
        }
        // A launcher whose ranks have ended exits by itself and cleans up.
        for timeout in [RANK_TERMINATION_WAIT, TERMINATION_WAIT] {
            let done = wait_until(timeout, || {
                self.poll();
                self.track_descendants();
                self.running.iter().all(|r| r.status.is_some()) && self.alive().is_empty()
            });
            if !done && timeout == RANK_TERMINATION_WAIT {
                for running in self.running.iter().filter(|r| r.status.is_none()) {
                    process::signal_group(running.child.id(), Signal::TERM);
                }
            }
        }
        for running in &self.running {
            process::signal_group(running.child.id(), Signal::KILL);
        }
        wait_until(Duration::from_millis(1500), || {
            self.track_descendants();
            for seen in self.alive() {
                process::signal(seen.process, Signal::KILL);
                process::reap(seen.process);
            }
            self.poll();
            self.running.iter().all(|r| r.status.is_some()) && self.alive().is_empty()
        });
        for seen in &self.tracked {
            process::reap(seen.process);
        }
        for running in &mut self.running {
            for reader in running.readers.drain(..) {
                // A grandchild may keep the pipe open: do not wait for it.
                if reader.is_finished() {
                    let _ = reader.join();
                }
            }
        }
    }

    #[cfg(test)]
    pub(super) fn first_process(&self) -> u32 {
        self.running[0].child.id()
    }

    fn poll(&mut self) {
        for running in &mut self.running {
            if running.status.is_none()
                && let Ok(Some(status)) = running.child.try_wait()
            {
                running.status = Some((status, Instant::now()));
            }
        }
    }

    /// Stores all descendants of the programs, to find them after their parents have ended.
    fn track_descendants(&mut self) {
        let roots: Vec<u32> = self.running.iter().map(|r| r.child.id()).collect();
        for seen in process::descendants(&roots, &self.session) {
            if !self.tracked.iter().any(|k| k.process == seen.process && k.start == seen.start) {
                self.tracked.push(seen);
            }
        }
    }

    /// Tracked processes that are still alive (identified by number and start time), without
    /// the programs themselves, whose exit `poll` collects.
    fn alive(&self) -> Vec<ProcessEntry> {
        let root = |p: u32| self.running.iter().any(|r| r.child.id() == p);
        let alive = |k: &&ProcessEntry| process::read_stat(k.process).is_some_and(|now| now.start == k.start);
        self.tracked.iter().filter(|k| !root(k.process)).filter(alive).copied().collect()
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        if self.running.iter().any(|r| r.status.is_none()) || !self.tracked.is_empty() {
            self.end();
        }
    }
}

impl Running {
    /// Whether it ended at least `ago`, and all its output was read.
    fn ended_before(&self, ago: Duration) -> bool {
        let Some((_, ended)) = self.status else { return false };
        let since = ended.elapsed();
        since >= ago && (since > OUTPUT_WAIT || self.readers.iter().all(JoinHandle::is_finished))
    }

    fn notices(&self) -> Notices {
        self.notices.lock().map(|n| *n).unwrap_or_default()
    }

    fn failure(&self) -> ProcessFailure {
        let how = match self.status {
            None => "still running".to_owned(),
            Some((status, _)) => match (status.code(), status.signal()) {
                // A shell or mpirun reports signal n as exit code 128 + n.
                (Some(code), _) if code > 128 && code < 160 => signal_name(code - 128),
                (Some(code), _) => format!("exit code {code}"),
                (None, Some(signal)) => signal_name(signal),
                (None, None) => "unknown".to_owned(),
            },
        };
        let tail = self.tail.lock().map(|t| t.lines_since_request().cloned().collect::<Vec<_>>().join("\n"));
        ProcessFailure {
            role: self.program.role,
            name: self.program.name.clone(),
            rank: self.notices().failed_rank,
            how,
            tail: tail.unwrap_or_default(),
        }
    }
}

fn signal_name(signal: i32) -> String {
    let name = match Signal::from_named_raw(signal) {
        Some(Signal::KILL) => " SIGKILL: killed, possibly out of memory",
        Some(Signal::SEGV) => " SIGSEGV: invalid memory access",
        Some(Signal::ABORT) => " SIGABRT: aborted",
        Some(Signal::TERM) => " SIGTERM: terminated",
        Some(Signal::INT) => " SIGINT: interrupted",
        Some(Signal::BUS) => " SIGBUS: memory fault, possibly /dev/shm is full",
        Some(Signal::FPE) => " SIGFPE: arithmetic exception",
        _ => "",
    };
    format!("signal {signal}{name}")
}

fn start(program: Program, console: &Console, muted: &Arc<AtomicBool>) -> Result<Running, RunError> {
    if let Some(folder) = program.log.parent() {
        std::fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    }
    let mut how = File::options();
    how.create(true).write(true).truncate(!program.continues).append(program.continues);
    let mut log = how.open(&program.log).map_err(RunError::file("create", &program.log))?;
    // The first line of the log is the command, to reproduce a failure.
    let _ = writeln!(log, "$ {}", program.line());
    let log = Arc::new(Mutex::new(log));
    let mut command = Command::new(&program.words[0]);
    command
        .args(&program.words[1..])
        .envs(program.environment.iter().map(|(k, v)| (k, v)))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    process::bind_to_parent(&mut command);
    let mut child = command.spawn().map_err(|source| {
        let what = program.words[0].to_string_lossy().into_owned();
        let help = if what == "mpirun" {
            "install OpenMPI (`apt install openmpi-bin`) or put it on the PATH"
        } else {
            "check the path and the execute permission"
        };
        RunError::Input(format!("cannot start `{what}` for {}: {source}; {help}", program.name))
    })?;
    let tail = Arc::new(Mutex::new(Tail::default()));
    let notices = Arc::default();
    let mut readers = Vec::new();
    let show = ConsoleOutput { role: program.role, console: console.clone(), muted: muted.clone() };
    if let Some(pipe) = child.stdout.take() {
        let shown = console.shows_all().then(|| show.clone());
        readers.push(read(pipe, log.clone(), tail.clone(), Arc::clone(&notices), shown));
    }
    if let Some(pipe) = child.stderr.take() {
        readers.push(read(pipe, log, tail.clone(), Arc::clone(&notices), Some(show)));
    }
    Ok(Running { program, child, status: None, readers, tail, notices, missing_since: None })
}

/// Console output of a program, until it is muted.
#[derive(Clone)]
struct ConsoleOutput {
    role: Role,
    console: Console,
    muted: Arc<AtomicBool>,
}

/// The last lines of a program.
#[derive(Default)]
struct Tail {
    lines: VecDeque<String>,
    /// Number of them since the last request.
    since_request: usize,
}

impl Tail {
    fn push(&mut self, line: String) {
        if self.lines.len() == TAIL_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
        self.since_request = (self.since_request + 1).min(TAIL_LINES);
    }

    /// Lines since the last request.
    fn lines_since_request(&self) -> impl Iterator<Item = &String> {
        self.lines.iter().skip(self.lines.len() - self.since_request)
    }
}

/// Copies lines to the log, the last ones to `tail`, and those of standard
/// error to the console. Framed MPI notices of a failed process go to the log only: the
/// coupler reports the failure. State records of the launcher go to `notices` only.
fn read(
    pipe: impl Read + Send + 'static,
    log: Arc<Mutex<File>>,
    tail: Arc<Mutex<Tail>>,
    notices: Arc<Mutex<Notices>>,
    show: Option<ConsoleOutput>,
) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let mut framed = false;
        let mut reader = BufReader::new(pipe);
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            match reader.read_until(b'\n', &mut bytes) {
                Ok(0) | Err(_) => break,
                Ok(_) => {}
            }
            let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
            if let Some(state) = parse_state(&line) {
                if let Some((rank, state)) = state
                    && let Ok(mut notices) = notices.lock()
                {
                    notices.record(rank, state);
                }
                continue;
            }
            if let Ok(mut log) = log.lock() {
                let _ = writeln!(log, "{line}");
            }
            let frame = line.len() > 20 && line.bytes().all(|b| b == b'-');
            framed ^= frame;
            if frame || framed || line.is_empty() {
                if let Some(rank) = parse_failed_rank(&line)
                    && let Ok(mut notices) = notices.lock()
                {
                    notices.failed_rank.get_or_insert(rank);
                }
                continue;
            }
            // What a program logs explains no failure.
            if !channel::is_log_line(&line)
                && let Ok(mut tail) = tail.lock()
            {
                tail.push(line.clone());
            }
            if let Some(show) = &show
                && !show.muted.load(Ordering::Relaxed)
            {
                show.console.program_line(show.role, &line);
            }
        }
    })
}

impl Notices {
    /// Stores the OpenMPI process state of a rank.
    fn record(&mut self, rank: u64, state: &str) {
        match state {
            "ABORTED BY SIGNAL" | "EXITED WITH NON-ZERO STATUS" | "CALLED ABORT" | "FAILED TO START" => {
                self.failed_rank.get_or_insert(rank);
            }
            "NORMALLY TERMINATED" => {
                self.exited_rank.get_or_insert(rank);
            }
            _ => {}
        }
    }
}

/// Parses a state record of OpenMPI: rank and state; `Some(None)` for a record of a job;
/// `None` for any other line.
fn parse_state(line: &str) -> Option<Option<(u64, &str)>> {
    let (head, rest) = line.split_once("] ACTIVATE ")?;
    let (what, state) = rest.split_once(" STATE ").filter(|_| head.starts_with('['))?;
    let (state, _) = state.split_once(" AT ")?;
    let rank = what.strip_prefix("PROC [[").and_then(|w| w.split_once("],"));
    let rank = rank.and_then(|(_, rank)| rank.strip_suffix(']')?.parse().ok());
    Some(rank.map(|rank| (rank, state)))
}

/// Parses the rank in OpenMPI's notice of a failed process. OpenMPI ends the other ranks
/// itself, so the exit of processes does not identify the first one.
fn parse_failed_rank(line: &str) -> Option<u64> {
    let number = |text: &str| text.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
    if let Some((_, rest)) = line.split_once("process rank ") {
        return number(rest);
    }
    let (_, rest) = line.split_once("Process name: [[")?.1.split_once("],")?;
    number(rest)
}

/// Polls `done` every 10 ms until `timeout`; whether it became true.
fn wait_until(timeout: Duration, done: impl FnMut() -> bool) -> bool {
    Deadline::after(timeout).poll(Duration::from_millis(10), done)
}

#[cfg(test)]
mod tests {
    use super::{Notices, parse_failed_rank, parse_state};

    #[test]
    fn failed_rank_is_parsed_from_notices() {
        let killed = "mpirun noticed that process rank 1 with PID 123 on node n exited on signal 9 (Killed).";
        assert_eq!(parse_failed_rank(killed), Some(1));
        assert_eq!(parse_failed_rank("  Process name: [[43310,1],12]"), Some(12));
        assert_eq!(parse_failed_rank("one or more processes exited with non-zero status"), None);
    }

    #[test]
    fn first_failed_and_first_exited_rank_are_recorded() {
        let line = |rank: u64, state: &str| {
            format!("[vm:12] [[320,0],0] ACTIVATE PROC [[320,1],{rank}] STATE {state} AT ../odls_base.c:1746")
        };
        let mut notices = Notices::default();
        for (rank, state) in
            [(0, "RUNNING"), (2, "NORMALLY TERMINATED"), (1, "ABORTED BY SIGNAL"), (0, "ABORTED BY SIGNAL")]
        {
            let line = line(rank, state);
            assert_eq!(parse_state(&line), Some(Some((rank, state))));
            notices.record(rank, state);
        }
        assert_eq!((notices.failed_rank, notices.exited_rank), (Some(1), Some(2)));
        assert_eq!(
            parse_state("[vm:12] [[320,0],0] ACTIVATE JOB [320,1] STATE VM READY AT ../x.c:1"),
            Some(None)
        );
        assert_eq!(parse_state("a program may say: ACTIVATE all"), None);
    }
}
