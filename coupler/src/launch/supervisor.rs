//! Watching over the programs of a stage.

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
use super::process::{self, Seen};
use super::usage::usage;

/// Time that a program's own message is given to arrive over the channel before
/// its exit alone is reported.
const LAST_WORDS: Duration = Duration::from_millis(700);
/// Time after an exit in which what was written before it is waited for: on a busy machine the
/// launcher's notice, which names the rank, is read later than the exit is seen. A process
/// that was left behind may hold the pipe open for longer.
const READ_OUT: Duration = Duration::from_millis(1500);
/// Time in which a launcher starts all its ranks, or says that one has failed.
const DESERTED: Duration = Duration::from_millis(2000);
/// Time between two counts of ranks.
const COUNTS: Duration = Duration::from_millis(250);
/// Time between the request to end and the forced end.
const GRACE: Duration = Duration::from_millis(1500);
/// The part of it in which only the ranks are asked.
const RANKS_FIRST: Duration = Duration::from_millis(700);
/// Lines of a log shown with a death.
const TAIL: usize = 12;

/// A program that ended although it should not have.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessFailure {
    /// Its role.
    pub role: Role,
    /// How messages call it.
    pub name: String,
    /// The rank that ended first, where the launcher has said so.
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
    /// Since when it has had fewer ranks than it was started with.
    fewer: Option<Instant>,
}

/// What the launcher has said of its ranks.
#[derive(Clone, Copy, Debug, Default)]
struct Notices {
    /// The rank that it blames.
    blamed: Option<u64>,
    /// The first one that ended well.
    left: Option<u64>,
}

/// The running programs of a stage. Dropping it ends them all.
pub struct Supervisor {
    running: Vec<Running>,
    session: String,
    known: Vec<Seen>,
    /// When ranks were counted last.
    counted: Option<Instant>,
    /// Set while all is being ended: what programs print then is in their logs only.
    muted: Arc<AtomicBool>,
}

impl Supervisor {
    /// Starts all `programs`; `session` marks their ranks.
    ///
    /// # Errors
    /// A program that cannot be started (those before it are ended), or a log
    /// that cannot be written.
    pub fn start(programs: Vec<Program>, session: &str, console: &Console) -> Result<Self, RunError> {
        process::adopt_orphans();
        let mut all = Self {
            running: Vec::new(),
            session: session.to_owned(),
            known: Vec::new(),
            counted: None,
            muted: Arc::default(),
        };
        for program in programs {
            let started = start(program, console, &all.muted)?;
            all.running.push(started);
        }
        Ok(all)
    }

    /// The first program that has ended, once its own last words had time to
    /// arrive elsewhere. Never waits.
    pub fn failure(&mut self) -> Option<ProcessFailure> {
        self.poll();
        let at = self.running.iter().position(|r| r.over(LAST_WORDS))?;
        Some(self.running[at].failure())
    }

    /// A program one of whose ranks has ended while its launcher waits for the others: OpenMPI
    /// does not mind a rank that ends well before it has begun, for which the others then
    /// wait for ever. For the time in which ranks arrive; never waits.
    pub fn missing_ranks(&mut self) -> Option<ProcessFailure> {
        if self.counted.is_some_and(|t| t.elapsed() < COUNTS) {
            return None;
        }
        self.counted = Some(Instant::now());
        let roots: Vec<u32> = self.running.iter().map(|r| r.child.id()).collect();
        let found = process::descendants(&roots, &self.session);
        for running in self.running.iter_mut().filter(|r| r.status.is_none() && r.program.on_this_host()) {
            let now = found.iter().filter(|s| s.parent == running.child.id()).count();
            let all = running.program.ranks();
            if now == 0 || now >= all {
                running.fewer = None;
            } else if running.fewer.get_or_insert_with(Instant::now).elapsed() > DESERTED {
                let how = format!("{} of its {all} ranks ended before they joined", all - now);
                let rank = running.notices().left;
                return Some(ProcessFailure { how, rank, ..running.failure() });
            }
        }
        None
    }

    /// What became of `role` if it ends within `patience`: its exit and last words.
    pub fn await_exit(&mut self, role: Role, patience: Duration) -> Option<ProcessFailure> {
        let at = self.running.iter().position(|r| r.program.role == role)?;
        wait_until(patience, || {
            self.poll();
            self.running[at].over(Duration::ZERO)
        });
        self.running[at].status.is_some().then(|| self.running[at].failure())
    }

    /// A question goes to the program of `role`: its last words are what it writes from now on.
    pub fn asked(&self, role: Role) {
        let running = self.running.iter().find(|r| r.program.role == role);
        if let Some(mut tail) = running.and_then(|r| r.tail.lock().ok()) {
            tail.since = 0;
        }
    }

    /// The last line that a role's program wrote since it was asked, waiting for one for a moment: lines come
    /// another way than answers. `None` where it wrote none.
    pub fn last_line(&self, role: Role) -> Option<String> {
        let running = self.running.iter().find(|r| r.program.role == role)?;
        let last = || running.tail.lock().ok()?.words().last().cloned();
        wait_until(LAST_WORDS, || last().is_some());
        last()
    }

    /// How messages call the program of `role`.
    pub fn name(&self, role: Role) -> String {
        let found = self.running.iter().find(|r| r.program.role == role);
        found.map_or_else(|| role.program().to_owned(), |r| r.program.name.clone())
    }

    /// What the programs have used so far, by role; ask while they are alive.
    pub fn usage(&self) -> Vec<(Role, Usage)> {
        self.running.iter().map(|r| (r.program.role, usage(r.child.id()))).collect()
    }

    /// Waits for all programs to end by themselves; those that do not within
    /// `patience` are ended. Returns those that did not end well.
    pub fn finish(mut self, patience: Duration) -> Vec<ProcessFailure> {
        let done = wait_until(patience, || {
            self.poll();
            self.running.iter().all(|r| r.status.is_some())
        });
        let bad = self
            .running
            .iter()
            .filter(|r| !r.status.is_some_and(|(status, _)| status.success()))
            .map(Running::failure)
            .collect();
        if !done {
            self.end();
        }
        bad
    }

    /// Ends everything: asks the ranks, then their launchers, then forces. Ranks
    /// included, however their launcher ended. Takes under 4 s.
    pub fn end(&mut self) {
        self.muted.store(true, Ordering::Relaxed);
        self.record_processes();
        for seen in self.living() {
            process::signal(seen.process, Signal::TERM);
        }
        // A launcher whose ranks have ended ends by itself, and more cleanly so.
        for patience in [RANKS_FIRST, GRACE] {
            let done = wait_until(patience, || {
                self.poll();
                self.record_processes();
                self.running.iter().all(|r| r.status.is_some()) && self.living().is_empty()
            });
            if !done && patience == RANKS_FIRST {
                for running in self.running.iter().filter(|r| r.status.is_none()) {
                    process::signal_group(running.child.id(), Signal::TERM);
                }
            }
        }
        for running in &self.running {
            process::signal_group(running.child.id(), Signal::KILL);
        }
        wait_until(Duration::from_millis(1500), || {
            self.record_processes();
            for seen in self.living() {
                process::signal(seen.process, Signal::KILL);
                process::reap(seen.process);
            }
            self.poll();
            self.running.iter().all(|r| r.status.is_some()) && self.living().is_empty()
        });
        for seen in &self.known {
            process::reap(seen.process);
        }
        for running in &mut self.running {
            for reader in running.readers.drain(..) {
                // A grandchild that holds the pipe open must not hold us.
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

    /// Notes all processes below the programs, to find them when their parents are gone.
    fn record_processes(&mut self) {
        let roots: Vec<u32> = self.running.iter().map(|r| r.child.id()).collect();
        for seen in process::descendants(&roots, &self.session) {
            if !self.known.iter().any(|k| k.process == seen.process && k.start == seen.start) {
                self.known.push(seen);
            }
        }
    }

    /// Processes once seen that are still there (the same, by start time), but
    /// for the programs themselves, whose exit `poll` collects.
    fn living(&self) -> Vec<Seen> {
        let root = |p: u32| self.running.iter().any(|r| r.child.id() == p);
        let alive = |k: &&Seen| process::look(k.process).is_some_and(|now| now.start == k.start);
        self.known.iter().filter(|k| !root(k.process)).filter(alive).copied().collect()
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        if self.running.iter().any(|r| r.status.is_none()) || !self.known.is_empty() {
            self.end();
        }
    }
}

impl Running {
    /// Whether it ended `ago`, and all that it wrote was read.
    fn over(&self, ago: Duration) -> bool {
        let Some((_, ended)) = self.status else { return false };
        let since = ended.elapsed();
        since >= ago && (since > READ_OUT || self.readers.iter().all(JoinHandle::is_finished))
    }

    fn notices(&self) -> Notices {
        self.notices.lock().map(|n| *n).unwrap_or_default()
    }

    fn failure(&self) -> ProcessFailure {
        let how = match self.status {
            None => "still running".to_owned(),
            Some((status, _)) => match (status.code(), status.signal()) {
                // A shell's and mpirun's way of passing on a signal.
                (Some(code), _) if code > 128 && code < 160 => signal_name(code - 128),
                (Some(code), _) => format!("exit code {code}"),
                (None, Some(signal)) => signal_name(signal),
                (None, None) => "unknown".to_owned(),
            },
        };
        let tail = self.tail.lock().map(|t| t.words().cloned().collect::<Vec<_>>().join("\n"));
        ProcessFailure {
            role: self.program.role,
            name: self.program.name.clone(),
            rank: self.notices().blamed,
            how,
            tail: tail.unwrap_or_default(),
        }
    }
}

fn signal_name(signal: i32) -> String {
    let name = match Signal::from_named_raw(signal) {
        Some(Signal::KILL) => " SIGKILL: killed, perhaps for want of memory",
        Some(Signal::SEGV) => " SIGSEGV: memory fault",
        Some(Signal::ABORT) => " SIGABRT: aborted",
        Some(Signal::TERM) => " SIGTERM: asked to end",
        Some(Signal::INT) => " SIGINT: interrupted",
        Some(Signal::BUS) => " SIGBUS: memory fault, perhaps /dev/shm is full",
        Some(Signal::FPE) => " SIGFPE: arithmetic fault",
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
    // Everything that goes wrong later is in the log; this line makes it repeatable.
    let _ = writeln!(log, "$ {}", program.line());
    let log = Arc::new(Mutex::new(log));
    let mut command = Command::new(&program.words[0]);
    command
        .args(&program.words[1..])
        .envs(program.environment.iter().map(|(k, v)| (k, v)))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    process::tie_to_parent(&mut command);
    let mut child = command.spawn().map_err(|source| {
        let what = program.words[0].to_string_lossy().into_owned();
        let help = if what == "mpirun" {
            "install OpenMPI (`apt install openmpi-bin`) or put it on the PATH"
        } else {
            "check the path and that it may be executed"
        };
        RunError::Input(format!("cannot start `{what}` for {}: {source}; {help}", program.name))
    })?;
    let tail = Arc::new(Mutex::new(Tail::default()));
    let notices = Arc::default();
    let mut readers = Vec::new();
    let show = Show { role: program.role, console: console.clone(), muted: muted.clone() };
    if let Some(pipe) = child.stdout.take() {
        let shown = console.shows_all().then(|| show.clone());
        readers.push(read(pipe, log.clone(), tail.clone(), Arc::clone(&notices), shown));
    }
    if let Some(pipe) = child.stderr.take() {
        readers.push(read(pipe, log, tail.clone(), Arc::clone(&notices), Some(show)));
    }
    Ok(Running { program, child, status: None, readers, tail, notices, fewer: None })
}

/// Where lines are shown, until it is muted.
#[derive(Clone)]
struct Show {
    role: Role,
    console: Console,
    muted: Arc<AtomicBool>,
}

/// The last lines of a program.
#[derive(Default)]
struct Tail {
    lines: VecDeque<String>,
    /// How many of them it wrote since it was asked last.
    since: usize,
}

impl Tail {
    fn push(&mut self, line: String) {
        if self.lines.len() == TAIL {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
        self.since = (self.since + 1).min(TAIL);
    }

    /// What it wrote since it was asked last.
    fn words(&self) -> impl Iterator<Item = &String> {
        self.lines.iter().skip(self.lines.len() - self.since)
    }
}

/// Copies lines to the log, the end of them to `tail`, and those of standard
/// error to the console, but for MPI's framed notices about a death, which the
/// coupler reports better. What the launcher records of its ranks is noted only.
fn read(
    pipe: impl Read + Send + 'static,
    log: Arc<Mutex<File>>,
    tail: Arc<Mutex<Tail>>,
    notices: Arc<Mutex<Notices>>,
    show: Option<Show>,
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
            if let Some(state) = recorded(&line) {
                if let Some((rank, state)) = state
                    && let Ok(mut notices) = notices.lock()
                {
                    notices.take(rank, state);
                }
                continue;
            }
            if let Ok(mut log) = log.lock() {
                let _ = writeln!(log, "{line}");
            }
            let frame = line.len() > 20 && line.bytes().all(|b| b == b'-');
            framed ^= frame;
            if frame || framed || line.is_empty() {
                if let Some(rank) = blamed_rank(&line)
                    && let Ok(mut notices) = notices.lock()
                {
                    notices.blamed.get_or_insert(rank);
                }
                continue;
            }
            if let Ok(mut tail) = tail.lock() {
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
    /// A rank has come to a state of OpenMPI's.
    fn take(&mut self, rank: u64, state: &str) {
        match state {
            "ABORTED BY SIGNAL" | "EXITED WITH NON-ZERO STATUS" | "CALLED ABORT" | "FAILED TO START" => {
                self.blamed.get_or_insert(rank);
            }
            "NORMALLY TERMINATED" => {
                self.left.get_or_insert(rank);
            }
            _ => {}
        }
    }
}

/// A line of OpenMPI's record of states: rank and state, `None` inside where it is not about a
/// rank; `None` where it is any other line.
fn recorded(line: &str) -> Option<Option<(u64, &str)>> {
    let (head, rest) = line.split_once("] ACTIVATE ")?;
    let (what, state) = rest.split_once(" STATE ").filter(|_| head.starts_with('['))?;
    let (state, _) = state.split_once(" AT ")?;
    let rank = what.strip_prefix("PROC [[").and_then(|w| w.split_once("],"));
    let rank = rank.and_then(|(_, rank)| rank.strip_suffix(']')?.parse().ok());
    Some(rank.map(|rank| (rank, state)))
}

/// The rank that a line of OpenMPI's notice about a death names: it ends the other ranks
/// itself, so that whoever looks may find all of them gone.
fn blamed_rank(line: &str) -> Option<u64> {
    let number = |text: &str| text.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
    if let Some((_, rest)) = line.split_once("process rank ") {
        return number(rest);
    }
    let (_, rest) = line.split_once("Process name: [[")?.1.split_once("],")?;
    number(rest)
}

/// Polls every 10 ms until `done` or the time is over; whether it was done.
fn wait_until(patience: Duration, done: impl FnMut() -> bool) -> bool {
    Deadline::after(patience).poll(Duration::from_millis(10), done)
}

#[cfg(test)]
mod tests {
    use super::{Notices, blamed_rank, recorded};

    #[test]
    fn the_launcher_s_notices_name_a_rank() {
        let killed = "mpirun noticed that process rank 1 with PID 123 on node n exited on signal 9 (Killed).";
        assert_eq!(blamed_rank(killed), Some(1));
        assert_eq!(blamed_rank("  Process name: [[43310,1],12]"), Some(12));
        assert_eq!(blamed_rank("one or more processes exited with non-zero status"), None);
    }

    #[test]
    fn the_launcher_s_record_tells_who_was_first() {
        let line = |rank: u64, state: &str| {
            format!("[vm:12] [[320,0],0] ACTIVATE PROC [[320,1],{rank}] STATE {state} AT ../odls_base.c:1746")
        };
        let mut notices = Notices::default();
        for (rank, state) in
            [(0, "RUNNING"), (2, "NORMALLY TERMINATED"), (1, "ABORTED BY SIGNAL"), (0, "ABORTED BY SIGNAL")]
        {
            let line = line(rank, state);
            assert_eq!(recorded(&line), Some(Some((rank, state))));
            notices.take(rank, state);
        }
        assert_eq!((notices.blamed, notices.left), (Some(1), Some(2)));
        assert_eq!(
            recorded("[vm:12] [[320,0],0] ACTIVATE JOB [320,1] STATE VM READY AT ../x.c:1"),
            Some(None)
        );
        assert_eq!(recorded("a program may say: ACTIVATE all"), None);
    }
}
