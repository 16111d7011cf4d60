//! How a rank joins a session, waits in it, and reports that it cannot go on.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use case::Role;

use crate::culprit::is_stopped;
use crate::header::{Header, Kind, Unit, role_code};
use crate::session::{Lock, MEMORY, Place, Watch};
use crate::transport::{Link, Message, Ringer, Sender, Sleeper};
use crate::wire::{Roster, during};
use crate::{CONTRACT_VERSION, Fault, ServeError, ServeOptions, SessionError, Window};

/// Between two looks at whether the coupler lives.
pub(crate) const LOOK: Duration = Duration::from_millis(200);

/// Time after which a wait for the coupler is told.
const SEARCH: Duration = Duration::from_secs(10);

/// A rank's membership of a session.
pub(crate) struct Post {
    pub at: ServeOptions,
    /// Identity of the session.
    pub id: u64,
    pub roster: Roster,
    pub coupler_bell: Ringer,
    /// Falls silent when the coupler dies.
    pub coupler: Watch,
    coupler_pid: u32,
    readers: Option<Ringer>,
    sleeper: Sleeper,
    pub link: Link,
    /// Tells the coupler that this process lives. Last: freed after all else.
    _lock: Lock,
}

impl Post {
    /// Waits until the coupler has opened the session, and joins it.
    pub fn join(at: &ServeOptions, patience: Option<Duration>) -> Result<Self, ServeError> {
        let place = Place::of(&at.session)?;
        let refused = |message: String| Err(ServeError::Refused { message });
        let me = format!("{}.{}", at.role.name(), at.rank);
        let start = Instant::now();
        let mut told = false;
        let (notice, coupler) = loop {
            if let Some(notice) = place.notice()
                && let Some(watch) = Watch::on(&place.lock_file("coupler"))
                && watch.is_held()
            {
                break (notice, watch);
            }
            if patience.is_some_and(|p| start.elapsed() >= p) {
                let seconds = start.elapsed().as_secs_f64();
                return Err(ServeError::NoCoupler { session: at.session.clone(), seconds });
            }
            if !told && start.elapsed() > SEARCH {
                told = true;
                let _ = writeln!(
                    std::io::stderr(),
                    "{me} waits for a coupler: session `{}` is not open in {MEMORY} of this host (`ripstop attach` \
                     prints the session's name; of ranks on several hosts one at least must run on the coupler's)",
                    at.session
                );
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        if notice.contract != CONTRACT_VERSION {
            return refused(format!(
                "the coupler of session `{}` speaks contract version {}, this {} speaks {CONTRACT_VERSION}: \
                 build both from the same version",
                at.session,
                notice.contract,
                at.role.program()
            ));
        }
        let (Some(roster), Ok(id)) = (Roster::from_notice(&notice), u64::from_str_radix(&notice.id, 16))
        else {
            return refused(format!("the notice of session `{}` cannot be read", at.session));
        };
        let ranks = roster.ranks(at.role);
        if at.rank >= ranks {
            return refused(format!(
                "session `{}` has {ranks} ranks of {}, this is rank {} of {}: start it with as many ranks \
                 as the coupler expects",
                at.session,
                at.role.program(),
                at.rank,
                at.ranks
            ));
        }
        let Some(lock) = Lock::take(&place.lock_file(&me))? else {
            return refused(format!(
                "session `{}` already has a {} (rank {}): it was started twice",
                at.session,
                at.role.program(),
                at.rank
            ));
        };
        let link = Link::new(&place, &me)?;
        let (name, sleepers, ringers) = roster.coupler_bell();
        let coupler_bell = link.join_bell(name, sleepers, ringers)?.ringer()?;
        let (name, sleepers, ringers) = roster.bell(at.role);
        let sleeper = link.join_bell(&name, sleepers, ringers)?.sleeper()?;
        let readers = if at.role == Role::Mesh && roster.ranks(Role::Flow) > 0 {
            let (name, sleepers, ringers) = roster.bell(Role::Flow);
            Some(link.join_bell(&name, sleepers, ringers)?.ringer()?)
        } else {
            None
        };
        let coupler_pid = notice.pid;
        Ok(Self {
            at: at.clone(),
            id,
            roster,
            coupler_bell,
            coupler,
            coupler_pid,
            readers,
            sleeper,
            link,
            _lock: lock,
        })
    }

    /// This rank's end of its answer channel.
    pub fn answer_sender(&self, words: usize) -> Result<Sender, SessionError> {
        let (name, spec) = self.roster.answer(self.at.role, self.at.rank);
        self.link.join(&name, spec)?.sender(words)
    }

    pub fn header(&self, kind: Kind, sequence: u64) -> Header {
        Header::new(kind, self.id, role_code(self.at.role), self.at.rank, sequence)
    }

    /// Wakes the ranks of the flow, if this is the mesh.
    pub fn ring_readers(&self) {
        if let Some(readers) = &self.readers {
            readers.ring();
        }
    }

    /// Polls, and sleeps in between until somebody rings. Ends with an error when
    /// the coupler dies or is silent beyond the deadline.
    pub fn wait<T>(
        &self,
        step: &(Kind, Window),
        mut poll: impl FnMut() -> Result<Option<T>, ServeError>,
    ) -> Result<T, ServeError> {
        let start = Instant::now();
        loop {
            // Looked at first: what the coupler sent before it died still counts.
            let alive = self.coupler.is_held();
            if let Some(found) = poll()? {
                return Ok(found);
            }
            if !alive {
                return Err(self.coupler_died(step));
            }
            let mut limit = LOOK;
            if let Some(deadline) = self.at.deadline {
                let left = deadline.saturating_sub(start.elapsed());
                if left.is_zero() {
                    return Err(ServeError::Deadline {
                        session: self.at.session.clone(),
                        seconds: deadline.as_secs_f64(),
                        during: after(step),
                    });
                }
                limit = limit.min(left);
            }
            self.sleeper.sleep(limit)?;
        }
    }

    /// Forgets what rang so far.
    pub fn hush(&self) -> Result<(), SessionError> {
        self.sleeper.sleep(Duration::ZERO)
    }

    pub fn coupler_died(&self, step: &(Kind, Window)) -> ServeError {
        ServeError::CouplerDied {
            session: self.at.session.clone(),
            pid: self.coupler_pid,
            during: after(step),
        }
    }

    /// Tells the coupler of a fault; the error for this side.
    pub fn fail(&self, answers: &Sender, sequence: u64, step: &(Kind, Window), fault: Fault) -> ServeError {
        let header = self.header(Kind::Fault, sequence).with_window(step.1);
        // If this cannot be sent either, the end of the process tells.
        let _ = answers.send_text(header, &fault.message);
        self.coupler_bell.ring();
        ServeError::Fault { during: during(step.0, &step.1), fault }
    }

    /// What is wrong with a message of another rank, if anything.
    pub fn problem(
        &self,
        message: &Message,
        role: Role,
        rank: usize,
        kind: Kind,
        unit: Unit,
        length: Option<usize>,
    ) -> Option<String> {
        let (header, found) = (message.header(), message.payload().len());
        header.problem(self.id, role_code(role), rank, found).or_else(|| {
            if header.kind != kind as u32 || header.unit != unit as u32 {
                Some(format!(
                    "kind {} and unit {} where {kind:?} of {unit:?} was due",
                    header.kind, header.unit
                ))
            } else {
                let expected = length.filter(|&n| n != found)?;
                Some(format!("{found} numbers instead of {expected}"))
            }
        })
    }
}

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

fn after(step: &(Kind, Window)) -> String {
    during(step.0, &step.1)
}
