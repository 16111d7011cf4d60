//! Location of this program and of the other programs, which are in the same folder.

use std::path::{Path, PathBuf};

use coupling::error::RunError;

/// Path of this executable.
///
/// # Errors
/// The executable was replaced during the run, for example by a build.
pub fn this_program() -> Result<PathBuf, RunError> {
    let me = std::env::current_exe().map_err(RunError::file("find", "this executable"))?;
    if me.exists() {
        return Ok(me);
    }
    Err(RunError::Input(
        "the program `ripstop` was replaced or removed during the run (for example by a build). Start the command again; \
         completed results are kept"
            .into(),
    ))
}

/// Folder of this executable and of the other programs.
pub fn program_folder() -> Result<PathBuf, RunError> {
    let me = std::env::current_exe().map_err(RunError::file("find", "this executable"))?;
    Ok(me.parent().map(Path::to_path_buf).unwrap_or_default())
}
