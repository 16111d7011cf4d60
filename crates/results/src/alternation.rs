//! Alternation of the load of the air from window to window: that of the coupling, or of an oscillation that windows do not resolve, but not of the air.

use serde::{Deserialize, Serialize};

use crate::wake::Sample;

/// Windows in the last half below which nothing is said.
const LEAST_WINDOWS: usize = 20;
/// Share of the drag above which the alternation is reported: the geometric mean of 0.7 % (immersed ATPS with damping) and 5 % (without).
const LARGE: f64 = 0.02;
/// Correlation of successive changes below which they take each other back: that of noise without memory. A wave of six windows has 0.5, of three -0.5.
const TAKEN_BACK: f64 = -0.5;
/// Check of the table that this is.
const CHECK: &str = "coupling.alternating-load";

/// Alternating part of the drag over the last half of the windows of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alternation {
    /// Root mean square of the alternating part, a quarter of the second difference, N.
    pub rms_n: f64,
    /// The same over the mean magnitude of the drag.
    pub share: f64,
    /// Correlation of successive changes of the drag: -1 where each takes back the one before.
    pub correlation: f64,
}

impl Alternation {
    /// Of the windows of a stage so far; `None` with fewer than 20 in the last half, and without a drag.
    pub fn of(samples: &[Sample]) -> Option<Self> {
        Self::of_drag(&samples.iter().map(|s| s.drag_n).collect::<Vec<_>>())
    }

    /// Of the columns of a `history.csv`.
    pub fn of_history(columns: &[(String, Vec<f64>)]) -> Option<Self> {
        Self::of_drag(&columns.iter().find(|(name, _)| name == "drag_n")?.1)
    }

    fn of_drag(drag: &[f64]) -> Option<Self> {
        let late = &drag[drag.len() / 2..];
        let mean = late.iter().map(|d| d.abs()).sum::<f64>() / late.len().max(1) as f64;
        if late.len() < LEAST_WINDOWS || mean.is_nan() || mean == 0.0 {
            return None;
        }
        let changes: Vec<f64> = late.windows(2).map(|d| d[1] - d[0]).collect();
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
        let second = square(&mut changes.windows(2).map(|c| 0.25 * (c[1] - c[0])));
        let rms = (second / (changes.len() - 1) as f64).sqrt();
        let products: f64 = changes.windows(2).map(|c| c[0] * c[1]).sum();
        let all = square(&mut changes.iter().copied());
        Some(Self {
            rms_n: rms,
            share: rms / mean,
            correlation: if all > 0.0 { products / all } else { 0.0 },
        })
    }

    /// Whether the alternation is more than noise and a small part of the drag.
    pub fn is_large(&self) -> bool {
        self.share > LARGE && self.correlation < TAKEN_BACK
    }

    /// The figures in words.
    pub fn line(&self) -> String {
        format!(
            "the drag alternates from window to window by {:.3} N, {:.1} % of it (root mean square over the last half; successive changes have a correlation of {:.2})",
            self.rms_n,
            100.0 * self.share,
            self.correlation
        )
    }

    /// The warning about `stage`; `None` where the alternation is small.
    pub fn warning(&self, stage: &str) -> Option<String> {
        self.is_large().then(|| {
            format!(
                "stage `{stage}`: {} [{CHECK}]. The load of a single window is that of the coupling, not of the air. Remedy: set stage.stiffness_damping_s \
                 (1e-3 s in the descent of the ATPS) or coupling.velocity_average, or average over several windows",
                self.line()
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn of(drag: impl Fn(usize) -> f64, windows: usize) -> Option<Alternation> {
        Alternation::of_drag(&(0..windows).map(drag).collect::<Vec<_>>())
    }

    #[test]
    fn load_that_alternates_is_reported_with_its_amplitude() {
        let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let found = of(|k| 1000.0 + 2.0 * k as f64 + 30.0 * sign(k), 100).expect("a drag");
        assert!((found.rms_n - 30.0).abs() < 1e-9 && found.correlation < -0.95, "{found:?}");
        let text = found.warning("descent").expect("a warning");
        assert!(text.contains("by 30.000 N, 2.6 % of it") && text.contains(CHECK), "{text}");
        // Small, resolved, too short, without a drag.
        let quiet = [
            of(|k| 1000.0 + 10.0 * sign(k), 100),
            of(|k| 1000.0 + 300.0 * (2.0 * PI * k as f64 / 8.0).sin(), 100),
        ];
        assert!(quiet.iter().flatten().filter_map(|a| a.warning("descent")).next().is_none(), "{quiet:?}");
        assert_eq!((of(|k| 1000.0 + 90.0 * sign(k), 38), of(|_| 0.0, 100)), (None, None));
        // Only the last half counts.
        let before = of(|k| 1000.0 + if k < 50 { 90.0 * sign(k) } else { 0.0 }, 100).expect("a drag");
        assert_eq!(before.warning("descent"), None);
    }
}
