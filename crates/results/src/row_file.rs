//! A CSV file that grows by rows and is flushed after each addition.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use coupling::error::RunError;

/// Writer of a CSV file.
pub(crate) struct RowFile {
    path: PathBuf,
    file: BufWriter<File>,
}

impl RowFile {
    /// Creates the file with its header line, or, where the stage is `resumed`, appends to one that was truncated to the restart
    /// window.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn open(path: &Path, header: &str, resumed: bool) -> Result<Self, RunError> {
        let append = resumed && path.exists();
        let file = if append { File::options().append(true).open(path) } else { File::create(path) };
        let action = if append { "write" } else { "create" };
        let file = file.map_err(RunError::file(action, path))?;
        let mut rows = Self { path: path.into(), file: BufWriter::new(file) };
        if !append {
            rows.push(&[header])?;
        }
        Ok(rows)
    }

    /// Adds rows.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, rows: &[impl AsRef<str>]) -> Result<(), RunError> {
        rows.iter()
            .try_for_each(|row| writeln!(self.file, "{}", row.as_ref()))
            .and_then(|()| self.file.flush())
            .map_err(RunError::file("write", &self.path))
    }

    /// Writes all rows to the disk, as required before a state is saved.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn sync(&self) -> Result<(), RunError> {
        self.file.get_ref().sync_data().map_err(RunError::file("write", &self.path))
    }
}
