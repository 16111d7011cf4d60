//! Lock of a results folder: only one run writes to it.

use std::fs::{File, TryLockError};
use std::path::Path;
use std::time::Duration;

use coupling::error::RunError;

/// Number of further attempts to lock a folder.
const RETRIES: u32 = 10;

/// Locks the folder `out` until the returned file is dropped. The kernel releases the lock when the process ends.
///
/// # Errors
/// Another run holds the lock, or the lock file cannot be created.
pub fn lock(out: &Path) -> Result<File, RunError> {
    let path = out.join(".lock");
    let file = File::create(&path).map_err(RunError::file("create", &path))?;
    let mut tried = file.try_lock();
    // `is_locked` holds the lock for an instant.
    for _ in 0..RETRIES {
        if !matches!(tried, Err(TryLockError::WouldBlock)) {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
        tried = file.try_lock();
    }
    match tried {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(RunError::Input(format!(
            "another run writes to {}. Wait for its end, or choose another folder with --out",
            out.display()
        ))),
        Err(TryLockError::Error(cause)) => Err(RunError::file("lock", &path)(cause)),
    }
}

/// Whether a run writes to the folder `out`. Does not write to it.
pub fn is_locked(out: &Path) -> bool {
    // Without a lock file no run has started there.
    let Ok(file) = File::open(out.join(".lock")) else { return false };
    matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_run_in_a_folder_is_refused_until_the_first_ends() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(!is_locked(folder.path()));
        let first = lock(folder.path()).expect("the lock");
        assert!(is_locked(folder.path()));
        assert!(lock(folder.path()).expect_err("held").to_string().contains("another run writes to"));
        drop(first);
        assert!(!is_locked(folder.path()));
        lock(folder.path()).expect("free again");
    }
}
