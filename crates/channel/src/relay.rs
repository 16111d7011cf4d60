//! Ranks on other hosts than the coupler's.
//!
//! Shared memory is limited to a host. In a program whose ranks span several hosts, its ranks on the coupler's host
//! proxy the others: they hold their locks and services and send their responses. So the coupler and the other
//! programs see no difference. Commands and responses of a remote rank pass through message passing inside its
//! program.

use std::io::Write as _;
use std::os::unix::fs::MetadataExt;
use std::time::Duration;

use archive::hash::fnv1a;

use crate::deadline::{Deadline, SlowWaitNotice};
use crate::header::{Kind, pack_text, text_words, truncate, unpack_text};
use crate::serve::Identity;
use crate::session::{LockMonitor, MEMORY, SessionPaths};
use crate::wire::decode_rows;
use crate::{Announcement, Fault, ServeError, ServeOptions, Stats, Window};

/// Message passing between the ranks of one program, for [`crate::serve_across`].
#[derive(Clone, Copy)]
pub struct Peers<'a> {
    /// Gathers one number of each rank, in rank order. Collective.
    pub gather: &'a dyn Fn(u64) -> Vec<u64>,
    /// Sends numbers to a rank. May wait until that rank polls for them.
    pub send: &'a dyn Fn(usize, &[f64]),
    /// The next message of a rank, if it has arrived. Must not wait.
    pub poll: &'a dyn Fn(usize) -> Option<Vec<f64>>,
}

/// Placement of a rank relative to the coupler's host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// On the coupler's host. Also proxies these ranks.
    Local(Vec<usize>),
    /// On another host, proxied by this rank.
    Remote(usize),
}

/// Time between two checks for the coupler's session.
const ROUND: Duration = Duration::from_millis(20);

/// Identifies the shared memory of this process: two processes with the same value share it.
pub(crate) fn memory_name() -> u64 {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let device = std::fs::metadata(MEMORY).map(|m| (m.dev(), m.ino())).unwrap_or_default();
    fnv1a(format!("{} {device:?}", boot.trim()).bytes())
}

/// Whether a live coupler serves `session` in this process's shared memory.
fn coupler_is_here(session: &str) -> bool {
    let Ok(place) = SessionPaths::of(session) else { return false };
    place.session_info().is_some()
        && LockMonitor::on(&place.lock_file("coupler")).is_some_and(|watch| watch.is_held())
}

/// Determines the placement of each rank. Collective. If all ranks share one memory, returns at once; otherwise waits
/// until the coupler's session appears in one of them.
pub(crate) fn find_placement(
    at: &ServeOptions,
    memory: u64,
    peers: &Peers<'_>,
) -> Result<Placement, ServeError> {
    let memories = (peers.gather)(memory);
    if memories.iter().all(|&m| m == memory) {
        return Ok(Placement::Local(Vec::new()));
    }
    let (search, mut reminder) = (Deadline::after(at.deadline), SlowWaitNotice::default());
    let (here, gone) = (1, 2);
    loop {
        // All ranks must come to the same result, so rank 0's clock decides.
        let over = at.rank == 0 && search.is_over();
        let mine = if coupler_is_here(&at.session) { here } else { u64::from(over) * gone };
        let all = (peers.gather)(mine);
        if let Some(home) = all.iter().position(|&x| x == here) {
            return Ok(place_rank(at.rank, memories[home], &memories));
        }
        if all.contains(&gone) {
            let seconds = search.elapsed().as_secs_f64();
            return Err(ServeError::NoCoupler { session: at.session.clone(), seconds });
        }
        if at.rank == 0 && reminder.is_due(search.elapsed()) {
            let _ = writeln!(
                std::io::stderr(),
                "no rank of this {} shares {MEMORY} with the coupler of session `{}` yet: at least one must \
                 run on the coupler's host",
                at.role.program(),
                at.session
            );
        }
        std::thread::sleep(ROUND);
    }
}

/// Assigns remote ranks to those on the coupler's host in turn.
fn place_rank(me: usize, home: u64, memories: &[u64]) -> Placement {
    let ranks = |here: bool| (0..memories.len()).filter(move |&r| (memories[r] == home) == here);
    let near: Vec<usize> = ranks(true).collect();
    let proxy = |i: usize| near[i % near.len()];
    match ranks(false).position(|r| r == me) {
        Some(i) => Placement::Remote(proxy(i)),
        None => Placement::Local(
            ranks(false).enumerate().filter(|&(i, _)| proxy(i) == me).map(|(_, r)| r).collect(),
        ),
    }
}

/// A message between a remote rank and its proxy.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Frame {
    pub kind: Kind,
    pub window: Window,
    pub stats: Stats,
    pub text: String,
    /// Input of the canopy, output, or output rows.
    pub first: Vec<f64>,
    /// Rows of the grid in the reader's order, or their indices.
    pub second: Vec<f64>,
}

/// Numbers before the text of a frame.
const HEAD: usize = 15 + crate::STATS;

impl Frame {
    pub fn new(kind: Kind, window: Window) -> Self {
        let (first, second) = (Vec::new(), Vec::new());
        Self { kind, window, stats: Stats::default(), text: String::new(), first, second }
    }

    /// Integers are represented exactly: they are far below 2^53.
    pub fn pack(&self) -> Vec<f64> {
        let w = &self.window;
        let mut words = Vec::with_capacity(HEAD + self.first.len() + self.second.len() + 1024);
        words.extend([
            f64::from(self.kind as u32),
            self.text.len() as f64,
            self.first.len() as f64,
            w.index as f64,
            w.iteration as f64,
            w.substeps as f64,
            w.time,
            w.dt,
        ]);
        words.extend(w.frame_velocity);
        words.extend(w.frame_acceleration);
        words.push(self.stats.busy_s);
        words.extend(self.stats.values);
        debug_assert_eq!(words.len(), HEAD);
        words.resize(HEAD + text_words(&self.text), 0.0);
        pack_text(&self.text, &mut words[HEAD..]);
        words.extend_from_slice(&self.first);
        words.extend_from_slice(&self.second);
        words
    }

    /// `None`: numbers that are not a frame.
    pub fn unpack(words: &[f64]) -> Option<Self> {
        let (head, rest) = words.split_at_checked(HEAD)?;
        let whole = |i: usize| head[i] as u64;
        let three = |i: usize| [head[i], head[i + 1], head[i + 2]];
        let bytes = whole(1);
        let (text, rest) = rest.split_at_checked(bytes.div_ceil(8) as usize)?;
        let (first, second) = rest.split_at_checked(whole(2) as usize)?;
        let window = Window {
            index: whole(3),
            iteration: whole(4),
            substeps: whole(5),
            time: head[6],
            dt: head[7],
            frame_velocity: three(8),
            frame_acceleration: three(11),
        };
        let mut stats = Stats { busy_s: head[14], ..Stats::default() };
        stats.values.copy_from_slice(&head[15..]);
        Some(Self {
            kind: Kind::from_code(head[0] as u32)?,
            window,
            stats,
            text: unpack_text(text, bytes)?,
            first: first.to_vec(),
            second: second.to_vec(),
        })
    }

    pub fn fault(window: Window, fault: &Fault) -> Self {
        let text = truncate(&fault.message, 8 * crate::serve::TEXT_WORDS).to_owned();
        Self { text, ..Self::new(Kind::Fault, window) }
    }

    /// The announcement of a remote rank.
    pub fn announce(identity: &Identity) -> Result<Self, Fault> {
        let numbers = |rows: &[u64]| rows.iter().map(|&row| row as f64).collect();
        Ok(Self {
            text: serde_json::to_string(&identity.announcement).map_err(Fault::new)?,
            first: numbers(&identity.output_rows),
            second: numbers(&identity.grid_rows),
            ..Self::new(Kind::Announce, Window::default())
        })
    }

    /// The announcement in a frame; an error is the reported fault, or an unreadable message.
    pub fn identity(&self, rank: usize) -> Result<Identity, Fault> {
        if self.kind == Kind::Fault {
            return Err(Fault::new(&self.text));
        }
        let announcement: Option<Announcement> = serde_json::from_str(&self.text).ok();
        match (self.kind, announcement, decode_rows(&self.first), decode_rows(&self.second)) {
            (Kind::Announce, Some(announcement), Some(output_rows), Some(grid_rows)) => {
                Ok(Identity { announcement, output_rows, grid_rows })
            }
            _ => Err(Fault::new(format!("the announcement of rank {rank} on another host cannot be read"))),
        }
    }
}

/// Waits for a message of `from`, asleep: MPI itself would spin. The pauses grow from 50 us to 1 ms, so a short wait
/// has little latency and a long one little cost.
pub(crate) fn receive(
    peers: &Peers<'_>,
    from: usize,
    deadline: Option<Duration>,
) -> Result<Frame, Option<String>> {
    let wait = Deadline::after(deadline);
    let mut pause = Duration::from_micros(50);
    loop {
        if let Some(words) = (peers.poll)(from) {
            return Frame::unpack(&words).ok_or_else(|| Some(format!("an invalid message of rank {from}")));
        }
        if wait.is_over() {
            return Err(None);
        }
        std::thread::sleep(pause);
        pause = longer(pause);
    }
}

fn longer(pause: Duration) -> Duration {
    (pause * 5 / 4).min(Duration::from_millis(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_restored_bitwise() {
        let window = Window {
            index: 7,
            iteration: 2,
            substeps: 10,
            time: 0.1,
            dt: 1e-3,
            frame_velocity: [1.0, -2.0, 3.0],
            frame_acceleration: [0.5, 0.25, -9.81],
        };
        let mut frame = Frame::new(Kind::Advance, window);
        frame.text = "grüße".into();
        frame.stats.busy_s = 0.3;
        frame.stats.values = std::array::from_fn(|i| 0.1 * i as f64);
        frame.first = vec![0.1, f64::MIN_POSITIVE];
        frame.second = vec![-0.0; 6];
        assert_eq!(Frame::unpack(&frame.pack()), Some(frame));
        assert_eq!(Frame::unpack(&[1.0; 5]), None, "too short");
        assert_eq!(Frame::unpack(&[99.0; HEAD + 99]), None, "unknown kind");
    }

    #[test]
    fn remote_ranks_are_distributed_over_proxies() {
        let at = |me| place_rank(me, 5, &[5, 9, 5, 9, 8]);
        assert_eq!([0, 2].map(at), [Placement::Local(vec![1, 4]), Placement::Local(vec![3])]);
        assert_eq!([1, 3, 4].map(at), [Placement::Remote(0), Placement::Remote(2), Placement::Remote(0)]);
    }

    #[test]
    fn pauses_grow_to_a_millisecond() {
        let us = Duration::from_micros;
        assert_eq!(
            [40, 400, 780, 800, 801, 1000].map(|p| longer(us(p))),
            [50, 500, 975, 1000, 1000, 1000].map(us)
        );
    }

    #[test]
    fn fault_from_another_host_fits_into_a_message() {
        let place = 8 * crate::serve::TEXT_WORDS;
        for (length, kept) in [(place - 1, place - 1), (place, place), (place + 1, place), (3 * place, place)]
        {
            let frame = Frame::fault(Window::default(), &Fault::new("x".repeat(length)));
            assert_eq!((frame.text.len(), text_words(&frame.text) <= crate::serve::TEXT_WORDS), (kept, true));
        }
    }

    /// Placement of rank `me` when the other ranks report `others` in the rounds of the search.
    fn found(
        me: usize,
        session: &str,
        deadline: Option<Duration>,
        others: &[u64],
    ) -> (Option<Placement>, Vec<u64>) {
        let reported = std::cell::RefCell::new(Vec::new());
        let gather = |x: u64| {
            let mut reported = reported.borrow_mut();
            reported.push(x);
            assert!(reported.len() <= others.len(), "no end after {reported:?}");
            let mut all = [others[reported.len() - 1]; 2];
            all[me] = x;
            all.to_vec()
        };
        let peers = Peers { gather: &gather, send: &|_, _| {}, poll: &|_| None };
        let at = ServeOptions {
            session: session.into(),
            role: case::Role::Mesh,
            rank: me,
            ranks: 2,
            stage: 0,
            deadline,
            exit_when_orphaned: false,
        };
        let find_placement = find_placement(&at, 7, &peers);
        (find_placement.ok(), reported.into_inner())
    }

    #[test]
    fn ranks_agree_on_the_coupler_s_host_or_its_absence() {
        let nobody = format!("nobody-{}", std::process::id());
        // One memory: no search.
        assert_eq!(found(0, &nobody, None, &[7]), (Some(Placement::Local(vec![])), vec![7]));
        // Two: the clock of rank 0 decides, and its report ends the search of the other.
        assert_eq!(found(0, &nobody, Some(Duration::ZERO), &[8, 0]), (None, vec![7, 2]));
        assert_eq!(found(1, &nobody, Some(Duration::ZERO), &[8, 0, 2]), (None, vec![7, 0, 0]));
        assert_eq!(found(0, &nobody, None, &[8, 0, 1]), (Some(Placement::Remote(1)), vec![7, 0, 0]));
        assert_eq!(found(1, &nobody, None, &[8, 0, 1]), (Some(Placement::Remote(0)), vec![7, 0, 0]));
    }
}
