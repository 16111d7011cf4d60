//! The coupler's side: opens a session, commands its programs, waits for them.

use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use archive::hash::fnv1a;
use case::Role;

use crate::culprit::suspect;
use crate::deadline::Deadline;
use crate::header::{Kind, unpack_text};
use crate::hub_options::{Arrivals, HubOptions, Interface};
use crate::program::{Payload, Program, Rank};
use crate::session::{Lock, Notice, Place, Watch, cleanup_stale};
use crate::transport::{Bell, Link, Sleeper};
use crate::wire::{Roster, during};
use crate::{Abort, Announcement, CONTRACT_VERSION, Fault, HubError, SessionError, Stats, Who, Window};

/// Called while the hub waits for answers, at most 50 ms apart: look after child
/// processes and Ctrl-C here. An error ends the wait.
pub type OnWait<'a> = &'a mut dyn FnMut() -> Result<(), Abort>;

/// Longest sleep between two calls of `on_wait`.
const TICK: Duration = Duration::from_millis(40);
/// A pause between two ticks in which this process cannot have been running.
const STOPPED: Duration = Duration::from_secs(2);
/// How long participants of a dead coupler may take to end.
const ORPHANS: Duration = Duration::from_secs(4);
/// How long participants are given to hear that the run has failed.
const FAREWELL: Duration = Duration::from_millis(300);

/// The coupler's end of all channels of a session.
///
/// Dropped without [`Hub::stop`], it tells the participants that the run has
/// failed; they end at their next wait. Call [`crate::cleanup`] when their
/// processes have ended.
pub struct Hub {
    pub(crate) options: HubOptions,
    pub(crate) interface: Interface,
    pub(crate) programs: Vec<Program>,
    pub(crate) roster: Roster,
    /// Identity of the session.
    pub(crate) id: u64,
    /// Why the run fails, once it does.
    failure: Option<String>,
    stopped: bool,
    sleeper: Sleeper,
    /// Kept for as long as participants may want to join.
    _bells: Vec<Bell>,
    _link: Link,
    pub(crate) place: Place,
    lock: Option<Lock>,
    /// Last: works when all else is closed.
    _sweep: Sweep,
}

impl Hub {
    /// Opens the session: from here on participants can join. What killed runs
    /// left behind is removed first.
    pub fn create(options: HubOptions) -> Result<Self, HubError> {
        check_options(&options)?;
        let place = Place::of(&options.session)?;
        cleanup_stale()?;
        let orphans = Deadline::after(ORPHANS);
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
            // The lock is free again; the first error is the one to tell.
            let _ = place.clean();
        }
        made
    }

    fn open(options: HubOptions, place: Place, lock: Lock) -> Result<Self, HubError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let id = fnv1a(format!("{} {} {now}", options.session, std::process::id()).bytes());
        let link = Link::new(&place, "coupler")?;
        let roster = Roster(options.roles.iter().map(|r| (r.role, r.ranks)).collect());
        let (name, sleepers, ringers) = roster.coupler_bell();
        let mut bells = vec![link.create_bell(name, sleepers, ringers)?];
        let sleeper = bells[0].sleeper()?;
        let mut programs = Vec::new();
        for spec in &options.roles {
            let (name, sleepers, ringers) = roster.bell(spec.role);
            let bell = link.create_bell(&name, sleepers, ringers)?;
            programs.push(Program::open(&link, &roster, spec, bell.ringer()?, options.watch_grid)?);
            bells.push(bell);
        }
        place.close_to_others()?;
        place.publish(&Notice {
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
            roster,
            id,
            failure: None,
            stopped: false,
            sleeper,
            _bells: bells,
            _link: link,
            _sweep: Sweep(place.clone()),
            place,
            lock: Some(lock),
        })
    }

    /// Waits until all ranks have arrived, checks what they announce against each
    /// other, and leads them through the handshake. `on_wait` is called every
    /// 100 ms or more often.
    pub fn await_participants(
        &mut self,
        on_wait: &mut dyn FnMut(&Arrivals) -> Result<(), Abort>,
    ) -> Result<(), HubError> {
        let result = self.handshake(on_wait);
        self.noted(result)
    }

    /// The canopy, once all participants have arrived.
    pub fn interface(&self) -> Interface {
        self.interface
    }

    /// What rank 0 of `role` announced.
    pub fn announcement(&self, role: Role) -> Option<&Announcement> {
        let program = self.programs.iter().find(|p| p.role == role)?;
        Some(&program.ranks[0].hello.as_ref()?.announcement)
    }

    /// Asks `role` for window `w`, without waiting. `fill` writes its input in
    /// place, shape as in [`crate::Input::canopy`], all of it.
    pub fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
    ) -> Result<(), HubError> {
        let id = self.id;
        let result = self.program(role).and_then(|p| p.ask_window(id, w, fill));
        self.noted(result)
    }

    /// Waits, asleep, until each rank of `role` has answered the window asked for.
    /// `each` reads the output of each rank in place, in rank order: global rows
    /// and `[rows][output_width]`. The mesh-mover's grid goes straight to the
    /// flow-solver: its data are empty here unless the hub watches the grid.
    /// Returns the statistics of each rank.
    pub fn collect(
        &mut self,
        role: Role,
        each: &mut dyn FnMut(&[u64], &[f64]),
        on_wait: OnWait<'_>,
    ) -> Result<Vec<Stats>, HubError> {
        let result = self.collect_outputs(role, each, on_wait);
        self.noted(result)
    }

    fn collect_outputs(
        &mut self,
        role: Role,
        each: &mut dyn FnMut(&[u64], &[f64]),
        on_wait: OnWait<'_>,
    ) -> Result<Vec<Stats>, HubError> {
        if self.program(role)?.asked.is_none_or(|a| a.kind != Kind::Advance) {
            return Err(HubError::Misuse(format!("{} was not asked for a window", role.program())));
        }
        self.wait_for(&[role], on_wait)?;
        let id = self.id;
        self.program(role)?.take_outputs(id, each)
    }

    /// Makes window `w` final in every program that computed it.
    pub fn accept(&mut self, w: &Window, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> =
            self.programs.iter().filter(|p| p.open == Some(w.index)).map(|p| p.role).collect();
        let result = if roles.is_empty() {
            Err(HubError::Misuse(format!("window {} is to be accepted, but no program computed it", w.index)))
        } else {
            self.ask(&roles, Kind::Accept, w, "", on_wait)
        };
        for program in &mut self.programs {
            program.open = program.open.filter(|&open| open != w.index);
        }
        self.noted(result)
    }

    /// Lets every program write its accepted state below `folder` (created if missing).
    pub fn save(&mut self, folder: &Path, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
        let result = folder_text(folder)
            .and_then(|folder| self.ask(&roles, Kind::Save, &Window::default(), &folder, on_wait));
        self.noted(result)
    }

    /// Lets the programs of `roles` add their accepted state to the ParaView
    /// series below `folder` (created if missing).
    pub fn snapshot(
        &mut self,
        roles: &[Role],
        time: f64,
        folder: &Path,
        on_wait: OnWait<'_>,
    ) -> Result<(), HubError> {
        let w = Window { time, ..Window::default() };
        let result =
            folder_text(folder).and_then(|folder| self.ask(roles, Kind::Snapshot, &w, &folder, on_wait));
        self.noted(result)
    }

    /// Ends the session in good order: each program is told to stop and waited for.
    pub fn stop(mut self, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
        let result = self.ask(&roles, Kind::Stop, &Window::default(), "", on_wait);
        self.noted(result)?;
        self.stopped = true;
        // What they still do in this session takes them microseconds.
        self.await_silence(Duration::from_secs(2));
        Ok(())
    }

    /// Ends the session because the run has failed: the participants that still
    /// listen are told why.
    pub fn abort(mut self, why: &str) {
        self.failure.get_or_insert_with(|| why.to_string());
    }

    /// Commands `roles` and waits until each rank has carried it out.
    pub(crate) fn ask(
        &mut self,
        roles: &[Role],
        kind: Kind,
        w: &Window,
        text: &str,
        on_wait: OnWait<'_>,
    ) -> Result<(), HubError> {
        self.tell(roles, kind, w, text)?;
        self.finish(roles, on_wait)
    }

    /// Waits until each rank of `roles` has carried out its command.
    pub(crate) fn finish(&mut self, roles: &[Role], on_wait: OnWait<'_>) -> Result<(), HubError> {
        self.wait_for(roles, on_wait)?;
        let id = self.id;
        roles.iter().try_for_each(|&role| self.program(role)?.take_done(id))
    }

    /// Commands `roles`, without waiting.
    pub(crate) fn tell(
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

    /// Waits until each rank of `roles` has answered something.
    fn wait_for(&mut self, roles: &[Role], on_wait: OnWait<'_>) -> Result<(), HubError> {
        let mut looked = Instant::now();
        loop {
            self.extend_deadlines(looked.elapsed());
            // Looked at first: what a rank sent before it died still counts.
            let dead = self.dead();
            self.drain()?;
            let open = |p: &&Program| roles.contains(&p.role) && p.ranks.iter().any(|r| r.answer.is_none());
            let Some(waiting) = self.programs.iter().find(open) else { return Ok(()) };
            if let Some(who) = dead.filter(|&who| self.silent(who)) {
                return Err(HubError::Died { who, during: self.doing(who.role) });
            }
            if let Some(asked) = waiting.asked.filter(|a| a.deadline.is_over()) {
                return Err(self.late(waiting, asked.deadline));
            }
            if looked.elapsed() >= TICK {
                on_wait()?;
                looked = Instant::now();
            }
            self.sleep(TICK.saturating_sub(looked.elapsed()).max(Duration::from_millis(1)))?;
        }
    }

    /// A rank of `program` that has not answered in time.
    fn late(&self, program: &Program, deadline: Deadline) -> HubError {
        let late: Vec<&Rank> = program.ranks.iter().filter(|r| r.answer.is_none()).collect();
        let pids: Vec<u32> = late.iter().filter_map(|r| Some(r.hello.as_ref()?.pid)).collect();
        // Ranks that wait for another one in MPI are silent as well.
        let (i, state) = suspect(&pids).unwrap_or((0, ""));
        let who = late[i].who;
        HubError::Deadline { who, during: self.doing(who.role), seconds: deadline.limit_s(), state }
    }

    /// Time in which this process was stopped (a batch system suspends all processes of a
    /// job, a person the coupler) is nobody's delay: it sleeps `TICK` at a time.
    fn extend_deadlines(&mut self, since: Duration) {
        if since > STOPPED {
            for asked in self.programs.iter_mut().filter_map(|p| p.asked.as_mut()) {
                asked.deadline.extend(since);
            }
        }
    }

    pub(crate) fn sleep(&self, limit: Duration) -> Result<(), HubError> {
        Ok(self.sleeper.sleep(limit)?)
    }

    /// Fetches answers that have come; a fault of any rank is an error at once.
    pub(crate) fn drain(&mut self) -> Result<(), HubError> {
        let mut faulty = None;
        for rank in self.programs.iter_mut().flat_map(|p| &mut p.ranks).filter(|r| r.answer.is_none()) {
            let Some(message) = rank.answers.receive()? else { continue };
            let header = message.header();
            if header.kind == Kind::Fault as u32 && faulty.is_none() {
                let text = unpack_text(message.payload(), header.bytes);
                faulty = Some((rank.who, Fault::new(text.as_deref().unwrap_or("a message that is no text"))));
            } else {
                rank.answer = Some(message);
            }
        }
        match faulty {
            Some((who, fault)) => Err(HubError::Fault { who, during: self.doing(who.role), fault }),
            None => Ok(()),
        }
    }

    /// A rank that has arrived, has not answered, and whose process is gone.
    pub(crate) fn dead(&self) -> Option<Who> {
        let silent = self.ranks().filter(|r| r.answer.is_none());
        silent.into_iter().find(|r| r.watch.as_ref().is_some_and(|w| !w.is_held())).map(|r| r.who)
    }

    /// Whether nothing has come from a rank that was not used yet.
    fn silent(&self, who: Who) -> bool {
        self.ranks().any(|r| r.who == who && r.answer.is_none())
    }

    fn ranks(&self) -> impl Iterator<Item = &Rank> {
        self.programs.iter().flat_map(|p| &p.ranks)
    }

    /// What a program is doing, for messages.
    pub(crate) fn doing(&self, role: Role) -> String {
        // A program that waits is best placed by what the others are doing.
        let asked = self.programs.iter().find(|p| p.role == role).and_then(|p| p.asked);
        match asked.or_else(|| self.programs.iter().find_map(|p| p.asked)) {
            Some(asked) => during(asked.kind, &asked.window),
            None => during(Kind::Announce, &Window::default()),
        }
    }

    /// Remembers why the run fails, to tell the participants.
    fn noted<T>(&mut self, result: Result<T, HubError>) -> Result<T, HubError> {
        if let Err(e) = &result {
            self.failure.get_or_insert_with(|| e.to_string());
        }
        result
    }

    /// Waits until no participant is in the session any more, or time is up.
    fn await_silence(&self, limit: Duration) {
        let silent = || !self.ranks().any(|r| r.watch.as_ref().is_some_and(Watch::is_held));
        Deadline::after(limit).poll(Duration::from_millis(2), silent);
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        if !self.stopped {
            let why = self.failure.take().unwrap_or_else(|| "the coupler gave up".into());
            for program in &mut self.programs {
                let _ = program.send(self.id, Kind::Abort, &Window::default(), Payload::Text(&why));
            }
            self.await_silence(FAREWELL);
        }
        // Now they notice without being told.
        self.lock = None;
        for program in &self.programs {
            program.bell.ring();
        }
    }
}

/// Removes the session's files if all its processes have ended; if not, that is
/// for [`crate::cleanup`].
pub(crate) struct Sweep(Place);

impl Drop for Sweep {
    fn drop(&mut self) {
        let _ = self.0.clean();
    }
}

fn folder_text(folder: &Path) -> Result<String, HubError> {
    let file = |source| HubError::Session(SessionError::File { path: folder.into(), source });
    std::fs::create_dir_all(folder).map_err(file)?;
    // Programs may run in another folder.
    let full = std::path::absolute(folder).map_err(file)?;
    full.into_os_string()
        .into_string()
        .map_err(|name| HubError::Misuse(format!("the folder name {} is not UTF-8", name.display())))
}

fn check_options(options: &HubOptions) -> Result<(), HubError> {
    let mut seen = Vec::new();
    for spec in &options.roles {
        if spec.ranks == 0 {
            return Err(HubError::Misuse(format!("{} needs at least one rank", spec.role.program())));
        }
        if seen.contains(&spec.role) {
            return Err(HubError::Misuse(format!("{} is listed twice", spec.role.program())));
        }
        seen.push(spec.role);
    }
    if seen.is_empty() { Err(HubError::Misuse("a session needs a participant".into())) } else { Ok(()) }
}
