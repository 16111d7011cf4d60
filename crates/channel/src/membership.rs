//! How a rank joins a session, waits in it, and reports that it cannot go on.

use std::io::Write as _;
use std::time::Duration;

use case::Role;

use crate::deadline::{Deadline, Reminder};
use crate::header::{Header, Kind, Unit, role_code};
use crate::session::{Lock, MEMORY, Notice, Place, Watch};
use crate::transport::{Link, Message, Ringer, Sender, Sleeper};
use crate::wire::{Roster, during};
use crate::{CONTRACT_VERSION, Fault, ServeError, ServeOptions, SessionError, Window};

/// Between two looks at whether the coupler lives.
pub(crate) const LOOK: Duration = Duration::from_millis(200);

/// A rank's membership of a session.
pub(crate) struct Membership {
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

impl Membership {
    /// Waits until the coupler has opened the session, and joins it.
    pub fn join(at: &ServeOptions, patience: Option<Duration>) -> Result<Self, ServeError> {
        let place = Place::of(&at.session)?;
        let me = format!("{}.{}", at.role.name(), at.rank);
        let (notice, coupler) = await_coupler(&place, &me, Deadline::after(patience))?;
        let (roster, id) = fitting(&notice, at)?;
        let lock = Lock::take(&place.lock_file(&me))?.ok_or_else(|| taken(at))?;
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
        Ok(Self {
            at: at.clone(),
            id,
            roster,
            coupler_bell,
            coupler,
            coupler_pid: notice.pid,
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
        let silence = Deadline::after(self.at.deadline);
        loop {
            // Looked at first: what the coupler sent before it died still counts.
            let alive = self.coupler.is_held();
            if let Some(found) = poll()? {
                return Ok(found);
            }
            if !alive {
                return Err(self.coupler_died(step));
            }
            let left = silence.left(LOOK);
            if left.is_zero() {
                return Err(ServeError::Deadline {
                    session: self.at.session.clone(),
                    seconds: silence.limit_s(),
                    during: after(step),
                });
            }
            self.sleeper.sleep(left)?;
        }
    }

    /// Forgets what rang so far.
    pub fn drain(&self) -> Result<(), SessionError> {
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

/// Waits until a live coupler has opened the session.
fn await_coupler(place: &Place, me: &str, search: Deadline) -> Result<(Notice, Watch), ServeError> {
    let mut reminder = Reminder::default();
    loop {
        if let Some(notice) = place.notice()
            && let Some(watch) = Watch::on(&place.lock_file("coupler"))
            && watch.is_held()
        {
            return Ok((notice, watch));
        }
        if search.is_over() {
            let seconds = search.elapsed().as_secs_f64();
            return Err(ServeError::NoCoupler { session: place.session.clone(), seconds });
        }
        if reminder.is_due(search.elapsed()) {
            let _ = writeln!(
                std::io::stderr(),
                "{me} waits for a coupler: session `{}` is not open in {MEMORY} of this host (`ripstop attach` \
                 prints the session's name; of ranks on several hosts one at least must run on the coupler's)",
                place.session
            );
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Programs and identity of the session, if the rank of `at` has a place in it.
fn fitting(notice: &Notice, at: &ServeOptions) -> Result<(Roster, u64), ServeError> {
    let refused = |message: String| Err(ServeError::Refused { message });
    if notice.contract != CONTRACT_VERSION {
        return refused(format!(
            "the coupler of session `{}` speaks contract version {}, this {} speaks {CONTRACT_VERSION}: \
             build both from the same version",
            at.session,
            notice.contract,
            at.role.program()
        ));
    }
    let (Some(roster), Ok(id)) = (Roster::from_notice(notice), u64::from_str_radix(&notice.id, 16)) else {
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
    Ok((roster, id))
}

/// Another process is this rank.
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
