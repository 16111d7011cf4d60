//! Colour scales and their legends.

use tiny_skia::{PathBuilder, Pixmap, Rect, Stroke, Transform};

use super::raster::Rgb;
use super::text;

/// Colours from low to high, lightness rising evenly.
pub(super) type Scale = &'static [u32];

/// Blue to yellow (viridis), for the flow.
pub(super) const COOL: Scale =
    &[0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b, 0xfde725];
/// Violet to yellow (plasma without its darkest end), for fabric.
pub(super) const WARM: Scale =
    &[0x4b2991, 0x7a2a9e, 0xa83296, 0xcf4886, 0xea6a6f, 0xf8915a, 0xfdba50, 0xfbe36a];

/// Ink of lines and labels.
pub(super) const INK: Rgb = [0.13, 0.15, 0.18];
/// Background.
pub(super) const PAPER: Rgb = [1.0, 1.0, 1.0];

/// Colour at `t` from 0 to 1.
pub(super) fn pick(scale: Scale, t: f64) -> Rgb {
    let last = scale.len() - 1;
    // NaN becomes 0.
    let x = (t.clamp(0.0, 1.0) * last as f64).max(0.0);
    let i = (x as usize).min(last - 1);
    let part = (x - i as f64) as f32;
    let rgb = |hex: u32| [16, 8, 0].map(|s| ((hex >> s) & 255) as f32 / 255.0);
    let (a, b) = (rgb(scale[i]), rgb(scale[i + 1]));
    [0, 1, 2].map(|c| a[c] + part * (b[c] - a[c]))
}

/// Values that a scale spans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Range {
    /// All but the part `cut` of the values at either end, so that a few extreme
    /// cells do not wash out the rest. Never empty.
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

    /// Place of a value, 0 at the low end and 1 at the high end.
    pub(super) fn place(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Round values inside, some five, with the number of digits that they need.
    fn ticks(self) -> (Vec<f64>, usize) {
        let rough = (self.high - self.low) / 5.0;
        let power = rough.log10().floor();
        let unit = 10f64.powf(power);
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * unit).find(|s| *s >= rough).unwrap_or(rough);
        let digits = (-(step * 1.001).log10().floor()).max(0.0) as usize;
        let first = (self.low / step - 1e-9).ceil();
        let ticks =
            (0..20).map(|i| (first + f64::from(i)) * step).take_while(|t| *t <= self.high + 1e-9 * step);
        // Adding zero turns -0 to 0.
        (ticks.map(|t| t + 0.0).collect(), digits)
    }
}

/// A scale with its values.
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

    /// Draws the bar lying in the rectangle from `(x, y)`, ticks below, title above.
    pub(super) fn draw(&self, pixmap: &mut Pixmap, [x, y]: [f32; 2], [width, height]: [f32; 2], size: f32) {
        const STEPS: usize = 256;
        for i in 0..STEPS {
            let t = i as f32 / STEPS as f32;
            // Overlapping to the right end, so that no seam shows.
            if let Some(bar) = Rect::from_ltrb(x + t * width, y, x + width, y + height) {
                let mut paint = text::paint(pick(self.scale, f64::from(t)));
                paint.anti_alias = false;
                pixmap.fill_rect(bar, &paint, Transform::identity(), None);
            }
        }
        text::write(pixmap, &self.title, [x, y - 0.7 * size], size, INK);
        let (ticks, digits) = self.range.ticks();
        for tick in ticks {
            let at = x + self.range.place(tick) as f32 * width;
            let label = format!("{tick:.digits$}");
            let mut pen = PathBuilder::new();
            pen.move_to(at, y + height);
            pen.line_to(at, y + height + 0.4 * size);
            if let Some(path) = pen.finish() {
                let stroke = Stroke { width: (0.1 * size).max(1.0), ..Stroke::default() };
                pixmap.stroke_path(&path, &text::paint(INK), &stroke, Transform::identity(), None);
            }
            let left = at - 0.5 * text::width(&label, size);
            text::write(pixmap, &label, [left, y + height + 1.9 * size], size, INK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_rises_and_anything_has_a_colour() {
        let light = |c: Rgb| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        for scale in [COOL, WARM] {
            let row: Vec<f32> = (0..=40).map(|i| light(pick(scale, f64::from(i) / 40.0))).collect();
            assert!(row.windows(2).all(|w| w[1] > w[0] - 1e-3), "{row:?}");
            for odd in [f64::NAN, f64::INFINITY, -7.0] {
                assert!(pick(scale, odd).iter().all(|c| (0.0..=1.0).contains(c)));
            }
        }
    }

    #[test]
    fn ranges_and_ticks() {
        let range = Range { low: -1.14, high: 35.2 };
        assert_eq!(range.ticks(), (vec![0.0, 10.0, 20.0, 30.0], 0));
        assert_eq!(
            Range { low: 0.0, high: 0.5 }.ticks(),
            (vec![0.0, 0.1, 0.2, 0.30000000000000004, 0.4, 0.5], 1)
        );
        let constant = Range::of([3.0; 9].into_iter(), 0.01);
        assert!(constant.low < 3.0 && constant.high > 3.0);
        assert_eq!(Range::of(std::iter::empty(), 0.01).place(0.5), 0.5);
        let one_wild = (0..1000).map(|i| if i == 500 { 1e9 } else { f64::from(i) });
        assert!(Range::of(one_wild, 0.002).high < 1000.0);
    }
}
