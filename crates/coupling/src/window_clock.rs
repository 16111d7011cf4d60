//! Time of a stage in whole ticks: windows are halved and doubled, never cut to fit.

use case::AdaptiveWindow;

/// Most windows that must go well before the next one is longer again.
const MOST_PATIENCE: u32 = 64;

/// Where a stage stands, and how long its next window is.
///
/// A planned window has $2^h$ ticks, $h$ the number of halvings allowed. A window of $2^k$ ticks starts at a
/// multiple of $2^k$, so that windows of any length meet the ends of planned ones, where results
/// are written. Times are products of an integer and one tick: a stage without rejections has the
/// times of equal windows to the bit.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WindowClock {
    planned_s: f64,
    most_halvings: u32,
    grow_after: u32,
    /// Ticks done.
    ticks: u64,
    /// Halvings of the next window.
    halvings: u32,
    /// Windows that went well since the last change of length.
    good: u32,
    /// How many must go well before windows grow.
    patience: u32,
    /// The next window is the first one after windows have grown.
    grown: bool,
}

impl WindowClock {
    /// At the start of a stage of planned windows of `window_s` seconds. `adaptive`: `None`
    /// for windows of one length.
    pub fn new(window_s: f64, adaptive: Option<&AdaptiveWindow>) -> Self {
        let (most_halvings, grow_after) = adaptive.map_or((0, 1), |a| (a.halvings, a.grow_after));
        Self {
            planned_s: window_s,
            most_halvings,
            grow_after,
            ticks: 0,
            halvings: 0,
            good: 0,
            patience: grow_after,
            grown: false,
        }
    }

    fn planned_ticks(&self) -> u64 {
        1 << self.most_halvings
    }

    fn length(&self) -> u64 {
        self.planned_ticks() >> self.halvings
    }

    fn seconds(&self, ticks: u64) -> f64 {
        ticks as f64 * (self.planned_s / self.planned_ticks() as f64)
    }

    /// Start of the next window, s.
    pub fn time(&self) -> f64 {
        self.seconds(self.ticks)
    }

    /// Length of the next window, s.
    pub fn dt(&self) -> f64 {
        self.seconds(self.length())
    }

    /// Planned windows that are over.
    pub fn planned(&self) -> u64 {
        self.ticks / self.planned_ticks()
    }

    /// Whether a planned window ends here.
    pub fn at_planned(&self) -> bool {
        self.ticks.is_multiple_of(self.planned_ticks())
    }

    /// Whether the next window is shorter than planned.
    pub fn is_short(&self) -> bool {
        self.halvings > 0
    }

    /// Whether the next window may be shorter still.
    pub fn can_shrink(&self) -> bool {
        self.halvings < self.most_halvings
    }

    /// Halves the next window, which was tried and given back; `false` where it is the shortest.
    pub fn shrink(&mut self) -> bool {
        if !self.can_shrink() {
            return false;
        }
        // Growth that is taken back at once is tried less often.
        self.patience = if self.grown { (2 * self.patience).min(MOST_PATIENCE) } else { self.grow_after };
        (self.grown, self.good) = (false, 0);
        self.halvings += 1;
        true
    }

    /// The window is over; `well`: it converged.
    pub fn advance(&mut self, well: bool) {
        self.ticks += self.length();
        self.good = if well { self.good + 1 } else { 0 };
        self.grown = false;
        if self.halvings > 0 && self.good >= self.patience && self.ticks.is_multiple_of(2 * self.length()) {
            self.halvings -= 1;
            (self.grown, self.good) = (true, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(window_s: f64) -> WindowClock {
        WindowClock::new(window_s, Some(&AdaptiveWindow { enabled: true, halvings: 3, grow_after: 2 }))
    }

    #[test]
    fn without_rejections_times_are_those_of_equal_windows_to_the_bit() {
        let (mut a, mut b) = (clock(5e-3), WindowClock::new(5e-3, None));
        for index in 0..2000u64 {
            for c in [&mut a, &mut b] {
                assert_eq!((c.time(), c.dt(), c.planned()), (index as f64 * 5e-3, 5e-3, index));
                assert!(c.at_planned() && !c.is_short());
                c.advance(true);
            }
        }
        assert!(a.can_shrink() && !b.can_shrink() && !b.shrink());
    }

    #[test]
    fn windows_shrink_and_grow_back_on_the_planned_times() {
        let mut c = clock(0.8);
        c.advance(true);
        assert!(c.shrink() && c.shrink());
        let mut lengths = Vec::new();
        while c.planned() < 3 {
            let multiple = c.time() / c.dt();
            assert!((multiple - multiple.round()).abs() < 1e-9, "windows start at multiples of their length");
            lengths.push((c.dt() * 10.0).round() as u32);
            c.advance(true);
        }
        // Two short ones, then of twice the length until a planned one may begin.
        assert_eq!(lengths, [2, 2, 4, 4, 4]);
        assert!(!c.is_short() && c.at_planned() && c.time() == 3.0 * 0.8);
    }

    #[test]
    fn growth_that_fails_is_tried_less_often_and_a_bad_window_starts_the_count_anew() {
        let mut c = clock(0.8);
        assert!(c.shrink());
        (0..2).for_each(|_| c.advance(true));
        assert!(!c.is_short() && c.shrink(), "grown, and taken back");
        for _ in 0..3 {
            c.advance(true);
            assert!(c.is_short());
        }
        c.advance(false);
        assert!(c.is_short());
        (0..4).for_each(|_| c.advance(true));
        assert!(!c.is_short());
        assert!(c.shrink() && c.shrink() && c.shrink() && !c.shrink());
    }
}
