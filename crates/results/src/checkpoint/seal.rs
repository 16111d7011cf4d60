//! The seal of a saved state: list of its files with checksums, written last, so that incomplete states are detected.

use std::fs::{self, File};
use std::path::Path;

use archive::hash::checksum;
use coupling::error::RunError;
use serde::{Deserialize, Serialize};

use super::unusable;

const FILE: &str = "seal.bin";
const KIND: [u8; 8] = *b"ripseal\0";
const VERSION: u32 = 1;

/// Description of a saved state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seal {
    /// Identity of the run.
    pub run: u64,
    /// Index of the stage.
    pub stage: u64,
    /// Name of the stage.
    pub name: String,
    /// Completed windows.
    pub windows: u64,
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// Reason of the end of the stage; `None` within the stage.
    pub ended: Option<String>,
    /// Names of the programs that do not support restart.
    pub cannot: Vec<String>,
    /// Name, length and checksum of each file.
    files: Vec<(String, u64, u64)>,
}

impl Seal {
    /// Description of a state to be written.
    pub fn new(run: u64, stage: (usize, &str), windows: u64, time_s: f64) -> Self {
        Self {
            run,
            stage: stage.0 as u64,
            name: stage.1.to_owned(),
            windows,
            time_s,
            ended: None,
            cannot: Vec::new(),
            files: Vec::new(),
        }
    }

    /// Reads the seal of `folder` and verifies all files.
    ///
    /// # Errors
    /// A file is missing or damaged, with the reason.
    pub fn of(folder: &Path) -> Result<Self, String> {
        let path = folder.join(FILE);
        if !path.exists() {
            return Err("it was not written completely".into());
        }
        let seal: Self = archive::load(&path, KIND, VERSION).map_err(|e| e.to_string())?;
        for (name, length, sum) in &seal.files {
            let bytes = fs::read(folder.join(name)).map_err(|e| format!("{name}: {e}"))?;
            if bytes.len() as u64 != *length {
                return Err(format!("{name} has {} of {length} bytes", bytes.len()));
            }
            if checksum(&bytes) != *sum {
                return Err(format!("the checksum of {name} does not match"));
            }
        }
        Ok(seal)
    }
}

/// Writes the seal of `folder` and flushes all files to the disk. Returns their total size, bytes.
///
/// # Errors
/// A file cannot be read or written.
pub fn seal(folder: &Path, mut seal: Seal) -> Result<u64, RunError> {
    let mut bytes = 0;
    let entries = fs::read_dir(folder).map_err(RunError::file("read", folder))?;
    let mut paths: Vec<_> = entries.flatten().map(|e| e.path()).filter(|p| p.is_file()).collect();
    paths.sort();
    for path in paths {
        let content = fs::read(&path).map_err(RunError::file("read", &path))?;
        File::open(&path).and_then(|f| f.sync_all()).map_err(RunError::file("write", &path))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        seal.files.push((name, content.len() as u64, checksum(&content)));
        bytes += content.len() as u64;
    }
    bytes += archive::save(&folder.join(FILE), KIND, VERSION, &seal).map_err(unusable)?;
    sync_folder(folder)?;
    Ok(bytes)
}

/// Flushes a folder to the disk.
pub(super) fn sync_folder(folder: &Path) -> Result<(), RunError> {
    File::open(folder).and_then(|f| f.sync_all()).map_err(RunError::file("write", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seal_detects_incomplete_and_damaged_files() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("flow.bin");
        fs::write(&file, [7; 100]).unwrap();
        assert!(Seal::of(folder.path()).unwrap_err().contains("not written completely"));
        let made = Seal::new(5, (1, "descent"), 12, 0.06);
        seal(folder.path(), made).unwrap();
        let found = Seal::of(folder.path()).unwrap();
        assert_eq!((found.run, found.windows, found.files.len()), (5, 12, 1));
        let mut bytes = vec![7; 100];
        bytes[50] = 8;
        fs::write(&file, &bytes).unwrap();
        assert!(Seal::of(folder.path()).unwrap_err().contains("checksum of flow.bin"));
        fs::write(&file, &bytes[..60]).unwrap();
        assert!(Seal::of(folder.path()).unwrap_err().contains("60 of 100 bytes"));
        fs::remove_file(&file).unwrap();
        assert!(Seal::of(folder.path()).unwrap_err().contains("flow.bin"));
    }
}
