//! Names and sizes of a session's services, and the texts of the handshake, common to both sides.

use case::Role;
use serde::{Deserialize, Serialize};

use crate::session::SessionInfo;
use crate::transport::ChannelSpec;
use crate::{Announcement, Kind, SessionError, Window};

/// Rank counts of a session, which determine all sizes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RankCounts(pub Vec<(Role, usize)>);

impl RankCounts {
    pub fn from_notice(session_info: &SessionInfo) -> Option<Self> {
        let role = |name: &str| Role::ALL.into_iter().find(|r| r.name() == name);
        session_info
            .roles
            .iter()
            .map(|(name, ranks)| Some((role(name)?, *ranks)))
            .collect::<Option<_>>()
            .map(Self)
    }

    pub fn ranks(&self, role: Role) -> usize {
        self.0.iter().find(|(r, _)| *r == role).map_or(0, |&(_, n)| n)
    }

    /// Coupler to all ranks of a program.
    pub fn command(&self, role: Role) -> (String, ChannelSpec) {
        let spec = ChannelSpec { receivers: self.ranks(role), newest_wins: false };
        (format!("command/{}", role.name()), spec)
    }

    /// Rank to coupler.
    pub fn answer(&self, role: Role, rank: usize) -> (String, ChannelSpec) {
        (format!("answer/{}.{rank}", role.name()), ChannelSpec { receivers: 1, newest_wins: false })
    }

    /// Rank to coupler and, for the mesh, to the ranks of the flow; during the handshake.
    pub fn layout(&self, role: Role, rank: usize) -> (String, ChannelSpec) {
        let partners = if role == Role::Mesh { self.ranks(Role::Flow) } else { 0 };
        let spec = ChannelSpec { receivers: 1 + partners, newest_wins: false };
        (format!("layout/{}.{rank}", role.name()), spec)
    }

    /// Rank of the mesh to all ranks of the flow, and to a coupler that watches. A grid that the flow was not asked
    /// to read is replaced by the next.
    pub fn grid(&self, rank: usize) -> (String, ChannelSpec) {
        let spec = ChannelSpec { receivers: 1 + self.ranks(Role::Flow), newest_wins: true };
        (format!("grid/{rank}"), spec)
    }

    /// Wakes the coupler: name, listeners, notifiers.
    pub fn coupler_event(&self) -> (&'static str, usize, usize) {
        ("bell/coupler", 1, self.0.iter().map(|&(_, n)| n).sum())
    }

    /// Wakes the ranks of a program: name, listeners, notifiers.
    pub fn wake_event(&self, role: Role) -> (String, usize, usize) {
        let partners = if role == Role::Flow { self.ranks(Role::Mesh) } else { 0 };
        (format!("bell/{}", role.name()), self.ranks(role), 1 + partners)
    }
}

/// Text of [`Kind::Announce`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Hello {
    pub contract: u32,
    pub stage: usize,
    pub rank: usize,
    pub ranks: usize,
    pub pid: u32,
    /// Length of [`crate::Participant::output_rows`].
    pub output_rows: u64,
    /// Length of [`crate::Participant::grid_rows`].
    pub grid_rows: u64,
    pub announcement: Announcement,
}

/// Text of [`Kind::Welcome`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Welcome {
    /// Numbers in the payload of each [`Kind::Advance`].
    pub input_length: u64,
    /// Rows of each rank of the mesh, where the flow reads the moved grid; else empty.
    pub mesh_rows: Vec<u64>,
    /// Ranks of the flow that read the moved grid.
    pub grid_readers: usize,
    /// Whether the coupler reads the moved grid too.
    pub coupler_reads_grid: bool,
}

/// Step of a run to which a message belongs, for messages.
pub(crate) fn during(kind: Kind, w: &Window) -> String {
    match kind {
        Kind::Advance | Kind::Output | Kind::Grid => {
            format!("window {} iteration {} (t = {} s)", w.index, w.iteration, w.time)
        }
        Kind::Accept => format!("the acceptance of window {}", w.index),
        Kind::Save => "saving".into(),
        Kind::Snapshot => "writing pictures".into(),
        Kind::Stop | Kind::Abort => "the end of the run".into(),
        _ => "the handshake".into(),
    }
}

/// Row indices encoded as doubles; `None` where one is not a row index.
pub(crate) fn decode_rows(payload: &[f64]) -> Option<Vec<u64>> {
    const EXACT: f64 = 9_007_199_254_740_992.0;
    payload.iter().map(|&x| ((0.0..EXACT).contains(&x) && x.fract() == 0.0).then_some(x as u64)).collect()
}

/// JSON of a text of the handshake.
pub(crate) fn to_json<T: Serialize>(value: &T) -> Result<String, SessionError> {
    serde_json::to_string(value)
        .map_err(|e| SessionError::Transport { what: "handshake".into(), problem: e.to_string() })
}

/// Index of the first number that is NaN or infinite. Whole blocks are judged by their bits, which compilers vectorise.
pub fn first_not_finite(values: &[f64]) -> Option<usize> {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    let bad = |x: &f64| x.to_bits() & EXPONENT == EXPONENT;
    const BLOCK: usize = 256;
    let block = values.chunks(BLOCK).position(|block| block.iter().fold(false, |any, x| any | bad(x)))?;
    values[block * BLOCK..].iter().position(bad).map(|i| block * BLOCK + i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_number_that_is_not_finite_is_found() {
        for n in [0, 1, 255, 256, 257, 1000] {
            let mut values = vec![f64::MAX; n];
            assert_eq!(first_not_finite(&values), None);
            for (i, x) in [(n / 2, f64::NAN), (n.saturating_sub(1), f64::NEG_INFINITY)] {
                if n > 0 {
                    values[i] = x;
                    assert_eq!(first_not_finite(&values), Some(i));
                    values[i] = -0.0;
                }
            }
        }
    }

    #[test]
    fn only_row_indices_are_decoded() {
        assert_eq!(decode_rows(&[0.0, 3.0, 4e15]), Some(vec![0, 3, 4_000_000_000_000_000]));
        for bad in [-1.0, 0.5, f64::NAN, f64::INFINITY, 1e16] {
            assert_eq!(decode_rows(&[1.0, bad]), None, "{bad}");
        }
    }

    #[test]
    fn sizes_of_services_follow_from_the_rank_counts() {
        let rank_counts = RankCounts(vec![(Role::Structure, 2), (Role::Mesh, 3), (Role::Flow, 4)]);
        let of = |(name, spec): (String, ChannelSpec)| (name, spec.receivers, spec.newest_wins);
        // Each rank of the program receives its commands; the coupler alone receives a response.
        assert_eq!(of(rank_counts.command(Role::Flow)), ("command/flow".into(), 4, false));
        assert_eq!(of(rank_counts.answer(Role::Flow, 3)), ("answer/flow.3".into(), 1, false));
        // The coupler reads every layout, the flow those of the mesh.
        let layouts = [Role::Structure, Role::Mesh, Role::Flow].map(|role| of(rank_counts.layout(role, 1)));
        let named = |role: &str, readers| (format!("layout/{role}.1"), readers, false);
        assert_eq!(layouts, [named("structure", 1), named("mesh", 5), named("flow", 1)]);
        assert_eq!(of(rank_counts.grid(2)), ("grid/2".into(), 5, true));
        assert_eq!(rank_counts.coupler_event(), ("bell/coupler", 1, 9));
        // The coupler notifies all; each rank of the mesh notifies those of the flow.
        let wake_events = [Role::Structure, Role::Mesh, Role::Flow].map(|role| rank_counts.wake_event(role));
        let named = |role: &str, listeners, notifiers| (format!("bell/{role}"), listeners, notifiers);
        assert_eq!(wake_events, [named("structure", 2, 1), named("mesh", 3, 1), named("flow", 4, 4)]);
    }
}
