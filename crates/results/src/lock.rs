//! One run at a time writes to a folder.

use std::fs::File;
use std::path::Path;

use coupling::error::RunError;

/// Locks the folder `out` until the file is dropped; the kernel frees the lock however this process ends.
///
/// # Errors
/// Another run holds it, or a file that cannot be made.
pub fn lock(out: &Path) -> Result<File, RunError> {
    let path = out.join(".lock");
    let file = File::create(&path).map_err(RunError::file("create", &path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(RunError::Input(format!(
            "another run writes to {}: wait for it, or name another folder with --out",
            out.display()
        ))),
        Err(std::fs::TryLockError::Error(cause)) => Err(RunError::file("lock", &path)(cause)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_run_in_a_folder_is_refused_until_the_first_ends() {
        let folder = tempfile::tempdir().expect("a folder");
        let first = lock(folder.path()).expect("the lock");
        assert!(lock(folder.path()).expect_err("held").to_string().contains("another run writes to"));
        drop(first);
        lock(folder.path()).expect("free again");
    }
}
