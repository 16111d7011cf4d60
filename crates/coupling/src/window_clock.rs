//! Time of a stage in integer ticks: windows are halved and doubled, and always end on the ends of planned windows.

use case::AdaptiveWindow;

/// Largest number of converged windows required before the length is doubled again.
const MAX_GROWTH_DELAY: u32 = 64;

/// Time of a stage and length of its next window.
///
/// A planned window has $`2^h`$ ticks, $`h`$ the number of halvings allowed. A window of $`2^k`$ ticks starts at a
/// multiple of $`2^k`$, so that windows of any length meet the ends of planned ones, where results are written. Times
/// are an integer times one tick: without rejections they are bitwise those of equal windows.
///
/// # Examples
///
/// ```
/// use case::AdaptiveWindow;
/// use coupling::window_clock::WindowClock;
///
/// let adaptive = AdaptiveWindow { halvings: 3, grow_after: 2, ..AdaptiveWindow::default() };
/// let mut clock = WindowClock::new(5e-3, Some(&adaptive));
/// // A rejected window is repeated with half its length; two converged ones complete the planned window.
/// assert!(clock.shrink());
/// assert_eq!(clock.dt(), 2.5e-3);
/// clock.advance(true);
/// assert!(!clock.at_planned());
/// clock.advance(true);
/// assert!(clock.at_planned() && clock.time() == 5e-3 && clock.dt() == 5e-3);
/// ```
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WindowClock {
    planned_s: f64,
    most_halvings: u32,
    grow_after: u32,
    /// Ticks done.
    ticks: u64,
    /// Halvings of the next window.
    halvings: u32,
    /// Halvings of the longest window allowed.
    least_halvings: u32,
    /// Converged windows since the last change of length.
    converged_windows: u32,
    /// Converged windows required before the length is doubled.
    growth_delay: u32,
    /// The next window is the first one after a doubling.
    grown: bool,
}

impl WindowClock {
    /// At the start of a stage of planned windows of `window_s` seconds. `adaptive`: `None` for windows of constant
    /// length.
    pub fn new(window_s: f64, adaptive: Option<&AdaptiveWindow>) -> Self {
        let (most_halvings, grow_after) = adaptive.map_or((0, 1), |a| (a.halvings, a.grow_after));
        Self {
            planned_s: window_s,
            most_halvings,
            grow_after,
            ticks: 0,
            halvings: 0,
            least_halvings: 0,
            converged_windows: 0,
            growth_delay: grow_after,
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

    /// Length of the longest window allowed, s.
    pub fn limit_s(&self) -> f64 {
        self.seconds(self.planned_ticks() >> self.least_halvings)
    }

    /// Number of completed planned windows.
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

    /// Whether the next window may be shortened further.
    pub fn can_shrink(&self) -> bool {
        self.halvings < self.most_halvings
    }

    /// Halves the next window after a rejection; `false` where it has the minimal length.
    pub fn shrink(&mut self) -> bool {
        if !self.can_shrink() {
            return false;
        }
        // A doubling that fails immediately is repeated after a longer delay.
        self.growth_delay =
            if self.grown { (2 * self.growth_delay).min(MAX_GROWTH_DELAY) } else { self.grow_after };
        (self.grown, self.converged_windows) = (false, 0);
        self.halvings += 1;
        true
    }

    /// Allows windows of at most the planned length halved `halvings` times, from the next one on.
    pub fn limit(&mut self, halvings: u32) {
        self.least_halvings = halvings.min(self.most_halvings);
        if self.halvings < self.least_halvings {
            self.halvings = self.least_halvings;
            (self.grown, self.converged_windows) = (false, 0);
        }
    }

    /// Completes the window; `converged`: it converged.
    pub fn advance(&mut self, converged: bool) {
        self.ticks += self.length();
        self.converged_windows = if converged { self.converged_windows + 1 } else { 0 };
        self.grown = false;
        if self.halvings > self.least_halvings
            && self.converged_windows >= self.growth_delay
            && self.ticks.is_multiple_of(2 * self.length())
        {
            self.halvings -= 1;
            (self.grown, self.converged_windows) = (true, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(window_s: f64) -> WindowClock {
        WindowClock::new(
            window_s,
            Some(&AdaptiveWindow { halvings: 3, grow_after: 2, ..AdaptiveWindow::default() }),
        )
    }

    #[test]
    fn times_without_rejections_are_bitwise_those_of_equal_windows() {
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
    fn windows_shrink_and_grow_on_the_planned_times() {
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
        // Two short ones, then twice the length until a planned one can start.
        assert_eq!(lengths, [2, 2, 4, 4, 4]);
        assert!(!c.is_short() && c.at_planned() && c.time() == 3.0 * 0.8);
    }

    #[test]
    fn limit_holds_for_growth_and_not_for_rejections() {
        let mut c = clock(0.8);
        c.advance(true);
        c.limit(1);
        assert_eq!(c.dt(), 0.4);
        assert!(c.shrink());
        let mut lengths = Vec::new();
        while c.planned() < 4 {
            lengths.push((c.dt() * 10.0).round() as u32);
            c.advance(true);
        }
        assert_eq!(lengths, [2, 2, 4, 4, 4, 4, 4]);
        c.limit(0);
        c.advance(true);
        c.advance(true);
        assert!(!c.is_short() && c.at_planned());
        // More halvings than the scene allows.
        c.limit(7);
        assert_eq!(c.dt(), 0.1);
        assert!(!c.can_shrink());
    }

    #[test]
    fn failed_growth_is_retried_later_and_an_unconverged_window_resets_the_count() {
        let mut c = clock(0.8);
        assert!(c.shrink());
        (0..2).for_each(|_| c.advance(true));
        assert!(!c.is_short() && c.shrink(), "grown, then rejected");
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
