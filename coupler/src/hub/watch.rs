//! Watching over the programs while the hub waits for them.

use std::sync::atomic::{AtomicBool, Ordering};

use channel::Abort;
use terminal::Console;

use crate::launch::{ProcessFailure, Supervisor};

/// Looks after the programs while the hub waits.
pub(super) struct Watch<'a> {
    pub supervisor: &'a mut Supervisor,
    pub stop: &'a AtomicBool,
    pub now: Option<&'a AtomicBool>,
    pub announced: &'a mut bool,
    pub console: &'a Console,
    pub failure: Option<ProcessFailure>,
}

impl Watch<'_> {
    /// Refuses to wait on after a signal or the death of a program.
    pub fn look(&mut self) -> Result<(), Abort> {
        if self.stop.load(Ordering::Relaxed) {
            if self.now.is_none_or(|now| now.load(Ordering::Relaxed)) {
                return Err(Abort::new("interrupted"));
            }
            if !std::mem::replace(self.announced, true) {
                self.console
                    .line("interrupted: this window is finished and saved; once more ends all at once");
            }
        }
        self.failure = self.supervisor.failure();
        self.told_by_casualty()
    }

    /// Whether ranks have ended before they joined.
    pub fn count(&mut self) -> Result<(), Abort> {
        self.failure = self.supervisor.missing_ranks();
        self.told_by_casualty()
    }

    fn told_by_casualty(&self) -> Result<(), Abort> {
        match &self.failure {
            Some(failure) => Err(Abort::new(&failure.how)),
            None => Ok(()),
        }
    }
}
