//! How a session can fail, on either side.

use case::Role;

use crate::Fault;

/// A rank of a program, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Who {
    /// Role of the program.
    pub role: Role,
    /// Rank within the program.
    pub rank: usize,
}

impl std::fmt::Display for Who {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (rank {})", self.role.program(), self.rank)
    }
}

/// The caller of a [`crate::Hub`] ends a wait: a child process died, Ctrl-C.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct Abort {
    /// One message for a person.
    pub message: String,
}

impl Abort {
    /// From any message or error.
    pub fn new(message: impl std::fmt::Display) -> Self {
        Self { message: message.to_string() }
    }
}

/// Why the coupler's side ends.
#[derive(Debug, thiserror::Error)]
pub enum HubError {
    /// A live coupler already has a session of this name.
    #[error(
        "session `{session}` is in use by {owner}: wait for it to end, or run under another session name"
    )]
    SessionInUse {
        /// Name of the session.
        session: String,
        /// Who holds it.
        owner: String,
    },
    /// Two sides do not fit each other.
    #[error("{message}")]
    Refused {
        /// Who announced what, against what, and the remedy.
        message: String,
    },
    /// A participant reported an error.
    #[error("{who} failed in {during}: {fault}")]
    Fault {
        /// The culprit.
        who: Who,
        /// Window and iteration, or another step of the run.
        during: String,
        /// What it reported.
        fault: Fault,
    },
    /// A participant's process is gone without a word.
    #[error("{who} died in {during} without a message: see its log")]
    Died {
        /// The culprit.
        who: Who,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// A participant did not answer in time.
    #[error("{who} gave no answer in {during} for {seconds:.1} s (its deadline){}", seen(.state))]
    Deadline {
        /// The culprit.
        who: Who,
        /// Window and iteration, or another step of the run.
        during: String,
        /// The deadline, s.
        seconds: f64,
        /// What its process does, where that tells; else empty.
        state: &'static str,
    },
    /// A message came out of turn, or with contents that break the contract.
    #[error("{who} broke the contract in {during}: {problem}")]
    Contract {
        /// The culprit.
        who: Who,
        /// Window and iteration, or another step of the run.
        during: String,
        /// What was expected and what came.
        problem: String,
    },
    /// The caller asked for something that the contract does not allow.
    #[error("the coupler broke the contract: {0}")]
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
        /// How long was waited, s.
        seconds: f64,
    },
    /// The coupler refused this participant, or cannot be joined.
    #[error("{message}")]
    Refused {
        /// Who announced what, against what, and the remedy.
        message: String,
    },
    /// The participant's own error; the coupler was told.
    #[error("{during}: {fault}")]
    Fault {
        /// Window and iteration, or another step of the run.
        during: String,
        /// What went wrong.
        fault: Fault,
    },
    /// The run failed elsewhere, and the coupler said so.
    #[error("the run was ended in {during}: {message}")]
    Aborted {
        /// What the coupler reported.
        message: String,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler's process is gone.
    #[error("the coupler of session `{session}` (process {pid}) died in {during}")]
    CouplerDied {
        /// Name of the session.
        session: String,
        /// Its process.
        pid: u32,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler was silent for too long.
    #[error(
        "the coupler of session `{session}` said nothing in {during} for {seconds:.1} s (the deadline of this program)"
    )]
    Deadline {
        /// Name of the session.
        session: String,
        /// The deadline, s.
        seconds: f64,
        /// Window and iteration, or another step of the run.
        during: String,
    },
    /// The coupler or a partner broke the contract.
    #[error("message out of turn in {during}: {problem}")]
    Contract {
        /// Window and iteration, or another step of the run.
        during: String,
        /// What was expected and what came.
        problem: String,
    },
    /// Shared memory, files or locks of the session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// A failure below the contract.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A name that cannot be a session's.
    #[error("`{0}` cannot name a session: 1 to 64 letters, digits, `-`, `_` and `.` are allowed")]
    BadName(String),
    /// A file or folder of the session.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The folder of all sessions is not this user's alone.
    #[error("{path} {problem}: remove it")]
    Untrusted {
        /// Which.
        path: std::path::PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A process of the session still lives.
    #[error("session `{session}` still has a running process: {who}")]
    StillAlive {
        /// Name of the session.
        session: String,
        /// Name of its lock.
        who: String,
    },
    /// Too little shared memory.
    #[error(
        "{what} needs {needed} MB in {path}, where {free} MB are free: make room or enlarge it (mount -o remount,size=...)"
    )]
    Memory {
        /// Where.
        path: std::path::PathBuf,
        /// For which service.
        what: String,
        /// Needed, MB.
        needed: u64,
        /// Free, MB.
        free: u64,
    },
    /// The shared-memory transport.
    #[error("shared memory, {what}: {problem}{}", remedy(.problem))]
    Transport {
        /// Service or port.
        what: String,
        /// Error of the transport.
        problem: String,
    },
}

fn seen(state: &str) -> String {
    if state.is_empty() { String::new() } else { format!(": {state}") }
}

fn remedy(problem: &str) -> &'static str {
    if problem.contains("Memory") || problem.contains("DataSegment") {
        " (is /dev/shm full? `df -h /dev/shm` tells)"
    } else {
        ""
    }
}
