//! Truncates the tables and series of a stage to the state from which it restarts, including an incomplete last row.

use std::fs;
use std::path::Path;

use coupling::error::RunError;

/// Truncates all tables (`.csv`, first column `window` or `time_s`) and series (`.pvd`) in `folder` to `windows` windows,
/// which end at `time` (s).
///
/// # Errors
/// A file cannot be read or written.
pub fn trim(folder: &Path, windows: u64, time: f64) -> Result<(), RunError> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for path in entries.flatten().map(|e| e.path()).filter(|p| p.is_file()) {
        let cut: fn(&str, u64, f64) -> String = match path.extension().and_then(|e| e.to_str()) {
            Some("csv") => table,
            Some("pvd") => series,
            _ => continue,
        };
        let text = fs::read_to_string(&path).map_err(RunError::file("read", &path))?;
        let kept = cut(&text, windows, time);
        if kept != text {
            let aside = path.with_extension("part");
            fs::write(&aside, kept)
                .and_then(|()| fs::rename(&aside, &path))
                .map_err(RunError::file("write", &path))?;
        }
    }
    Ok(())
}

/// Whether time `t` is not after the saved `time`; tables have nine digits.
fn known(t: f64, time: f64) -> bool {
    t <= time * (1.0 + 1e-8) + 1e-9
}

fn table(text: &str, windows: u64, time: f64) -> String {
    let Some((header, rows)) = text.split_once('\n') else { return text.to_owned() };
    let by_window = match header.split(',').next() {
        Some("window") => true,
        Some("time_s") => false,
        _ => return text.to_owned(),
    };
    let cells = header.split(',').count();
    let mut kept = format!("{header}\n");
    for row in rows.split_inclusive('\n') {
        let first = row.split(',').next().unwrap_or_default();
        let inside = if by_window {
            first.parse::<u64>().is_ok_and(|w| w < windows)
        } else {
            first.parse::<f64>().is_ok_and(|t| known(t, time))
        };
        if inside && row.ends_with('\n') && row.split(',').count() == cells {
            kept += row;
        }
    }
    kept
}

fn series(text: &str, _windows: u64, time: f64) -> String {
    let of = |line: &str| {
        let from = line.find("timestep=\"")? + 10;
        line[from..].split('"').next()?.parse::<f64>().ok()
    };
    text.split_inclusive('\n').filter(|line| of(line).is_none_or(|t| known(t, time))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_after_the_state_and_incomplete_rows_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
        write("history.csv", "window,a\n0,1\n1,2\n2,3\n3,");
        write("short.csv", "window,a\n0,1\n1");
        write("probes.csv", "time_s,a\n0.100000000,1\n0.200000001,2\n0.3,3\n");
        write("other.csv", "name,a\nx,1\n");
        write("flow.pvd", "<C>\n <DataSet timestep=\"0.2\"/>\n <DataSet timestep=\"0.3\"/>\n</C>\n");
        trim(folder.path(), 2, 0.2).unwrap();
        let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
        assert_eq!(read("history.csv"), "window,a\n0,1\n1,2\n");
        assert_eq!(read("short.csv"), "window,a\n0,1\n");
        assert_eq!(read("probes.csv"), "time_s,a\n0.100000000,1\n0.200000001,2\n");
        assert_eq!(read("other.csv"), "name,a\nx,1\n");
        assert_eq!(read("flow.pvd"), "<C>\n <DataSet timestep=\"0.2\"/>\n</C>\n");
        assert!(!folder.path().join("history.part").exists());
    }
}
