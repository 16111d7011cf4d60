//! A CSV file that grows by one row a window.

use std::io::Write;
use std::path::{Path, PathBuf};

use channel::Fault;
use comm::Comm;

/// A table whose first column is the time, s. Only rank 0 writes.
pub struct Table {
    name: &'static str,
    header: String,
    file: Option<(PathBuf, std::fs::File)>,
}

impl Table {
    /// A table `name` with these columns after the time; nothing is written yet.
    pub fn new(name: &'static str, columns: &[String]) -> Self {
        Self {
            name,
            header: ["time_s"]
                .into_iter()
                .chain(columns.iter().map(String::as_str))
                .collect::<Vec<_>>()
                .join(","),
            file: None,
        }
    }

    /// Adds a row; a value that is not finite is an empty cell. The first row drops rows at and after its time that an earlier run
    /// has left. Collective.
    ///
    /// # Errors
    /// The file cannot be written; returned on every rank.
    pub fn row(&mut self, comm: &Comm, folder: &Path, time: f64, values: &[f64]) -> Result<(), Fault> {
        let outcome = if comm.is_root() { self.append(folder, time, values) } else { Ok(()) };
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        let path = folder.join(self.name);
        Err(Fault::new(match outcome {
            Err(e) => format!("cannot write {}: {e}", path.display()),
            Ok(()) => format!("rank 0 could not write {}", path.display()),
        }))
    }

    fn append(&mut self, folder: &Path, time: f64, values: &[f64]) -> std::io::Result<()> {
        if self.file.is_none() {
            std::fs::create_dir_all(folder)?;
            let path = folder.join(self.name);
            let kept = self.earlier(&path, time);
            std::fs::write(&path, kept)?;
            self.file = Some((path.clone(), std::fs::OpenOptions::new().append(true).open(&path)?));
        }
        let mut line = format!("{time:.9}");
        for v in values {
            line.push(',');
            if v.is_finite() {
                line += &format!("{v:.9e}");
            }
        }
        line.push('\n');
        let (_, file) = self.file.as_mut().expect("opened above");
        file.write_all(line.as_bytes())
    }

    /// What the file holds for before `time`: header and rows.
    fn earlier(&self, path: &Path, time: f64) -> String {
        let mut text = self.header.clone() + "\n";
        let old = std::fs::read_to_string(path).unwrap_or_default();
        let mut lines = old.lines();
        if lines.next() == Some(self.header.as_str()) {
            for line in lines {
                let at = line.split(',').next().and_then(|t| t.parse::<f64>().ok());
                if at.is_some_and(|t| t < time - 1e-9 * time.abs().max(1e-9)) {
                    text += line;
                    text.push('\n');
                }
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restart_drops_rows_of_later_times() {
        let folder = tempfile::tempdir().unwrap();
        let (comm, columns) = (Comm::solo(), ["p_pa".to_owned()]);
        let write = |times: &[f64]| {
            let mut table = Table::new("t.csv", &columns);
            times.iter().for_each(|t| table.row(&comm, folder.path(), *t, &[10.0 * t]).unwrap());
            std::fs::read_to_string(folder.path().join("t.csv")).unwrap()
        };
        assert_eq!(write(&[0.1, 0.2, 0.3]).lines().count(), 4);
        let text = write(&[0.2, 0.5]);
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(rows[0], "time_s,p_pa");
        assert_eq!(
            rows[1..],
            ["0.100000000,1.000000000e0", "0.200000000,2.000000000e0", "0.500000000,5.000000000e0"]
        );
        let mut bad = Table::new("t.csv", &columns);
        let message = bad.row(&comm, &folder.path().join("t.csv"), 0.1, &[0.0]).unwrap_err().message;
        assert!(message.contains("cannot write"), "{message}");
    }
}
