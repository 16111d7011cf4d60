//! Progress of a stage: on the terminal, in the log, and in `progress.json` for other programs.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use case::StageKind;
use channel::structure_stats;
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Deserialize, Serialize};
use terminal::{Console, clock, counted};

use crate::eta::Eta;
use crate::history::Row;
use crate::summary::drag;

/// Interval of progress lines without a terminal.
const EVERY: Duration = Duration::from_secs(5);
/// Shortest interval between two versions of the file.
const FILE_EVERY: Duration = Duration::from_millis(500);
/// Name of the file in the folder of results.
const FILE: &str = "progress.json";
/// Columns of a line.
const WIDTH: usize = 80;
/// Columns of the bar.
const BAR: usize = 10;

/// Where a run is: `progress.json`, written at the start of a stage and then at most twice a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageProgress {
    /// Name of the stage.
    pub stage: String,
    /// Number of the stage, from 1.
    pub number: usize,
    /// Number of stages of the scene.
    pub stages: usize,
    /// Completed planned windows.
    pub done: u64,
    /// Planned windows of the stage.
    pub windows: u64,
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// Length of the last window, s; 0 before the first one.
    pub window_s: f64,
    /// Wall time since the programs of the stage joined, s.
    pub wall_s: f64,
    /// Wall time until the last planned window, s; `None` before the first window.
    pub eta_s: Option<f64>,
    /// What is shown on the terminal.
    pub line: String,
}

impl StageProgress {
    /// Reads the file of the run in `out`; `None` where there is none.
    pub fn read(out: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(out.join(FILE)).ok()?).ok()
    }

    /// Removes the file of an earlier run in `out`.
    pub fn remove(out: &Path) {
        // The run writes it again, or fails to write its results.
        let _ = std::fs::remove_file(out.join(FILE));
    }

    fn write(&self, path: &Path) {
        let aside = path.with_extension("part");
        let text = serde_json::to_string_pretty(self).unwrap_or_default() + "\n";
        // An error is ignored: a full disk ends the run when results are written.
        let _ = std::fs::write(&aside, text).and_then(|()| std::fs::rename(&aside, path));
    }
}

/// The progress line of a stage.
pub struct Progress {
    console: Console,
    bar: Option<ProgressBar>,
    kind: StageKind,
    /// Surfaces whose drag is shown.
    drag_of: String,
    eta: Eta,
    start: Instant,
    last_line: Option<Instant>,
    state: StageProgress,
    file: Option<PathBuf>,
    last_file: Option<Instant>,
}

impl Progress {
    /// Progress of a stage of `windows` windows, of which the first `first` are completed.
    pub fn new(console: &Console, stage: &str, kind: StageKind, first: u64, windows: u64) -> Self {
        let bar = (console.colour() && !console.quiet()).then(|| {
            let bar = ProgressBar::new(windows);
            let template = format!("{{prefix:.bold}} {{bar:{BAR}.cyan/dim}} {{msg}}");
            // The template is valid for any width.
            if let Ok(style) = ProgressStyle::with_template(&template) {
                bar.set_style(style.progress_chars("━╸─"));
            }
            bar.set_prefix(short(stage));
            bar
        });
        console.set_bar(bar.clone());
        let state = StageProgress {
            stage: stage.to_owned(),
            number: 1,
            stages: 1,
            done: first,
            windows,
            time_s: 0.0,
            window_s: 0.0,
            wall_s: 0.0,
            eta_s: None,
            line: String::new(),
        };
        Self {
            console: console.clone(),
            bar,
            kind,
            drag_of: case::WatchedForce::Canopy.name().into(),
            eta: Eta::new(first),
            start: Instant::now(),
            last_line: None,
            state,
            file: None,
            last_file: None,
        }
    }

    /// Shows the drag of the surfaces named `of`.
    pub fn with_drag_of(mut self, of: &str) -> Self {
        self.drag_of = of.into();
        self
    }

    /// Writes `progress.json` to the folder of results `out`. The stage is number `number` (from 1) of `stages` and starts
    /// or resumes at `time_s`.
    pub fn with_file(mut self, out: &Path, number: usize, stages: usize, time_s: f64) -> Self {
        (self.state.number, self.state.stages, self.state.time_s) = (number, stages, time_s);
        let path = out.join(FILE);
        self.state.write(&path);
        self.file = Some(path);
        self
    }

    /// Shows work before the first window.
    pub fn note(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(text.to_owned());
        }
    }

    /// Shows a completed window.
    pub fn update(&mut self, row: &Row) {
        let wall_s = self.start.elapsed().as_secs_f64();
        self.eta.add(row.done, wall_s);
        let eta_s = self.eta.rest_s(self.state.windows);
        let parts = parts(self.kind, &self.drag_of, row, self.state.windows, wall_s, eta_s);
        let line = fitted(&format!("[{}] ", short(&self.state.stage)), &parts, WIDTH);
        if let Some(bar) = &self.bar {
            let room = WIDTH - BAR - 2 - short(&self.state.stage).chars().count();
            bar.set_position(row.done);
            bar.set_message(fitted("", &parts, room));
        }
        let last = row.done == self.state.windows;
        if self.last_line.is_none_or(|t| t.elapsed() >= EVERY) || last {
            self.last_line = Some(Instant::now());
            if self.bar.is_some() { self.console.note(&line) } else { self.console.line(&line) }
        }
        (self.state.done, self.state.time_s, self.state.window_s) = (row.done, row.time_s, row.window_s);
        (self.state.wall_s, self.state.eta_s, self.state.line) = (wall_s, eta_s, line);
        if let Some(file) = &self.file
            && (last || self.last_file.is_none_or(|t| t.elapsed() >= FILE_EVERY))
        {
            self.last_file = Some(Instant::now());
            self.state.write(file);
        }
    }

    /// Wall time since the start of the stage, s.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.console.set_bar(None);
        if let Some(bar) = self.bar.take() {
            bar.abandon();
        }
    }
}

/// The name of a stage in at most 20 letters.
fn short(stage: &str) -> String {
    if stage.chars().count() <= 20 {
        return stage.to_owned();
    }
    stage.chars().take(19).chain(['…']).collect()
}

/// `head` and as many of the `parts`, in order, as fit into `columns`.
fn fitted(head: &str, parts: &[String], columns: usize) -> String {
    let mut line = head.to_owned();
    for (at, part) in parts.iter().enumerate() {
        let between = if at == 0 { "" } else { " | " };
        if line.chars().count() + between.len() + part.chars().count() > columns {
            break;
        }
        line += between;
        line += part;
    }
    line
}

/// Parts of the line, the most important ones first.
fn parts(
    kind: StageKind,
    drag_of: &str,
    row: &Row,
    windows: u64,
    wall_s: f64,
    eta_s: Option<f64>,
) -> Vec<String> {
    let eta = eta_s.map_or("-".into(), clock);
    let mut parts =
        vec![format!("{}/{windows}", row.done), format!("t {:.3} s", row.time_s), format!("ETA {eta}")];
    if !row.report.converged {
        parts.push("not converged".into());
    }
    if row.rejected > 0 {
        parts.push(format!("rejected {} x", row.rejected));
    }
    parts.extend(state(kind, drag_of, row));
    parts.push(format!("wall {}", clock(wall_s)));
    parts
}

fn state(kind: StageKind, drag_of: &str, row: &Row) -> Vec<String> {
    let structure = &row.report.stats[case::Role::Structure as usize].values;
    match kind {
        StageKind::PreInflation => vec![
            format!("area {:.1} m2", structure[structure_stats::PROJECTED_AREA]),
            energies(structure[structure_stats::KINETIC_ENERGY], structure[structure_stats::STRAIN_ENERGY]),
            format!("load {:.0} N", structure[structure_stats::VERTICAL_LOAD]),
        ],
        StageKind::FlowOnly | StageKind::Prescribed => vec![drag(drag_of, row.drag_n, 0)],
        StageKind::Trajectory => vec![
            format!("{:.3} m/s", row.descent_speed_m_s),
            format!("fallen {:.1} m", row.trajectory.map_or(0.0, |t| -t.position_m[2])),
        ],
        StageKind::Coupled => {
            // A frame at rest has no speed.
            let speed = (row.descent_speed_m_s != 0.0).then(|| format!("{:.3} m/s", row.descent_speed_m_s));
            let rest = [drag(drag_of, row.drag_n, 0), counted(u64::from(row.report.iterations), "iteration")];
            speed.into_iter().chain(rest).collect()
        }
    }
}

/// Ratio of kinetic to strain energy (both J), or both energies if the strain energy is negligible.
fn energies(kinetic: f64, strain: f64) -> String {
    let ratio = kinetic / strain;
    if ratio < 1e6 { format!("Ek/Es {ratio:.0e}") } else { format!("Ek {kinetic:.1e} J, Es {strain:.1e} J") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negligible_strain_energy_gives_no_ratio() {
        assert_eq!(energies(0.5, 2.0), "Ek/Es 2e-1");
        for (kinetic, strain) in [(3.0, 0.0), (0.0, 0.0), (3.0, 1e-300)] {
            let text = energies(kinetic, strain);
            assert!(text.contains(" J, Es ") && !text.contains("e29"), "{text}");
        }
    }

    fn row() -> Row {
        let mut row = Row { done: 12_345, time_s: 123.456, rejected: 3, window_s: 5e-3, ..Row::default() };
        (row.descent_speed_m_s, row.drag_n) = (12.345, 12_345.6);
        row.report.iterations = 12;
        let structure = &mut row.report.stats[case::Role::Structure as usize].values;
        structure[structure_stats::VERTICAL_LOAD] = 12_345.0;
        structure[structure_stats::PROJECTED_AREA] = 123.0;
        structure[structure_stats::STRAIN_ENERGY] = 1.0;
        row
    }

    /// Large values of all kinds of stage: what does not fit is left out from the end, never the ETA.
    #[test]
    fn lines_have_at_most_80_columns_and_the_eta() {
        use StageKind::{Coupled, FlowOnly, PreInflation, Prescribed, Trajectory};
        for kind in [PreInflation, FlowOnly, Coupled, Prescribed, Trajectory] {
            let parts = parts(kind, "canopy", &row(), 100_000, 40_000.0, Some(360_000.0));
            for stage in ["descent", "a-stage-with-a-name-of-37-characters"] {
                let line = fitted(&format!("[{}] ", short(stage)), &parts, WIDTH);
                let columns = line.chars().count();
                assert!(columns <= WIDTH && line.contains("ETA 6000:00 min"), "{columns}: {line}");
            }
        }
    }

    /// The usual line has all parts.
    #[test]
    fn usual_line_is_complete() {
        let mut row = row();
        (row.done, row.time_s, row.rejected, row.drag_n, row.descent_speed_m_s) = (17, 0.085, 0, 55.1, 3.975);
        (row.report.converged, row.report.iterations) = (true, 3);
        let parts = parts(StageKind::Coupled, "canopy", &row, 20, 8.3, Some(1.46));
        let line = fitted("[descent] ", &parts, WIDTH);
        assert_eq!(line, "[descent] 17/20 | t 0.085 s | ETA 1.5 s | 3.975 m/s | drag 55 N | 3 iterations");
        row.descent_speed_m_s = 0.0;
        let parts = super::parts(StageKind::Coupled, "canopy", &row, 20, 8.3, Some(1.46));
        assert_eq!(parts[3..], ["drag 55 N", "3 iterations", "wall 8.3 s"]);
    }

    #[test]
    fn progress_file_is_written_at_the_start_and_at_the_end() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(StageProgress::read(folder.path()), None);
        let console = Console::new(true);
        let mut progress =
            Progress::new(&console, "descent", StageKind::Coupled, 4, 6).with_file(folder.path(), 3, 3, 0.02);
        let start = StageProgress::read(folder.path()).expect("a file");
        assert_eq!((start.number, start.done, start.time_s, start.eta_s), (3, 4, 0.02, None));
        for done in [5, 6] {
            progress.update(&Row { done, time_s: 5e-3 * done as f64, window_s: 5e-3, ..Row::default() });
        }
        let end = StageProgress::read(folder.path()).expect("a file");
        assert_eq!((end.done, end.windows, end.time_s, end.eta_s), (6, 6, 0.03, Some(0.0)));
        std::fs::write(folder.path().join(FILE), "{").expect("written");
        assert_eq!(StageProgress::read(folder.path()), None);
        StageProgress::remove(folder.path());
        assert!(!folder.path().join(FILE).exists());
    }
}
