//! Options of a run.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;

use crate::settings::Setting;

/// Options of a run in addition to its scene.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Scene file.
    pub scene: PathBuf,
    /// Folder of the results. `None`: the scene's `output.folder`, or `runs/<name>`.
    pub out: Option<PathBuf>,
    /// Overridden values of the scene.
    pub settings: Vec<Setting>,
    /// Overridden rank counts.
    pub ranks: Vec<(Role, u32)>,
    /// Commands that replace the project's programs.
    pub programs: Vec<(Role, String)>,
    /// Options of `mpirun`, for one program or for all.
    pub mpirun: Vec<(Option<Role>, String)>,
    /// Name of the first stage to run; earlier stages have saved states.
    pub stage: Option<String>,
    /// Runs only that stage.
    pub only: bool,
    /// Maximum number of windows of each stage.
    pub stop_after_windows: Option<u64>,
    /// Accepts windows that are not converged.
    pub accept_unconverged: bool,
    /// Time limit for one reply of a program.
    pub deadline: Option<Duration>,
    /// Level of the logs of the programs. `None`: the environment's, or their own default.
    pub log_level: Option<LogLevel>,
    /// Programs that the user starts.
    pub attach: Vec<Role>,
    /// Resumes the run in the folder.
    pub resume: bool,
    /// Ends the run immediately when it becomes true; the run's stop flag then completes the current window first.
    /// `None`: the stop flag itself ends the run immediately.
    pub now: Option<Arc<AtomicBool>>,
    /// Windows between checkpoints instead of the scene's; 0: none within a stage.
    pub checkpoint_every: Option<u32>,
    /// Records all messages.
    pub record: Option<RecordOptions>,
    /// Compares all messages with a recording.
    pub baseline: Option<BaselineOptions>,
}

/// What programs write to their logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogLevel {
    /// What the program computes and its totals.
    Info,
    /// Each solve too: iterations, residual and its target, time.
    Debug,
}

impl LogLevel {
    /// The word for `RIPSTOP_LOG`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Debug => "debug",
        }
    }
}

/// How a run is recorded.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Omits the moving grid.
    pub without_grid: bool,
}

/// Comparison of a run with a baseline.
#[derive(Clone, Debug)]
pub struct BaselineOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Relative tolerance of fields.
    pub tolerance: f64,
    /// Relative tolerance of iteration counts. `None`: their differences are reported, not judged.
    pub iteration_tolerance: Option<f64>,
    /// Ends the run at the first deviation.
    pub stop: bool,
}
