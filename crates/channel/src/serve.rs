//! The loop of one rank of a participant.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use case::Role;

use crate::header::{COUPLER, Kind, Unit, text_words, unpack_text};
use crate::post::{Guardian, Post, dismiss_guardians};
use crate::relay::{Frame, Peers, Standing, memory_name, receive, serve_far, standing};
use crate::session::panic_fault;
use crate::transport::{Loan, Message, Receiver, Sender};
use crate::windows::Windows;
use crate::wire::{Hello, Welcome, decode_rows, during, first_not_finite, to_json};
use crate::{Announcement, CONTRACT_VERSION, Fault, Grid, Input, Participant, ServeError, Stats, Window};

/// Which rank serves, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct ServeOptions {
    /// Session of the coupler.
    pub session: String,
    /// Role of the program.
    pub role: Role,
    /// This rank.
    pub rank: usize,
    /// Ranks of the program.
    pub ranks: usize,
    /// Stage of the scene, announced to the coupler.
    pub stage: usize,
    /// Longest silence of the coupler. `None`: no limit.
    pub deadline: Option<Duration>,
    /// Ends this *process* when the coupler dies in the middle of a long
    /// computation. Off: that is noticed when the computation is over.
    pub exit_when_orphaned: bool,
}

/// How a run ended well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServeEnd {
    /// Windows accepted.
    pub windows: u64,
}

/// Numbers that any answer channel can carry, so that messages to people fit.
pub(crate) const TEXT_WORDS: usize = 1024;

/// Serves one rank of a program from the handshake to the coupler's `stop`.
///
/// Each rank of the program calls this with its own participant. While it waits
/// it sleeps in the kernel. A fault or panic of the participant is reported to
/// the coupler before this returns; the caller then ends the process with a code
/// other than zero (under MPI without `MPI_Finalize`, so that `mpirun` ends the
/// other ranks).
pub fn serve(participant: &mut dyn Participant, at: &ServeOptions) -> Result<ServeEnd, ServeError> {
    serve_near(participant, at, None)
}

/// As [`serve`], for a program whose ranks may span several hosts. Collective.
///
/// Ranks that share the coupler's memory serve as ever. Those that do not are asked through
/// one that does, by `peers`; at least one rank must run on the coupler's host.
pub fn serve_across(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
) -> Result<ServeEnd, ServeError> {
    serve_from(memory_name(), participant, at, peers)
}

/// As [`serve_across`] for a process that sees `memory`.
pub(crate) fn serve_from(
    memory: u64,
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
) -> Result<ServeEnd, ServeError> {
    match standing(at, memory, peers)? {
        Standing::Near(kept) => serve_near(participant, at, Some((peers, &kept))),
        Standing::Far(keeper) => serve_far(participant, at, peers, keeper),
    }
}

fn serve_near(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    far: Option<(&Peers<'_>, &[usize])>,
) -> Result<ServeEnd, ServeError> {
    // A full disk is an error that the coupler is told.
    crate::kept::bear_size_limit();
    let post = Post::join(at, at.deadline)?;
    let _guardian = if at.exit_when_orphaned { Guardian::over(&at.session, None)? } else { None };
    let mut desk = Desk::open(post, guarded(|| Identity::of(participant)))?;
    let mut kept = Vec::new();
    if let Some((peers, ranks)) = far {
        for &rank in ranks {
            let post = Post::join(&ServeOptions { rank, ..at.clone() }, at.deadline)?;
            let said = receive(peers, rank, None).map_err(|p| Fault::new(p.unwrap_or_default()));
            let desk = Desk::open(post, said.and_then(|frame| frame.identity(rank)))?;
            kept.push(Kept { desk, peers: *peers, rank });
        }
    }
    desk.welcome()?;
    kept.iter_mut().try_for_each(|k| k.desk.welcome())?;
    desk.lay_out()?;
    kept.iter_mut().try_for_each(|k| k.desk.lay_out())?;
    desk.run(participant, kept)
}

/// Tells the coupler that this rank cannot even begin (its scene, mesh or state
/// is faulty), so that its one message names the cause. Does nothing where no
/// coupler is there.
pub fn report(at: &ServeOptions, fault: &Fault) {
    let Ok(post) = Post::join(at, Some(Duration::from_millis(200))) else { return };
    let _ = post.answer_sender(TEXT_WORDS).and_then(|answers| {
        answers.send_text(post.header(Kind::Fault, 0), &fault.message)?;
        post.coupler_bell.ring();
        // The coupler connects to a new sender when it next looks: stay until then.
        std::thread::sleep(Duration::from_millis(300));
        Ok(())
    });
}

/// Runs a call of the participant; a panic becomes a fault.
pub(crate) fn guarded<T>(call: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| Err(panic_fault(panic)))
}

/// What a participant says of itself.
pub(crate) struct Identity {
    pub announcement: Announcement,
    pub output_rows: Vec<u64>,
    pub grid_rows: Vec<u64>,
}

impl Identity {
    pub fn of(participant: &dyn Participant) -> Result<Self, Fault> {
        Ok(Self {
            announcement: participant.announce(),
            output_rows: participant.output_rows(),
            grid_rows: participant.grid_rows(),
        })
    }
}

/// An output that may leave the program.
pub(crate) fn finite(output: &[f64], rows: &[u64], width: usize, stats: &Stats) -> Result<(), Fault> {
    if let Some(i) = first_not_finite(output) {
        let (row, component) = (rows[i / width], i % width);
        return Err(Fault::new(format!(
            "component {component} of output row {row} is {} (NaN also where it was not written): \
             the solution has diverged or the row was left out",
            output[i]
        )));
    }
    if let Some(i) = first_not_finite(&stats.values) {
        return Err(Fault::new(format!("statistic {i} is {}: the solution has diverged", stats.values[i])));
    }
    Ok(())
}

/// The place of one rank in a session: its channels, and where it stands.
struct Desk {
    post: Post,
    answers: Sender,
    commands: Receiver,
    /// Where the mesh puts its grid.
    grid_out: Option<Sender>,
    /// Held until the first window: its readers may be late.
    layout_out: Option<Sender>,
    link: GridLink,
    welcome: Welcome,
    output_rows: Vec<u64>,
    grid_rows: Vec<u64>,
    /// Number of the last command, and what it was.
    sequence: u64,
    step: (Kind, Window),
}

/// What a rank of the flow needs to read the grid where the mesh wrote it.
#[derive(Default)]
struct GridLink {
    pieces: Vec<Receiver>,
    /// Rows of the pieces, during the handshake.
    layouts: Vec<Receiver>,
    /// Piece and row of each of the reader's rows.
    index: Vec<(u32, u32)>,
}

impl Desk {
    /// Announces the rank of `post`.
    fn open(post: Post, identity: Result<Identity, Fault>) -> Result<Self, ServeError> {
        let role = post.at.role;
        let (name, spec) = post.roster.command(role);
        let commands = post.link.join(&name, spec)?.receiver()?;
        let step = (Kind::Announce, Window::default());
        let Identity { announcement, output_rows, grid_rows } = match identity {
            Ok(identity) => identity,
            Err(fault) => return Err(post.fail(&post.answer_sender(TEXT_WORDS)?, 0, &step, fault)),
        };
        let hello = to_json(&Hello {
            contract: CONTRACT_VERSION,
            stage: post.at.stage,
            rank: post.at.rank,
            ranks: post.at.ranks,
            pid: std::process::id(),
            output_rows: output_rows.len() as u64,
            grid_rows: grid_rows.len() as u64,
            announcement,
        })?;
        let output = output_rows.len() * Unit::of_output(role).width();
        let grid_out = if role == Role::Mesh {
            let (name, spec) = post.roster.grid(post.at.rank);
            Some(post.link.join(&name, spec)?.sender(output.max(1))?)
        } else {
            None
        };
        let answer = if grid_out.is_some() { 0 } else { output };
        let answers = post.answer_sender(answer.max(TEXT_WORDS).max(text_words(&hello)))?;
        answers.send_text(post.header(Kind::Announce, 0), &hello)?;
        post.coupler_bell.ring();
        Ok(Self {
            post,
            answers,
            commands,
            grid_out,
            layout_out: None,
            link: GridLink::default(),
            welcome: Welcome::default(),
            output_rows,
            grid_rows,
            sequence: 0,
            step,
        })
    }

    /// The first half of the handshake: who the partners are.
    fn welcome(&mut self) -> Result<(), ServeError> {
        let command = self.expect(Kind::Welcome)?;
        let text = unpack_text(command.payload(), command.header().bytes).unwrap_or_default();
        drop(command);
        self.welcome = match serde_json::from_str(&text) {
            Ok(welcome) => welcome,
            Err(e) => return Err(self.broken(format!("the coupler's welcome cannot be read: {e}"))),
        };
        if self.post.at.role == Role::Flow {
            for mesh_rank in 0..self.welcome.mesh_rows.len() {
                let (name, spec) = self.post.roster.grid(mesh_rank);
                self.link.pieces.push(self.post.link.join(&name, spec)?.receiver()?);
                let (name, spec) = self.post.roster.layout(Role::Mesh, mesh_rank);
                self.link.layouts.push(self.post.link.join(&name, spec)?.receiver()?);
            }
        }
        self.done()
    }

    /// The second half: which rows are where.
    fn lay_out(&mut self) -> Result<(), ServeError> {
        let (role, rank) = (self.post.at.role, self.post.at.rank);
        drop(self.expect(Kind::SendLayout)?);
        let (name, spec) = self.post.roster.layout(role, rank);
        let rows = self.output_rows.len() + self.grid_rows.len();
        let sender = self.post.link.join(&name, spec)?.sender(rows.max(1))?;
        let mut loan = sender.loan(rows)?;
        for (word, &row) in loan.payload().iter_mut().zip(self.output_rows.iter().chain(&self.grid_rows)) {
            *word = row as f64;
        }
        let header = self.post.header(Kind::Layout, self.sequence).with_payload(Unit::Rows, rows);
        let readers = if role == Role::Mesh { self.welcome.grid_readers } else { 0 };
        let got = loan.send(header)?;
        self.delivered(Kind::Layout, got, 1 + readers)?;
        self.layout_out = Some(sender);
        self.post.ring_readers();
        let layouts = std::mem::take(&mut self.link.layouts);
        if !layouts.is_empty() {
            self.link.index = self.index_grid(&layouts)?;
        }
        self.done()
    }

    /// Piece and row of each grid node that this rank reads.
    fn index_grid(&self, layouts: &[Receiver]) -> Result<Vec<(u32, u32)>, ServeError> {
        let mut place = std::collections::HashMap::with_capacity(self.grid_rows.len());
        place.extend(self.grid_rows.iter().map(|&row| (row, (u32::MAX, 0))));
        for (rank, layout) in layouts.iter().enumerate() {
            let message = self.wait(|| Ok(layout.receive()?))?;
            let rows = self.welcome.mesh_rows[rank] as usize;
            let problem = self.post.problem(&message, Role::Mesh, rank, Kind::Layout, Unit::Rows, None);
            let owned = message.payload().get(..rows).and_then(decode_rows);
            let (None, Some(owned)) = (&problem, owned) else {
                let problem = problem.unwrap_or_else(|| "rows that are no row numbers".into());
                return Err(self.broken(format!("layout of the mesh-mover (rank {rank}): {problem}")));
            };
            for (i, row) in owned.iter().enumerate() {
                if let Some(place) = place.get_mut(row) {
                    *place = (rank as u32, i as u32);
                }
            }
        }
        let index: Vec<_> = self.grid_rows.iter().map(|row| place[row]).collect();
        match index.iter().position(|&(piece, _)| piece == u32::MAX) {
            None => Ok(index),
            Some(i) => {
                let row = self.grid_rows[i];
                Err(self.broken(format!(
                    "grid node {row}, which this rank reads, is on no rank of the mesh-mover"
                )))
            }
        }
    }

    /// Serves windows until the coupler stops the run; ranks on other hosts, whose posts
    /// are `kept` here, are asked first and heard last.
    fn run(
        mut self,
        participant: &mut dyn Participant,
        mut kept: Vec<Kept<'_>>,
    ) -> Result<ServeEnd, ServeError> {
        let mut windows = Windows::default();
        loop {
            let command = self.next()?;
            let (kind, w) = self.step;
            let asked: Vec<Message> =
                kept.iter_mut().map(|k| k.next(&self.step)).collect::<Result<_, _>>()?;
            match kind {
                Kind::Advance => {
                    self.layout_out = None;
                    if let Some(problem) = windows.advance(&w) {
                        return Err(self.broken(problem));
                    }
                    for (k, command) in kept.iter_mut().zip(&asked) {
                        k.desk.layout_out = None;
                        k.ask_window(command, &w)?;
                    }
                    self.advance(participant, &command, &w)?;
                    drop(asked);
                    kept.iter().try_for_each(|k| k.hear_window(&w))?;
                }
                Kind::Accept => {
                    if let Some(problem) = windows.accept(&w) {
                        return Err(self.broken(problem));
                    }
                    kept.iter().for_each(|k| k.tell(""));
                    self.call(|| participant.accept(&w))?;
                    kept.iter().try_for_each(Kept::hear)?;
                }
                Kind::Save | Kind::Snapshot => {
                    let Some(text) = unpack_text(command.payload(), command.header().bytes) else {
                        return Err(self.broken("a folder whose name is no text".into()));
                    };
                    kept.iter().for_each(|k| k.tell(&text));
                    let folder = Path::new(&text);
                    if kind == Kind::Save {
                        self.call(|| participant.save(folder))?;
                    } else {
                        self.call(|| participant.snapshot(w.time, folder))?;
                    }
                    kept.iter().try_for_each(Kept::hear)?;
                }
                Kind::Stop => {
                    if self.post.at.exit_when_orphaned {
                        dismiss_guardians();
                    }
                    kept.iter().for_each(|k| k.tell(""));
                    kept.iter().try_for_each(Kept::hear)?;
                    self.done()?;
                    return Ok(ServeEnd { windows: windows.accepted });
                }
                _ => return Err(self.broken(format!("`{kind:?}` between windows"))),
            }
        }
    }

    /// The moved grid of window `w`, when the input has been checked.
    fn begin(&self, command: &Message, w: &Window) -> Result<Vec<Message>, ServeError> {
        let input = self.welcome.input_length as usize;
        let unit = Unit::of_input(self.post.at.role);
        if command.payload().len() != input || command.header().unit != unit as u32 {
            let (n, code) = (command.payload().len(), command.header().unit);
            return Err(self.broken(format!(
                "input of {n} numbers in unit {code}, expected {input} in unit {} ({unit:?})",
                unit as u32
            )));
        }
        if let Some(i) = first_not_finite(command.payload()) {
            let (row, component, x) = (i / unit.width(), i % unit.width(), command.payload()[i]);
            return Err(self.broken(format!("component {component} of row {row} of the input is {x}")));
        }
        let pieces = self.grid_pieces(w)?;
        for (rank, piece) in pieces.iter().enumerate() {
            if let Some(i) = first_not_finite(piece.payload()) {
                let (row, x) = (i / Unit::Grid.width(), piece.payload()[i]);
                return Err(
                    self.broken(format!("row {row} of the grid of the mesh-mover (rank {rank}) holds {x}"))
                );
            }
        }
        Ok(pieces)
    }

    /// Memory for the output of a window.
    fn loan(&self) -> Result<Loan, ServeError> {
        let words = self.output_rows.len() * Unit::of_output(self.post.at.role).width();
        Ok(self.grid_out.as_ref().unwrap_or(&self.answers).loan(words)?)
    }

    /// One window: input read in place, output written in place.
    fn advance(
        &self,
        participant: &mut dyn Participant,
        command: &Message,
        w: &Window,
    ) -> Result<(), ServeError> {
        let pieces = self.begin(command, w)?;
        let pieces: Vec<&[f64]> = pieces.iter().map(Message::payload).collect();
        let input =
            Input { canopy: command.payload(), grid: Grid { pieces: &pieces, index: &self.link.index } };
        let width = Unit::of_output(self.post.at.role).width();
        let mut loan = self.loan()?;
        let start = Instant::now();
        let result = guarded(|| participant.advance(w, &input, loan.payload()))
            .and_then(|stats| finite(loan.payload(), &self.output_rows, width, &stats).map(|()| stats));
        match result {
            Ok(mut stats) => {
                stats.busy_s = start.elapsed().as_secs_f64();
                self.publish(loan, w, stats)
            }
            Err(fault) => {
                // Only one message can be in the making.
                drop(loan);
                Err(self.post.fail(&self.answers, self.sequence, &self.step, fault))
            }
        }
    }

    /// Sends the output of a window.
    fn publish(&self, mut loan: Loan, w: &Window, stats: Stats) -> Result<(), ServeError> {
        let (unit, words) = (Unit::of_output(self.post.at.role), loan.payload().len());
        let mut answer = self.post.header(Kind::Output, self.sequence).with_window(*w);
        answer.stats = stats;
        if self.grid_out.is_some() {
            let mut grid = self.post.header(Kind::Grid, self.sequence).with_payload(unit, words);
            grid.window = *w;
            let got = loan.send(grid)?;
            let readers = self.welcome.grid_readers + usize::from(self.welcome.coupler_reads_grid);
            self.delivered(Kind::Grid, got, readers)?;
            self.post.ring_readers();
            self.answer(self.answers.send(answer)?)
        } else {
            self.answer(loan.send(answer.with_payload(unit, words))?)
        }
    }

    /// The grid of window `w`, one message for each rank of the mesh.
    fn grid_pieces(&self, w: &Window) -> Result<Vec<Message>, ServeError> {
        let mut pieces = Vec::with_capacity(self.link.pieces.len());
        for (rank, receiver) in self.link.pieces.iter().enumerate() {
            let message = self.wait(|| {
                while let Some(message) = receiver.receive()? {
                    let found = message.header().window;
                    match (found.index, found.iteration).cmp(&(w.index, w.iteration)) {
                        // Of an iteration that the coupler did not ask the flow for.
                        std::cmp::Ordering::Less => continue,
                        std::cmp::Ordering::Equal => return Ok(Some(message)),
                        std::cmp::Ordering::Greater => {
                            return Err(self.broken(format!(
                                "the mesh-mover (rank {rank}) is ahead, in {}",
                                during(Kind::Grid, &found)
                            )));
                        }
                    }
                }
                if let Some(command) = self.commands.receive()? {
                    return Err(self.end_early(&command));
                }
                Ok(None)
            })?;
            let length = self.welcome.mesh_rows[rank] as usize * Unit::Grid.width();
            if let Some(problem) =
                self.post.problem(&message, Role::Mesh, rank, Kind::Grid, Unit::Grid, Some(length))
            {
                return Err(self.broken(format!("grid of the mesh-mover (rank {rank}): {problem}")));
            }
            pieces.push(message);
        }
        Ok(pieces)
    }

    /// A call of the participant that is answered with `Done`.
    fn call(&self, call: impl FnOnce() -> Result<(), Fault>) -> Result<(), ServeError> {
        match guarded(call) {
            Ok(()) => self.done(),
            Err(fault) => Err(self.post.fail(&self.answers, self.sequence, &self.step, fault)),
        }
    }

    fn done(&self) -> Result<(), ServeError> {
        self.answer(self.answers.send(self.post.header(Kind::Done, self.sequence).with_window(self.step.1))?)
    }

    fn answer(&self, got: usize) -> Result<(), ServeError> {
        self.delivered(Kind::Output, got, 1)?;
        self.post.coupler_bell.ring();
        Ok(())
    }

    fn delivered(&self, kind: Kind, got: usize, expected: usize) -> Result<(), ServeError> {
        if got == expected {
            return Ok(());
        }
        // A reader that is gone is the more likely, and the better, reason.
        if !self.post.coupler.is_held() {
            return Err(self.post.coupler_died(&self.step));
        }
        Err(self.broken(format!("`{kind:?}` reached {got} of {expected} readers")))
    }

    /// The next command, waited for asleep.
    fn next(&mut self) -> Result<Message, ServeError> {
        let command = self.wait(|| Ok(self.commands.receive()?))?;
        let header = *command.header();
        if let Some(problem) = header.problem(self.post.id, COUPLER, 0, command.payload().len()) {
            return Err(self.broken(problem));
        }
        if header.sequence != self.sequence + 1 {
            return Err(self.broken(format!("command {} after command {}", header.sequence, self.sequence)));
        }
        match Kind::from_code(header.kind) {
            Some(Kind::Abort | Kind::Refuse) => return Err(self.end_early(&command)),
            Some(kind) => self.step = (kind, header.window),
            None => return Err(self.broken(format!("a command of unknown kind {}", header.kind))),
        }
        self.sequence += 1;
        Ok(command)
    }

    fn expect(&mut self, kind: Kind) -> Result<Message, ServeError> {
        let command = self.next()?;
        if self.step.0 == kind {
            Ok(command)
        } else {
            Err(self.broken(format!("`{:?}` where `{kind:?}` was due", self.step.0)))
        }
    }

    /// What a command that comes while another is being carried out means.
    fn end_early(&self, command: &Message) -> ServeError {
        let message = unpack_text(command.payload(), command.header().bytes).unwrap_or_default();
        match Kind::from_code(command.header().kind) {
            Some(Kind::Refuse) => ServeError::Refused { message },
            Some(Kind::Abort) => ServeError::Aborted { message, during: during(self.step.0, &self.step.1) },
            kind => self.broken(format!("command {kind:?} before the last was answered")),
        }
    }

    fn wait<T>(&self, poll: impl FnMut() -> Result<Option<T>, ServeError>) -> Result<T, ServeError> {
        self.post.wait(&self.step, poll)
    }

    /// Ends this rank because somebody else broke the contract; the coupler is told.
    fn broken(&self, problem: String) -> ServeError {
        self.post.fail(&self.answers, self.sequence, &self.step, Fault::new(&problem));
        ServeError::Contract { during: during(self.step.0, &self.step.1), problem }
    }
}

/// The post of a rank on another host.
struct Kept<'a> {
    desk: Desk,
    peers: Peers<'a>,
    rank: usize,
}

impl Kept<'_> {
    /// The next command, which is that of the rank that keeps this post.
    fn next(&mut self, step: &(Kind, Window)) -> Result<Message, ServeError> {
        let command = self.desk.next()?;
        // Its bell is listened to by the keeper's own ear.
        self.desk.post.hush()?;
        if self.desk.step == *step { Ok(command) } else { Err(self.desk.broken("another command".into())) }
    }

    fn send(&self, frame: &Frame) {
        (self.peers.send)(self.rank, &frame.pack());
    }

    fn tell(&self, text: &str) {
        let (kind, window) = self.desk.step;
        self.send(&Frame { text: text.to_owned(), ..Frame::new(kind, window) });
    }

    fn ask_window(&self, command: &Message, w: &Window) -> Result<(), ServeError> {
        let pieces = self.desk.begin(command, w)?;
        let mut frame = Frame::new(Kind::Advance, *w);
        frame.first = command.payload().to_vec();
        let pieces: Vec<&[f64]> = pieces.iter().map(Message::payload).collect();
        let grid = Grid { pieces: &pieces, index: &self.desk.link.index };
        if !grid.is_empty() {
            frame.second = (0..self.desk.grid_rows.len()).flat_map(|i| *grid.row(i)).collect();
        }
        self.send(&frame);
        Ok(())
    }

    /// What the rank answered; its fault is told to the coupler.
    fn answer(&self, kind: Kind) -> Result<Frame, ServeError> {
        let fail =
            |fault| self.desk.post.fail(&self.desk.answers, self.desk.sequence, &self.desk.step, fault);
        match receive(&self.peers, self.rank, None) {
            Ok(frame) if frame.kind == kind => Ok(frame),
            Ok(frame) if frame.kind == Kind::Fault => Err(fail(Fault::new(frame.text))),
            Ok(frame) => Err(fail(Fault::new(format!("`{:?}` where `{kind:?}` was due", frame.kind)))),
            Err(problem) => Err(fail(Fault::new(problem.unwrap_or_default()))),
        }
    }

    fn hear(&self) -> Result<(), ServeError> {
        self.answer(Kind::Done)?;
        self.desk.done()
    }

    fn hear_window(&self, w: &Window) -> Result<(), ServeError> {
        let frame = self.answer(Kind::Output)?;
        let mut loan = self.desk.loan()?;
        if frame.first.len() != loan.payload().len() {
            let (found, wanted) = (frame.first.len(), loan.payload().len());
            return Err(self.desk.broken(format!("rank {} sent {found} numbers of {wanted}", self.rank)));
        }
        loan.payload().copy_from_slice(&frame.first);
        self.desk.publish(loan, w, frame.stats)
    }
}

#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;

#[cfg(test)]
#[path = "order_tests.rs"]
mod order_tests;

#[cfg(test)]
#[path = "relay_tests.rs"]
mod relay_tests;
