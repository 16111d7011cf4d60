//! The coupler's side.

use std::path::Path;
use std::time::Duration;

use case::Role;

use crate::{Abort, Announcement, HubError, Stats, Who, Window};

/// What a session consists of.
#[derive(Clone, Debug)]
pub struct HubOptions {
    /// Name of the session: isolates it from all others on this machine.
    pub session: String,
    /// Participants.
    pub roles: Vec<RoleOptions>,
    /// Stage of the scene, checked against what the programs announce.
    pub stage: usize,
    /// The canopy as the coupler knows it. `None`: what the programs announce,
    /// if they agree.
    pub interface: Option<Interface>,
    /// Longest wait for all participants to arrive. `None`: no limit.
    pub arrival_deadline: Option<Duration>,
    /// Lets [`Hub::collect`] see the grid that the mesh-mover publishes (for
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
    /// Longest time for one answer. `None`: no limit.
    pub deadline: Option<Duration>,
    /// Effects of the scene that it must implement.
    pub effects: Vec<String>,
}

/// The canopy that all programs share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Nodes.
    pub nodes: u64,
    /// Faces.
    pub faces: u64,
    /// [`crate::surface_hash`] of the faces.
    pub surface_hash: u64,
}

/// Who has arrived so far.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Ranks that have announced themselves, with the name and version of their program.
    pub arrived: Vec<(Who, String)>,
    /// Ranks that have not.
    pub missing: Vec<Who>,
    /// Seconds since the wait began.
    pub seconds: f64,
}

/// Called while the hub waits for answers, at most 50 ms apart: look after child
/// processes and Ctrl-C here. An error ends the wait.
pub type OnWait<'a> = &'a mut dyn FnMut() -> Result<(), Abort>;

/// The coupler's end of all channels of a session.
pub struct Hub {}

impl Hub {
    /// Opens the session: from here on participants can join.
    pub fn create(options: HubOptions) -> Result<Self, HubError> {
        let _ = options;
        todo!()
    }

    /// Waits until all ranks have arrived, checks what they announce against each
    /// other, and leads them through the handshake. `on_wait` is called every
    /// 100 ms or more often.
    pub fn await_participants(
        &mut self,
        on_wait: &mut dyn FnMut(&Arrivals) -> Result<(), Abort>,
    ) -> Result<(), HubError> {
        let _ = on_wait;
        todo!()
    }

    /// The canopy, once all participants have arrived.
    pub fn interface(&self) -> Interface {
        todo!()
    }

    /// What rank 0 of `role` announced.
    pub fn announcement(&self, role: Role) -> Option<&Announcement> {
        let _ = role;
        todo!()
    }

    /// Asks `role` for window `w`, without waiting. `fill` writes its input in
    /// place, shape as in [`crate::Input::canopy`].
    pub fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
    ) -> Result<(), HubError> {
        let _ = (role, w, fill);
        todo!()
    }

    /// Waits, asleep, until each rank of `role` has answered the window asked for.
    /// `each` reads the output of each rank in place, in rank order: global rows
    /// and `[rows][output_width]`. The mesh-mover's grid goes straight to the
    /// flow-solver: its data are empty here unless the hub watches the grid.
    /// Returns the statistics of each rank.
    pub fn collect(
        &mut self,
        role: Role,
        each: &mut dyn FnMut(&[u64], &[f64]),
        on_wait: OnWait<'_>,
    ) -> Result<Vec<Stats>, HubError> {
        let _ = (role, each, on_wait);
        todo!()
    }

    /// Makes window `w` final in every program that computed it.
    pub fn accept(&mut self, w: &Window, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let _ = (w, on_wait);
        todo!()
    }

    /// Lets every program write its accepted state below `folder` (created if missing).
    pub fn save(&mut self, folder: &Path, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let _ = (folder, on_wait);
        todo!()
    }

    /// Lets the programs of `roles` add their accepted state to the ParaView
    /// series below `folder` (created if missing).
    pub fn snapshot(
        &mut self,
        roles: &[Role],
        time: f64,
        folder: &Path,
        on_wait: OnWait<'_>,
    ) -> Result<(), HubError> {
        let _ = (roles, time, folder, on_wait);
        todo!()
    }

    /// Ends the session in good order: each program is told to stop and waited for.
    pub fn stop(self, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let _ = on_wait;
        todo!()
    }
}
