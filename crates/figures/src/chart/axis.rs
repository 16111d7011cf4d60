//! Axes: ranges, ticks and number formats.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// Scaling of an axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Division {
    /// Linear.
    Linear,
    /// Logarithmic.
    Logarithmic,
    /// Categories with these names; the centre of the first is at 0.5.
    Categories(Vec<String>),
}

/// An axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Label with unit; empty if the figure shows it elsewhere.
    pub label: String,
    /// Scaling.
    pub division: Division,
    /// Values at the left (lower) and right (upper) end.
    pub range: [f64; 2],
}

impl Axis {
    /// An axis around all finite `values` with a margin; logarithmic axes show values above zero. Linear axes of
    /// non-negative values start at zero if that needs little space.
    pub fn around(label: &str, logarithmic: bool, values: impl Iterator<Item = f64>) -> Self {
        let shown = values.filter(|v| v.is_finite() && (!logarithmic || *v > 0.0));
        let (low, high) = shown.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let range = match (low <= high, logarithmic) {
            (false, true) => [0.1, 1.0],
            (false, false) => [0.0, 1.0],
            (true, true) => {
                let margin = (high / low).powf(0.07).max(1.25);
                [low / margin, high * margin]
            }
            (true, false) => {
                let margin = (0.08 * (high - low)).max(1e-3 * high.abs().max(low.abs())).max(1e-12);
                let from_zero = low >= 0.0 && low < 0.3 * high;
                [if from_zero { 0.0 } else { low - margin }, high + margin]
            }
        };
        let division = if logarithmic { Division::Logarithmic } else { Division::Linear };
        Self { label: label.into(), division, range }
    }

    /// An axis from the smallest to the largest finite value, such as times.
    pub fn spanning(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let shown = values.filter(|v| v.is_finite());
        let (low, high) = shown.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let range = if low < high {
            [low, high]
        } else if low == high {
            [low - 0.5, low + 0.5]
        } else {
            [0.0, 1.0]
        };
        Self { label: label.into(), division: Division::Linear, range }
    }

    /// An axis of categories, from the left or from below.
    pub fn categories(label: &str, names: Vec<String>) -> Self {
        let range = [0.0, names.len().max(1) as f64];
        Self { label: label.into(), division: Division::Categories(names), range }
    }

    /// The reversed axis: from the right or from above.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.range.reverse();
        self
    }

    /// Whether the axis is logarithmic.
    pub fn logarithmic(&self) -> bool {
        self.division == Division::Logarithmic
    }

    /// Position along the axis, 0 to 1; `None` if it cannot show the value.
    pub(super) fn share(&self, v: f64) -> Option<f64> {
        let [low, high] = self.range;
        let t =
            if self.logarithmic() { (v / low).ln() / (high / low).ln() } else { (v - low) / (high - low) };
        t.is_finite().then_some(t)
    }

    /// About `most` ticks with their labels.
    pub(super) fn marks(&self, most: usize) -> Vec<(f64, String)> {
        let most = most.max(2);
        match &self.division {
            Division::Linear => linear_marks(self.range, most),
            Division::Logarithmic => logarithmic_marks(self.range, most),
            Division::Categories(names) => {
                let every = names.len().div_ceil(most).max(1);
                let all = names.iter().enumerate().step_by(every);
                all.map(|(i, name)| (i as f64 + 0.5, name.clone())).collect()
            }
        }
    }
}

/// Round step for about `most` ticks in a range, and its number of decimals.
fn round_step([low, high]: [f64; 2], most: usize) -> (f64, usize) {
    let rough = (high - low) / most as f64;
    let unit = 10f64.powf(rough.log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * unit).find(|s| *s >= rough * 0.999).unwrap_or(rough);
    (step, (-(step * 1.001).log10().floor()).clamp(0.0, 12.0) as usize)
}

/// About `most` ticks at round values.
pub(crate) fn linear_marks(range: [f64; 2], most: usize) -> Vec<(f64, String)> {
    let (step, digits) = round_step(range, most);
    let large = range[0].abs().max(range[1].abs()) >= 1e6;
    let small = step < 1e-6;
    let label = |v: f64| if large || small { short(v) } else { format!("{v:.digits$}") };
    let first = (range[0] / step - 1e-9).ceil();
    let all = (0..40).map(|i| (first + f64::from(i)) * step).take_while(|v| *v <= range[1] + 1e-9 * step);
    // Adding zero turns -0 to 0.
    all.map(|v| v + 0.0).map(|v| (v, label(v))).collect()
}

/// Ticks at decades, or at round values if there are few decades.
fn logarithmic_marks([low, high]: [f64; 2], most: usize) -> Vec<(f64, String)> {
    let decades = (high / low).log10();
    let within: &[f64] = if decades > 2.5 {
        &[1.0]
    } else if decades > 1.0 {
        &[1.0, 3.0]
    } else {
        &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
    };
    let mut all = Vec::new();
    for decade in low.log10().floor() as i32..=high.log10().ceil() as i32 {
        let values = within.iter().map(|w| w * 10f64.powi(decade));
        all.extend(values.filter(|v| (low..=high).contains(v)).map(|v| (v, short(v))));
    }
    let every = all.len().div_ceil(most.max(2)).max(1);
    all.into_iter().step_by(every).collect()
}

/// Short text of a number.
pub fn short(v: f64) -> String {
    if v == 0.0 {
        "0".into()
    } else if (1e-2..1e4).contains(&v.abs()) {
        let digits = (2.0 - v.abs().log10().floor()).clamp(0.0, 4.0) as usize;
        let text = format!("{v:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
    } else {
        let text = format!("{v:.1e}");
        text.replace(".0e", "e")
    }
}

/// An axis with its ticks, for plotters.
#[derive(Clone)]
pub(super) struct Coordinate {
    axis: Axis,
    marks: Vec<(f64, String)>,
}

impl Coordinate {
    /// The axis with about `most` ticks.
    pub(super) fn new(axis: &Axis, most: usize) -> Self {
        Self { axis: axis.clone(), marks: axis.marks(most) }
    }

    /// Labels of the ticks.
    pub(super) fn labels(&self) -> impl Iterator<Item = &str> {
        self.marks.iter().map(|m| m.1.as_str())
    }

    /// Position along the axis, 0 to 1.
    pub(super) fn share(&self, v: f64) -> Option<f64> {
        self.axis.share(v)
    }
}

impl Ranged for Coordinate {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let share = self.share(*value).unwrap_or(0.0).clamp(-0.02, 1.02);
        from + (share * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.iter().map(|m| m.0).collect()
    }

    fn range(&self) -> Range<f64> {
        self.axis.range[0]..self.axis.range[1]
    }
}

impl ValueFormatter<f64> for Coordinate {
    fn format_ext(&self, value: &f64) -> String {
        let mark = self.marks.iter().find(|m| m.0 == *value);
        mark.map_or_else(String::new, |m| m.1.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_contain_their_values() {
        let a = Axis::around("x", true, [1e-3, 2.0, f64::NAN, 0.0].into_iter());
        assert!(a.range[0] < 1e-3 && a.range[1] > 2.0);
        assert!(a.share(1e-3).unwrap() > 0.0 && a.share(2.0).unwrap() < 1.0 && a.share(0.0).is_none());
        for axis in [
            Axis::around("x", true, std::iter::empty()),
            Axis::around("x", false, [2.0, 2.0].into_iter()),
            Axis::around("x", false, [0.0, 0.0].into_iter()),
            Axis::spanning("x", [3.0].into_iter()),
            Axis::spanning("x", [f64::NAN].into_iter()),
        ] {
            assert!(axis.range[1] > axis.range[0]);
        }
        assert_eq!(Axis::around("x", false, [0.2, 5.0].into_iter()).range[0], 0.0);
        for logarithmic in [false, true] {
            let axis = Axis::around("x", logarithmic, [0.9, 4.2].into_iter());
            let marks = axis.marks(6);
            assert!((2..=12).contains(&marks.len()), "{marks:?}");
        }
        let rows = Axis::categories("", vec!["a".into(), "b".into()]).reversed();
        assert_eq!((rows.share(0.0), rows.share(2.0), rows.marks(9)[1].0), (Some(1.0), Some(0.0), 1.5));
    }

    #[test]
    fn ticks_are_round() {
        let labels = |range, most| linear_marks(range, most).into_iter().map(|m| m.1).collect::<Vec<_>>();
        assert_eq!(labels([-1.14, 35.2], 5), ["0", "10", "20", "30"]);
        assert_eq!(labels([0.0, 0.5], 5), ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5"]);
        assert_eq!(labels([0.0, 2e7], 4), ["0", "5e6", "1e7", "1.5e7", "2e7"]);
        let texts = [0.05, 1234.0, 1e-7, 2.5, -0.3].map(short);
        assert_eq!(texts, ["0.05", "1234", "1e-7", "2.5", "-0.3"]);
    }
}
