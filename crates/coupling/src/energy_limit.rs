//! Limit of the window length by the energy that the coupling creates.
//!
//! Windows that do not resolve an oscillation of fabric and air feed it: loads that belong to the end of a window act on its whole motion. The energy created is
//! known in each window ([`crate::energy`]). Where it exceeds a limit over some windows, later windows are half as long; once the coupling creates little, they
//! are allowed to grow again.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// Windows over which the energy is judged.
const RECENT: usize = 20;
/// Share of the limit below which longer windows are tried: the error of a window is of first order at least, so that twice its length creates at least twice as
/// much.
const QUIET: f64 = 0.25;
/// Windows of one length before longer ones are tried for the first time.
const FIRST_TRIAL: u32 = 100;
/// Largest number of windows before longer ones are tried again.
const LAST_TRIAL: u32 = 1600;
/// Half the length helps where the share falls below this part of what it was: one half is expected.
const HELPS: f64 = 0.75;
/// Windows without a limit where half the length did not help.
const PAUSE: u32 = 1000;

/// A change of the limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Windows are halved once more: the coupling created this share of the work.
    Shorter(f64),
    /// Half the length did not help: the coupling created these shares of the work before and after.
    NoHelp(f64, f64),
    /// Windows may be twice as long again.
    Longer,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| 100.0 * share;
        match *self {
            Self::Shorter(share) => {
                write!(
                    f,
                    "the coupling created {:.1} % of the work of the air in the last {RECENT} windows",
                    percent(share)
                )
            }
            Self::NoHelp(before, share) => write!(
                f,
                "half the length did not help: the coupling created {:.1} % of the work of the air, {:.1} % before",
                percent(share),
                percent(before)
            ),
            Self::Longer => write!(f, "the coupling creates less than {:.0} % of its limit", percent(QUIET)),
        }
    }
}

/// The limit of the window length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnergyLimit {
    /// Energy that may be created, relative to the work of the air; 0: no limit.
    limit: f64,
    /// Largest number of halvings.
    most_halvings: u32,
    /// Halvings of the longest window allowed at present.
    halvings: u32,
    /// Length (s), energy created (J) and work of the air (J) of the last windows, newest last.
    recent: VecDeque<[f64; 3]>,
    /// Sums of length and work over the stage.
    time_s: f64,
    work_j: f64,
    /// Windows since the last change.
    since: u32,
    /// Windows before longer ones are tried.
    trial: u32,
    /// Share at the last halving, until it is known whether that helped.
    before: Option<f64>,
    /// Windows until the energy is judged again.
    pause: u32,
}

impl EnergyLimit {
    /// Allows the share `limit` of the work of the air to be created, and windows to be halved `most_halvings` times.
    pub fn new(limit: f64, most_halvings: u32) -> Self {
        Self {
            limit,
            most_halvings,
            halvings: 0,
            recent: VecDeque::new(),
            time_s: 0.0,
            work_j: 0.0,
            since: 0,
            trial: FIRST_TRIAL,
            before: None,
            pause: 0,
        }
    }

    /// Without limit.
    pub fn none() -> Self {
        Self::new(0.0, 0)
    }

    /// Halvings of the longest window allowed.
    pub fn halvings(&self) -> u32 {
        self.halvings
    }

    /// Adds a window of `dt` seconds in which the coupling created `created` and the air did the work `work`, J. `judged`: the initial transient is over.
    pub fn add_window(&mut self, dt: f64, created: f64, work: f64, judged: bool) -> Option<Change> {
        self.time_s += dt;
        self.work_j += work.abs();
        self.recent.push_back([dt, created, work.abs()]);
        if self.recent.len() > RECENT {
            self.recent.pop_front();
        }
        self.since = self.since.saturating_add(1);
        self.pause = self.pause.saturating_sub(1);
        if !judged || self.limit <= 0.0 || self.pause > 0 || self.recent.len() < RECENT {
            return None;
        }
        let share = self.share();
        if let Some(before) = self.before.take().filter(|before| share > self.limit.max(HELPS * before)) {
            self.halvings -= 1;
            self.pause = PAUSE;
            return Some(self.changed(Change::NoHelp(before, share)));
        }
        if share > self.limit && self.halvings < self.most_halvings {
            self.halvings += 1;
            self.before = Some(share);
            return Some(self.changed(Change::Shorter(share)));
        }
        if self.halvings > 0 && self.since >= self.trial && share < QUIET * self.limit {
            self.halvings -= 1;
            self.trial = (2 * self.trial).min(LAST_TRIAL);
            return Some(self.changed(Change::Longer));
        }
        None
    }

    /// Energy created in the last windows relative to the work of the air in them, or to its mean over the stage in the same time, where that is larger: in a calm the
    /// work of the air vanishes.
    fn share(&self) -> f64 {
        let [time, created, work] =
            self.recent.iter().fold([0.0; 3], |sum, w| [0, 1, 2].map(|i| sum[i] + w[i]));
        let usual = self.work_j / self.time_s * time;
        if work.max(usual) > 0.0 { created / work.max(usual) } else { 0.0 }
    }

    /// Later windows are judged by themselves.
    fn changed(&mut self, change: Change) -> Change {
        self.recent.clear();
        self.since = 0;
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 0.05;

    /// Changes over `windows`, with their numbers, where windows of `halvings` create the share `created(window, halvings)` of a work of 1 J a second.
    fn changes(
        limit: &mut EnergyLimit,
        windows: u32,
        created: impl Fn(u32, u32) -> f64,
    ) -> Vec<(u32, Change)> {
        let window = |i: u32| {
            let dt = 0.01 / f64::from(1 << limit.halvings());
            limit.add_window(dt, dt * created(i, limit.halvings()), -dt, true).map(|change| (i, change))
        };
        (0..windows).filter_map(window).collect()
    }

    fn new() -> EnergyLimit {
        EnergyLimit::new(LIMIT, 3)
    }

    #[test]
    fn little_energy_or_damping_changes_nothing() {
        assert_eq!(changes(&mut new(), 5000, |_, _| 0.99 * LIMIT), []);
        assert_eq!(changes(&mut new(), 5000, |_, _| -2.0), []);
        assert_eq!(changes(&mut EnergyLimit::none(), 5000, |_, _| 2.0), []);
        let mut none = EnergyLimit::new(LIMIT, 0);
        assert_eq!(changes(&mut none, 5000, |_, _| 2.0), []);
    }

    /// An instability of long windows: half of them is enough, and longer ones are tried less and less often.
    #[test]
    fn windows_are_halved_and_longer_ones_tried_again() {
        let mut limit = new();
        let found = changes(&mut limit, 4000, |_, halvings| if halvings == 0 { 0.4 } else { -0.02 });
        let (numbers, kinds): (Vec<u32>, Vec<Change>) = found.into_iter().unzip();
        assert!(matches!(kinds[0], Change::Shorter(share) if (share - 0.4).abs() < 1e-12), "{kinds:?}");
        assert!(kinds.iter().skip(1).step_by(2).all(|k| *k == Change::Longer), "{kinds:?}");
        assert!(kinds.iter().step_by(2).all(|k| matches!(k, Change::Shorter(_))), "{kinds:?}");
        let first = RECENT as u32;
        let expected = [first, first + 100, 2 * first + 100, 2 * first + 300, 3 * first + 300];
        assert_eq!(numbers[..5], expected.map(|n| n - 1));
        // With trials every 1600 windows in the end, 20 long windows of every 1620.
        let long = changes(&mut limit, 16_200, |_, halvings| if halvings == 0 { 0.4 } else { -0.02 });
        assert!((18..=22).contains(&long.len()), "{}", long.len());
    }

    /// An error of first order is halved until it is below the limit, and stays there: twice the length would exceed it.
    #[test]
    fn error_of_first_order_is_halved_until_it_is_small() {
        let mut limit = new();
        let found = changes(&mut limit, 6000, |_, halvings| 0.15 / f64::from(1 << halvings));
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!(limit.halvings(), 2);
    }

    /// Loads that no window resolves: the windows return to their length, and are tried again much later.
    #[test]
    fn windows_return_to_their_length_where_half_of_it_does_not_help() {
        let mut limit = new();
        let found = changes(&mut limit, 1000, |_, halvings| 0.3 - 0.02 * f64::from(halvings));
        assert!(matches!(found[..], [(19, Change::Shorter(_)), (39, Change::NoHelp(..))]), "{found:?}");
        assert_eq!(limit.halvings(), 0);
    }

    /// In a calm after much work the noise of the tolerance is no reason for short windows; nor is the start.
    #[test]
    fn calm_and_start_are_not_judged() {
        let mut limit = new();
        for _ in 0..500 {
            assert_eq!(limit.add_window(0.01, 0.0, 1.0, true), None);
        }
        for _ in 0..500 {
            assert_eq!(limit.add_window(0.01, 5e-3, 1e-2, true), None);
        }
        let mut limit = new();
        for _ in 0..200 {
            assert_eq!(limit.add_window(0.01, 1.0, 1.0, false), None);
        }
        assert!(limit.add_window(0.01, 1.0, 1.0, true).is_some());
    }
}
