//! Stopping criterion of the coupling iteration.

use channel::UNCONVERGED_LIMIT;

/// Relative residual above which no window is accepted, whatever the tolerance.
const MAX_ACCEPTABLE: f64 = 0.1;

/// Iterations without progress after which an acceptable window is accepted: the residual has reached the noise of
/// the solvers' tolerances.
const STAGNATION_LENGTH: usize = 6;

/// Iterations without progress after which a window that is not acceptable is rejected, where it can be repeated.
const DIVERGENCE_LENGTH: usize = 12;

/// A window that ends its iterations above the tolerance but below this relative residual is accepted and counted as
/// unconverged; above it the window is an error.
pub(crate) fn acceptable(tolerance: f64) -> f64 {
    (UNCONVERGED_LIMIT * tolerance).min(MAX_ACCEPTABLE).max(tolerance)
}

/// Decision after an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decision {
    /// The window is accepted.
    Accept,
    /// Another iteration.
    Continue,
    /// The window is rejected.
    Reject,
}

/// Limits of the iteration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoppingCriterion {
    /// Most iterations of a window.
    pub max_iterations: u32,
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

impl StoppingCriterion {
    /// Decision after an iteration, from the relative residuals in `history` and the `tolerance`. `shorter`: the
    /// window may be repeated with half its length, so one that reaches the iteration limit is not accepted.
    pub fn decide(&self, history: &[f64], tolerance: f64, shorter: bool) -> Decision {
        let Some(&residual) = history.last() else { return Decision::Continue };
        if residual <= tolerance {
            return Decision::Accept;
        }
        let limit = acceptable(tolerance);
        let stagnated =
            without_progress(history, STAGNATION_LENGTH, |recent| recent.iter().all(|&m| m <= limit));
        let diverging = !residual.is_finite()
            || without_progress(history, DIVERGENCE_LENGTH, |recent| best(recent) > limit);
        let stop = history.len() == self.max_iterations as usize || stagnated || (shorter && diverging);
        let accepted = residual <= limit || (self.accept_unconverged && residual.is_finite());
        let exhausted = shorter && !stagnated;
        match (stop, accepted && !exhausted) {
            (false, _) => Decision::Continue,
            (true, true) => Decision::Accept,
            (true, false) => Decision::Reject,
        }
    }
}

/// Whether the last `count` residuals satisfy `condition` without improving on the best one before them.
fn without_progress(history: &[f64], count: usize, condition: impl Fn(&[f64]) -> bool) -> bool {
    let Some(split) = history.len().checked_sub(count).filter(|&s| s > 0) else { return false };
    let (before, recent) = history.split_at(split);
    condition(recent) && best(recent) > 0.9 * best(before)
}

fn best(residuals: &[f64]) -> f64 {
    residuals.iter().copied().fold(f64::INFINITY, f64::min)
}
