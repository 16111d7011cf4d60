//! One rank of a session: the handshake, then commands and responses.

use std::path::Path;
use std::time::Instant;

use case::Role;

use crate::header::{COUPLER, Kind, Unit, text_words, unpack_text};
use crate::membership::Membership;
use crate::proxied_rank::ProxiedRank;
use crate::serve::{Identity, ResponseClock, TEXT_WORDS, finite, guarded};
use crate::transport::{Loan, Message, Receiver, Sender};
use crate::watchdog::disarm_watchdogs;
use crate::windows::WindowOrder;
use crate::wire::{Hello, Welcome, decode_rows, during, first_not_finite, to_json};
use crate::{CONTRACT_VERSION, Fault, Grid, Input, Participant, ServeEnd, ServeError, Stats, Window};

/// One rank of a session: its channels and its present step.
pub(crate) struct RankServer {
    pub member: Membership,
    pub answers: Sender,
    pub commands: Receiver,
    /// Channel of the mesh's grid.
    pub grid_out: Option<Sender>,
    /// Kept until the first window, for readers that are late.
    pub layout_out: Option<Sender>,
    pub link: GridReader,
    pub welcome: Welcome,
    pub output_rows: Vec<u64>,
    pub grid_rows: Vec<u64>,
    /// Number and kind of the last command.
    pub sequence: u64,
    pub step: (Kind, Window),
}

/// Channels by which a rank of the flow reads the grid in place.
#[derive(Default)]
pub(crate) struct GridReader {
    pieces: Vec<Receiver>,
    /// Rows of the pieces, during the handshake.
    layouts: Vec<Receiver>,
    /// Piece and row of each of the reader's rows.
    pub index: Vec<(u32, u32)>,
}

impl RankServer {
    /// Announces the rank of `member`.
    pub fn open(member: Membership, identity: Result<Identity, Fault>) -> Result<Self, ServeError> {
        let role = member.at.role;
        let (name, spec) = member.rank_counts.command(role);
        let commands = member.link.join(&name, spec)?.receiver()?;
        let step = (Kind::Announce, Window::default());
        let Identity { announcement, output_rows, grid_rows } = match identity {
            Ok(identity) => identity,
            Err(fault) => return Err(member.fail(&member.answer_sender(TEXT_WORDS)?, 0, &step, fault)),
        };
        let hello = to_json(&Hello {
            contract: CONTRACT_VERSION,
            stage: member.at.stage,
            rank: member.at.rank,
            ranks: member.at.ranks,
            pid: std::process::id(),
            output_rows: output_rows.len() as u64,
            grid_rows: grid_rows.len() as u64,
            announcement,
        })?;
        let output = output_rows.len() * Unit::of_output(role).width();
        let grid_out = if role == Role::Mesh {
            let (name, spec) = member.rank_counts.grid(member.at.rank);
            Some(member.link.join(&name, spec)?.sender(output.max(1))?)
        } else {
            None
        };
        let answer = if grid_out.is_some() { 0 } else { output };
        let answers = member.answer_sender(answer.max(TEXT_WORDS).max(text_words(&hello)))?;
        answers.send_text(member.header(Kind::Announce, 0), &hello)?;
        member.coupler_event.notify();
        Ok(Self {
            member,
            answers,
            commands,
            grid_out,
            layout_out: None,
            link: GridReader::default(),
            welcome: Welcome::default(),
            output_rows,
            grid_rows,
            sequence: 0,
            step,
        })
    }

    /// The first half of the handshake: the partners.
    pub fn welcome(&mut self) -> Result<(), ServeError> {
        let command = self.expect(Kind::Welcome)?;
        let text = unpack_text(command.payload(), command.header().bytes).unwrap_or_default();
        drop(command);
        self.welcome = match serde_json::from_str(&text) {
            Ok(welcome) => welcome,
            Err(e) => return Err(self.broken(format!("the coupler's welcome cannot be read: {e}"))),
        };
        if self.member.at.role == Role::Flow {
            for mesh_rank in 0..self.welcome.mesh_rows.len() {
                let (name, spec) = self.member.rank_counts.grid(mesh_rank);
                self.link.pieces.push(self.member.link.join(&name, spec)?.receiver()?);
                let (name, spec) = self.member.rank_counts.layout(Role::Mesh, mesh_rank);
                self.link.layouts.push(self.member.link.join(&name, spec)?.receiver()?);
            }
        }
        self.done()
    }

    /// The second half: the layout of rows over ranks.
    pub fn lay_out(&mut self) -> Result<(), ServeError> {
        let (role, rank) = (self.member.at.role, self.member.at.rank);
        drop(self.expect(Kind::SendLayout)?);
        let (name, spec) = self.member.rank_counts.layout(role, rank);
        let rows = self.output_rows.len() + self.grid_rows.len();
        let sender = self.member.link.join(&name, spec)?.sender(rows.max(1))?;
        let mut loan = sender.loan(rows)?;
        for (word, &row) in loan.payload().iter_mut().zip(self.output_rows.iter().chain(&self.grid_rows)) {
            *word = row as f64;
        }
        let header = self.member.header(Kind::Layout, self.sequence).with_payload(Unit::Rows, rows);
        let readers = if role == Role::Mesh { self.welcome.grid_readers } else { 0 };
        let got = loan.send(header)?;
        self.delivered(Kind::Layout, got, 1 + readers)?;
        self.layout_out = Some(sender);
        self.member.notify_readers();
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
            let problem = self.member.problem(&message, Role::Mesh, rank, Kind::Layout, Unit::Rows, None);
            let owned = message.payload().get(..rows).and_then(decode_rows);
            let (None, Some(owned)) = (&problem, owned) else {
                let problem = problem.unwrap_or_else(|| "it holds numbers that are not row indices".into());
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

    /// Serves windows until the coupler stops the run. The ranks on other hosts that are `proxied` here get each
    /// command first, and their responses are received last.
    pub fn run(
        mut self,
        participant: &mut dyn Participant,
        mut proxied: Vec<ProxiedRank<'_>>,
    ) -> Result<ServeEnd, ServeError> {
        let mut windows = WindowOrder::default();
        loop {
            let command = self.next()?;
            let (kind, w) = self.step;
            let proxied_commands: Vec<Message> =
                proxied.iter_mut().map(|p| p.next(&self.step)).collect::<Result<_, _>>()?;
            match kind {
                Kind::Advance => {
                    self.layout_out = None;
                    if let Some(problem) = windows.advance(&w) {
                        return Err(self.broken(problem));
                    }
                    for (p, command) in proxied.iter_mut().zip(&proxied_commands) {
                        p.server.layout_out = None;
                        p.send_advance(command, &w)?;
                    }
                    self.advance(participant, &command, &w)?;
                    drop(proxied_commands);
                    proxied.iter().try_for_each(|p| p.receive_output(&w))?;
                }
                Kind::Accept => {
                    if let Some(problem) = windows.accept(&w) {
                        return Err(self.broken(problem));
                    }
                    proxied.iter().for_each(|p| p.send_command(""));
                    self.call(|| participant.accept(&w))?;
                    proxied.iter().try_for_each(ProxiedRank::receive_done)?;
                }
                Kind::Save | Kind::Snapshot => {
                    let Some(text) = unpack_text(command.payload(), command.header().bytes) else {
                        return Err(self.broken("the name of a folder is not valid text".into()));
                    };
                    proxied.iter().for_each(|p| p.send_command(&text));
                    let folder = Path::new(&text);
                    if kind == Kind::Save {
                        self.call(|| participant.save(folder))?;
                    } else {
                        self.call(|| participant.snapshot(w.time, folder))?;
                    }
                    proxied.iter().try_for_each(ProxiedRank::receive_done)?;
                }
                Kind::Stop => {
                    if self.member.at.exit_when_orphaned {
                        disarm_watchdogs();
                    }
                    proxied.iter().for_each(|p| p.send_command(""));
                    proxied.iter().try_for_each(ProxiedRank::receive_done)?;
                    self.done()?;
                    return Ok(ServeEnd { windows: windows.accepted });
                }
                _ => return Err(self.broken(format!("unexpected command `{kind:?}` between windows"))),
            }
        }
    }

    /// Checks the input and receives the moved grid of window `w`.
    pub fn begin(&self, command: &Message, w: &Window) -> Result<Vec<Message>, ServeError> {
        let input = self.welcome.input_length as usize;
        let unit = Unit::of_input(self.member.at.role);
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
    pub fn loan(&self) -> Result<Loan, ServeError> {
        let (sender, words) = self.output();
        Ok(sender.loan(words)?)
    }

    /// Channel and numbers of the output.
    fn output(&self) -> (&Sender, usize) {
        let words = self.output_rows.len() * Unit::of_output(self.member.at.role).width();
        (self.grid_out.as_ref().unwrap_or(&self.answers), words)
    }

    /// Computes one window: input is read in place, output is written in place.
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
        let width = Unit::of_output(self.member.at.role).width();
        let mut loan = self.loan()?;
        let clock = ResponseClock::start(participant);
        let result = guarded(|| participant.advance(w, &input, loan.payload()))
            .and_then(|stats| finite(loan.payload(), &self.output_rows, width, &stats).map(|()| stats));
        match result {
            Ok(mut stats) => {
                clock.stop(participant, &mut stats);
                self.publish(loan, w, stats)
            }
            Err(fault) => {
                // Only one message can be in preparation.
                drop(loan);
                Err(self.member.fail(&self.answers, self.sequence, &self.step, fault))
            }
        }
    }

    /// Sends the output of a window.
    pub fn publish(&self, mut loan: Loan, w: &Window, stats: Stats) -> Result<(), ServeError> {
        let (unit, words) = (Unit::of_output(self.member.at.role), loan.payload().len());
        let mut answer = self.member.header(Kind::Output, self.sequence).with_window(*w);
        answer.stats = stats;
        if self.grid_out.is_some() {
            let mut grid = self.member.header(Kind::Grid, self.sequence).with_payload(unit, words);
            grid.window = *w;
            let got = loan.send(grid)?;
            let readers = self.welcome.grid_readers + usize::from(self.welcome.coupler_reads_grid);
            self.delivered(Kind::Grid, got, readers)?;
            self.member.notify_readers();
            self.answer(self.answers.send(answer)?)?;
        } else {
            self.answer(loan.send(answer.with_payload(unit, words))?)?;
        }
        let (sender, words) = self.output();
        sender.prepare(words);
        Ok(())
    }

    /// The grid of window `w`: one message from each rank of the mesh.
    fn grid_pieces(&self, w: &Window) -> Result<Vec<Message>, ServeError> {
        let mut pieces = Vec::with_capacity(self.link.pieces.len());
        for (rank, receiver) in self.link.pieces.iter().enumerate() {
            let message = self.wait(|| {
                while let Some(message) = receiver.receive()? {
                    let found = message.header().window;
                    match (found.index, found.iteration).cmp(&(w.index, w.iteration)) {
                        // From an iteration that was not requested from the flow.
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
                self.member.problem(&message, Role::Mesh, rank, Kind::Grid, Unit::Grid, Some(length))
            {
                return Err(self.broken(format!("grid of the mesh-mover (rank {rank}): {problem}")));
            }
            pieces.push(message);
        }
        Ok(pieces)
    }

    /// A call of the participant that is answered with `Done`.
    fn call(&self, call: impl FnOnce() -> Result<(), Fault>) -> Result<(), ServeError> {
        let start = Instant::now();
        match guarded(call) {
            Ok(()) => self.done_after(start.elapsed().as_secs_f64()),
            Err(fault) => Err(self.member.fail(&self.answers, self.sequence, &self.step, fault)),
        }
    }

    pub fn done(&self) -> Result<(), ServeError> {
        self.done_after(0.0)
    }

    /// A command is completed on which this rank worked for `busy_s` seconds.
    pub fn done_after(&self, busy_s: f64) -> Result<(), ServeError> {
        let mut header = self.member.header(Kind::Done, self.sequence).with_window(self.step.1);
        header.stats.busy_s = busy_s;
        self.answer(self.answers.send(header)?)
    }

    fn answer(&self, got: usize) -> Result<(), ServeError> {
        self.delivered(Kind::Output, got, 1)?;
        self.member.coupler_event.notify();
        Ok(())
    }

    fn delivered(&self, kind: Kind, got: usize, expected: usize) -> Result<(), ServeError> {
        if got == expected {
            return Ok(());
        }
        // A reader that has ended is the more likely reason.
        if !self.member.coupler.is_held() {
            return Err(self.member.coupler_died(&self.step));
        }
        Err(self.broken(format!("`{kind:?}` reached {got} of {expected} readers")))
    }

    /// Waits, asleep, for the next command.
    pub fn next(&mut self) -> Result<Message, ServeError> {
        let command = self.wait(|| Ok(self.commands.receive()?))?;
        let header = *command.header();
        if let Some(problem) = header.problem(self.member.id, COUPLER, 0, command.payload().len()) {
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

    pub fn expect(&mut self, kind: Kind) -> Result<Message, ServeError> {
        let command = self.next()?;
        if self.step.0 == kind {
            Ok(command)
        } else {
            Err(self.broken(format!("command `{:?}`, expected `{kind:?}`", self.step.0)))
        }
    }

    /// The error for a command that arrives during another one.
    fn end_early(&self, command: &Message) -> ServeError {
        let message = unpack_text(command.payload(), command.header().bytes).unwrap_or_default();
        match Kind::from_code(command.header().kind) {
            Some(Kind::Refuse) => ServeError::Refused { message },
            Some(Kind::Abort) => ServeError::Aborted { message, during: during(self.step.0, &self.step.1) },
            kind => self.broken(format!("command {kind:?} before the last one was answered")),
        }
    }

    fn wait<T>(&self, poll: impl FnMut() -> Result<Option<T>, ServeError>) -> Result<T, ServeError> {
        self.member.wait(&self.step, poll)
    }

    /// Ends this rank because of a violation of the contract by another one; reports it to the coupler.
    pub fn broken(&self, problem: String) -> ServeError {
        self.member.fail(&self.answers, self.sequence, &self.step, Fault::new(&problem));
        ServeError::Contract { during: during(self.step.0, &self.step.1), problem }
    }
}
