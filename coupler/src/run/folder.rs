//! The results folder of a run and the folder of its recording.

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

/// Log of all console output in the folder of results.
const LOG: &str = "ripstop.log";

/// Creates and locks the results folder, opens its log and copies the scene to it. Returns the lock.
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
        None => copy_scene(file, out)?,
    }
    Ok(lock)
}

/// Writes the record that identifies the run. Returns its identity.
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

/// Creates the folder of a recording that starts with stage `first`.
pub(super) fn open_recording(
    record: &RecordOptions,
    prepared: &Prepared,
    first: usize,
) -> Result<(), RunError> {
    fs::create_dir_all(&record.folder).map_err(RunError::file("create", &record.folder))?;
    copy_scene(&prepared.file, &record.folder)?;
    results::state::copy_states(&prepared.scene, first, &prepared.out, &record.folder)
}

/// Clears the folder of a stage if it contains results of an earlier run, and creates it.
pub(super) fn clear(folder: &Path) -> Result<(), RunError> {
    if folder.join("history.csv").exists() || folder.join("logs").exists() {
        fs::remove_dir_all(folder).map_err(RunError::file("clear", folder))?;
    }
    fs::create_dir_all(folder).map_err(RunError::file("create", folder))
}

/// Copies the scene `file` into the folder `out`, with absolute paths of the files that it names.
pub(crate) fn copy_scene(file: &Path, out: &Path) -> Result<(), RunError> {
    let copy = out.join(SCENE);
    if copy != file {
        let text = fs::read_to_string(file).map_err(RunError::file("read", file))?;
        let folder = file.parent().unwrap_or(Path::new(""));
        fs::write(&copy, case::with_absolute_paths(&text, folder)).map_err(RunError::file("write", &copy))?;
    }
    Ok(())
}
