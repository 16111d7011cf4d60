//! Checkpoints: a run resumes from them after Ctrl-C, a crash or a full disk.
//!
//! A stage's folder `state` holds the last saved state, `state.old` the one before and, while one is
//! being written, `state.new`. Each is sealed: a list of its files with their checksums is
//! written last. Whatever has no whole seal is passed over.

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

/// The folder beside `state` that a state is written to first.
pub fn draft(state: &Path) -> PathBuf {
    state.with_extension("new")
}

/// The folder beside `state` of the state before.
pub fn old(state: &Path) -> PathBuf {
    state.with_extension("old")
}

/// Puts the sealed draft into the place of `state`, whose content is kept as the old one.
///
/// # Errors
/// Trouble with the folders; the last whole state is then still found.
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
/// Trouble with the folder.
pub fn remove(folder: &Path) -> Result<(), RunError> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(RunError::file("remove", folder)(e)),
        _ => Ok(()),
    }
}

/// An archive's error in words of a run.
pub(crate) fn unusable(error: archive::Error) -> RunError {
    match error {
        archive::Error::Io { action, path, source } => RunError::File { action, path, source },
        other => RunError::Input(other.to_string()),
    }
}
