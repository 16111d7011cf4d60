//! What a program announces to save and resume, and the files of its ranks' memory.

use std::path::{Path, PathBuf};

use case::Role;
use serde::de::DeserializeOwned;

/// The effect that a program announces that can go on in the middle of a stage: it takes
/// `--resume FOLDER` and starts from what it wrote there on `Save`.
pub const RESUME: &str = "resume";

/// Effect of a structure that reports `SUPPORT_FORCE` and `VERTICAL_MOMENTUM`.
pub const SUPPORT_FORCE: &str = "descent.equation";

/// The effect that a program announces that takes the wind of a stage as `case::Scene::wind` gives it: winds
/// and gusts of single stages, and gusts whose clock runs through several.
pub const STAGE_WIND: &str = "stage.wind";

/// File of what a rank remembers beside its share of the program's state: warm starts,
/// factors, all that changes the last digits and that another number of ranks has no use for.
pub fn memory_file(folder: &Path, role: Role, rank: usize, ranks: usize) -> PathBuf {
    folder.join(format!("{}-memory-{rank}-of-{ranks}.bin", role.name()))
}

/// The [`memory_file`] of a rank, an archive of `kind`, where `check` finds nothing wrong with it; `None` where there is
/// no such file: another number of ranks has written the state.
///
/// # Errors
/// [`archive::Error`]: damage, another version, content that does not fit.
pub fn remembered<T: DeserializeOwned>(
    path: &Path,
    kind: [u8; 8],
    version: u32,
    check: impl FnOnce(&T) -> Result<(), String>,
) -> Result<Option<T>, archive::Error> {
    let memory = archive::if_present(archive::load(path, kind, version))?;
    memory.as_ref().map_or(Ok(()), check).map_err(|reason| archive::Error::content(path, reason))?;
    Ok(memory)
}

/// From now on a file that grows beyond the limit of this process (`RLIMIT_FSIZE`) is an error
/// that can be told, and not its end.
pub fn ignore_sigxfsz() {
    // SAFETY: sets a disposition of this process; no memory is involved.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}
