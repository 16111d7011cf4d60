//! Limits of waiting times.

use std::time::{Duration, Instant};

/// A time limit that starts when it is created; without a limit it never expires.
///
/// All waits of the channel and of the coupler's launcher are bounded by one: for a coupler, a command, a response, a
/// process.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    start: Instant,
    limit: Option<Duration>,
}

impl Deadline {
    /// Starts now. `None`: no limit.
    pub fn after(limit: impl Into<Option<Duration>>) -> Self {
        Self { start: Instant::now(), limit: limit.into() }
    }

    /// Time since its start, less its extensions.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Whether its limit has passed.
    pub fn is_over(&self) -> bool {
        self.limit.is_some_and(|limit| self.elapsed() >= limit)
    }

    /// Remaining time, at most `longest`: how long to sleep before the next poll. Zero: expired.
    pub fn left(&self, longest: Duration) -> Duration {
        self.limit.map_or(longest, |limit| limit.saturating_sub(self.elapsed()).min(longest))
    }

    /// The limit, s, for messages; 0 without one.
    pub fn limit_s(&self) -> f64 {
        self.limit.unwrap_or_default().as_secs_f64()
    }

    /// Extends the limit by `by`, a time in which nobody could respond.
    pub fn extend(&mut self, by: Duration) {
        self.start += by;
    }

    /// Polls `done` every `pause` until it is true or the limit has expired; returns whether it was true.
    pub fn poll(&self, pause: Duration, mut done: impl FnMut() -> bool) -> bool {
        loop {
            if done() {
                return true;
            }
            if self.is_over() {
                return false;
            }
            std::thread::sleep(pause);
        }
    }
}

/// Reports once that a search takes long.
#[derive(Default)]
pub(crate) struct SlowWaitNotice {
    reported: bool,
}

impl SlowWaitNotice {
    /// Time after which a search is reported.
    pub const AFTER: Duration = Duration::from_secs(10);

    /// Whether to report now.
    pub fn is_due(&mut self, searched: Duration) -> bool {
        let due = !self.reported && searched > Self::AFTER;
        self.reported |= due;
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(3600);

    #[test]
    fn limit_expires_and_no_limit_does_not() {
        let over = Deadline::after(Duration::ZERO);
        assert!(over.is_over() && over.left(LONG).is_zero());
        let never = Deadline::after(None);
        assert!(!never.is_over());
        assert_eq!((never.left(LONG), never.limit_s()), (LONG, 0.0));
        let later = Deadline::after(LONG);
        assert!(!later.is_over() && later.left(Duration::from_secs(1)) == Duration::from_secs(1));
        assert!(later.left(2 * LONG) <= LONG);
        assert_eq!(later.limit_s(), 3600.0);
    }

    #[test]
    fn extended_limit_expires_later() {
        let mut over = Deadline::after(Duration::from_nanos(1));
        std::thread::sleep(Duration::from_millis(1));
        assert!(over.is_over());
        over.extend(LONG);
        assert!(!over.is_over() && over.elapsed().is_zero());
    }

    #[test]
    fn completion_at_the_first_poll_counts_after_the_limit() {
        let over = Deadline::after(Duration::ZERO);
        assert!(over.poll(LONG, || true) && !over.poll(LONG, || false));
        let mut polls = 0;
        let done = || {
            polls += 1;
            polls == 3
        };
        assert!(Deadline::after(None).poll(Duration::from_micros(1), done));
    }

    #[test]
    fn long_search_is_reported_once() {
        let late = SlowWaitNotice::AFTER + Duration::from_nanos(1);
        let mut reminder = SlowWaitNotice::default();
        assert!(!reminder.is_due(SlowWaitNotice::AFTER) && reminder.is_due(late) && !reminder.is_due(late));
    }
}
