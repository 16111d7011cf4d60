//! Colour scale of values with its colour bar.

use crate::chart::linear_marks;
use crate::colour::{Rgb, Scale, pick};
use crate::colour_bar::ColourBar;
use crate::sheet::{Canvas, Drawn, Sheet};

/// Range of a colour scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Range {
    /// Range of the values without the share `cut` at either end, so that outliers do not set the scale. Never empty.
    pub(super) fn of(values: impl Iterator<Item = f64>, cut: f64) -> Self {
        let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        let at = |part: f64| values.get((part * values.len() as f64) as usize).or(values.last());
        let (low, high) = (at(cut).copied().unwrap_or(0.0), at(1.0 - cut).copied().unwrap_or(1.0));
        if high - low > 1e-9 * high.abs().max(low.abs()) {
            Self { low, high }
        } else {
            Self { low: low - 0.5 * low.abs().max(1.0), high: high + 0.5 * high.abs().max(1.0) }
        }
    }

    /// Position of a value: 0 at the lower end, 1 at the upper end.
    pub(super) fn place(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// A colour scale with its range and title.
#[derive(Clone)]
pub(super) struct Legend {
    pub(super) title: String,
    pub(super) scale: Scale,
    pub(super) range: Range,
}

impl Legend {
    /// Colour of a value.
    pub(super) fn colour(&self, value: f64) -> Rgb {
        pick(self.scale, self.range.place(value))
    }

    /// Draws the colour bar from `corner`, with title above and ticks below; nothing without a title. Lengths in pixels; `text` is the font size.
    pub(super) fn draw<DB: Canvas>(
        &self,
        sheet: &Sheet<'_, DB>,
        corner: [f64; 2],
        size: [f64; 2],
        text: f64,
    ) -> Drawn<DB> {
        if self.title.is_empty() {
            return Ok(());
        }
        let marks = linear_marks([self.range.low, self.range.high], 5);
        let marks = marks.into_iter().map(|(v, label)| (self.range.place(v), label)).collect();
        ColourBar { title: &self.title, scale: self.scale, marks }.draw(sheet, corner, size, text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_cover_most_values_and_are_never_empty() {
        let constant = Range::of([3.0; 9].into_iter(), 0.01);
        assert!(constant.low < 3.0 && constant.high > 3.0);
        assert_eq!(Range::of(std::iter::empty(), 0.01).place(0.5), 0.5);
        let one_wild = (0..1000).map(|i| if i == 500 { 1e9 } else { f64::from(i) });
        assert!(Range::of(one_wild, 0.002).high < 1000.0);
    }
}
