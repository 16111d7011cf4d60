//! Why a run ends early, in words for a person.

use std::path::PathBuf;

use case::Role;

use crate::impossible_flow::ImpossibleFlow;
use crate::structure_energy::EnergyCreated;

/// Where in a run something happened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Name of the stage.
    pub stage: String,
    /// Window and coupling iteration, once the first one was opened.
    pub window: Option<(u64, u64)>,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "stage `{}`", self.stage)?;
        match self.window {
            Some((window, iteration)) => write!(f, ", window {window}, coupling iteration {iteration}"),
            None => write!(f, ", before its first window"),
        }
    }
}

/// Why a run ended before its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scene or the command line asks for something impossible.
    #[error("{0}")]
    Input(String),
    /// Ctrl-C or a termination signal.
    #[error("interrupted in {0}")]
    Interrupted(Place),
    /// A run that ended early, and how it can be gone on with.
    #[error("{error}\n{hint}")]
    Resumable {
        /// Why it ended.
        error: Box<Self>,
        /// The command.
        hint: String,
    },
    /// A program reported an error.
    #[error("{program}{} failed in {place}: {message}", rank_text(*.rank))]
    Fault {
        /// Role of the program.
        role: Role,
        /// What was started.
        program: String,
        /// Rank that reported, if known.
        rank: Option<u64>,
        /// Where.
        place: Place,
        /// The program's own words.
        message: String,
    },
    /// A process ended on its own.
    #[error("{program}{} ended unexpectedly ({how}) in {place}{}", rank_text(*.rank), tail_text(.tail))]
    Died {
        /// Role of the program.
        role: Role,
        /// What was started.
        program: String,
        /// Rank that died, if known.
        rank: Option<u64>,
        /// Exit code or signal.
        how: String,
        /// Where.
        place: Place,
        /// Its last words.
        tail: String,
    },
    /// A program answered nothing within its deadline.
    #[error(
        "{program} gave no answer for {seconds:.0} s in {place}: {} \
         (--deadline SECONDS raises the limit)",
        if .state.is_empty() { "it hangs, is stopped, or is slower than that" } else { .state }
    )]
    Stalled {
        /// Role of the program.
        role: Role,
        /// What was started.
        program: String,
        /// Seconds waited.
        seconds: f64,
        /// What its process does, where that tells; else empty.
        state: &'static str,
        /// Where.
        place: Place,
    },
    /// The grid cannot follow the canopy. All programs are alive and stand at the last accepted
    /// window.
    #[error("the grid cannot follow the canopy in {place}: {message}{}", saved_text(.saved.as_deref()))]
    Stuck {
        /// Where.
        place: Place,
        /// Cell, quality and region.
        message: String,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// A program has no answer for a window. All programs are alive and stand at the last accepted
    /// window.
    #[error("{program} found no answer in {place}: {message}{}", saved_text(.saved.as_deref()))]
    NoAnswer {
        /// Role of the program.
        role: Role,
        /// What was started.
        program: String,
        /// Where.
        place: Place,
        /// What it says of it.
        message: String,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// An answer that would be accepted lies too far above its target. All programs are alive and stand at the
    /// last accepted window.
    #[error("the {what} is not converged in {place}: {message}{}", saved_text(.saved.as_deref()))]
    Unconverged {
        /// What: flow, structure, grid motion, turbulence.
        what: &'static str,
        /// Where.
        place: Place,
        /// Figures and remedies.
        message: String,
        /// A shorter window may converge.
        shorter: bool,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// Time integration of the structure creates energy beyond the work done. All programs are alive and
    /// stand at the last accepted window.
    #[error("{energy} in {place}{}", saved_text(.saved.as_deref()))]
    Energy {
        /// Where.
        place: Place,
        /// The figures.
        energy: EnergyCreated,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// Speeds or pressures of the flow that no physics allows.
    #[error("{flow} in {place}{}", saved_text(.saved.as_deref()))]
    ImpossibleFlow {
        /// Where.
        place: Place,
        /// The figures.
        flow: ImpossibleFlow,
        /// Folder of the state that was saved.
        saved: Option<PathBuf>,
    },
    /// The coupling iteration failed although every program answered.
    #[error("the coupling failed in {place}: {message}")]
    Coupling {
        /// Where.
        place: Place,
        /// What was seen and what to do.
        message: String,
    },
    /// The falling frame does what no measured force explains. All programs stand at the last accepted window.
    #[error("the descent is not physical in {place}: {message}")]
    Unphysical {
        /// Where.
        place: Place,
        /// Figures and remedies.
        message: String,
    },
    /// The channel refused (handshake, mismatch, out of memory).
    #[error("{place}: {message}")]
    Channel {
        /// Where.
        place: Place,
        /// The channel's message.
        message: String,
    },
    /// What was compared is not the same; the report was printed.
    #[error("not the same, or not as the contract asks: see above")]
    Differs,
    /// A study without an answer: its base sample failed, or nothing could be assessed.
    #[error("{0}")]
    Study(String),
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
    if tail.is_empty() { String::new() } else { format!("; its last words:\n{tail}") }
}

impl RunError {
    /// For `map_err` on file operations.
    pub fn file(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { action, path, source }
    }

    /// Whether the programs still stand at the last accepted window, so that a shorter window may pass.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Stuck { .. }
            | Self::NoAnswer { .. }
            | Self::Energy { .. }
            | Self::Coupling { .. }
            | Self::Unphysical { .. } => true,
            Self::Unconverged { shorter, .. } => *shorter,
            _ => false,
        }
    }

    /// The same, with the folder in which the last accepted window was saved.
    pub fn saved_in(self, folder: PathBuf) -> Self {
        match self {
            Self::Stuck { place, message, .. } => Self::Stuck { place, message, saved: Some(folder) },
            Self::NoAnswer { role, program, place, message, .. } => {
                Self::NoAnswer { role, program, place, message, saved: Some(folder) }
            }
            Self::Unconverged { what, place, message, shorter, .. } => {
                Self::Unconverged { what, place, message, shorter, saved: Some(folder) }
            }
            Self::Energy { place, energy, .. } => Self::Energy { place, energy, saved: Some(folder) },
            other => other,
        }
    }

    /// The same with a cause and its remedy at the end, where the error is about a window.
    pub fn advised(mut self, advice: &str) -> Self {
        match &mut self {
            Self::Stuck { message, .. }
            | Self::NoAnswer { message, .. }
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
            Self::Differs => 3,
            _ => 1,
        }
    }
}
