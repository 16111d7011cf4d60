//! Checkpoints, from which a run resumes after Ctrl-C, a crash or a full disk.
//!
//! In the folder of a stage, `state` is the last saved state, `state.old` the previous one, and `state.new` the one being
//! written. The last file of a state is its seal, a list of the files with their checksums. A state without a valid seal
//! is skipped.

mod changes;
mod find;
mod progress;
mod record;
mod seal;
mod trim;

use coupling::error::RunError;
pub use find::{Point, find, hint};
pub use progress::Progress;
pub use record::Record;
pub use seal::{Seal, seal};
pub use trim::trim;

use std::path::{Path, PathBuf};

/// Folder to which a state is written first: `state.new`.
pub fn draft(state: &Path) -> PathBuf {
    state.with_extension("new")
}

/// Folder of the previous state: `state.old`.
pub fn old(state: &Path) -> PathBuf {
    state.with_extension("old")
}

/// Replaces `state` by the sealed draft and keeps the former state as `state.old`.
///
/// # Errors
/// A folder cannot be moved. The last complete state can still be found.
pub fn replace(state: &Path) -> Result<(), RunError> {
    let (draft, old) = (draft(state), old(state));
    if state.exists() {
        remove(&old)?;
        std::fs::rename(state, &old).map_err(RunError::file("rename", state))?;
    }
    std::fs::rename(&draft, state).map_err(RunError::file("rename", &draft))?;
    seal::sync_folder(state.parent().unwrap_or(state))
}

/// Removes a folder that may not exist.
///
/// # Errors
/// The folder cannot be removed.
pub fn remove(folder: &Path) -> Result<(), RunError> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(RunError::file("remove", folder)(e)),
        _ => Ok(()),
    }
}

/// Converts an archive error to a run error.
pub(crate) fn unusable(error: archive::Error) -> RunError {
    match error {
        archive::Error::Io { action, path, source } => RunError::File { action, path, source },
        other => RunError::Input(other.to_string()),
    }
}
