//! Membership of a rank in a session: joining, waiting, reporting a fault.

use std::io::Write as _;
use std::time::Duration;

use case::Role;

use crate::deadline::{Deadline, SlowWaitNotice};
use crate::header::{Header, Kind, Unit, role_code};
use crate::session::{Lock, LockMonitor, MEMORY, SessionInfo, SessionPaths};
use crate::transport::{Connection, Message, Sender, WakeListener, WakeNotifier};
use crate::wire::{RankCounts, during};
use crate::{CONTRACT_VERSION, Fault, ServeError, ServeOptions, SessionError, Window};

/// Time between two checks that the coupler is alive.
pub(crate) const LIVENESS_INTERVAL: Duration = Duration::from_millis(200);

/// A rank's membership of a session.
pub(crate) struct Membership {
    pub at: ServeOptions,
    /// Identity of the session.
    pub id: u64,
    pub rank_counts: RankCounts,
    pub coupler_event: WakeNotifier,
    /// Released when the coupler dies.
    pub coupler: LockMonitor,
    coupler_pid: u32,
    readers: Option<WakeNotifier>,
    listener: WakeListener,
    pub link: Connection,
    /// Shows the coupler that this process is alive. Dropped last.
    _lock: Lock,
}

impl Membership {
    /// Waits until the coupler has opened the session, and joins it.
    pub fn join(at: &ServeOptions, limit: Option<Duration>) -> Result<Self, ServeError> {
        let place = SessionPaths::of(&at.session)?;
        let me = format!("{}.{}", at.role.name(), at.rank);
        let (session_info, coupler) = await_coupler(&place, &me, Deadline::after(limit))?;
        let (rank_counts, id) = fitting(&session_info, at)?;
        let lock = Lock::take(&place.lock_file(&me))?.ok_or_else(|| taken(at))?;
        let link = Connection::new(&place, &me)?;
        let (name, listeners, notifiers) = rank_counts.coupler_event();
        let coupler_event = link.join_event(name, listeners, notifiers)?.notifier()?;
        let (name, listeners, notifiers) = rank_counts.wake_event(at.role);
        let listener = link.join_event(&name, listeners, notifiers)?.listener()?;
        let readers = if at.role == Role::Mesh && rank_counts.ranks(Role::Flow) > 0 {
            let (name, listeners, notifiers) = rank_counts.wake_event(Role::Flow);
            Some(link.join_event(&name, listeners, notifiers)?.notifier()?)
        } else {
            None
        };
        Ok(Self {
            at: at.clone(),
            id,
            rank_counts,
            coupler_event,
            coupler,
            coupler_pid: session_info.pid,
            readers,
            listener,
            link,
            _lock: lock,
        })
    }

    /// This rank's end of its response channel.
    pub fn answer_sender(&self, words: usize) -> Result<Sender, SessionError> {
        let (name, spec) = self.rank_counts.answer(self.at.role, self.at.rank);
        self.link.join(&name, spec)?.sender(words)
    }

    pub fn header(&self, kind: Kind, sequence: u64) -> Header {
        Header::new(kind, self.id, role_code(self.at.role), self.at.rank, sequence)
    }

    /// Wakes the ranks of the flow, if this is the mesh.
    pub fn notify_readers(&self) {
        if let Some(readers) = &self.readers {
            readers.notify();
        }
    }

    /// Polls, and sleeps in between until notified. Ends with an error when the coupler dies or sends nothing within
    /// the deadline.
    pub fn wait<T>(
        &self,
        step: &(Kind, Window),
        mut poll: impl FnMut() -> Result<Option<T>, ServeError>,
    ) -> Result<T, ServeError> {
        let silence = Deadline::after(self.at.deadline);
        loop {
            // Checked first: a message that the coupler sent before it died still counts.
            let alive = self.coupler.is_held();
            if let Some(found) = poll()? {
                return Ok(found);
            }
            if !alive {
                return Err(self.coupler_died(step));
            }
            let left = silence.left(LIVENESS_INTERVAL);
            if left.is_zero() {
                return Err(ServeError::Deadline {
                    session: self.at.session.clone(),
                    seconds: silence.limit_s(),
                    during: after(step),
                });
            }
            self.listener.sleep(left)?;
        }
    }

    /// Consumes pending notifications.
    pub fn drain(&self) -> Result<(), SessionError> {
        self.listener.sleep(Duration::ZERO)
    }

    pub fn coupler_died(&self, step: &(Kind, Window)) -> ServeError {
        ServeError::CouplerDied {
            session: self.at.session.clone(),
            pid: self.coupler_pid,
            during: after(step),
        }
    }

    /// Reports a fault to the coupler; returns the error for this side.
    pub fn fail(&self, answers: &Sender, sequence: u64, step: &(Kind, Window), fault: Fault) -> ServeError {
        let header = self.header(Kind::Fault, sequence).with_window(step.1);
        // If the message cannot be sent, the coupler notices the end of the process.
        let _ = answers.send_text(header, &fault.message);
        self.coupler_event.notify();
        ServeError::Fault { during: during(step.0, &step.1), fault }
    }

    /// The first problem of a message of another rank, if any.
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
                    "kind {} and unit {} instead of {kind:?} in unit {unit:?}",
                    header.kind, header.unit
                ))
            } else {
                let expected = length.filter(|&n| n != found)?;
                Some(format!("{found} numbers, expected {expected}"))
            }
        })
    }
}

/// Waits until a live coupler has opened the session.
fn await_coupler(
    place: &SessionPaths,
    me: &str,
    search: Deadline,
) -> Result<(SessionInfo, LockMonitor), ServeError> {
    let mut reminder = SlowWaitNotice::default();
    loop {
        if let Some(session_info) = place.session_info()
            && let Some(watch) = LockMonitor::on(&place.lock_file("coupler"))
            && watch.is_held()
        {
            return Ok((session_info, watch));
        }
        if search.is_over() {
            let seconds = search.elapsed().as_secs_f64();
            return Err(ServeError::NoCoupler { session: place.session.clone(), seconds });
        }
        if reminder.is_due(search.elapsed()) {
            let _ = writeln!(
                std::io::stderr(),
                "{me} is waiting for a coupler: session `{}` is not open in {MEMORY} of this host (`ripstop attach` \
                 prints the session's name; of ranks on several hosts at least one must run on the coupler's)",
                place.session
            );
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Programs and identity of the session, if it contains the rank of `at`.
fn fitting(session_info: &SessionInfo, at: &ServeOptions) -> Result<(RankCounts, u64), ServeError> {
    let refused = |message: String| Err(ServeError::Refused { message });
    if session_info.contract != CONTRACT_VERSION {
        return refused(format!(
            "the coupler of session `{}` uses contract version {}, this {} uses {CONTRACT_VERSION}: \
             build both from the same version",
            at.session,
            session_info.contract,
            at.role.program()
        ));
    }
    let (Some(rank_counts), Ok(id)) =
        (RankCounts::from_notice(session_info), u64::from_str_radix(&session_info.id, 16))
    else {
        return refused(format!("session.json of session `{}` cannot be read", at.session));
    };
    let ranks = rank_counts.ranks(at.role);
    if at.rank >= ranks {
        return refused(format!(
            "session `{}` has {ranks} ranks of {}, this is rank {} of {}: start it with the number of ranks \
             that the coupler expects",
            at.session,
            at.role.program(),
            at.rank,
            at.ranks
        ));
    }
    Ok((rank_counts, id))
}

/// The error where another process is this rank.
fn taken(at: &ServeOptions) -> ServeError {
    ServeError::Refused {
        message: format!(
            "session `{}` already has a {} (rank {}): it was started twice",
            at.session,
            at.role.program(),
            at.rank
        ),
    }
}

fn after(step: &(Kind, Window)) -> String {
    during(step.0, &step.1)
}
