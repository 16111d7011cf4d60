//! Lock of a results folder: only one run writes to it.

use std::fs::File;
use std::path::Path;

use coupling::error::RunError;

/// Locks the folder `out` until the returned file is dropped. The kernel releases the lock when the process ends.
///
/// # Errors
/// Another run holds the lock, or the lock file cannot be created.
pub fn lock(out: &Path) -> Result<File, RunError> {
    let path = out.join(".lock");
    let file = File::create(&path).map_err(RunError::file("create", &path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(RunError::Input(format!(
            "another run writes to {}. Wait for its end, or choose another folder with --out",
            out.display()
        ))),
        Err(std::fs::TryLockError::Error(cause)) => Err(RunError::file("lock", &path)(cause)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_run_in_a_folder_is_refused_until_the_first_ends() {
        let folder = tempfile::tempdir().expect("a folder");
        let first = lock(folder.path()).expect("the lock");
        assert!(lock(folder.path()).expect_err("held").to_string().contains("another run writes to"));
        drop(first);
        lock(folder.path()).expect("free again");
    }
}
