//! Watchdog: ends a process after the death of its coupler.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use crate::SessionError;
use crate::session::{LockMonitor, SessionPaths};
use crate::stalled_rank::is_stopped;

/// The coupler has stopped the run: this process may outlive it.
static RUN_ENDED: AtomicBool = AtomicBool::new(false);

/// Allows this process to outlive the coupler.
pub(crate) fn disarm_watchdogs() {
    RUN_ENDED.store(true, Ordering::Relaxed);
}

/// A thread that ends the process after the coupler's death where nobody else notices it, because this rank computes,
/// reads its scene or waits in MPI.
pub(crate) struct Watchdog {
    /// The thread ends when this is dropped.
    end: mpsc::Sender<()>,
}

impl Watchdog {
    /// Exit code of an orphaned process.
    pub const ORPHAN: i32 = 70;
    /// Time between two polls.
    pub const INTERVAL: Duration = Duration::from_millis(500);
    /// Missed polls until the process is ended: longer than a waiting rank needs to notice by itself.
    pub const MAX_MISSED_POLLS: u32 = 4;

    /// Also ends the process when the coupler has been stopped for `limit`. `None`: no coupler serves `session`
    /// now.
    pub fn over(session: &str, limit: Option<Duration>) -> Result<Option<Self>, SessionError> {
        let place = SessionPaths::of(session)?;
        let path = place.lock_file("coupler");
        let (Some(session_info), Some(watch)) = (place.session_info(), LockMonitor::on(&path)) else {
            return Ok(None);
        };
        if !watch.is_held() {
            return Ok(None);
        }
        let (end, ended) = mpsc::channel::<()>();
        let work = move || {
            let (mut missed_polls, mut stopped_polls) = (0, 0);
            while ended.recv_timeout(Self::INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let over = RUN_ENDED.load(Ordering::Relaxed);
                missed_polls = if over || watch.is_held() { 0 } else { missed_polls + 1 };
                // Counted in polls, so that time in which this process was stopped as well does not count.
                stopped_polls = if over || missed_polls > 0 || !is_stopped(session_info.pid) {
                    0
                } else {
                    stopped_polls + 1
                };
                let reason = if missed_polls == Self::MAX_MISSED_POLLS {
                    Some("died")
                } else if limit.is_some_and(|p| Self::INTERVAL * stopped_polls >= p.max(Self::INTERVAL)) {
                    Some("has been stopped for longer than its deadline")
                } else {
                    None
                };
                if let Some(reason) = reason {
                    // The reader of standard error died with the coupler: a failed write must not end this thread
                    // before the process.
                    let _ = writeln!(
                        std::io::stderr(),
                        "the coupler of session `{}` (process {}) {reason}; this process ({}) ends during \
                         its computation",
                        session_info.session,
                        session_info.pid,
                        std::process::id()
                    );
                    // SAFETY: accepts any code and does not return. Handlers of a normal exit may wait for the thread
                    // that computes.
                    unsafe { libc::_exit(Self::ORPHAN) };
                }
            }
        };
        let file = |source| SessionError::File { path, source };
        std::thread::Builder::new().name("guardian".into()).spawn(work).map_err(file)?;
        Ok(Some(Self { end }))
    }

    /// Keeps the watchdog until the process ends.
    pub fn stay(self) {
        std::mem::forget(self.end);
    }
}
