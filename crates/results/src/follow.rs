//! Rows of a CSV file that another process is writing.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use coupling::error::RunError;

use crate::history::{self, Columns};

/// Reader that adds the rows written since its last call. A last line without its end is left for later.
///
/// # Examples
///
/// ```
/// use results::follow::Follower;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("history.csv");
/// let mut rows = Follower::new(&path);
/// assert_eq!(rows.update()?, 0);
/// std::fs::write(&path, "window,time_s\n0,0.5\n1,1")?;
/// rows.update()?;
/// assert_eq!(rows.column("time_s"), Some(&[0.5][..]));
/// std::fs::write(&path, "window,time_s\n0,0.5\n1,1.0\n")?;
/// rows.update()?;
/// assert_eq!(rows.column("time_s"), Some(&[0.5, 1.0][..]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Follower {
    path: PathBuf,
    /// First and last line that were read, with their ends; empty before.
    header: String,
    last: String,
    columns: Columns,
    /// Bytes of the complete lines that were read.
    read: u64,
}

impl Follower {
    /// A reader of `path`, which need not exist yet.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.into(),
            header: String::new(),
            last: String::new(),
            columns: Columns::new(),
            read: 0,
        }
    }

    /// Reads the rows that were added. A file in which they are replaced, as after a restart, is read again from its
    /// start. Returns the number of rows; 0 without a file.
    ///
    /// # Errors
    /// The file cannot be read, or is not a table of numbers.
    pub fn update(&mut self) -> Result<usize, RunError> {
        let mut file = match File::open(&self.path) {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                *self = Self::new(&self.path);
                return Ok(0);
            }
            Err(e) => return Err(RunError::file("read", &self.path)(e)),
        };
        if !self.continues(&mut file) {
            *self = Self::new(&self.path);
        }
        let failed = || RunError::file("read", &self.path);
        file.seek(SeekFrom::Start(self.read)).map_err(failed())?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(failed())?;
        text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        self.append(&text)?;
        Ok(self.rows())
    }

    /// Whether `file` still has the first and the last line that were read, each at its place.
    fn continues(&self, file: &mut File) -> bool {
        let mut has = |at: u64, line: &str| {
            let mut found = vec![0; line.len()];
            let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut found));
            read.is_ok() && found == line.as_bytes()
        };
        has(0, &self.header) && has(self.read - self.last.len() as u64, &self.last)
    }

    /// Adds complete lines.
    fn append(&mut self, text: &str) -> Result<(), RunError> {
        if text.is_empty() {
            return Ok(());
        }
        if self.header.is_empty() {
            self.header = text.lines().next().map(|line| format!("{line}\n")).unwrap_or_default();
            self.columns = history::parse(text, &self.path)?;
        } else {
            let added = history::parse(&format!("{}{text}", self.header), &self.path)?;
            self.columns.iter_mut().zip(added).for_each(|((_, all), (_, new))| all.extend(new));
        }
        self.last = text.lines().last().map(|line| format!("{line}\n")).unwrap_or_default();
        self.read += text.len() as u64;
        Ok(())
    }

    /// Number of rows read.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    /// Values of a column, empty cells as NaN; `None` without such a column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..])
    }

    /// The value of a column in the last row; `None` without one.
    pub fn last(&self, name: &str) -> Option<f64> {
        self.column(name)?.last().copied().filter(|v| v.is_finite())
    }

    /// Names of the columns.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|(name, _)| name.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_row_waits_and_a_replaced_file_is_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("history.csv");
        let mut rows = Follower::new(&path);
        let mut x = |text: &str| {
            std::fs::write(&path, text).expect("written");
            rows.update().expect("rows");
            rows.column("x").map(<[f64]>::to_vec).unwrap_or_default()
        };
        assert_eq!(x("a,"), [0.0; 0]);
        assert_eq!(x("a,x\n1,2\n3,4"), [2.0]);
        assert_eq!(x("a,x\n1,2\n3,45\n"), [2.0, 45.0]);
        // A restart truncates the file and appends other rows, here before the next call.
        assert_eq!(x("a,x\n1,2\n3,46\n5,6\n"), [2.0, 46.0, 6.0]);
        assert_eq!(x("a,x\n1,2\n"), [2.0]);
        assert_eq!(x("x\n7\n"), [7.0]);
        std::fs::remove_file(&path).expect("removed");
        assert_eq!((rows.update().expect("no file"), rows.rows()), (0, 0));
    }

    #[test]
    fn empty_cells_are_not_numbers_and_a_damaged_row_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("history.csv");
        let mut rows = Follower::new(&path);
        std::fs::write(&path, "a,x\n1,2\n3,\n").expect("written");
        assert_eq!(rows.update().expect("rows"), 2);
        assert!(rows.column("x").is_some_and(|v| v[1].is_nan()) && rows.last("x").is_none());
        assert_eq!((rows.last("a"), rows.names().collect::<Vec<_>>()), (Some(3.0), vec!["a", "x"]));
        std::fs::write(&path, "a,x\n1,2\n3,\n4\n").expect("written");
        let error = rows.update().expect_err("a damaged row").to_string();
        assert!(error.contains("1 cells for 2 columns"), "{error}");
    }
}
