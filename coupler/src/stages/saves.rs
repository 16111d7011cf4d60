//! Checkpoint intervals within a stage, and the cost of saving.

use std::time::{Duration, Instant};

use terminal::Console;

/// Largest share of the wall time for checkpoints at the default interval.
const MAX_COST: f64 = 0.01;
/// Shortest default interval of checkpoints.
const MIN_INTERVAL: Duration = Duration::from_secs(30);

/// Number and cost of saves.
pub(super) struct Saves {
    /// Number of saves.
    pub count: u64,
    /// End of the last save (or start of the stage), and its duration.
    pub last: (Instant, Duration),
    /// Size of the last save.
    pub bytes: u64,
    /// Wall time of all saves, s.
    pub seconds: f64,
}

impl Default for Saves {
    fn default() -> Self {
        Self { count: 0, last: (Instant::now(), Duration::ZERO), bytes: 0, seconds: 0.0 }
    }
}

impl Saves {
    /// Whether to save after `done` windows. Results do not depend on it.
    pub fn due(&self, every: Option<u64>, done: u64) -> bool {
        let (at, took) = self.last;
        match every {
            Some(0) => false,
            Some(every) => done.is_multiple_of(every),
            None => at.elapsed() >= MIN_INTERVAL.max(took.div_f64(MAX_COST)),
        }
    }

    /// Prints number and cost of the saves, where there was one within the stage.
    pub fn report(&self, console: &Console, stage: &str, all: f64) {
        if self.count > 1 {
            console.line(&format!(
                "stage `{stage}`: {} checkpoints, {:.1} MB and {:.2} s each, {:.1} % of {all:.1} s",
                self.count,
                self.bytes as f64 / 1e6,
                self.seconds / self.count as f64,
                100.0 * self.seconds / all.max(f64::MIN_POSITIVE)
            ));
        }
    }
}
