//! What the named parts of all programs took in a stage.

use std::path::{Path, PathBuf};

use case::Role;
use serde::{Deserialize, Serialize};
use timing::{Part, Profile};

/// Folder in that of a stage into which its programs write what their parts took, while the stage lasts.
const FOLDER: &str = "timings";

/// Parts below this share of their program are left out of tables for people.
const LEAST_SHARE: f64 = 0.002;

/// The parts of a program's work in a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProgramTimings {
    /// Name of the program.
    pub program: String,
    /// Its parts on its first rank, each behind the one it lies in. Empty: it did not write any.
    pub parts: Vec<Part>,
}

/// The parts of all programs' work in a stage, since it was begun or resumed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTimings {
    /// Name of the stage.
    pub stage: String,
    /// The coupler, then the programs that ran.
    pub programs: Vec<ProgramTimings>,
}

/// The file into which the program of `role` writes in a stage with this `folder`.
pub fn file(folder: &Path, role: Role) -> PathBuf {
    folder.join(FOLDER).join(format!("{}.json", role.name()))
}

/// Removes what the programs of a killed run wrote in the stage's `folder`.
pub fn clear(folder: &Path) {
    // What is not there need not go, and what stays is at most an old figure.
    let _ = std::fs::remove_dir_all(folder.join(FOLDER));
}

impl StageTimings {
    /// Reads what the programs of `roles` wrote in the stage's `folder` and removes their files; `coupler` is the coupler's
    /// own. A program that wrote nothing (one of another make, one that died, one on another host) has no parts.
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

    /// The table for people: parts by program, with their calls, seconds and share of the program's.
    pub fn table(&self) -> String {
        let mut lines = vec![format!(
            "  {:<52} {:>9} {:>10} {:>7} {:>11}",
            format!("timings of stage `{}`", self.stage),
            "calls",
            "wall",
            "share",
            "a call"
        )];
        for program in &self.programs {
            if program.parts.is_empty() {
                lines.push(format!("  {}: it reported no timings", program.program));
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

/// A part as tables show it.
#[derive(Clone, Debug, PartialEq)]
pub struct TimingRow<'a> {
    /// How many parts it lies in, itself included.
    pub depth: usize,
    /// Its name.
    pub name: &'a str,
    /// How often it ran.
    pub calls: u64,
    /// Wall seconds, parts in it included.
    pub seconds: f64,
    /// The same over those of the program's outermost parts.
    pub share: f64,
}

impl ProgramTimings {
    /// The parts that take a share worth showing.
    pub fn rows(&self) -> impl Iterator<Item = TimingRow<'_>> {
        let whole = Profile { parts: self.parts.clone() }.seconds().max(f64::MIN_POSITIVE);
        let rows = self.parts.iter().map(move |part| TimingRow {
            depth: part.path.len(),
            name: part.path.last().map_or("", String::as_str),
            calls: part.calls,
            seconds: part.seconds,
            share: part.seconds / whole,
        });
        rows.filter(|row| row.share >= LEAST_SHARE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_programs_wrote_is_read_once_and_shown() {
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
        assert!(!folder.path().join(FOLDER).exists(), "their files are gone");
        flow.save(&file(folder.path(), Role::Flow)).unwrap();
        clear(folder.path());
        let timings_of_none = StageTimings::collect("descent", folder.path(), &roles, Profile::default());
        assert!(timings_of_none.programs.iter().all(|p| p.parts.is_empty()), "those of a killed run as well");
        let names: Vec<_> = timings.programs.iter().map(|p| (p.program.as_str(), p.parts.len())).collect();
        assert_eq!(names, [("coupler", 2), ("structure-solver", 0), ("flow-solver", 3)]);
        let table = timings.table();
        assert!(table.contains("structure-solver: it reported no timings"), "{table}");
        let pressure = table.lines().find(|l| l.contains("pressure")).expect("a row");
        assert!(pressure.contains("60.0 %") && pressure.contains("60.000 ms"), "{pressure}");
        assert!(!table.contains("dust"), "{table}");
        let text = serde_json::to_string(&timings).unwrap();
        assert_eq!(serde_json::from_str::<StageTimings>(&text).unwrap(), timings);
    }
}
