//! The coupler's side.

use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use case::Role;

use crate::header::{COUPLER, Header, Kind, Unit, role_code, text_words, unpack_text};
use crate::session::{Lock, Notice, Place, Watch, cleanup_stale, fnv};
use crate::transport::{Bell, Channel, Link, Message, Receiver, Ringer, Sender, Sleeper};
use crate::wire::{Hello, Roster, during, first_not_finite};
use crate::{Abort, Announcement, CONTRACT_VERSION, Fault, HubError, SessionError, Stats, Who, Window};

/// What a session consists of.
#[derive(Clone, Debug)]
pub struct HubOptions {
    /// Name of the session: isolates it from all others on this machine.
    pub session: String,
    /// Participants.
    pub roles: Vec<RoleOptions>,
    /// Stage of the scene, checked against what the programs announce.
    pub stage: usize,
    /// The canopy as the coupler knows it. `None`: what the programs announce,
    /// if they agree.
    pub interface: Option<Interface>,
    /// Longest wait for all participants to arrive. `None`: no limit.
    pub arrival_deadline: Option<Duration>,
    /// Lets [`Hub::collect`] see the grid that the mesh-mover publishes (for
    /// recordings and conformance tests).
    pub watch_grid: bool,
}

/// One program of a session.
#[derive(Clone, Debug)]
pub struct RoleOptions {
    /// Its role.
    pub role: Role,
    /// Its ranks.
    pub ranks: usize,
    /// Longest time for one answer. `None`: no limit.
    pub deadline: Option<Duration>,
    /// Effects of the scene that it must implement.
    pub effects: Vec<String>,
}

/// The canopy that all programs share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Nodes.
    pub nodes: u64,
    /// Faces.
    pub faces: u64,
    /// [`crate::surface_hash`] of the faces.
    pub surface_hash: u64,
}

/// Who has arrived so far.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Ranks that have announced themselves, with the name and version of their program.
    pub arrived: Vec<(Who, String)>,
    /// Ranks that have not.
    pub missing: Vec<Who>,
    /// Seconds since the wait began.
    pub seconds: f64,
}

/// Called while the hub waits for answers, at most 50 ms apart: look after child
/// processes and Ctrl-C here. An error ends the wait.
pub type OnWait<'a> = &'a mut dyn FnMut() -> Result<(), Abort>;

/// Longest sleep between two calls of `on_wait`.
const TICK: Duration = Duration::from_millis(40);
/// Numbers that any command can carry, so that folders and messages fit.
const TEXT_WORDS: usize = 1024;
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
    place: Place,
    lock: Option<Lock>,
    /// Last: works when all else is closed.
    _sweep: Sweep,
}

/// One program, seen from the coupler.
pub(crate) struct Program {
    pub role: Role,
    pub deadline: Option<Duration>,
    pub input_length: usize,
    pub ranks: Vec<Rank>,
    channel: Channel,
    command: Option<Sender>,
    bell: Ringer,
    /// Number of the last command.
    pub sequence: u64,
    /// The command that is being carried out.
    asked: Option<Asked>,
    /// Window of the last `advance` since the last `accept`.
    open: Option<u64>,
}

#[derive(Clone, Copy)]
struct Asked {
    kind: Kind,
    window: Window,
    at: Instant,
}

/// One rank, seen from the coupler.
pub(crate) struct Rank {
    pub who: Who,
    pub hello: Option<Hello>,
    /// Global rows of its output.
    pub rows: Vec<u64>,
    /// Its layout during the handshake.
    pub layout: Option<(Channel, Receiver)>,
    /// Its grid, if it is the mesh's: made by the coupler, read by the flow.
    grid: Option<Channel>,
    watched_grid: Option<Receiver>,
    answers: Receiver,
    /// Its answer, in place and not yet used.
    answer: Option<Message>,
    /// Whether it lives; from its arrival on.
    watch: Option<Watch>,
}

impl Hub {
    /// Opens the session: from here on participants can join. What killed runs
    /// left behind is removed first.
    pub fn create(options: HubOptions) -> Result<Self, HubError> {
        check_options(&options)?;
        let place = Place::of(&options.session)?;
        cleanup_stale()?;
        let lock = match place.open()? {
            Ok(lock) => lock,
            Err(owner) => return Err(HubError::SessionInUse { session: options.session, owner }),
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
        let id = fnv(format!("{} {} {now}", options.session, std::process::id()).as_bytes());
        let link = Link::new(&place, "coupler")?;
        let roster = Roster(options.roles.iter().map(|r| (r.role, r.ranks)).collect());
        let (name, sleepers, ringers) = roster.coupler_bell();
        let mut bells = vec![link.create_bell(name, sleepers, ringers)?];
        let sleeper = bells[0].sleeper()?;
        let mut programs = Vec::new();
        for spec in &options.roles {
            let role = spec.role;
            let (name, sleepers, ringers) = roster.bell(role);
            let bell = link.create_bell(&name, sleepers, ringers)?;
            let ranks = (0..spec.ranks).map(|rank| Rank::open(&link, &roster, Who { role, rank }, &options));
            let ranks = ranks.collect::<Result<_, _>>()?;
            let (name, channel) = roster.command(role);
            programs.push(Program {
                role,
                deadline: spec.deadline,
                input_length: 0,
                ranks,
                channel: link.create(&name, channel)?,
                command: None,
                bell: bell.ringer()?,
                sequence: 0,
                asked: None,
                open: None,
            });
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
            // Looked at first: what a rank sent before it died still counts.
            let dead = self.dead();
            self.drain()?;
            let open = |p: &&Program| roles.contains(&p.role) && p.ranks.iter().any(|r| r.answer.is_none());
            let Some(waiting) = self.programs.iter().find(open) else { return Ok(()) };
            if let Some(who) = dead.filter(|&who| self.silent(who)) {
                return Err(HubError::Died { who, during: self.doing(who.role) });
            }
            if let (Some(deadline), Some(asked)) = (waiting.deadline, waiting.asked)
                && asked.at.elapsed() >= deadline
            {
                let late = waiting.ranks.iter().find(|r| r.answer.is_none()).expect("one is waited for");
                let (who, seconds) = (late.who, deadline.as_secs_f64());
                return Err(HubError::Deadline { who, during: self.doing(who.role), seconds });
            }
            if looked.elapsed() >= TICK {
                on_wait()?;
                looked = Instant::now();
            }
            self.sleep(TICK.saturating_sub(looked.elapsed()).max(Duration::from_millis(1)))?;
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

    /// Announcements that have come since the last call.
    pub(crate) fn greet(&mut self) -> Result<(), HubError> {
        self.drain()?;
        for rank in self.programs.iter_mut().flat_map(|p| &mut p.ranks) {
            if let Some(message) = rank.answer.take() {
                let hello = rank
                    .check(&message, self.id, Kind::Announce, Unit::Text, None, 0)
                    .or_else(|| rank.hello.is_some().then(|| "announced itself twice".to_string()));
                let text = unpack_text(message.payload(), message.header().bytes).unwrap_or_default();
                match (hello, serde_json::from_str::<Hello>(&text)) {
                    (None, Ok(hello)) => rank.hello = Some(hello),
                    (problem, parsed) => {
                        let problem = problem.unwrap_or_else(|| {
                            format!(
                                "its announcement cannot be read: {}",
                                parsed.err().map_or("?".into(), |e| e.to_string())
                            )
                        });
                        return Err(rank.broken(Kind::Announce, &Window::default(), problem));
                    }
                }
                let Who { role, rank: number } = rank.who;
                rank.watch = Watch::on(&self.place.lock_file(&format!("{}.{number}", role.name())));
            }
        }
        Ok(())
    }

    /// What ranks published as their layout.
    pub(crate) fn layout(&mut self, role: Role, rank: usize) -> Result<Vec<f64>, HubError> {
        let id = self.id;
        let rank = &mut self.program(role)?.ranks[rank];
        let (_, receiver) = rank.layout.as_ref().expect("opened with the session");
        let Some(message) = receiver.receive()? else {
            return Err(rank.broken(Kind::Layout, &Window::default(), "it published no layout".into()));
        };
        let hello = rank.hello.as_ref().expect("it has arrived");
        let length = (hello.output_rows + hello.grid_rows) as usize;
        match rank.check(&message, id, Kind::Layout, Unit::Rows, Some(length), message.header().sequence) {
            Some(problem) => Err(rank.broken(Kind::Layout, &Window::default(), problem)),
            None => Ok(message.payload().to_vec()),
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
        let end = Instant::now() + limit;
        while self.ranks().any(|r| r.watch.as_ref().is_some_and(Watch::is_held)) && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(2));
        }
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

enum Payload<'a> {
    Text(&'a str),
    Numbers(Unit, usize, &'a mut dyn FnMut(&mut [f64])),
}

impl Program {
    fn ask_window(&mut self, id: u64, w: &Window, fill: &mut dyn FnMut(&mut [f64])) -> Result<(), HubError> {
        if let Some(open) = self.open.filter(|&open| open != w.index) {
            return Err(HubError::Misuse(format!(
                "{} is asked for window {} before window {open} was accepted",
                self.role.program(),
                w.index
            )));
        }
        let input = Payload::Numbers(Unit::of_input(self.role), self.input_length, fill);
        self.command(id, Kind::Advance, w, input)?;
        self.open = Some(w.index);
        Ok(())
    }

    /// Sends a command that is to be answered.
    fn command(&mut self, id: u64, kind: Kind, w: &Window, payload: Payload<'_>) -> Result<(), HubError> {
        if let Some(asked) = self.asked {
            return Err(HubError::Misuse(format!(
                "{} was told `{kind:?}` while it works on {}",
                self.role.program(),
                during(asked.kind, &asked.window)
            )));
        }
        if let Some(rank) = self.ranks.iter().find(|r| r.answer.is_some()) {
            return Err(rank.broken(kind, w, "it sent an answer that nobody asked for".into()));
        }
        self.asked = Some(Asked { kind, window: *w, at: Instant::now() });
        let got = self.send(id, kind, w, payload)?;
        if got == self.ranks.len() {
            return Ok(());
        }
        if let Some(dead) = self.ranks.iter().find(|r| r.watch.as_ref().is_some_and(|w| !w.is_held())) {
            return Err(HubError::Died { who: dead.who, during: during(kind, w) });
        }
        let problem = format!("`{kind:?}` reached {got} of its {} ranks", self.ranks.len());
        Err(self.ranks[0].broken(kind, w, problem))
    }

    /// Sends a command. Returns how many ranks it reached.
    fn send(&mut self, id: u64, kind: Kind, w: &Window, payload: Payload<'_>) -> Result<usize, HubError> {
        let longest = self.input_length.max(TEXT_WORDS);
        if self.command.as_ref().is_none_or(|c| c.words < longest) {
            // A channel has one sender at a time.
            self.command = None;
            self.command = Some(self.channel.sender(longest)?);
        }
        let sender = self.command.as_ref().expect("just made");
        let header = Header::new(kind, id, COUPLER, 0, self.sequence + 1).with_window(*w);
        let got = match payload {
            Payload::Text("") => sender.send(header)?,
            Payload::Text(text) if text_words(text) > sender.words && kind != Kind::Abort => {
                return Err(HubError::Misuse(format!("the text of `{kind:?}` is too long: {text}")));
            }
            Payload::Text(text) => sender.send_text(header, text)?,
            Payload::Numbers(unit, length, fill) => {
                let mut loan = sender.loan(length)?;
                fill(loan.payload());
                if let Some(i) = first_not_finite(loan.payload()) {
                    return Err(HubError::Misuse(format!(
                        "component {} of row {} of the input of {} in {} is {}: the coupling has diverged \
                         or the row was left out",
                        i % unit.width(),
                        i / unit.width(),
                        self.role.program(),
                        during(kind, w),
                        loan.payload()[i]
                    )));
                }
                loan.send(header.with_payload(unit, length))?
            }
        };
        self.sequence += 1;
        self.bell.ring();
        Ok(got)
    }

    fn take_done(&mut self, id: u64) -> Result<(), HubError> {
        let asked = self.asked.take().expect("a command was sent");
        for rank in &mut self.ranks {
            let message = rank.answer.take().expect("each rank has answered");
            if let Some(problem) = rank.check(&message, id, Kind::Done, Unit::None, Some(0), self.sequence) {
                return Err(rank.broken(asked.kind, &asked.window, problem));
            }
        }
        Ok(())
    }

    fn take_outputs(
        &mut self,
        id: u64,
        each: &mut dyn FnMut(&[u64], &[f64]),
    ) -> Result<Vec<Stats>, HubError> {
        let asked = self.asked.take().expect("a window was asked for");
        let mut stats = Vec::with_capacity(self.ranks.len());
        for rank in &mut self.ranks {
            let message = rank.answer.take().expect("each rank has answered");
            stats.push(message.header().stats);
            let sequence = self.sequence;
            let through_hub = self.role != Role::Mesh;
            let output = Unit::of_output(self.role);
            let length = rank.rows.len() * output.width();
            let (unit, expected) = if through_hub { (output, length) } else { (Unit::None, 0) };
            let mut problem = rank.check(&message, id, Kind::Output, unit, Some(expected), sequence);
            let mut grid = None;
            if let (None, Some(receiver)) = (&problem, &rank.watched_grid) {
                match receiver.receive()? {
                    Some(message) => {
                        problem = rank.check(&message, id, Kind::Grid, output, Some(length), sequence);
                        grid = Some(message);
                    }
                    None => problem = Some("it published no grid".into()),
                }
            }
            let answered = message.header().window;
            if (answered.index, answered.iteration) != (asked.window.index, asked.window.iteration) {
                problem = Some(format!("it answered {}", during(Kind::Output, &answered)));
            }
            let data = grid.as_ref().unwrap_or(&message).payload();
            if let Some(i) = first_not_finite(data) {
                problem = Some(format!("output row {} holds {}", rank.rows[i / output.width()], data[i]));
            }
            if let Some(i) = first_not_finite(&message.header().stats.values) {
                problem = Some(format!("statistic {i} is not finite"));
            }
            match problem {
                Some(problem) => return Err(rank.broken(asked.kind, &asked.window, problem)),
                None => each(&rank.rows, data),
            }
        }
        Ok(stats)
    }
}

impl Rank {
    fn open(link: &Link, roster: &Roster, who: Who, options: &HubOptions) -> Result<Self, SessionError> {
        let (name, spec) = roster.answer(who.role, who.rank);
        let answers = link.create(&name, spec)?.receiver()?;
        let (name, spec) = roster.layout(who.role, who.rank);
        let layout = link.create(&name, spec)?;
        let layout_receiver = layout.receiver()?;
        let (mut grid, mut watched_grid) = (None, None);
        if who.role == Role::Mesh {
            let (name, spec) = roster.grid(who.rank);
            let channel = link.create(&name, spec)?;
            watched_grid = options.watch_grid.then(|| channel.receiver()).transpose()?;
            grid = Some(channel);
        }
        Ok(Self {
            who,
            hello: None,
            rows: Vec::new(),
            layout: Some((layout, layout_receiver)),
            grid,
            watched_grid,
            answers,
            answer: None,
            watch: None,
        })
    }

    /// The participants have joined what they need.
    pub fn settle(&mut self) {
        self.layout = None;
        self.grid = None;
    }

    /// What is wrong with a message of this rank, if anything.
    fn check(
        &self,
        message: &Message,
        id: u64,
        kind: Kind,
        unit: Unit,
        length: Option<usize>,
        sequence: u64,
    ) -> Option<String> {
        let (header, found) = (message.header(), message.payload().len());
        let shared = header.problem(id, role_code(self.who.role), self.who.rank, found);
        shared.or_else(|| {
            if header.kind != kind as u32 || header.unit != unit as u32 {
                let came =
                    Kind::from_code(header.kind).map_or("an unknown kind".into(), |k| format!("{k:?}"));
                Some(format!("{came} in unit {} where {kind:?} in unit {unit:?} was due", header.unit))
            } else if header.sequence != sequence {
                Some(format!("an answer to command {} where {sequence} was asked", header.sequence))
            } else {
                let expected = length.filter(|&n| n != found)?;
                Some(format!("{found} numbers where {expected} were due"))
            }
        })
    }

    pub fn broken(&self, kind: Kind, w: &Window, problem: String) -> HubError {
        HubError::Contract { who: self.who, during: during(kind, w), problem }
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
