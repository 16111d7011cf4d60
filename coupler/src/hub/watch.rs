//! Supervision of the programs while the hub waits for them.

use std::sync::atomic::{AtomicBool, Ordering};

use channel::Abort;
use terminal::Console;

use crate::launch::{ProcessFailure, Supervisor};

/// Checks signals and programs while the hub waits.
pub(super) struct Watch<'a> {
    pub supervisor: &'a mut Supervisor,
    pub stop: &'a AtomicBool,
    pub now: Option<&'a AtomicBool>,
    pub interrupt_reported: &'a mut bool,
    pub console: &'a Console,
    pub failure: Option<ProcessFailure>,
}

impl Watch<'_> {
    /// Aborts the wait after a signal or the failure of a program.
    pub fn check(&mut self) -> Result<(), Abort> {
        if self.stop.load(Ordering::Relaxed) {
            if self.now.is_none_or(|now| now.load(Ordering::Relaxed)) {
                return Err(Abort::new("interrupted"));
            }
            if !std::mem::replace(self.interrupt_reported, true) {
                self.console.line(
                    "interrupted: completing and saving this window; a second signal ends the run immediately",
                );
            }
        }
        self.failure = self.supervisor.failure();
        self.abort_on_failure()
    }

    /// Aborts the wait if ranks have ended before they joined.
    pub fn check_ranks(&mut self) -> Result<(), Abort> {
        self.failure = self.supervisor.missing_ranks();
        self.abort_on_failure()
    }

    fn abort_on_failure(&self) -> Result<(), Abort> {
        match &self.failure {
            Some(failure) => Err(Abort::new(&failure.how)),
            None => Ok(()),
        }
    }
}
