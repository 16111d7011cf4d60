//! When the iteration of a window ends.

use channel::UNCONVERGED_LIMIT;

/// Whatever the tolerance, no window is accepted that ends its iterations above this measure.
const MOST_ACCEPTABLE: f64 = 0.1;

/// Iterations without progress after which an acceptable window is accepted: it
/// has come to the noise of the solvers' own tolerances.
const STAGNATION_LENGTH: usize = 6;

/// Iterations without progress after which a window that is not acceptable is rejected, where it can be.
const DIVERGENCE_LENGTH: usize = 12;

/// A window that ends its iterations above the tolerance but below this measure is accepted and counted as
/// not converged; above it the run ends.
pub(crate) fn acceptable(tolerance: f64) -> f64 {
    (UNCONVERGED_LIMIT * tolerance).min(MOST_ACCEPTABLE).max(tolerance)
}

/// What follows an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The window is accepted.
    Accept,
    /// Another iteration.
    Continue,
    /// The window is rejected.
    Reject,
}

/// Limits of the iteration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    /// Most iterations of a window.
    pub max_iterations: u32,
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

impl Stopping {
    /// After the iteration with the last of the measures in `history`, at this `tolerance`. `shorter`: the window
    /// may be repeated with half its length, so that one which runs out of iterations is not accepted.
    pub fn verdict(&self, history: &[f64], tolerance: f64, shorter: bool) -> Verdict {
        let Some(&measure) = history.last() else { return Verdict::Continue };
        if measure <= tolerance {
            return Verdict::Accept;
        }
        let most = acceptable(tolerance);
        let stagnated =
            without_progress(history, STAGNATION_LENGTH, |recent| recent.iter().all(|&m| m <= most));
        let hopeless = !measure.is_finite()
            || without_progress(history, DIVERGENCE_LENGTH, |recent| best(recent) > most);
        let over = history.len() == self.max_iterations as usize || stagnated || (shorter && hopeless);
        let accepted = measure <= most || (self.accept_unconverged && measure.is_finite());
        let exhausted = shorter && !stagnated;
        match (over, accepted && !exhausted) {
            (false, _) => Verdict::Continue,
            (true, true) => Verdict::Accept,
            (true, false) => Verdict::Reject,
        }
    }
}

/// Whether the last `count` measures satisfy `condition` and are no better than the best one before them.
fn without_progress(history: &[f64], count: usize, condition: impl Fn(&[f64]) -> bool) -> bool {
    let Some(split) = history.len().checked_sub(count).filter(|&s| s > 0) else { return false };
    let (before, recent) = history.split_at(split);
    condition(recent) && best(recent) > 0.9 * best(before)
}

fn best(measures: &[f64]) -> f64 {
    measures.iter().copied().fold(f64::INFINITY, f64::min)
}
