//! Where this program lies, with the others beside it.

use std::path::{Path, PathBuf};

use coupling::error::RunError;

/// This executable.
///
/// # Errors
/// It was replaced while it runs, as a build does: the new one would continue the work of the old one.
pub fn this_program() -> Result<PathBuf, RunError> {
    let me = std::env::current_exe().map_err(RunError::file("find", "this executable"))?;
    if me.exists() {
        return Ok(me);
    }
    Err(RunError::Input(
        "the program `ripstop` was replaced or removed while it runs (by a build?): start the command again; what has \
         been computed is kept"
            .into(),
    ))
}

/// Folder of this executable: the project's programs lie side by side.
pub fn program_folder() -> Result<PathBuf, RunError> {
    let me = std::env::current_exe().map_err(RunError::file("find", "this executable"))?;
    Ok(me.parent().map(Path::to_path_buf).unwrap_or_default())
}
