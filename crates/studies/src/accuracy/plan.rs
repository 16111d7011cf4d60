//! The samples of a study with their estimated cost, and the confirmation before they run.

use std::io::{BufRead, IsTerminal, Write};

use coupling::error::RunError;
use terminal::clock;

use super::runs::{Execution, Queue};
use super::study::Study;

/// Estimated cost of the outstanding runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Number of runs.
    pub runs: usize,
    /// Wall time with parallel runs, s.
    pub wall_s: f64,
    /// Whether it is based on runs of this study instead of the sizes of the scene.
    pub measured: bool,
}

impl Estimate {
    /// Estimate for the runs of `queue`. The base runs first and alone.
    pub fn new(study: &Study, execution: &Execution, queue: &Queue) -> Self {
        let seconds = |m: usize| queue.base_s.0 * study.samples[m].ratio;
        let (base, others) = queue.open.split_at(usize::from(queue.open.first() == Some(&0)));
        let sum: f64 = others.iter().map(|&m| seconds(m)).sum();
        let longest = others.iter().map(|&m| seconds(m)).fold(0.0, f64::max);
        let alone: f64 = base.iter().map(|&m| seconds(m)).sum();
        Self {
            runs: queue.open.len(),
            wall_s: alone + (sum / execution.jobs.max(1) as f64).max(longest),
            measured: queue.base_s.1,
        }
    }

    /// Text of one line.
    pub fn words(&self, execution: &Execution) -> String {
        let source = if self.measured {
            "from completed runs"
        } else {
            "estimated from the sizes of the scene, within a factor of about 3"
        };
        format!(
            "{} runs, {} at a time: about {} of wall time ({source})",
            self.runs,
            execution.jobs,
            clock(self.wall_s)
        )
    }
}

/// The list of samples with their measured or estimated cost.
pub fn plan(study: &Study, execution: &Execution, queue: &Queue) -> String {
    let mut text = format!("{} samples of {}; quantities:\n", study.samples.len(), study.title);
    for q in &study.quantities {
        text += &format!("  {}\n", q.name);
    }
    text += "samples, cost relative to the base:\n";
    for (m, record) in study.samples.iter().zip(&queue.records) {
        let estimate = match record.runs.first() {
            Some(c) => format!("{} (measured)", clock(c.wall_s)),
            None => format!("about {}", clock(queue.base_s.0 * m.ratio)),
        };
        let check = if m.check { "  (check sample)" } else { "" };
        text += &format!("  {:<28} x {:>7.2}  {estimate}{check}\n", m.label, m.ratio);
    }
    text + "to run: " + &Estimate::new(study, execution, queue).words(execution)
}

/// Asks for confirmation on a terminal. Without a terminal (batch systems, scripts) the runs start without confirmation.
///
/// # Errors
/// The user does not confirm.
pub fn confirm(estimate: &Estimate, yes: bool) -> Result<(), RunError> {
    let terminal = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    if yes || estimate.runs == 0 || !terminal {
        return Ok(());
    }
    let mut answer = String::new();
    drop(write!(std::io::stderr(), "Start these runs? [y/N] "));
    let read = std::io::stdin().lock().read_line(&mut answer);
    if read.is_ok() && agrees(&answer) {
        return Ok(());
    }
    Err(RunError::Input("not started: the runs were not confirmed. Answer y, or use --yes".into()))
}

fn agrees(answer: &str) -> bool {
    matches!(answer.trim().to_ascii_lowercase().as_str(), "y" | "yes")
}

#[cfg(test)]
mod tests {
    use super::super::judge::tests::made;
    use super::super::runs::Record;
    use super::*;

    #[test]
    fn estimate_runs_the_base_alone_and_others_in_parallel() {
        let (study, _, records) = made();
        let execution = Execution { out: "out".into(), jobs: 2, repeat: 1, any_build: false, limit_s: None };
        let queue = |open: Vec<usize>| Queue {
            records: vec![Record::default(); records.len()],
            open,
            base_s: (10.0, true),
        };
        let of = |open: Vec<usize>| Estimate::new(&study, &execution, &queue(open)).wall_s;
        let ratio = |m: usize| study.samples[m].ratio;
        assert!((of(vec![0]) - 10.0).abs() < 1e-9);
        let pair = 10.0 + (5.0 * (ratio(1) + ratio(2))).max(10.0 * ratio(1)).max(10.0 * ratio(2));
        assert!((of(vec![0, 1, 2]) - pair).abs() < 1e-9);
        assert_eq!(of(vec![]), 0.0);
        assert!(
            plan(&study, &execution, &queue(vec![0])).contains("to run: 1 runs, 2 at a time: about 10.0 s")
        );
    }

    #[test]
    fn only_yes_confirms() {
        assert!(agrees("y\n") && agrees(" YES ") && !agrees("") && !agrees("n\n") && !agrees("yep"));
    }
}
