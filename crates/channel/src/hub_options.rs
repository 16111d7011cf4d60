//! Options of a session, and the state of its arrivals.

use std::time::Duration;

use case::Role;

use crate::RankId;

/// Definition of a session.
#[derive(Clone, Debug)]
pub struct HubOptions {
    /// Name of the session: isolates it from all others on this machine.
    pub session: String,
    /// Participants.
    pub roles: Vec<RoleOptions>,
    /// Stage of the scene, checked against the announcements.
    pub stage: usize,
    /// The canopy as the coupler knows it. `None`: the one that the programs announce consistently.
    pub interface: Option<Interface>,
    /// Longest wait for all participants to arrive. `None`: no limit.
    pub arrival_deadline: Option<Duration>,
    /// Lets [`crate::Hub::collect`] see the grid that the mesh-mover publishes (for
    /// recordings and conformance tests).
    pub watch_grid: bool,
}

/// One program of a session.
#[derive(Clone, Debug)]
pub struct RoleOptions {
    /// Its role.
    pub role: Role,
    /// Its ranks.
    pub ranks: usize,
    /// Longest time for a response. `None`: no limit.
    pub deadline: Option<Duration>,
    /// Effects of the scene that it must implement.
    pub effects: Vec<String>,
}

/// The canopy that all programs share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Nodes.
    pub nodes: u64,
    /// Faces.
    pub faces: u64,
    /// [`crate::surface_hash`] of the faces.
    pub surface_hash: u64,
}

/// Arrival of the participants.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Ranks that have announced themselves, with the name and version of their program.
    pub arrived: Vec<(RankId, String)>,
    /// Ranks that have not announced themselves.
    pub missing: Vec<RankId>,
    /// Seconds since the wait began.
    pub seconds: f64,
}
