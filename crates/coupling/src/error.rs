//! Why a run ends early: errors, their messages and exit codes.

use std::path::PathBuf;

use case::Role;

use crate::impossible_flow::ImpossibleFlow;
use crate::local_mach::SupersonicFlow;
use crate::structure_energy::EnergyCreated;

/// Location in a run: stage, window and coupling iteration.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// Name of the stage.
    pub stage: String,
    /// Window and coupling iteration; `None` before the first window.
    pub window: Option<(u64, u64)>,
}

impl std::fmt::Display for Location {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "stage `{}`", self.stage)?;
        match self.window {
            Some((window, iteration)) => write!(f, ", window {window}, coupling iteration {iteration}"),
            None => write!(f, ", before its first window"),
        }
    }
}

/// Why a run ends early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scene or the command line is not valid.
    #[error("{0}")]
    Input(String),
    /// Ctrl-C or a termination signal.
    #[error("interrupted in {0}")]
    Interrupted(Location),
    /// A run that ended early and can be resumed.
    #[error("{error}\n{hint}")]
    Resumable {
        /// Why it ended.
        error: Box<Self>,
        /// The command that resumes it.
        hint: String,
    },
    /// A program reported an error.
    #[error("{program}{} failed in {place}: {message}", rank_text(*.rank))]
    Fault {
        /// Role of the program.
        role: Role,
        /// Name of the program.
        program: String,
        /// Rank that reported, if known.
        rank: Option<u64>,
        /// Where.
        place: Location,
        /// The program's message.
        message: String,
    },
    /// A process ended on its own.
    #[error("{program}{} ended unexpectedly ({how}) in {place}{}", rank_text(*.rank), tail_text(.tail))]
    Died {
        /// Role of the program.
        role: Role,
        /// Name of the program.
        program: String,
        /// Rank whose process ended, if known.
        rank: Option<u64>,
        /// Exit code or signal.
        how: String,
        /// Where.
        place: Location,
        /// Last lines of its log.
        tail: String,
    },
    /// A program did not respond within its deadline.
    #[error(
        "{program} did not respond for {seconds:.0} s in {place}: {} \
         (--deadline SECONDS raises the limit)",
        if .state.is_empty() { "it hangs, is stopped, or needs longer" } else { .state }
    )]
    Stalled {
        /// Role of the program.
        role: Role,
        /// Name of the program.
        program: String,
        /// Seconds waited.
        seconds: f64,
        /// State of its process, where the kernel reports it; else empty.
        state: &'static str,
        /// Where.
        place: Location,
    },
    /// The grid motion failed. All programs are alive, in the state of the last accepted window.
    #[error("the grid cannot follow the canopy in {place}: {message}{}", saved_text(.saved.as_deref()))]
    GridMotionFailed {
        /// Where.
        place: Location,
        /// Cell, quality and region.
        message: String,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// A program could not solve a window. All programs are alive, in the state of the last accepted window.
    #[error("{program} could not solve {place}: {message}{}", saved_text(.saved.as_deref()))]
    SolveFailed {
        /// Role of the program.
        role: Role,
        /// Name of the program.
        program: String,
        /// Where.
        place: Location,
        /// The program's message.
        message: String,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// A response that would be accepted exceeds its target by too much. All programs are alive, in the state of the
    /// last accepted window.
    #[error("the {what} is not converged in {place}: {message}{}", saved_text(.saved.as_deref()))]
    Unconverged {
        /// Subproblem: flow, structure, grid motion, turbulence equation.
        what: &'static str,
        /// Where.
        place: Location,
        /// Residuals and remedies.
        message: String,
        /// A shorter window may converge.
        shorter: bool,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// Time integration of the structure creates energy beyond the work done. All programs are alive, in the state of
    /// the last accepted window.
    #[error("{energy} in {place}{}", saved_text(.saved.as_deref()))]
    Energy {
        /// Where.
        place: Location,
        /// The energies.
        energy: EnergyCreated,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// Speeds or pressures of the flow beyond physical bounds.
    #[error("{flow} in {place}{}", saved_text(.saved.as_deref()))]
    ImpossibleFlow {
        /// Where.
        place: Location,
        /// The values.
        flow: ImpossibleFlow,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// A local Mach number beyond what the equations describe.
    #[error("{flow}; in {place}")]
    Supersonic {
        /// Where.
        place: Location,
        /// The Mach number.
        flow: SupersonicFlow,
    },
    /// The coupling iteration failed although every program responded.
    #[error("the coupling failed in {place}: {message}")]
    Coupling {
        /// Where.
        place: Location,
        /// Residuals and remedies.
        message: String,
    },
    /// The acceleration of the frame exceeds the measured forces. All programs are in the state of the last accepted
    /// window.
    #[error("the descent is not physical in {place}: {message}")]
    Unphysical {
        /// Where.
        place: Location,
        /// Values and remedies.
        message: String,
    },
    /// The channel reported an error (handshake, mismatch, out of memory).
    #[error("{place}: {message}")]
    Channel {
        /// Where.
        place: Location,
        /// The channel's message.
        message: String,
    },
    /// A run that was to end where it deviates from its baseline.
    #[error("{place}: the run deviates from its baseline: {message}")]
    Deviates {
        /// Where.
        place: Location,
        /// The first deviation.
        message: String,
    },
    /// A comparison failed or a program violated the contract; the report is already printed.
    #[error("comparison failed or contract violated; see above")]
    Differs,
    /// A study without a result: its base sample failed, or nothing could be assessed.
    #[error("{0}")]
    Study(String),
    /// A run that was followed ended early.
    #[error("the run ended early: {how}")]
    Followed {
        /// Why.
        how: String,
        /// Its exit code.
        code: u8,
    },
    /// A file could not be read or written.
    #[error("cannot {action} {}: {source}", .path.display())]
    File {
        /// read, write, create
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
}

impl From<case::NotATable> for RunError {
    fn from(problem: case::NotATable) -> Self {
        Self::Input(problem.to_string())
    }
}

fn saved_text(folder: Option<&std::path::Path>) -> String {
    folder.map(|f| format!("; the last accepted window is saved in {}", f.display())).unwrap_or_default()
}

fn rank_text(rank: Option<u64>) -> String {
    rank.map(|r| format!(" rank {r}")).unwrap_or_default()
}

fn tail_text(tail: &str) -> String {
    if tail.is_empty() { String::new() } else { format!("; last lines of its log:\n{tail}") }
}

impl RunError {
    /// For `map_err` on file operations.
    pub fn file(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { action, path, source }
    }

    /// Whether all programs are in the state of the last accepted window, so that a shorter window may be tried.
    pub fn is_retryable(&self) -> bool {
        match self {
            Self::GridMotionFailed { .. }
            | Self::SolveFailed { .. }
            | Self::Energy { .. }
            | Self::Coupling { .. }
            | Self::Unphysical { .. } => true,
            Self::Unconverged { shorter, .. } => *shorter,
            _ => false,
        }
    }

    /// The same error with the folder in which the last accepted window was saved.
    pub fn with_saved_state(self, folder: PathBuf) -> Self {
        match self {
            Self::GridMotionFailed { place, message, .. } => {
                Self::GridMotionFailed { place, message, saved: Some(folder) }
            }
            Self::SolveFailed { role, program, place, message, .. } => {
                Self::SolveFailed { role, program, place, message, saved: Some(folder) }
            }
            Self::Unconverged { what, place, message, shorter, .. } => {
                Self::Unconverged { what, place, message, shorter, saved: Some(folder) }
            }
            Self::Energy { place, energy, .. } => Self::Energy { place, energy, saved: Some(folder) },
            other => other,
        }
    }

    /// The same error with a cause and its remedy appended, where it concerns a window.
    pub fn with_advice(mut self, advice: &str) -> Self {
        match &mut self {
            Self::GridMotionFailed { message, .. }
            | Self::SolveFailed { message, .. }
            | Self::Unconverged { message, .. }
            | Self::Coupling { message, .. }
            | Self::Fault { message, .. } => {
                message.push_str(". ");
                message.push_str(advice);
            }
            _ => {}
        }
        self
    }

    /// The exit code of `ripstop` for this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Interrupted(_) => 130,
            Self::Resumable { error, .. } => error.exit_code(),
            Self::Differs | Self::Deviates { .. } => 3,
            Self::Followed { code, .. } => *code,
            _ => 1,
        }
    }
}
