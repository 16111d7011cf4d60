//! A rank on another host, represented by a rank on the coupler's host.

use crate::header::Kind;
use crate::membership::Membership;
use crate::rank_server::RankServer;
use crate::relay::{Frame, Peers, receive};
use crate::transport::Message;
use crate::{Fault, Grid, ServeError, ServeOptions, Window};

/// Representation of a rank on another host.
pub(crate) struct ProxiedRank<'a> {
    pub server: RankServer,
    peers: Peers<'a>,
    rank: usize,
}

impl<'a> ProxiedRank<'a> {
    /// Joins the session as `rank`, once it has sent its announcement.
    pub fn open(at: &ServeOptions, peers: Peers<'a>, rank: usize) -> Result<Self, ServeError> {
        let member = Membership::join(&ServeOptions { rank, ..at.clone() }, at.deadline)?;
        let reported = receive(&peers, rank, None).map_err(|p| Fault::new(p.unwrap_or_default()));
        let server = RankServer::open(member, reported.and_then(|frame| frame.identity(rank)))?;
        Ok(Self { server, peers, rank })
    }

    /// The next command, which must be the same as that of the proxy.
    pub fn next(&mut self, step: &(Kind, Window)) -> Result<Message, ServeError> {
        let command = self.server.next()?;
        // Its notifications are received by the proxy's own listener.
        self.server.member.drain()?;
        if self.server.step == *step {
            Ok(command)
        } else {
            Err(self.server.broken("a command that differs from the proxy's".into()))
        }
    }

    fn send(&self, frame: &Frame) {
        (self.peers.send)(self.rank, &frame.pack());
    }

    pub fn send_command(&self, text: &str) {
        let (kind, window) = self.server.step;
        self.send(&Frame { text: text.to_owned(), ..Frame::new(kind, window) });
    }

    pub fn send_advance(&self, command: &Message, w: &Window) -> Result<(), ServeError> {
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

    /// The response of the rank; its fault is reported to the coupler.
    fn answer(&self, kind: Kind) -> Result<Frame, ServeError> {
        let fail = |fault| {
            self.server.member.fail(&self.server.answers, self.server.sequence, &self.server.step, fault)
        };
        match receive(&self.peers, self.rank, None) {
            Ok(frame) if frame.kind == kind => Ok(frame),
            Ok(frame) if frame.kind == Kind::Fault => Err(fail(Fault::new(frame.text))),
            Ok(frame) => Err(fail(Fault::new(format!("message `{:?}`, expected `{kind:?}`", frame.kind)))),
            Err(problem) => Err(fail(Fault::new(problem.unwrap_or_default()))),
        }
    }

    pub fn receive_done(&self) -> Result<(), ServeError> {
        let frame = self.answer(Kind::Done)?;
        self.server.done_after(frame.stats.busy_s)
    }

    pub fn receive_output(&self, w: &Window) -> Result<(), ServeError> {
        let frame = self.answer(Kind::Output)?;
        let mut loan = self.server.loan()?;
        if frame.first.len() != loan.payload().len() {
            let (found, expected) = (frame.first.len(), loan.payload().len());
            return Err(self
                .server
                .broken(format!("rank {} sent {found} numbers, expected {expected}", self.rank)));
        }
        loan.payload().copy_from_slice(&frame.first);
        self.server.publish(loan, w, frame.stats)
    }
}
