//! Serving a rank of a participant: its placement, the handshake, the windows.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use case::Role;

use crate::header::Kind;
use crate::logged::Logged;
use crate::membership::Membership;
use crate::proxied_rank::ProxiedRank;
use crate::rank_server::RankServer;
use crate::relay::{Peers, Placement, find_placement, memory_name};
use crate::remote_rank::serve_remote;
use crate::session::panic_fault;
use crate::watchdog::Watchdog;
use crate::wire::first_not_finite;
use crate::{Announcement, Fault, Participant, ServeError, Stats, flow_stats};

/// Identity of the rank to serve.
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
    /// Longest time without a message of the coupler. `None`: no limit.
    pub deadline: Option<Duration>,
    /// Ends this *process* when the coupler dies during a long computation. Otherwise the death is noticed after the
    /// computation.
    pub exit_when_orphaned: bool,
}

/// Result of a completed run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServeEnd {
    /// Accepted windows.
    pub windows: u64,
}

/// Size of the smallest response channel, so that messages fit.
pub(crate) const TEXT_WORDS: usize = 1024;

/// Serves one rank of a program from the handshake to the coupler's `stop`.
///
/// Each rank of the program calls this with its own participant. While it waits it sleeps in the kernel. A fault or
/// panic of the participant is reported to the coupler before this returns; the caller then ends the process with a
/// nonzero code (under MPI without `MPI_Finalize`, so that `mpirun` ends the other ranks).
///
/// # Examples
///
/// The `main` function of a structure on one rank, which `ripstop run SCENE --structure "./my-structure"` starts:
///
/// ```no_run
/// fn run(mut structure: impl channel::Participant) -> Result<(), channel::ServeError> {
///     let arguments = channel::ProgramArgs::parse_or_exit();
///     let end = channel::serve(&mut structure, &arguments.serve_options(case::Role::Structure, 0))?;
///     eprintln!("{} windows accepted", end.windows);
///     Ok(())
/// }
/// ```
pub fn serve(participant: &mut dyn Participant, at: &ServeOptions) -> Result<ServeEnd, ServeError> {
    let mut logged = Logged::new(participant, at);
    let end = serve_local(&mut logged, at, None);
    ended(at, logged.end(end))
}

/// As [`serve`], for a program whose ranks may span several hosts. Collective.
///
/// Ranks that share the coupler's memory are served directly. All others communicate through one of those, by
/// `peers`; at least one rank must run on the coupler's host.
pub fn serve_across(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
) -> Result<ServeEnd, ServeError> {
    let mut logged = Logged::new(participant, at);
    let end = serve_from(memory_name(), &mut logged, at, peers);
    ended(at, logged.end(end))
}

/// Writes the timings of the first rank where the coupler requested them.
fn ended<T>(at: &ServeOptions, end: T) -> T {
    if at.rank == 0
        && let Err(error) = timing::write_if_requested()
    {
        eprintln!("{error}");
    }
    end
}

/// As [`serve_across`] for a process with the memory identifier `memory`.
pub(crate) fn serve_from(
    memory: u64,
    participant: &mut dyn Participant,
    at: &ServeOptions,
    peers: &Peers<'_>,
) -> Result<ServeEnd, ServeError> {
    match find_placement(at, memory, peers)? {
        Placement::Local(proxied) => serve_local(participant, at, Some((peers, &proxied))),
        Placement::Remote(proxy) => serve_remote(participant, at, peers, proxy),
    }
}

fn serve_local(
    participant: &mut dyn Participant,
    at: &ServeOptions,
    far: Option<(&Peers<'_>, &[usize])>,
) -> Result<ServeEnd, ServeError> {
    // A full disk is an error that is reported to the coupler.
    crate::resume::ignore_sigxfsz();
    let member = Membership::join(at, at.deadline)?;
    let _guardian = if at.exit_when_orphaned { Watchdog::over(&at.session, None)? } else { None };
    let mut server = RankServer::open(member, guarded(|| Identity::of(participant)))?;
    let mut proxied = Vec::new();
    if let Some((peers, ranks)) = far {
        for &rank in ranks {
            proxied.push(ProxiedRank::open(at, *peers, rank)?);
        }
    }
    server.welcome()?;
    proxied.iter_mut().try_for_each(|p| p.server.welcome())?;
    server.lay_out()?;
    proxied.iter_mut().try_for_each(|p| p.server.lay_out())?;
    server.run(participant, proxied)
}

/// Reports to the coupler that this rank cannot start (invalid scene, mesh or state), so that the coupler's message
/// names the cause. No effect where there is no coupler.
pub fn report(at: &ServeOptions, fault: &Fault) {
    let Ok(member) = Membership::join(at, Some(Duration::from_millis(200))) else { return };
    let _ = member.answer_sender(TEXT_WORDS).and_then(|answers| {
        answers.send_text(member.header(Kind::Fault, 0), &fault.message)?;
        member.coupler_event.notify();
        // The coupler connects to a new sender at its next poll: wait for it.
        std::thread::sleep(Duration::from_millis(300));
        Ok(())
    });
}

/// Runs a call of the participant; a panic becomes a fault.
pub(crate) fn guarded<T>(call: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| Err(panic_fault(panic)))
}

/// Measures what a response costs its rank.
pub(crate) struct ResponseClock {
    start: Instant,
    waited_s: f64,
}

impl ResponseClock {
    pub fn start(participant: &dyn Participant) -> Self {
        Self { start: Instant::now(), waited_s: participant.waited_s() }
    }

    /// Writes the seconds since the start, and those of waiting for other ranks where the participant measures them: others
    /// may have reported them in their own way.
    pub fn stop(&self, participant: &dyn Participant, stats: &mut Stats) {
        stats.busy_s = self.start.elapsed().as_secs_f64();
        let waited_s = participant.waited_s() - self.waited_s;
        if waited_s > 0.0 {
            // At the same index for all roles.
            stats.values[flow_stats::WAITED_S] = waited_s;
        }
    }
}

/// Announcement and layout of a participant.
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

/// Checks an output before it is sent.
pub(crate) fn finite(output: &[f64], rows: &[u64], width: usize, stats: &Stats) -> Result<(), Fault> {
    if let Some(i) = first_not_finite(output) {
        let (row, component) = (rows[i / width], i % width);
        return Err(Fault::new(format!(
            "component {component} of output row {row} is {} (NaN also where it was not written): \
             the solution has diverged or the row was not written",
            output[i]
        )));
    }
    if let Some(i) = first_not_finite(&stats.values) {
        return Err(Fault::new(format!("statistic {i} is {}: the solution has diverged", stats.values[i])));
    }
    Ok(())
}
