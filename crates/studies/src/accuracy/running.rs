//! Progress of a study: a line for each running sample with its ETA, and the number of outstanding runs.

use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use case::Scene;
use indicatif::{ProgressBar, ProgressStyle};
use terminal::Console;
use terminal::clock;

use super::runs;
use super::study::Study;

/// Interval of progress lines without a terminal.
const EVERY: Duration = Duration::from_secs(10);
/// Interval of progress updates on a terminal.
const REDRAWN: Duration = Duration::from_millis(500);

/// A running sample.
#[derive(Clone, Copy)]
struct Running {
    sample: usize,
    since: Instant,
}

/// Completed, running and outstanding runs.
struct State {
    running: Vec<Running>,
    /// Sums of wall time, s, and cost ratio of the completed runs.
    done: (f64, f64),
    /// Sum of the cost ratios of the outstanding runs, and their number.
    left: (f64, usize),
    printed: Instant,
}

/// Progress of the samples of a study.
pub struct Progress<'a> {
    study: &'a Study,
    out: &'a Path,
    console: &'a Console,
    jobs: usize,
    /// Estimated wall time of the base, s.
    guess_s: f64,
    bar: Option<ProgressBar>,
    state: Mutex<State>,
}

impl<'a> Progress<'a> {
    /// Progress of the runs `open` (sample indices), `jobs` at a time; `guess_s`: estimated wall time of the base, s.
    pub fn new(
        study: &'a Study,
        out: &'a Path,
        console: &'a Console,
        jobs: usize,
        open: &[usize],
        guess_s: f64,
    ) -> Self {
        let bar = (console.colour() && !console.quiet()).then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{msg}") {
                bar.set_style(style);
            }
            bar
        });
        console.set_bar(bar.clone());
        let ratio = open.iter().map(|&m| study.samples[m].ratio).sum();
        let state = State {
            running: Vec::new(),
            done: (0.0, 0.0),
            left: (ratio, open.len()),
            printed: Instant::now(),
        };
        Self { study, out, console, jobs: jobs.max(1), guess_s, bar, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Marks a run of `sample` as started.
    pub fn begin(&self, sample: usize) {
        let mut s = self.state();
        s.left.0 -= self.study.samples[sample].ratio;
        s.left.1 -= 1;
        s.running.push(Running { sample, since: Instant::now() });
        drop(s);
        self.report(Some(sample));
    }

    /// Marks the run of `sample` as ended; `counts`: it is complete, so that its wall time improves the ETA of others.
    pub fn end(&self, sample: usize, counts: bool) {
        let mut s = self.state();
        if let Some(at) = s.running.iter().position(|r| r.sample == sample) {
            let r = s.running.remove(at);
            if counts {
                s.done.0 += r.since.elapsed().as_secs_f64();
                s.done.1 += self.study.samples[sample].ratio;
            }
        }
    }

    /// Reports the running samples if the interval has passed.
    pub fn tick(&self) {
        self.report(None);
    }

    /// Reports `begun` at once, and all running samples if the interval has passed.
    fn report(&self, begun: Option<usize>) {
        let mut s = self.state();
        let every = if self.bar.is_some() { REDRAWN } else { EVERY };
        let due = s.printed.elapsed() >= every;
        if s.running.is_empty() || (begun.is_none() && !due) {
            return;
        }
        if due {
            s.printed = Instant::now();
        }
        let rate = if s.done.1 > 0.0 { s.done.0 / s.done.1 } else { self.guess_s };
        let rest = |r: &Running| rate * self.study.samples[r.sample].ratio - r.since.elapsed().as_secs_f64();
        let running: f64 = s.running.iter().map(|r| rest(r).max(0.0)).sum();
        let longest = s.running.iter().map(rest).fold(0.0, f64::max);
        let all = ((rate * s.left.0.max(0.0) + running) / self.jobs as f64).max(longest);
        let shown = s.running.iter().filter(|r| due || self.bar.is_some() || begun == Some(r.sample));
        let lines: Vec<String> = shown.map(|r| self.line(r, rest(r))).collect();
        let left = match s.left.1 {
            0 => "none left".to_owned(),
            n => format!("{n} left"),
        };
        let tail = format!(" | {left}, ETA {}", clock(all));
        match &self.bar {
            Some(bar) => bar.set_message(lines.join("; ") + &tail),
            None => lines.iter().for_each(|l| self.console.line(&format!("      {l}{tail}"))),
        }
    }

    fn line(&self, r: &Running, rest: f64) -> String {
        let sample = &self.study.samples[r.sample];
        let at = place(&runs::run_folder(self.out, sample), &sample.scene);
        let eta = if rest > 0.0 { clock(rest) } else { "overdue".into() };
        format!(
            "running `{}`: {}wall {}, ETA {eta}",
            sample.label,
            at.map(|p| format!("{p}, ")).unwrap_or_default(),
            clock(r.since.elapsed().as_secs_f64())
        )
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        self.console.set_bar(None);
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// Stage and window of a run, from the last history.
fn place(run: &Path, scene: &Scene) -> Option<String> {
    let (at, rows) = (0..scene.stages.len()).rev().find_map(|at| {
        let text = std::fs::read_to_string(case::stage_folder(run, scene, at).join("history.csv")).ok()?;
        Some((at, text.lines().count().saturating_sub(1)))
    })?;
    let stage = &scene.stages[at];
    let of = if stage.duration_s > 0.0 { format!("/{}", stage.windows()) } else { String::new() };
    Some(format!("stage {}, window {rows}{of}", stage.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_shows_stage_and_window_of_the_last_history() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
        let scene = case::load(&file).unwrap();
        let run = tempfile::tempdir().unwrap();
        assert_eq!(place(run.path(), &scene), None);
        let write = |at: usize, rows: usize| {
            let folder = case::stage_folder(run.path(), &scene, at);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("history.csv"), "window\n".repeat(rows + 1)).unwrap();
        };
        write(0, 200);
        write(2, 7);
        assert_eq!(place(run.path(), &scene).unwrap(), "stage descent, window 7/20");
    }
}
