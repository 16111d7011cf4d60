//! The loop of one rank of a participant.

use std::time::Duration;

use case::Role;

use crate::{Participant, ServeError};

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
}

/// How a run ended well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServeEnd {
    /// Windows accepted.
    pub windows: u64,
}

/// Serves one rank of a program from the handshake to the coupler's `stop`.
///
/// Each rank of the program calls this with its own participant. While it waits
/// it sleeps in the kernel. A fault or panic of the participant is reported to
/// the coupler before this returns; the caller then ends the process with a code
/// other than zero (under MPI without `MPI_Finalize`, so that `mpirun` ends the
/// other ranks).
pub fn serve(participant: &mut dyn Participant, at: &ServeOptions) -> Result<ServeEnd, ServeError> {
    let _ = (participant, at);
    todo!()
}
