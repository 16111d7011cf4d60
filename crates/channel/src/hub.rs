//! The coupler's side: opens a session, sends commands to its programs, waits for them.

use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use archive::hash::fnv1a;
use case::Role;

use crate::deadline::Deadline;
use crate::header::{Kind, unpack_text};
use crate::hub_options::{Arrivals, HubOptions, Interface};
use crate::program::{Payload, Program, Rank};
use crate::session::{Lock, LockMonitor, SessionInfo, SessionPaths, cleanup_stale};
use crate::stalled_rank::find_stalled;
use crate::transport::{Connection, WakeEvent, WakeListener};
use crate::wire::{RankCounts, during};
use crate::{Abort, Announcement, CONTRACT_VERSION, Fault, HubError, RankId, SessionError, Stats, Window};

/// Called while the hub waits for responses, at least every 50 ms, to check child processes and Ctrl-C. An error ends
/// the wait.
pub type OnWait<'a> = &'a mut dyn FnMut() -> Result<(), Abort>;

/// Longest sleep between two calls of `on_wait`.
const POLL_INTERVAL: Duration = Duration::from_millis(40);
/// A time between two polls that shows that this process was suspended.
const SUSPENDED: Duration = Duration::from_secs(2);
/// Time in which participants of a dead coupler end.
const ORPHAN_EXIT_TIME: Duration = Duration::from_secs(4);
/// Time for participants to receive the message that the run has failed.
const ABORT_NOTICE_TIME: Duration = Duration::from_millis(300);

/// The coupler's end of all channels of a session.
///
/// Dropped without [`Hub::stop`], it informs the participants that the run has failed; they end at their next wait.
/// Call [`crate::cleanup`] when their processes have ended.
pub struct Hub {
    pub(crate) options: HubOptions,
    pub(crate) interface: Interface,
    pub(crate) programs: Vec<Program>,
    pub(crate) rank_counts: RankCounts,
    /// Identity of the session.
    pub(crate) id: u64,
    /// Reason of the failure, if the run has failed.
    failure: Option<String>,
    stopped: bool,
    listener: WakeListener,
    /// Kept while participants may join.
    _bells: Vec<WakeEvent>,
    _link: Connection,
    pub(crate) place: SessionPaths,
    lock: Option<Lock>,
    /// Dropped last, when everything else is closed.
    _sweep: CleanupGuard,
}

impl Hub {
    /// Opens the session: participants can join from here on. Removes remains of killed runs first.
    pub fn create(options: HubOptions) -> Result<Self, HubError> {
        check_options(&options)?;
        let place = SessionPaths::of(&options.session)?;
        cleanup_stale()?;
        let orphans = Deadline::after(ORPHAN_EXIT_TIME);
        let lock = loop {
            match place.open()? {
                Ok(lock) => break lock,
                // Of a session whose coupler died; they end by themselves.
                Err(owner) if owner != "coupler" && !orphans.is_over() => {
                    std::thread::sleep(Duration::from_millis(50));
                }
                Err(owner) => return Err(HubError::SessionInUse { session: options.session, owner }),
            }
        };
        let made = Self::open(options, place.clone(), lock);
        if made.is_err() {
            // The lock is free again; the first error is returned.
            let _ = place.clean();
        }
        made
    }

    fn open(options: HubOptions, place: SessionPaths, lock: Lock) -> Result<Self, HubError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let id = fnv1a(format!("{} {} {now}", options.session, std::process::id()).bytes());
        let link = Connection::new(&place, "coupler")?;
        let rank_counts = RankCounts(options.roles.iter().map(|r| (r.role, r.ranks)).collect());
        let (name, listeners, notifiers) = rank_counts.coupler_event();
        let mut wake_events = vec![link.create_event(name, listeners, notifiers)?];
        let listener = wake_events[0].listener()?;
        let mut programs = Vec::new();
        for spec in &options.roles {
            let (name, listeners, notifiers) = rank_counts.wake_event(spec.role);
            let wake_event = link.create_event(&name, listeners, notifiers)?;
            programs.push(Program::open(
                &link,
                &rank_counts,
                spec,
                wake_event.notifier()?,
                options.watch_grid,
            )?);
            wake_events.push(wake_event);
        }
        place.close_to_others()?;
        place.publish(&SessionInfo {
            contract: CONTRACT_VERSION,
            session: options.session.clone(),
            id: format!("{id:016x}"),
            pid: std::process::id(),
            roles: options.roles.iter().map(|r| (r.role.name().to_string(), r.ranks)).collect(),
        })?;
        Ok(Self {
            interface: options.interface.unwrap_or_default(),
            options,
            programs,
            rank_counts,
            id,
            failure: None,
            stopped: false,
            listener,
            _bells: wake_events,
            _link: link,
            _sweep: CleanupGuard(place.clone()),
            place,
            lock: Some(lock),
        })
    }

    /// Waits until all ranks have arrived, checks their announcements against each other, and completes the
    /// handshake. Calls `on_wait` at least every 100 ms.
    pub fn await_participants(
        &mut self,
        on_wait: &mut dyn FnMut(&Arrivals) -> Result<(), Abort>,
    ) -> Result<(), HubError> {
        let result = self.handshake(on_wait);
        self.record_failure(result)
    }

    /// The canopy, once all participants have arrived.
    pub fn interface(&self) -> Interface {
        self.interface
    }

    /// The announcement of rank 0 of `role`.
    pub fn announcement(&self, role: Role) -> Option<&Announcement> {
        let program = self.programs.iter().find(|p| p.role == role)?;
        Some(&program.ranks[0].hello.as_ref()?.announcement)
    }

    /// Requests window `w` from `role`, without waiting. `fill` writes its complete input in place, with the shape of
    /// [`crate::Input::canopy`].
    pub fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
    ) -> Result<(), HubError> {
        let id = self.id;
        let result = self.program(role).and_then(|p| p.send_advance(id, w, fill));
        self.record_failure(result)
    }

    /// Waits, asleep, until each rank of `role` has sent its response to the requested window. `each` reads the
    /// output of each rank in place, in rank order and by blocks of rows: global rows and `[rows][output_width]`. The mesh-mover's grid
    /// goes directly to the flow-solver: its data are empty here unless the hub watches the grid. Returns the
    /// statistics of each rank.
    pub fn collect(
        &mut self,
        role: Role,
        each: &mut dyn FnMut(&[u64], &[f64]),
        on_wait: OnWait<'_>,
    ) -> Result<Vec<Stats>, HubError> {
        let result = self.collect_outputs(role, each, on_wait);
        self.record_failure(result)
    }

    fn collect_outputs(
        &mut self,
        role: Role,
        each: &mut dyn FnMut(&[u64], &[f64]),
        on_wait: OnWait<'_>,
    ) -> Result<Vec<Stats>, HubError> {
        if self.program(role)?.pending.is_none_or(|a| a.kind != Kind::Advance) {
            return Err(HubError::Misuse(format!(
                "the output of {} was collected without a request for a window",
                role.program()
            )));
        }
        self.wait_for(&[role], on_wait)?;
        let id = self.id;
        self.program(role)?.take_outputs(id, each)
    }

    /// Accepts window `w` in every program that computed it; the seconds that each worked on that, by its slowest rank.
    pub fn accept(&mut self, w: &Window, on_wait: OnWait<'_>) -> Result<Vec<(Role, f64)>, HubError> {
        let roles: Vec<Role> =
            self.programs.iter().filter(|p| p.open == Some(w.index)).map(|p| p.role).collect();
        let result = if roles.is_empty() {
            Err(HubError::Misuse(format!("window {} is to be accepted, but no program computed it", w.index)))
        } else {
            self.send_command(&roles, Kind::Accept, w, "").and_then(|()| self.finish_timed(&roles, on_wait))
        };
        for program in &mut self.programs {
            program.open = program.open.filter(|&open| open != w.index);
        }
        self.record_failure(result)
    }

    /// Requests every program to write its accepted state below `folder` (created if missing).
    pub fn save(&mut self, folder: &Path, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
        let result = folder_text(folder)
            .and_then(|folder| self.request(&roles, Kind::Save, &Window::default(), &folder, on_wait));
        self.record_failure(result)
    }

    /// Requests the programs of `roles` to add their accepted state to the ParaView series below `folder` (created if
    /// missing).
    pub fn snapshot(
        &mut self,
        roles: &[Role],
        time: f64,
        folder: &Path,
        on_wait: OnWait<'_>,
    ) -> Result<(), HubError> {
        let w = Window { time, ..Window::default() };
        let result =
            folder_text(folder).and_then(|folder| self.request(roles, Kind::Snapshot, &w, &folder, on_wait));
        self.record_failure(result)
    }

    /// Ends the session in an orderly way: stops each program and waits for it.
    pub fn stop(mut self, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
        let result = self.request(&roles, Kind::Stop, &Window::default(), "", on_wait);
        self.record_failure(result)?;
        self.stopped = true;
        // Their remaining work in this session needs microseconds.
        self.await_silence(Duration::from_secs(2));
        Ok(())
    }

    /// Ends the session because the run has failed, and informs the remaining participants of the reason.
    pub fn abort(mut self, why: &str) {
        self.failure.get_or_insert_with(|| why.to_string());
    }

    /// Sends a command to `roles` and waits until each rank has completed it.
    pub(crate) fn request(
        &mut self,
        roles: &[Role],
        kind: Kind,
        w: &Window,
        text: &str,
        on_wait: OnWait<'_>,
    ) -> Result<(), HubError> {
        self.send_command(roles, kind, w, text)?;
        self.finish(roles, on_wait)
    }

    /// Waits until each rank of `roles` has completed its command.
    pub(crate) fn finish(&mut self, roles: &[Role], on_wait: OnWait<'_>) -> Result<(), HubError> {
        self.finish_timed(roles, on_wait).map(|_| ())
    }

    /// As [`Hub::finish`]; the seconds that each program worked, by its slowest rank.
    fn finish_timed(&mut self, roles: &[Role], on_wait: OnWait<'_>) -> Result<Vec<(Role, f64)>, HubError> {
        self.wait_for(roles, on_wait)?;
        let id = self.id;
        roles.iter().map(|&role| Ok((role, self.program(role)?.take_done(id)?))).collect()
    }

    /// Sends a command to `roles`, without waiting.
    pub(crate) fn send_command(
        &mut self,
        roles: &[Role],
        kind: Kind,
        w: &Window,
        text: &str,
    ) -> Result<(), HubError> {
        let id = self.id;
        for &role in roles {
            self.program(role)?.command(id, kind, w, Payload::Text(text))?;
        }
        Ok(())
    }

    pub(crate) fn program(&mut self, role: Role) -> Result<&mut Program, HubError> {
        self.programs.iter_mut().find(|p| p.role == role).ok_or_else(|| {
            HubError::Misuse(format!("session `{}` has no {}", self.place.session, role.program()))
        })
    }

    /// Waits until each rank of `roles` has sent a response.
    fn wait_for(&mut self, roles: &[Role], on_wait: OnWait<'_>) -> Result<(), HubError> {
        let mut looked = Instant::now();
        loop {
            self.extend_deadlines(looked.elapsed());
            // Checked first: a message that a rank sent before it died still counts.
            let dead = self.dead();
            self.drain()?;
            let open = |p: &&Program| roles.contains(&p.role) && p.ranks.iter().any(|r| r.answer.is_none());
            let Some(waiting) = self.programs.iter().find(open) else { return Ok(()) };
            if let Some(who) = dead.filter(|&who| self.silent(who)) {
                return Err(HubError::Died { who, during: self.current_step(who.role) });
            }
            if let Some(pending) = waiting.pending.filter(|a| a.deadline.is_over()) {
                return Err(self.late(waiting, pending.deadline));
            }
            if looked.elapsed() >= POLL_INTERVAL {
                on_wait()?;
                looked = Instant::now();
            }
            self.sleep(POLL_INTERVAL.saturating_sub(looked.elapsed()).max(Duration::from_millis(1)))?;
        }
    }

    /// The error for a rank of `program` that has not responded in time.
    fn late(&self, program: &Program, deadline: Deadline) -> HubError {
        let late: Vec<&Rank> = program.ranks.iter().filter(|r| r.answer.is_none()).collect();
        let pids: Vec<u32> = late.iter().filter_map(|r| Some(r.hello.as_ref()?.pid)).collect();
        // Ranks that wait for another one in MPI are silent as well.
        let (i, state) = find_stalled(&pids).unwrap_or((0, ""));
        let who = late[i].who;
        HubError::Deadline { who, during: self.current_step(who.role), seconds: deadline.limit_s(), state }
    }

    /// Extends the deadlines by the time in which this process was suspended (by the batch system or by a user); it
    /// sleeps at most `POLL_INTERVAL` at a time.
    fn extend_deadlines(&mut self, since: Duration) {
        if since > SUSPENDED {
            for pending in self.programs.iter_mut().filter_map(|p| p.pending.as_mut()) {
                pending.deadline.extend(since);
            }
        }
    }

    pub(crate) fn sleep(&self, limit: Duration) -> Result<(), HubError> {
        Ok(self.listener.sleep(limit)?)
    }

    /// Receives responses; a fault of any rank is an error at once.
    pub(crate) fn drain(&mut self) -> Result<(), HubError> {
        let mut faulty = None;
        for rank in self.programs.iter_mut().flat_map(|p| &mut p.ranks).filter(|r| r.answer.is_none()) {
            let Some(message) = rank.answers.receive()? else { continue };
            let header = message.header();
            if header.kind == Kind::Fault as u32 && faulty.is_none() {
                let text = unpack_text(message.payload(), header.bytes);
                faulty =
                    Some((rank.who, Fault::new(text.as_deref().unwrap_or("a message without valid text"))));
            } else {
                rank.answer = Some(message);
            }
        }
        match faulty {
            Some((who, fault)) => Err(HubError::Fault { who, during: self.current_step(who.role), fault }),
            None => Ok(()),
        }
    }

    /// A rank that has arrived, has not responded, and whose process has ended.
    pub(crate) fn dead(&self) -> Option<RankId> {
        let silent = self.ranks().filter(|r| r.answer.is_none());
        silent.into_iter().find(|r| r.watch.as_ref().is_some_and(|w| !w.is_held())).map(|r| r.who)
    }

    /// Whether a rank has no unread response.
    fn silent(&self, who: RankId) -> bool {
        self.ranks().any(|r| r.who == who && r.answer.is_none())
    }

    fn ranks(&self) -> impl Iterator<Item = &Rank> {
        self.programs.iter().flat_map(|p| &p.ranks)
    }

    /// The current step of a program, for messages.
    pub(crate) fn current_step(&self, role: Role) -> String {
        // The step of a waiting program is that of the others.
        let pending = self.programs.iter().find(|p| p.role == role).and_then(|p| p.pending);
        match pending.or_else(|| self.programs.iter().find_map(|p| p.pending)) {
            Some(pending) => during(pending.kind, &pending.window),
            None => during(Kind::Announce, &Window::default()),
        }
    }

    /// Records the first failure, to inform the participants.
    fn record_failure<T>(&mut self, result: Result<T, HubError>) -> Result<T, HubError> {
        if let Err(e) = &result {
            self.failure.get_or_insert_with(|| e.to_string());
        }
        result
    }

    /// Waits until no participant is in the session any more, or the limit has expired.
    fn await_silence(&self, limit: Duration) {
        let silent = || !self.ranks().any(|r| r.watch.as_ref().is_some_and(LockMonitor::is_held));
        Deadline::after(limit).poll(Duration::from_millis(2), silent);
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        if !self.stopped {
            let why = self.failure.take().unwrap_or_else(|| "the coupler ended the run".into());
            for program in &mut self.programs {
                let _ = program.send(self.id, Kind::Abort, &Window::default(), Payload::Text(&why));
            }
            self.await_silence(ABORT_NOTICE_TIME);
        }
        // Participants now notice the end without a message.
        self.lock = None;
        for program in &self.programs {
            program.wake_event.notify();
        }
    }
}

/// Removes the session's files if all its processes have ended; otherwise [`crate::cleanup`] does.
pub(crate) struct CleanupGuard(SessionPaths);

impl Drop for CleanupGuard {
    fn drop(&mut self) {
        let _ = self.0.clean();
    }
}

fn folder_text(folder: &Path) -> Result<String, HubError> {
    let file = |source| HubError::Session(SessionError::File { path: folder.into(), source });
    std::fs::create_dir_all(folder).map_err(file)?;
    // Programs may run in another working directory.
    let full = std::path::absolute(folder).map_err(file)?;
    full.into_os_string()
        .into_string()
        .map_err(|name| HubError::Misuse(format!("the folder name {} is not UTF-8", name.display())))
}

fn check_options(options: &HubOptions) -> Result<(), HubError> {
    let mut roles = Vec::new();
    for spec in &options.roles {
        if spec.ranks == 0 {
            return Err(HubError::Misuse(format!("{} needs at least one rank", spec.role.program())));
        }
        if roles.contains(&spec.role) {
            return Err(HubError::Misuse(format!("{} is listed twice", spec.role.program())));
        }
        roles.push(spec.role);
    }
    if roles.is_empty() { Err(HubError::Misuse("a session needs a participant".into())) } else { Ok(()) }
}
