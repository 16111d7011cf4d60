//! One program of a session as the coupler sees it: commands to all its ranks, responses from each, checked before
//! use.

use std::time::Duration;

use case::Role;

use crate::deadline::Deadline;
use crate::header::{COUPLER, Header, Kind, Unit, role_code, text_words};
use crate::hub_options::RoleOptions;
use crate::session::LockMonitor;
use crate::transport::{Channel, Connection, Message, Receiver, Sender, WakeNotifier};
use crate::wire::{Hello, RankCounts, during, first_not_finite};
use crate::{HubError, RankId, SessionError, Stats, Window};

/// Size of the smallest command channel, so that folders and messages fit.
const TEXT_WORDS: usize = 1024;

/// One program as the coupler sees it.
pub(crate) struct Program {
    pub role: Role,
    /// Longest time for a response.
    limit: Option<Duration>,
    pub input_length: usize,
    pub ranks: Vec<Rank>,
    channel: Channel,
    pub command: Option<Sender>,
    pub wake_event: WakeNotifier,
    /// Number of the last command.
    pub sequence: u64,
    /// The command in progress.
    pub pending: Option<PendingCommand>,
    /// Window of the last `advance` since the last `accept`.
    pub open: Option<u64>,
}

#[derive(Clone, Copy)]
pub(crate) struct PendingCommand {
    pub kind: Kind,
    pub window: Window,
    pub deadline: Deadline,
}

/// One rank as the coupler sees it.
pub(crate) struct Rank {
    pub who: RankId,
    pub hello: Option<Hello>,
    /// Global rows of its output.
    pub rows: Vec<u64>,
    /// Its layout during the handshake.
    pub layout: Option<(Channel, Receiver)>,
    /// Its grid, if it is a rank of the mesh: created by the coupler, read by the flow.
    grid: Option<Channel>,
    watched_grid: Option<Receiver>,
    pub answers: Receiver,
    /// Its response, in place and not yet used.
    pub answer: Option<Message>,
    /// Whether it is alive; from its arrival on.
    pub watch: Option<LockMonitor>,
}

pub(crate) enum Payload<'a> {
    Text(&'a str),
    Numbers(Unit, usize, &'a mut dyn FnMut(&mut [f64])),
}

impl Program {
    /// Creates the channels of the program and of its ranks.
    pub fn open(
        link: &Connection,
        rank_counts: &RankCounts,
        spec: &RoleOptions,
        wake_event: WakeNotifier,
        watch_grid: bool,
    ) -> Result<Self, SessionError> {
        let role = spec.role;
        let ranks =
            (0..spec.ranks).map(|rank| Rank::open(link, rank_counts, RankId { role, rank }, watch_grid));
        let (name, channel) = rank_counts.command(role);
        Ok(Self {
            role,
            limit: spec.deadline,
            input_length: 0,
            ranks: ranks.collect::<Result<_, _>>()?,
            channel: link.create(&name, channel)?,
            command: None,
            wake_event,
            sequence: 0,
            pending: None,
            open: None,
        })
    }

    pub fn send_advance(
        &mut self,
        id: u64,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
    ) -> Result<(), HubError> {
        if let Some(open) = self.open.filter(|&open| open != w.index) {
            return Err(HubError::Misuse(format!(
                "{} received a request for window {} before window {open} was accepted",
                self.role.program(),
                w.index
            )));
        }
        let input = Payload::Numbers(Unit::of_input(self.role), self.input_length, fill);
        self.command(id, Kind::Advance, w, input)?;
        self.open = Some(w.index);
        Ok(())
    }

    /// Sends a command that requires a response.
    pub fn command(&mut self, id: u64, kind: Kind, w: &Window, payload: Payload<'_>) -> Result<(), HubError> {
        if let Some(pending) = self.pending {
            return Err(HubError::Misuse(format!(
                "{} received `{kind:?}` while it works on {}",
                self.role.program(),
                during(pending.kind, &pending.window)
            )));
        }
        if let Some(rank) = self.ranks.iter().find(|r| r.answer.is_some()) {
            return Err(rank.broken(kind, w, "it sent a response without a request".into()));
        }
        self.pending = Some(PendingCommand { kind, window: *w, deadline: Deadline::after(self.limit) });
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

    /// Sends a command. Returns the number of ranks that it reached.
    pub fn send(&mut self, id: u64, kind: Kind, w: &Window, payload: Payload<'_>) -> Result<usize, HubError> {
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
                         or the row was not written",
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
        self.wake_event.notify();
        if kind == Kind::Advance {
            sender.prepare(self.input_length);
        }
        Ok(got)
    }

    /// Seconds that the slowest rank worked on the command.
    pub fn take_done(&mut self, id: u64) -> Result<f64, HubError> {
        let pending = self.pending.take().expect("a command was sent");
        let mut busy_s = 0.0f64;
        for rank in &mut self.ranks {
            let message = rank.answer.take().expect("each rank has answered");
            if let Some(problem) = rank.check(&message, id, Kind::Done, Unit::None, Some(0), self.sequence) {
                return Err(rank.broken(pending.kind, &pending.window, problem));
            }
            busy_s = busy_s.max(message.header().stats.busy_s);
        }
        Ok(busy_s)
    }

    pub fn take_outputs(
        &mut self,
        id: u64,
        each: &mut dyn FnMut(&[u64], &[f64]),
    ) -> Result<Vec<Stats>, HubError> {
        let pending = self.pending.take().expect("a window was requested");
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
            if (answered.index, answered.iteration) != (pending.window.index, pending.window.iteration) {
                problem = Some(format!("it answered {}", during(Kind::Output, &answered)));
            }
            let data = grid.as_ref().unwrap_or(&message).payload();
            if let Some(i) = first_not_finite(&message.header().stats.values) {
                problem = Some(format!("statistic {i} is not finite"));
            }
            let problem = problem.map_or_else(|| read_finite(&rank.rows, data, output.width(), each), Err);
            problem.map_err(|problem| rank.broken(pending.kind, &pending.window, problem))?;
        }
        Ok(stats)
    }
}

/// Rows of an output that are checked and then read, while they are in the first cache.
const CHECKED_ROWS: usize = 512;

/// Passes the rows of an output to `each`, up to a row that holds a number that is not finite: the error names it.
fn read_finite(
    rows: &[u64],
    data: &[f64],
    width: usize,
    each: &mut dyn FnMut(&[u64], &[f64]),
) -> Result<(), String> {
    if data.is_empty() {
        each(rows, data);
        return Ok(());
    }
    for (rows, data) in rows.chunks(CHECKED_ROWS).zip(data.chunks(CHECKED_ROWS * width)) {
        if let Some(i) = first_not_finite(data) {
            return Err(format!("output row {} holds {}", rows[i / width], data[i]));
        }
        each(rows, data);
    }
    Ok(())
}

impl Rank {
    pub fn open(
        link: &Connection,
        rank_counts: &RankCounts,
        who: RankId,
        watch_grid: bool,
    ) -> Result<Self, SessionError> {
        let (name, spec) = rank_counts.answer(who.role, who.rank);
        let answers = link.create(&name, spec)?.receiver()?;
        let (name, spec) = rank_counts.layout(who.role, who.rank);
        let layout = link.create(&name, spec)?;
        let layout_receiver = layout.receiver()?;
        let (mut grid, mut watched_grid) = (None, None);
        if who.role == Role::Mesh {
            let (name, spec) = rank_counts.grid(who.rank);
            let channel = link.create(&name, spec)?;
            watched_grid = watch_grid.then(|| channel.receiver()).transpose()?;
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

    /// Drops the channels of the handshake, after the participants have joined theirs.
    pub fn drop_handshake_channels(&mut self) {
        self.layout = None;
        self.grid = None;
    }

    /// The first problem of a message of this rank, if any.
    pub fn check(
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
                Some(format!("{came} in unit {}, expected {kind:?} in unit {unit:?}", header.unit))
            } else if header.sequence != sequence {
                Some(format!("it answers command {}, expected {sequence}", header.sequence))
            } else {
                let expected = length.filter(|&n| n != found)?;
                Some(format!("{found} numbers, expected {expected}"))
            }
        })
    }

    pub fn broken(&self, kind: Kind, w: &Window, problem: String) -> HubError {
        HubError::Contract { who: self.who, during: during(kind, w), problem }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of an output arrive complete and in order; the first bad number is named by its row, and nothing from its block on is read.
    #[test]
    fn outputs_are_read_up_to_the_block_of_a_bad_number() {
        let n = 2 * CHECKED_ROWS + 3;
        let rows: Vec<u64> = (0..n as u64).map(|row| 7 * row).collect();
        let mut data: Vec<f64> = (0..3 * n).map(|i| i as f64).collect();
        let read = |data: &[f64]| {
            let (mut of_rows, mut of_data) = (Vec::new(), Vec::new());
            let end = read_finite(&rows, data, 3, &mut |rows, data| {
                of_rows.extend_from_slice(rows);
                of_data.extend_from_slice(data);
            });
            (end, of_rows, of_data)
        };
        assert_eq!(read(&data), (Ok(()), rows.clone(), data.clone()));
        assert_eq!(
            read(&[]),
            (Ok(()), rows.clone(), Vec::new()),
            "a grid that does not pass through the coupler"
        );
        let row = CHECKED_ROWS + 5;
        data[3 * row + 1] = f64::NAN;
        let (end, of_rows, of_data) = read(&data);
        assert_eq!(end, Err(format!("output row {} holds NaN", 7 * row)));
        assert_eq!((of_rows.len(), of_data.len()), (CHECKED_ROWS, 3 * CHECKED_ROWS));
    }
}
