//! What a user asks of a run.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;

use crate::settings::Setting;

/// What a user asks of a run, beside the scene.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Scene file.
    pub scene: PathBuf,
    /// Folder of the results; the scene's own, or `runs/<name>`, if absent.
    pub out: Option<PathBuf>,
    /// Values instead of the scene's.
    pub settings: Vec<Setting>,
    /// Ranks instead of the scene's.
    pub ranks: Vec<(Role, u32)>,
    /// Programs instead of the project's.
    pub programs: Vec<(Role, String)>,
    /// Options for `mpirun`, of one program or of all.
    pub mpirun: Vec<(Option<Role>, String)>,
    /// Name of the stage to start at; the stages before it were run earlier.
    pub stage: Option<String>,
    /// Runs no stage after it.
    pub only: bool,
    /// Stops each stage after so many windows.
    pub stop_after_windows: Option<u64>,
    /// Accepts windows that are not converged.
    pub accept_unconverged: bool,
    /// Longest time for one answer of a program.
    pub deadline: Option<Duration>,
    /// Programs that somebody else starts.
    pub attach: Vec<Role>,
    /// Resumes the run in the folder.
    pub resume: bool,
    /// Ends all at once when it becomes true; windows are finished first when only the run's flag to
    /// stop is. `None`: that flag already ends all.
    pub now: Option<Arc<AtomicBool>>,
    /// Windows between saves instead of the scene's; 0: none.
    pub checkpoint_every: Option<u32>,
    /// Keeps every exchange.
    pub record: Option<RecordOptions>,
    /// Compares every exchange with a recording.
    pub baseline: Option<BaselineOptions>,
}

/// How a run is recorded.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Leaves out the moving grid.
    pub without_grid: bool,
}

/// Comparison of a run with a baseline.
#[derive(Clone, Debug)]
pub struct BaselineOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Largest relative difference that is none.
    pub tolerance: f64,
    /// Judges counts of iterations, as [`results::recording::Comparison`].
    pub iteration_tolerance: Option<f64>,
    /// Ends the run at the first deviation.
    pub stop: bool,
}
