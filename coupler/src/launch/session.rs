//! A session: its name, and the folder of MPI's temporary files.

use std::fs;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use case::Scene;
use coupling::error::RunError;
use terminal::Console;

/// The session of a stage. Dropping it removes the folder of MPI's temporary files.
pub(crate) struct Session {
    /// Its name, unique on this machine.
    pub name: String,
    scratch: Scratch,
}

impl Session {
    /// Session `number` of this process, which runs `scene`.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn create(scene: &Scene, number: usize) -> Result<Self, RunError> {
        let scene: String = scene.name.chars().take(24).collect();
        let name = format!("{scene}-{}-{number}", std::process::id());
        let scratch = Scratch::create(&name)?;
        Ok(Self { name, scratch })
    }

    /// Folder for MPI's temporary files.
    pub fn scratch(&self) -> &Path {
        &self.scratch.0
    }

    /// Removes the shared memory of a session that has ended.
    pub fn clean_up(&self, console: &Console) {
        if let Err(error) = channel::cleanup(&self.name) {
            console.warning(&format!("shared memory of session {}: {error}", self.name));
        }
    }

    /// Removes the folders of runs that were killed.
    pub fn remove_leftovers() {
        Scratch::sweep();
    }
}

/// Folder for MPI's temporary files, in shared memory, removed when dropped.
struct Scratch(PathBuf);

impl Scratch {
    const PREFIX: &str = "ripstop-mpi-";

    fn base() -> PathBuf {
        let memory = Path::new("/dev/shm");
        if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() }
    }

    /// Removes folders of runs that were killed. Their names contain the process number.
    fn sweep() {
        let Ok(entries) = fs::read_dir(Self::base()) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let Some(session) = name.strip_prefix(Self::PREFIX) else { continue };
            let process = session.rsplit('-').nth(1).and_then(|p| p.parse::<u32>().ok());
            if process.is_some_and(|p| !Path::new(&format!("/proc/{p}")).exists()) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    fn create(session: &str) -> Result<Self, RunError> {
        // Paths of sockets below it have a maximum length, so this path is short.
        let folder = Self::base().join(format!("{}{session}", Self::PREFIX));
        // The parent folder is world-writable. An existing folder with this process number is a leftover
        // of an earlier process of this user, which is removed, or of another user, which makes `create` fail.
        let _ = fs::remove_dir_all(&folder);
        fs::DirBuilder::new().mode(0o700).create(&folder).map_err(RunError::file("create", &folder))?;
        Ok(Self(folder))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A rank that is being killed may still write: retry briefly.
        for _ in 0..20 {
            match fs::remove_dir_all(&self.0) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    std::thread::sleep(Duration::from_millis(25));
                }
                _ => break,
            }
        }
    }
}
