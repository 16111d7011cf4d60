//! The folder of a run's results, and that of its recording.

use std::fs::{self, File};
use std::path::Path;

use checks::Inspection;
use coupling::error::RunError;
use results::checkpoint::Record;
use terminal::Console;

use super::options::{RecordOptions, RunOptions};
use super::prepare::Prepared;
use super::resume::Resume;

/// Copy of the scene in the folder of results.
pub(super) const SCENE: &str = "scene.toml";

/// Everything that was printed, in the folder of results.
const LOG: &str = "ripstop.log";

/// Makes and locks the folder, begins its log and keeps the scene in it; the lock.
pub(super) fn open(
    options: &RunOptions,
    prepared: &Prepared,
    inspection: &Inspection,
    console: &Console,
) -> Result<File, RunError> {
    let Prepared { file, text, out, .. } = prepared;
    fs::create_dir_all(out).map_err(RunError::file("create", out))?;
    let lock = results::lock::lock(out)?;
    let log = out.join(LOG);
    console.log_to(&log, options.resume || options.stage.is_some()).map_err(RunError::file("write", &log))?;
    console.note(&std::env::args().collect::<Vec<_>>().join(" "));
    inspection.above_notes().iter().for_each(|finding| console.note(&finding.line()));
    match text {
        Some(text) => fs::write(file, text).map_err(RunError::file("write", file))?,
        None => keep_scene(file, out)?,
    }
    Ok(lock)
}

/// Writes what identifies the run; its identity.
pub(super) fn identify(
    prepared: &Prepared,
    first: usize,
    resume: Option<&mut Resume>,
) -> Result<u64, RunError> {
    let Prepared { scene, file, out, .. } = prepared;
    if let Some(resume) = resume {
        return resume.begin(scene, out);
    }
    let record = Record::new(scene, file, first);
    record.write(out)?;
    Ok(record.run)
}

/// Makes the folder of a recording that starts with stage `first`.
pub(super) fn open_recording(
    record: &RecordOptions,
    prepared: &Prepared,
    first: usize,
) -> Result<(), RunError> {
    fs::create_dir_all(&record.folder).map_err(RunError::file("create", &record.folder))?;
    keep_scene(&prepared.file, &record.folder)?;
    results::state::copy_states(&prepared.scene, first, &prepared.out, &record.folder)
}

/// Removes what an earlier run left in a stage's folder, and only if it is one.
pub(super) fn clear(folder: &Path) -> Result<(), RunError> {
    if folder.join("history.csv").exists() || folder.join("logs").exists() {
        fs::remove_dir_all(folder).map_err(RunError::file("clear", folder))?;
    }
    fs::create_dir_all(folder).map_err(RunError::file("create", folder))
}

/// Copies the scene `file` into the folder `out`.
pub(crate) fn keep_scene(file: &Path, out: &Path) -> Result<(), RunError> {
    let copy = out.join(SCENE);
    if copy != file {
        fs::copy(file, &copy).map_err(RunError::file("write", &copy))?;
    }
    Ok(())
}
