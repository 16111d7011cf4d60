//! How long to wait for somebody, and when to say so.

use std::time::{Duration, Instant};

/// A limit of time that runs from when it was made; without a limit it never ends.
///
/// All waits of the channel and of the coupler's launcher end by one: for a coupler, for a command, for an answer, for a
/// process.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    start: Instant,
    limit: Option<Duration>,
}

impl Deadline {
    /// Begins now. `None`: no limit.
    pub fn after(limit: impl Into<Option<Duration>>) -> Self {
        Self { start: Instant::now(), limit: limit.into() }
    }

    /// Time since its begin, without what it was extended by.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Whether its limit has passed.
    pub fn is_over(&self) -> bool {
        self.limit.is_some_and(|limit| self.elapsed() >= limit)
    }

    /// What is left of it, `longest` at most: how long to sleep before the next look. Zero: it is over.
    pub fn left(&self, longest: Duration) -> Duration {
        self.limit.map_or(longest, |limit| limit.saturating_sub(self.elapsed()).min(longest))
    }

    /// The limit, s, for messages; 0 without one.
    pub fn limit_s(&self) -> f64 {
        self.limit.unwrap_or_default().as_secs_f64()
    }

    /// Ends `by` later: what passed in it is nobody's delay.
    pub fn extend(&mut self, by: Duration) {
        self.start += by;
    }

    /// Looks every `pause` until `done` or the limit has passed; whether it was done.
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

/// Says once that a search takes long.
#[derive(Default)]
pub(crate) struct Reminder {
    said: bool,
}

impl Reminder {
    /// Time after which a search is reported.
    pub const AFTER: Duration = Duration::from_secs(10);

    /// Whether it is to be said now.
    pub fn is_due(&mut self, searched: Duration) -> bool {
        let due = !self.said && searched > Self::AFTER;
        self.said |= due;
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(3600);

    #[test]
    fn a_limit_ends_and_none_does_not() {
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
    fn an_extended_limit_ends_later() {
        let mut over = Deadline::after(Duration::from_nanos(1));
        std::thread::sleep(Duration::from_millis(1));
        assert!(over.is_over());
        over.extend(LONG);
        assert!(!over.is_over() && over.elapsed().is_zero());
    }

    #[test]
    fn what_is_done_at_once_counts_also_after_the_limit() {
        let over = Deadline::after(Duration::ZERO);
        assert!(over.poll(LONG, || true) && !over.poll(LONG, || false));
        let mut looks = 0;
        let done = || {
            looks += 1;
            looks == 3
        };
        assert!(Deadline::after(None).poll(Duration::from_micros(1), done));
    }

    #[test]
    fn a_long_search_is_said_once() {
        let late = Reminder::AFTER + Duration::from_nanos(1);
        let mut reminder = Reminder::default();
        assert!(!reminder.is_due(Reminder::AFTER) && reminder.is_due(late) && !reminder.is_due(late));
    }
}
