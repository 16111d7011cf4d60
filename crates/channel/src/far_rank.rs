//! A rank on another host than the coupler's: it is asked, and answers, through a rank that proxies it.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::header::Kind;
use crate::relay::{Frame, Peers, receive};
use crate::serve::{Identity, finite, guarded};
use crate::wire::during;
use crate::{Fault, Grid, Input, Participant, ServeEnd, ServeError, ServeOptions, Window};

/// Serves a rank on another host; rank `proxy` has its place in the session.
pub(crate) fn serve_far(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
    proxy: usize,
) -> Result<ServeEnd, ServeError> {
    println!(
        "rank {} of {} runs on another host than the coupler: rank {proxy} has its place in the session",
        at.rank, at.ranks
    );
    let mut rank = FarRank::announce(participant, at, Line { peers, proxy })?;
    let mut windows = 0;
    loop {
        let command = rank.next()?;
        if command.kind == Kind::Advance {
            rank.advance(participant, &command)?;
            continue;
        }
        rank.carry_out(participant, &command)?;
        match command.kind {
            Kind::Accept => windows += 1,
            Kind::Stop => return Ok(ServeEnd { windows }),
            _ => {}
        }
    }
}

/// Messages to the rank that proxies this one.
#[derive(Clone, Copy)]
struct Line<'a> {
    peers: &'a Peers<'a>,
    proxy: usize,
}

impl Line<'_> {
    fn send(&self, frame: &Frame) {
        (self.peers.send)(self.proxy, &frame.pack());
    }

    /// Reports a fault in `step`; the error for this side.
    fn fail(&self, step: &(Kind, Window), fault: Fault) -> ServeError {
        self.send(&Frame::fault(step.1, &fault));
        // The end of this process ends the others: the message is to come first.
        std::thread::sleep(Duration::from_millis(500));
        ServeError::Fault { during: during(step.0, &step.1), fault }
    }
}

struct FarRank<'a> {
    at: &'a ServeOptions,
    line: Line<'a>,
    identity: Identity,
    /// Rows of the grid come in the order in which they are read.
    index: Vec<(u32, u32)>,
    /// The output, in memory that is used again.
    answer: Frame,
    /// The last command.
    step: (Kind, Window),
}

impl<'a> FarRank<'a> {
    fn announce(
        participant: &dyn Participant,
        at: &'a ServeOptions,
        line: Line<'a>,
    ) -> Result<Self, ServeError> {
        let step = (Kind::Announce, Window::default());
        let failed = |fault| line.fail(&step, fault);
        let identity = guarded(|| Identity::of(participant)).map_err(failed)?;
        line.send(&Frame::announce(&identity).map_err(failed)?);
        let index = (0..identity.grid_rows.len() as u32).map(|row| (0, row)).collect();
        Ok(Self { at, line, identity, index, answer: Frame::new(Kind::Output, Window::default()), step })
    }

    /// The next command.
    fn next(&mut self) -> Result<Frame, ServeError> {
        let during = during(self.step.0, &self.step.1);
        let command =
            receive(self.line.peers, self.line.proxy, self.at.deadline).map_err(|problem| match problem {
                None => ServeError::Deadline {
                    session: self.at.session.clone(),
                    seconds: self.at.deadline.unwrap_or_default().as_secs_f64(),
                    during,
                },
                Some(problem) => ServeError::Contract { during, problem },
            })?;
        self.step = (command.kind, command.window);
        Ok(command)
    }

    /// One window, answered with its output.
    fn advance(&mut self, participant: &mut dyn Participant, command: &Frame) -> Result<(), ServeError> {
        let w = command.window;
        let pieces = [&command.second[..]];
        // No rows: the grid stands still.
        let grid = match command.second.is_empty() {
            true => Grid::default(),
            false => Grid { pieces: &pieces, index: &self.index },
        };
        let input = Input { canopy: &command.first, grid };
        let Identity { announcement, output_rows, .. } = &self.identity;
        let width = announcement.output_width as usize;
        let output = &mut self.answer.first;
        output.clear();
        output.resize(output_rows.len() * width, f64::NAN);
        let start = Instant::now();
        let computed = guarded(|| participant.advance(&w, &input, output))
            .and_then(|stats| finite(output, output_rows, width, &stats).map(|()| stats));
        self.answer.stats = computed.map_err(|fault| self.line.fail(&self.step, fault))?;
        self.answer.stats.busy_s = start.elapsed().as_secs_f64();
        self.answer.window = w;
        self.line.send(&self.answer);
        Ok(())
    }

    /// A command that is answered with `Done`.
    fn carry_out(&self, participant: &mut dyn Participant, command: &Frame) -> Result<(), ServeError> {
        let (w, folder) = (&command.window, Path::new(&command.text));
        let done = match command.kind {
            Kind::Accept => guarded(|| participant.accept(w)),
            Kind::Save => guarded(|| {
                crate::resume::ignore_sigxfsz();
                participant.save(folder)
            }),
            Kind::Snapshot => guarded(|| participant.snapshot(w.time, folder)),
            Kind::Stop => Ok(()),
            kind => Err(Fault::new(format!("`{kind:?}` between windows"))),
        };
        done.map_err(|fault| self.line.fail(&self.step, fault))?;
        self.line.send(&Frame::new(Kind::Done, *w));
        Ok(())
    }
}
