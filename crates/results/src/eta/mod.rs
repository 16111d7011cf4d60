//! Remaining wall time of a stage, from the wall times of its windows so far.
//!
//! The first windows of a stage cost more or less than the others: programs allocate, a flow starts from rest, a coupling
//! has no columns of earlier windows. The estimate therefore takes the last half of the windows. Times between windows
//! count, so that snapshots and checkpoints are in it in the share in which they occur.

#[cfg(test)]
mod tests;

/// Estimate of the remaining wall time of one stage.
///
/// # Examples
///
/// A slow start does not count once it is in the first half:
///
/// ```
/// use results::eta::Eta;
///
/// let mut eta = Eta::new(0);
/// for window in 1..=10 {
///     let wall_s = if window <= 5 { 4.0 * window as f64 } else { 20.0 + (window - 5) as f64 };
///     eta.add(window, wall_s);
/// }
/// assert_eq!(eta.rest_s(30), Some(20.0));
/// ```
#[derive(Clone, Debug)]
pub struct Eta {
    /// Planned windows completed and wall time since the start, s, at the start and after each window.
    reports: Vec<(u64, f64)>,
}

impl Eta {
    /// For a stage that starts now after `first` completed planned windows.
    pub fn new(first: u64) -> Self {
        Self { reports: vec![(first, 0.0)] }
    }

    /// Adds an accepted window: `done` planned windows are completed, `wall_s` seconds after the start. A window that was
    /// shortened completes no planned window, but its time counts.
    pub fn add(&mut self, done: u64, wall_s: f64) {
        self.reports.push((done, wall_s));
    }

    /// Wall time until `windows` planned windows are completed, s; `None` before the first one.
    pub fn rest_s(&self, windows: u64) -> Option<f64> {
        let (first, _) = *self.reports.first()?;
        let (done, wall_s) = *self.reports.last()?;
        let half = first + (done - first) / 2;
        let at = self.reports.partition_point(|r| r.0 < half).min(self.reports.len() - 1);
        let (from, since_s) = self.reports[at];
        let counted = done.checked_sub(from).filter(|n| *n > 0)?;
        Some((wall_s - since_s) / counted as f64 * windows.saturating_sub(done) as f64)
    }
}
