//! Ends a process whose coupler is gone.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use crate::SessionError;
use crate::culprit::is_stopped;
use crate::session::{Place, Watch};

/// The coupler has ended the run in good order: this process may take its time.
static STOPPED: AtomicBool = AtomicBool::new(false);

/// From now on this process may outlive the coupler.
pub(crate) fn dismiss_guardians() {
    STOPPED.store(true, Ordering::Relaxed);
}

/// A thread that ends the process when the coupler has died and nobody here
/// notices, because this rank computes, reads its scene or waits in MPI.
pub(crate) struct Guardian {
    /// The thread ends when this goes.
    end: mpsc::Sender<()>,
}

impl Guardian {
    /// Code with which an orphaned process ends.
    pub const ORPHAN: i32 = 70;
    /// Between two looks.
    pub const INTERVAL: Duration = Duration::from_millis(500);
    /// Looks in vain until the process is ended: longer than a rank that waits needs to
    /// notice by itself.
    pub const LOOKS: u32 = 4;

    /// Ends the process too when the coupler has been stopped for `patience`.
    /// `None`: no coupler serves `session` now.
    pub fn over(session: &str, patience: Option<Duration>) -> Result<Option<Self>, SessionError> {
        let place = Place::of(session)?;
        let path = place.lock_file("coupler");
        let (Some(notice), Some(watch)) = (place.notice(), Watch::on(&path)) else { return Ok(None) };
        if !watch.is_held() {
            return Ok(None);
        }
        let (end, ended) = mpsc::channel::<()>();
        let work = move || {
            let (mut alone, mut held_up) = (0, 0);
            while ended.recv_timeout(Self::INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let over = STOPPED.load(Ordering::Relaxed);
                alone = if over || watch.is_held() { 0 } else { alone + 1 };
                // Counted in looks: time in which this process was stopped as well does not count.
                held_up = if over || alone > 0 || !is_stopped(notice.pid) { 0 } else { held_up + 1 };
                let fate = if alone == Self::LOOKS {
                    Some("died")
                } else if patience.is_some_and(|p| Self::INTERVAL * held_up >= p.max(Self::INTERVAL)) {
                    Some("has been stopped for longer than its deadline")
                } else {
                    None
                };
                if let Some(fate) = fate {
                    // Its reader died with the coupler: a line that cannot be written must
                    // not end this thread before the process.
                    let _ = writeln!(
                        std::io::stderr(),
                        "the coupler of session `{}` (process {}) {fate}; this process ({}) ends in the middle \
                         of its computation",
                        notice.session,
                        notice.pid,
                        std::process::id()
                    );
                    // SAFETY: takes any code and does not return. Handlers of a
                    // normal exit may wait for the thread that computes.
                    unsafe { libc::_exit(Self::ORPHAN) };
                }
            }
        };
        let file = |source| SessionError::File { path, source };
        std::thread::Builder::new().name("guardian".into()).spawn(work).map_err(file)?;
        Ok(Some(Self { end }))
    }

    /// Lets it watch until the process ends.
    pub fn stay(self) {
        std::mem::forget(self.end);
    }
}
