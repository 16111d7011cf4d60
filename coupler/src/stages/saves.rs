//! When the states of a stage are saved, and what that costs.

use std::time::{Duration, Instant};

use terminal::Console;

/// Saves within a stage that nobody has asked for take at most this share of its time ...
const SHARE: f64 = 0.01;
/// ... and are at least this far apart.
const APART: Duration = Duration::from_secs(30);

/// What saving has cost.
pub(super) struct Saves {
    /// So many.
    pub count: u64,
    /// When the last one ended, or the stage began, and what it took.
    pub last: (Instant, Duration),
    /// Of the last one.
    pub bytes: u64,
    /// Of all.
    pub seconds: f64,
}

impl Default for Saves {
    fn default() -> Self {
        Self { count: 0, last: (Instant::now(), Duration::ZERO), bytes: 0, seconds: 0.0 }
    }
}

impl Saves {
    /// Whether to save now that `done` windows are done. What is computed does not depend on it.
    pub fn due(&self, every: Option<u64>, done: u64) -> bool {
        let (at, took) = self.last;
        match every {
            Some(0) => false,
            Some(every) => done.is_multiple_of(every),
            None => at.elapsed() >= APART.max(took.div_f64(SHARE)),
        }
    }

    /// Says so, where the stage was saved within too.
    pub fn report(&self, console: &Console, stage: &str, all: f64) {
        if self.count > 1 {
            console.line(&format!(
                "stage `{stage}`: saved {} times, {:.1} MB in {:.2} s each, {:.1} % of {all:.1} s",
                self.count,
                self.bytes as f64 / 1e6,
                self.seconds / self.count as f64,
                100.0 * self.seconds / all.max(f64::MIN_POSITIVE)
            ));
        }
    }
}
