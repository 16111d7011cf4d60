//! Wall time of the timed parts of all programs in a stage.

use std::path::{Path, PathBuf};

use case::Role;
use serde::{Deserialize, Serialize};
use timing::{Part, Profile};

/// Subfolder of a stage for the timings of its programs during the stage.
const FOLDER: &str = "timings";

/// Minimum share of a part in tables.
const MIN_SHARE: f64 = 0.002;

/// Timed parts of a program in a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProgramTimings {
    /// Name of the program.
    pub program: String,
    /// Parts on rank 0, each after the part that contains it; empty if the program wrote none.
    pub parts: Vec<Part>,
}

/// Timed parts of all programs in a stage, since its start or last restart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTimings {
    /// Name of the stage.
    pub stage: String,
    /// The coupler, then the programs that ran.
    pub programs: Vec<ProgramTimings>,
}

/// Timings file of the program `role` in the stage folder `folder`.
pub fn file(folder: &Path, role: Role) -> PathBuf {
    folder.join(FOLDER).join(format!("{}.json", role.name()))
}

/// Removes timings of a killed run in the stage folder `folder`.
pub fn clear(folder: &Path) {
    // Fails if the folder does not exist. Remaining files are only outdated timings.
    let _ = std::fs::remove_dir_all(folder.join(FOLDER));
}

impl StageTimings {
    /// Reads and removes the timings of the programs `roles` in the stage folder `folder`; `coupler`: those of the coupler.
    /// A program without a file (a third-party program, a failed one, or one on another host) has no parts.
    pub fn collect(stage: &str, folder: &Path, roles: &[Role], coupler: Profile) -> Self {
        let own = ProgramTimings { program: "coupler".into(), parts: coupler.parts };
        let others = roles.iter().map(|role| ProgramTimings {
            program: role.program().into(),
            parts: Profile::load(&file(folder, *role)).map(|p| p.parts).unwrap_or_default(),
        });
        let programs = std::iter::once(own).chain(others).collect();
        clear(folder);
        Self { stage: stage.into(), programs }
    }

    /// The table for the terminal: calls, wall time and share of each part, by program.
    pub fn table(&self) -> String {
        let mut lines = vec![format!(
            "  {:<52} {:>9} {:>10} {:>7} {:>11}",
            format!("timings of stage `{}`", self.stage),
            "calls",
            "wall",
            "share",
            "per call"
        )];
        for program in &self.programs {
            if program.parts.is_empty() {
                lines.push(format!("  {}: no timings reported", program.program));
                continue;
            }
            lines.push(format!("  {}", program.program));
            lines.extend(program.rows().map(|row| {
                format!(
                    "  {:<52} {:>9} {:>10} {:>5.1} % {:>8.3} ms",
                    format!("{}{}", "  ".repeat(row.depth), row.name),
                    row.calls,
                    format!("{:.3} s", row.seconds),
                    100.0 * row.share,
                    1e3 * row.seconds / row.calls.max(1) as f64
                )
            }));
        }
        lines.join("\n")
    }
}

/// A table row of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct TimingRow<'a> {
    /// Nesting depth, from 1.
    pub depth: usize,
    /// Name.
    pub name: &'a str,
    /// Number of calls.
    pub calls: u64,
    /// Wall time including nested parts, s.
    pub seconds: f64,
    /// Wall time relative to the sum of the outermost parts of the program.
    pub share: f64,
}

impl ProgramTimings {
    /// The parts with at least 0.2 % of the wall time.
    pub fn rows(&self) -> impl Iterator<Item = TimingRow<'_>> {
        let whole = Profile { parts: self.parts.clone() }.seconds().max(f64::MIN_POSITIVE);
        let rows = self.parts.iter().map(move |part| TimingRow {
            depth: part.path.len(),
            name: part.path.last().map_or("", String::as_str),
            calls: part.calls,
            seconds: part.seconds,
            share: part.seconds / whole,
        });
        rows.filter(|row| row.share >= MIN_SHARE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_are_read_once_and_tabulated() {
        let folder = tempfile::tempdir().unwrap();
        let part = |path: &[&str], calls, seconds| Part {
            path: path.iter().map(|n| (*n).to_owned()).collect(),
            calls,
            seconds,
        };
        let flow = Profile {
            parts: vec![
                part(&["advance"], 4, 3.0),
                part(&["advance", "pressure"], 40, 2.4),
                part(&["save"], 1, 1.0),
            ],
        };
        flow.save(&file(folder.path(), Role::Flow)).unwrap();
        let coupler = Profile { parts: vec![part(&["window"], 4, 4.0), part(&["window", "dust"], 4, 1e-3)] };
        let roles = [Role::Structure, Role::Flow];
        let timings = StageTimings::collect("descent", folder.path(), &roles, coupler);
        assert!(!folder.path().join(FOLDER).exists(), "the files are removed");
        flow.save(&file(folder.path(), Role::Flow)).unwrap();
        clear(folder.path());
        let timings_of_none = StageTimings::collect("descent", folder.path(), &roles, Profile::default());
        assert!(timings_of_none.programs.iter().all(|p| p.parts.is_empty()), "also those of a killed run");
        let names: Vec<_> = timings.programs.iter().map(|p| (p.program.as_str(), p.parts.len())).collect();
        assert_eq!(names, [("coupler", 2), ("structure-solver", 0), ("flow-solver", 3)]);
        let table = timings.table();
        assert!(table.contains("structure-solver: no timings reported"), "{table}");
        let pressure = table.lines().find(|l| l.contains("pressure")).expect("a row");
        assert!(pressure.contains("60.0 %") && pressure.contains("60.000 ms"), "{pressure}");
        assert!(!table.contains("dust"), "{table}");
        let text = serde_json::to_string(&timings).unwrap();
        assert_eq!(serde_json::from_str::<StageTimings>(&text).unwrap(), timings);
    }
}
