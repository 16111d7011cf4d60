//! A rank on another host, in whose name a rank on the coupler's host speaks.

use crate::header::Kind;
use crate::membership::Membership;
use crate::rank_server::RankServer;
use crate::relay::{Frame, Peers, receive};
use crate::transport::Message;
use crate::{Fault, Grid, ServeError, ServeOptions, Window};

/// The place of a rank on another host.
pub(crate) struct ProxiedRank<'a> {
    pub server: RankServer,
    peers: Peers<'a>,
    rank: usize,
}

impl<'a> ProxiedRank<'a> {
    /// Takes the place of `rank` in the session, once it has said what it is.
    pub fn open(at: &ServeOptions, peers: Peers<'a>, rank: usize) -> Result<Self, ServeError> {
        let member = Membership::join(&ServeOptions { rank, ..at.clone() }, at.deadline)?;
        let said = receive(&peers, rank, None).map_err(|p| Fault::new(p.unwrap_or_default()));
        let server = RankServer::open(member, said.and_then(|frame| frame.identity(rank)))?;
        Ok(Self { server, peers, rank })
    }

    /// The next command, which is that of the rank that proxies this one.
    pub fn next(&mut self, step: &(Kind, Window)) -> Result<Message, ServeError> {
        let command = self.server.next()?;
        // Its bell is listened to by the proxy's own ear.
        self.server.member.drain()?;
        if self.server.step == *step {
            Ok(command)
        } else {
            Err(self.server.broken("another command".into()))
        }
    }

    fn send(&self, frame: &Frame) {
        (self.peers.send)(self.rank, &frame.pack());
    }

    pub fn tell(&self, text: &str) {
        let (kind, window) = self.server.step;
        self.send(&Frame { text: text.to_owned(), ..Frame::new(kind, window) });
    }

    pub fn ask_window(&self, command: &Message, w: &Window) -> Result<(), ServeError> {
        let pieces = self.server.begin(command, w)?;
        let mut frame = Frame::new(Kind::Advance, *w);
        frame.first = command.payload().to_vec();
        let pieces: Vec<&[f64]> = pieces.iter().map(Message::payload).collect();
        let grid = Grid { pieces: &pieces, index: &self.server.link.index };
        if !grid.is_empty() {
            frame.second = (0..self.server.grid_rows.len()).flat_map(|i| *grid.row(i)).collect();
        }
        self.send(&frame);
        Ok(())
    }

    /// What the rank answered; its fault is told to the coupler.
    fn answer(&self, kind: Kind) -> Result<Frame, ServeError> {
        let fail = |fault| {
            self.server.member.fail(&self.server.answers, self.server.sequence, &self.server.step, fault)
        };
        match receive(&self.peers, self.rank, None) {
            Ok(frame) if frame.kind == kind => Ok(frame),
            Ok(frame) if frame.kind == Kind::Fault => Err(fail(Fault::new(frame.text))),
            Ok(frame) => Err(fail(Fault::new(format!("`{:?}` where `{kind:?}` was due", frame.kind)))),
            Err(problem) => Err(fail(Fault::new(problem.unwrap_or_default()))),
        }
    }

    pub fn hear(&self) -> Result<(), ServeError> {
        self.answer(Kind::Done)?;
        self.server.done()
    }

    pub fn hear_window(&self, w: &Window) -> Result<(), ServeError> {
        let frame = self.answer(Kind::Output)?;
        let mut loan = self.server.loan()?;
        if frame.first.len() != loan.payload().len() {
            let (found, wanted) = (frame.first.len(), loan.payload().len());
            return Err(self.server.broken(format!("rank {} sent {found} numbers of {wanted}", self.rank)));
        }
        loan.payload().copy_from_slice(&frame.first);
        self.server.publish(loan, w, frame.stats)
    }
}
