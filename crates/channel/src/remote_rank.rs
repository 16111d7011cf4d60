//! A rank on another host than the coupler's: its commands and responses pass through a rank that proxies it.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::header::Kind;
use crate::relay::{Frame, Peers, receive};
use crate::serve::{Identity, ResponseClock, finite, guarded};
use crate::wire::during;
use crate::{Fault, Grid, Input, Participant, ServeEnd, ServeError, ServeOptions, Window};

/// Serves a rank on another host; rank `proxy` represents it in the session.
pub(crate) fn serve_remote(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
    proxy: usize,
) -> Result<ServeEnd, ServeError> {
    println!(
        "rank {} of {} runs on another host than the coupler: rank {proxy} represents it in the session",
        at.rank, at.ranks
    );
    let mut rank = RemoteRank::announce(participant, at, ProxyChannel { peers, proxy })?;
    let mut windows = 0;
    loop {
        let command = rank.next()?;
        if command.kind == Kind::Advance {
            rank.advance(participant, &command)?;
            continue;
        }
        rank.execute(participant, &command)?;
        match command.kind {
            Kind::Accept => windows += 1,
            Kind::Stop => return Ok(ServeEnd { windows }),
            _ => {}
        }
    }
}

/// Message channel to the rank that proxies this one.
#[derive(Clone, Copy)]
struct ProxyChannel<'a> {
    peers: &'a Peers<'a>,
    proxy: usize,
}

impl ProxyChannel<'_> {
    fn send(&self, frame: &Frame) {
        (self.peers.send)(self.proxy, &frame.pack());
    }

    /// Reports a fault in `step`; returns the error for this side.
    fn fail(&self, step: &(Kind, Window), fault: Fault) -> ServeError {
        self.send(&Frame::fault(step.1, &fault));
        // The end of this process ends the others: the message must arrive first.
        std::thread::sleep(Duration::from_millis(500));
        ServeError::Fault { during: during(step.0, &step.1), fault }
    }
}

struct RemoteRank<'a> {
    at: &'a ServeOptions,
    channel: ProxyChannel<'a>,
    identity: Identity,
    /// Rows of the grid arrive in the order in which they are read.
    index: Vec<(u32, u32)>,
    /// The output buffer, reused.
    answer: Frame,
    /// The last command.
    step: (Kind, Window),
}

impl<'a> RemoteRank<'a> {
    fn announce(
        participant: &dyn Participant,
        at: &'a ServeOptions,
        channel: ProxyChannel<'a>,
    ) -> Result<Self, ServeError> {
        let step = (Kind::Announce, Window::default());
        let failed = |fault| channel.fail(&step, fault);
        let identity = guarded(|| Identity::of(participant)).map_err(failed)?;
        channel.send(&Frame::announce(&identity).map_err(failed)?);
        let index = (0..identity.grid_rows.len() as u32).map(|row| (0, row)).collect();
        Ok(Self { at, channel, identity, index, answer: Frame::new(Kind::Output, Window::default()), step })
    }

    /// The next command.
    fn next(&mut self) -> Result<Frame, ServeError> {
        let during = during(self.step.0, &self.step.1);
        let command = receive(self.channel.peers, self.channel.proxy, self.at.deadline).map_err(
            |problem| match problem {
                None => ServeError::Deadline {
                    session: self.at.session.clone(),
                    seconds: self.at.deadline.unwrap_or_default().as_secs_f64(),
                    during,
                },
                Some(problem) => ServeError::Contract { during, problem },
            },
        )?;
        self.step = (command.kind, command.window);
        Ok(command)
    }

    /// Computes one window and sends its output.
    fn advance(&mut self, participant: &mut dyn Participant, command: &Frame) -> Result<(), ServeError> {
        let w = command.window;
        let pieces = [&command.second[..]];
        // No rows: the grid is at rest.
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
        let clock = ResponseClock::start(participant);
        let computed = guarded(|| participant.advance(&w, &input, output))
            .and_then(|stats| finite(output, output_rows, width, &stats).map(|()| stats));
        self.answer.stats = computed.map_err(|fault| self.channel.fail(&self.step, fault))?;
        clock.stop(participant, &mut self.answer.stats);
        self.answer.window = w;
        self.channel.send(&self.answer);
        Ok(())
    }

    /// Executes a command that is answered with `Done`.
    fn execute(&self, participant: &mut dyn Participant, command: &Frame) -> Result<(), ServeError> {
        let (w, folder) = (&command.window, Path::new(&command.text));
        let start = Instant::now();
        let done = match command.kind {
            Kind::Accept => guarded(|| participant.accept(w)),
            Kind::Save => guarded(|| {
                crate::resume::ignore_sigxfsz();
                participant.save(folder)
            }),
            Kind::Snapshot => guarded(|| participant.snapshot(w.time, folder)),
            Kind::Stop => Ok(()),
            kind => Err(Fault::new(format!("unexpected command `{kind:?}` between windows"))),
        };
        done.map_err(|fault| self.channel.fail(&self.step, fault))?;
        let mut answer = Frame::new(Kind::Done, *w);
        answer.stats.busy_s = start.elapsed().as_secs_f64();
        self.channel.send(&answer);
        Ok(())
    }
}
