//! Progress of a stage on the terminal.

use std::time::{Duration, Instant};

use case::StageKind;
use channel::structure_stats;
use indicatif::{ProgressBar, ProgressStyle};
use terminal::{Console, clock, counted};

use crate::history::Row;
use crate::summary::drag;

/// Interval of progress lines without a terminal.
const EVERY: Duration = Duration::from_secs(5);

/// The progress line of a stage.
pub struct Progress {
    console: Console,
    bar: Option<ProgressBar>,
    stage: String,
    kind: StageKind,
    windows: u64,
    /// Surfaces whose drag is shown.
    drag_of: String,
    /// Windows completed before the restart.
    first: u64,
    start: Instant,
    last_line: Option<Instant>,
}

impl Progress {
    /// Progress of a stage of `windows` windows, of which the first `first` are completed.
    pub fn new(console: &Console, stage: &str, kind: StageKind, first: u64, windows: u64) -> Self {
        let bar = (console.colour() && !console.quiet()).then(|| {
            let bar = ProgressBar::new(windows);
            // The template is constant and valid.
            if let Ok(style) = ProgressStyle::with_template("{prefix:.bold} {bar:24.cyan/dim} {msg}") {
                bar.set_style(style.progress_chars("━╸─"));
            }
            bar.set_prefix(stage.to_owned());
            bar
        });
        console.set_bar(bar.clone());
        Self {
            console: console.clone(),
            bar,
            stage: stage.to_owned(),
            kind,
            windows,
            drag_of: case::WatchedForce::Canopy.name().into(),
            first,
            start: Instant::now(),
            last_line: None,
        }
    }

    /// Shows the drag of the surfaces named `of`.
    pub fn with_drag_of(mut self, of: &str) -> Self {
        self.drag_of = of.into();
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
        let done = row.done;
        let wall = self.start.elapsed().as_secs_f64();
        let rest =
            wall / done.saturating_sub(self.first).max(1) as f64 * self.windows.saturating_sub(done) as f64;
        let mut text = format!(
            "t {:.3} s | {done} of {}{} | wall {} | ETA {}",
            row.time_s,
            counted(self.windows, "window"),
            if row.rejected > 0 { format!(" (rejected {} x)", row.rejected) } else { String::new() },
            clock(wall),
            clock(rest)
        );
        text += &state(self.kind, &self.drag_of, row);
        if let Some(bar) = &self.bar {
            bar.set_position(done);
            bar.set_message(text.clone());
        }
        if self.last_line.is_none_or(|t| t.elapsed() >= EVERY) || done == self.windows {
            self.last_line = Some(Instant::now());
            let line = format!("[{}] {text}", self.stage);
            if self.bar.is_some() { self.console.note(&line) } else { self.console.line(&line) }
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

fn state(kind: StageKind, drag_of: &str, row: &Row) -> String {
    let structure = &row.report.stats[case::Role::Structure as usize].values;
    match kind {
        StageKind::PreInflation => format!(
            " | load {:.0} N | projected area {:.1} m2 | {}",
            structure[structure_stats::VERTICAL_LOAD],
            structure[structure_stats::PROJECTED_AREA],
            energies(structure[structure_stats::KINETIC_ENERGY], structure[structure_stats::STRAIN_ENERGY])
        ),
        StageKind::FlowOnly | StageKind::Prescribed => format!(" | {}", drag(drag_of, row.drag_n, 0)),
        StageKind::Trajectory => format!(
            " | descent {:.3} m/s | {:.1} m below the release",
            row.descent_speed_m_s,
            row.trajectory.map_or(0.0, |t| -t.position_m[2])
        ),
        StageKind::Coupled => format!(
            " | descent {:.3} m/s | drag {:.0} N | {}{}",
            row.descent_speed_m_s,
            row.drag_n,
            counted(u64::from(row.report.iterations), "iteration"),
            if row.report.converged { "" } else { " (not converged)" }
        ),
    }
}

/// Ratio of kinetic to strain energy (both J), or both energies if the strain energy is negligible.
fn energies(kinetic: f64, strain: f64) -> String {
    let ratio = kinetic / strain;
    if ratio < 1e6 {
        format!("kinetic/strain energy {ratio:.1e}")
    } else {
        format!("kinetic energy {kinetic:.1e} J, strain energy {strain:.1e} J")
    }
}

#[cfg(test)]
mod tests {
    use super::energies;

    #[test]
    fn negligible_strain_energy_gives_no_ratio() {
        assert_eq!(energies(0.5, 2.0), "kinetic/strain energy 2.5e-1");
        for (kinetic, strain) in [(3.0, 0.0), (0.0, 0.0), (3.0, 1e-300)] {
            let text = energies(kinetic, strain);
            assert!(text.contains(" J, strain energy ") && !text.contains("e29"), "{text}");
        }
    }
}
