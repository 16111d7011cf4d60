//! Errors of a session, on either side.

use case::Role;

use crate::Fault;

/// A rank of a program, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RankId {
    /// Role of the program.
    pub role: Role,
    /// Rank within the program.
    pub rank: usize,
}

impl std::fmt::Display for RankId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (rank {})", self.role.program(), self.rank)
    }
}

/// The caller of a [`crate::Hub`] ends a wait: a child process died, Ctrl-C.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct Abort {
    /// The message.
    pub message: String,
}

impl Abort {
    /// From any message or error.
    pub fn new(message: impl std::fmt::Display) -> Self {
        Self { message: message.to_string() }
    }
}

/// Why the coupler's side of a session fails.
#[derive(Debug, thiserror::Error)]
pub enum HubError {
    /// A live coupler already has a session of this name.
    #[error(
        "session `{session}` is in use by {owner}: wait for it to end, or run under another session name"
    )]
    SessionInUse {
        /// Name of the session.
        session: String,
        /// Its process.
        owner: String,
    },
    /// Two sides do not match.
    #[error("{message}")]
    Refused {
        /// Who announced what, against what, and the remedy.
        message: String,
    },
    /// A participant reported an error.
    #[error("{who} failed in {during}: {fault}")]
    Fault {
        /// The rank that failed.
        who: RankId,
        /// Window and iteration, or another step of the run.
        during: String,
        /// The reported error.
        fault: Fault,
    },
    /// The process of a participant ended without a message.
    #[error("{who} died in {during} without a message: see its log")]
    Died {
        /// The rank that ended.
        who: RankId,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// A participant did not respond in time.
    #[error("{who} did not respond in {during} for {seconds:.1} s (its deadline){}", state_text(.state))]
    Deadline {
        /// The rank that did not respond.
        who: RankId,
        /// Window and iteration, or another step of the run.
        during: String,
        /// The deadline, s.
        seconds: f64,
        /// State of its process, where the kernel reports it; else empty.
        state: &'static str,
    },
    /// A message out of order, or with contents that violate the contract.
    #[error("{who} violated the contract in {during}: {problem}")]
    Contract {
        /// The rank that sent it.
        who: RankId,
        /// Window and iteration, or another step of the run.
        during: String,
        /// What was expected and what was received.
        problem: String,
    },
    /// The caller requested something that the contract does not allow.
    #[error("the coupler violated the contract: {0}")]
    Misuse(String),
    /// The caller ended the wait.
    #[error(transparent)]
    Aborted(#[from] Abort),
    /// Shared memory, files or locks of the session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// Why a participant's side ends, other than by the coupler's `stop`.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// No coupler serves the session.
    #[error(
        "no coupler opened session `{session}` within {seconds:.1} s: start `ripstop run` or `ripstop attach` first"
    )]
    NoCoupler {
        /// Name of the session.
        session: String,
        /// Waiting time, s.
        seconds: f64,
    },
    /// The coupler refused this participant, or cannot be joined.
    #[error("{message}")]
    Refused {
        /// Who announced what, against what, and the remedy.
        message: String,
    },
    /// The participant's own error; it was reported to the coupler.
    #[error("{during}: {fault}")]
    Fault {
        /// Window and iteration, or another step of the run.
        during: String,
        /// What went wrong.
        fault: Fault,
    },
    /// The run failed elsewhere, as the coupler reported.
    #[error("the run was ended in {during}: {message}")]
    Aborted {
        /// What the coupler reported.
        message: String,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler's process has ended.
    #[error("the coupler of session `{session}` (process {pid}) died in {during}")]
    CouplerDied {
        /// Name of the session.
        session: String,
        /// Its process.
        pid: u32,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler sent nothing for too long.
    #[error(
        "the coupler of session `{session}` sent nothing in {during} for {seconds:.1} s (the deadline of this program)"
    )]
    Deadline {
        /// Name of the session.
        session: String,
        /// The deadline, s.
        seconds: f64,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler or a partner violated the contract.
    #[error("message out of order in {during}: {problem}")]
    Contract {
        /// Window and iteration, or another step of the run.
        during: String,
        /// What was expected and what was received.
        problem: String,
    },
    /// Shared memory, files or locks of the session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// A failure below the contract.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A name that is not valid for a session.
    #[error("`{0}` cannot name a session: 1 to 64 letters, digits, `-`, `_` and `.` are allowed")]
    BadName(String),
    /// A file or folder of the session.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The folder of all sessions is accessible to other users.
    #[error("{path} {problem}, so sessions in it are not safe: remove it")]
    Untrusted {
        /// The folder.
        path: std::path::PathBuf,
        /// Why it is not accepted.
        problem: String,
    },
    /// A process of the session is still running.
    #[error("session `{session}` still has a running process: {who}")]
    StillAlive {
        /// Name of the session.
        session: String,
        /// Name of the process's lock.
        who: String,
    },
    /// Too little shared memory.
    #[error(
        "{what} needs {needed} MB in {path}, where {free} MB are free: make room or enlarge it (mount -o remount,size=...)"
    )]
    Memory {
        /// Shared memory.
        path: std::path::PathBuf,
        /// The service that needs it.
        what: String,
        /// Needed, MB.
        needed: u64,
        /// Free, MB.
        free: u64,
    },
    /// An error of the shared-memory transport.
    #[error("shared memory, {what}: {problem}{}", remedy(.problem))]
    Transport {
        /// Service or port.
        what: String,
        /// Error of the transport.
        problem: String,
    },
}

fn state_text(state: &str) -> String {
    if state.is_empty() { String::new() } else { format!(": {state}") }
}

fn remedy(problem: &str) -> &'static str {
    if problem.contains("Memory") || problem.contains("DataSegment") {
        " (is /dev/shm full? Check with `df -h /dev/shm`)"
    } else {
        ""
    }
}
