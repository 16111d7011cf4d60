//! Panels with axes, linear or in decades, drawn by the canvas of `ripstop picture`.

use std::path::Path;

use coupling::error::RunError;
use figures::picture::canvas::{Canvas, Pixels, Svg};

type Rgb = [f32; 3];
type Place<'a> = &'a dyn Fn(&Axis, f64) -> Option<f32>;

/// Text and frames.
pub const INK: Rgb = [0.13, 0.15, 0.18];
/// Lines of the grid.
const FAINT: Rgb = [0.88, 0.89, 0.90];
/// What stands back.
pub const GREY: Rgb = [0.55, 0.57, 0.60];
/// Colours of series, in order.
pub const COLOURS: [Rgb; 8] = [
    [0.12, 0.36, 0.60],
    [0.75, 0.32, 0.09],
    [0.18, 0.49, 0.20],
    [0.48, 0.12, 0.64],
    [0.62, 0.50, 0.05],
    [0.05, 0.52, 0.55],
    [0.70, 0.15, 0.35],
    [0.35, 0.35, 0.40],
];

const LEFT: f32 = 78.0;
const RIGHT: f32 = 14.0;
/// Room for a legend beside the axes.
const LEGEND: f32 = 190.0;
const TOP: f32 = 34.0;
const BOTTOM: f32 = 46.0;

/// An axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Its name with unit.
    pub label: String,
    /// In decades.
    pub log: bool,
    /// Range.
    pub range: [f64; 2],
}

impl Axis {
    /// That shows all finite `values` with a margin; on a logarithmic one those above zero.
    pub fn around(label: &str, log: bool, values: impl Iterator<Item = f64>) -> Self {
        let shown = values.filter(|v| v.is_finite() && (!log || *v > 0.0));
        let (low, high) = shown.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let range = match (low <= high, log) {
            (false, true) => [0.1, 1.0],
            (false, false) => [0.0, 1.0],
            (true, true) => {
                let margin = (high / low).powf(0.07).max(1.25);
                [low / margin, high * margin]
            }
            (true, false) => {
                let margin = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-12);
                [low - margin, high + margin]
            }
        };
        Self { label: label.into(), log, range }
    }

    /// Share of the way along the axis; `None` outside of what it can show.
    fn share(&self, v: f64) -> Option<f64> {
        let [low, high] = self.range;
        let t = if self.log { (v / low).ln() / (high / low).ln() } else { (v - low) / (high - low) };
        t.is_finite().then_some(t)
    }

    fn ticks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.range;
        if !self.log {
            let step = nice((high - low) / 5.0);
            let first = (low / step).ceil() as i64;
            let last = (high / step).floor() as i64;
            let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
            return (first..=last)
                .take(12)
                .map(|i| (i as f64 * step, format!("{:.digits$}", i as f64 * step)))
                .collect();
        }
        let decades = (high / low).log10();
        let within: &[f64] = if decades > 2.5 {
            &[1.0]
        } else if decades > 1.0 {
            &[1.0, 3.0]
        } else {
            &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
        };
        let mut all = Vec::new();
        for e in low.log10().floor() as i32..=high.log10().ceil() as i32 {
            for w in within {
                let v = w * 10f64.powi(e);
                if v >= low && v <= high {
                    all.push((v, short(v)));
                }
            }
        }
        let every = all.len().div_ceil(8).max(1);
        all.into_iter().step_by(every).collect()
    }
}

fn nice(step: f64) -> f64 {
    let decade = 10f64.powf(step.log10().floor());
    let m = step / decade;
    decade
        * if m < 1.5 {
            1.0
        } else if m < 3.5 {
            2.0
        } else if m < 7.5 {
            5.0
        } else {
            10.0
        }
}

/// A number in few letters.
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

/// How points are marked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A filled circle.
    Dot,
    /// A ring.
    Ring,
    /// None.
    None,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub struct Series {
    /// For the legend; empty: none.
    pub name: String,
    /// Colour.
    pub colour: Rgb,
    /// Points, and half the band about each (0: none).
    pub points: Vec<([f64; 2], f64)>,
    /// Marks.
    pub mark: Mark,
    /// Width of the line between them (0: none).
    pub line: f32,
    /// Words beside points.
    pub notes: Vec<(usize, String)>,
}

/// A panel.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// What is drawn, the first at the back.
    pub series: Vec<Series>,
    /// A band across: from, to.
    pub band: Option<[f64; 2]>,
}

impl Panel {
    fn draw(&self, on: &mut dyn Canvas, [x0, y0]: [f32; 2], [w, h]: [f32; 2]) {
        let (left, top) = (x0 + LEFT, y0 + TOP);
        let named = self.series.iter().any(|s| !s.name.is_empty());
        let right = if named { LEGEND } else { RIGHT };
        let (width, height) = (w - LEFT - right, h - TOP - BOTTOM);
        on.label(&self.title, [x0 + 8.0, y0 + 18.0], 9.5, 0.0, INK);
        let across: Place<'_> = &|a, v| Some(left + a.share(v)?.clamp(-0.02, 1.02) as f32 * width);
        let up: Place<'_> = &|a, v| Some(top + height - a.share(v)?.clamp(-0.02, 1.02) as f32 * height);
        if let Some([low, high]) = self.band
            && let (Some(a), Some(b)) = (up(&self.y, low), up(&self.y, high))
        {
            on.rect(
                [left, b.max(top)],
                [width, (a.min(top + height) - b.max(top)).max(1.0)],
                [0.87, 0.92, 0.97],
            );
        }
        for (v, text) in self.x.ticks() {
            let Some(x) = across(&self.x, v) else { continue };
            on.line([x, top], [x, top + height], 1.0, FAINT);
            on.label(&text, [x, top + height + 14.0], 7.5, 0.5, INK);
        }
        for (v, text) in self.y.ticks() {
            let Some(y) = up(&self.y, v) else { continue };
            on.line([left, y], [left + width, y], 1.0, FAINT);
            on.label(&text, [left - 6.0, y + 3.5], 7.5, 1.0, INK);
        }
        for (a, b) in
            [([left, top], [left, top + height]), ([left, top + height], [left + width, top + height])]
        {
            on.line(a, b, 1.2, INK);
        }
        on.label(&self.x.label, [left + 0.5 * width, top + height + 32.0], 8.0, 0.5, INK);
        on.label(&self.y.label, [x0 + 8.0, y0 + 30.0], 7.5, 0.0, GREY);
        for s in &self.series {
            s.draw(on, self, across, up);
        }
        let mut at = top + 12.0;
        for s in self.series.iter().filter(|s| !s.name.is_empty()) {
            let x = left + width + 22.0;
            on.label(&s.name, [x + 6.0, at + 3.0], 7.5, 0.0, INK);
            match s.mark {
                Mark::Dot => on.circle([x - 5.0, at], 3.4, None, s.colour),
                Mark::Ring => on.circle([x - 5.0, at], 4.2, Some(1.6), s.colour),
                Mark::None => on.line([x - 11.0, at], [x, at], s.line.max(1.2), s.colour),
            }
            at += 14.0;
        }
    }
}

impl Series {
    fn draw(&self, on: &mut dyn Canvas, panel: &Panel, across: Place<'_>, up: Place<'_>) {
        let place = |p: &[f64; 2]| Some([across(&panel.x, p[0])?, up(&panel.y, p[1])?]);
        if self.line > 0.0 {
            let placed: Vec<_> = self.points.iter().filter_map(|(p, _)| place(p)).collect();
            placed.windows(2).for_each(|w| on.line(w[0], w[1], self.line, self.colour));
        }
        for (p, half) in &self.points {
            let Some([x, y]) = place(p) else { continue };
            if *half > 0.0 && half.is_finite() {
                let low = if panel.y.log { (p[1] - half).max(panel.y.range[0]) } else { p[1] - half };
                if let (Some(a), Some(b)) = (up(&panel.y, low), up(&panel.y, p[1] + half)) {
                    on.line([x, a], [x, b], 1.0, self.colour);
                    [a, b].into_iter().for_each(|e| on.line([x - 3.0, e], [x + 3.0, e], 1.0, self.colour));
                }
            }
            match self.mark {
                Mark::Dot => on.circle([x, y], 3.4, None, self.colour),
                Mark::Ring => on.circle([x, y], 5.6, Some(1.6), self.colour),
                Mark::None => {}
            }
        }
        for (at, text) in &self.notes {
            if let Some([x, y]) = self.points.get(*at).and_then(|(p, _)| place(p)) {
                on.label(text, [x + 7.0, y - 5.0], 7.0, 0.0, self.colour);
            }
        }
    }
}

/// A bar of parts on top of each other.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Below it.
    pub label: String,
    /// Name, colour and height of each part.
    pub parts: Vec<(String, Rgb, f64)>,
}

/// A picture: panels in rows, or bars.
pub enum Figure {
    /// Panels.
    Panels(Vec<Panel>),
    /// Stacked bars with the name of their unit.
    Bars(String, Vec<Bar>),
}

const PANEL: [f32; 2] = [470.0, 340.0];
/// A panel alone.
const WIDE: [f32; 2] = [940.0, 440.0];
const BAR_ROW: f32 = 26.0;

impl Figure {
    fn size(&self) -> [u32; 2] {
        match self {
            Self::Panels(p) => {
                if p.len() == 1 {
                    return WIDE.map(|s| s as u32);
                }
                let columns = 2;
                let rows = p.len().div_ceil(columns).max(1);
                [(PANEL[0] * columns as f32) as u32, (PANEL[1] * rows as f32) as u32]
            }
            Self::Bars(_, bars) => [940, (64.0 + BAR_ROW * bars.len() as f32 + 40.0) as u32],
        }
    }

    fn draw(&self, on: &mut dyn Canvas) {
        match self {
            Self::Panels(panels) => {
                if let [one] = panels.as_slice() {
                    return one.draw(on, [0.0; 2], WIDE);
                }
                let columns = 2;
                for (i, p) in panels.iter().enumerate() {
                    let (column, row) = (i % columns, i / columns);
                    p.draw(on, [column as f32 * PANEL[0], row as f32 * PANEL[1]], PANEL);
                }
            }
            Self::Bars(unit, bars) => draw_bars(on, unit, bars),
        }
    }

    /// Writes `<name>.svg` and `<name>.png` into `folder`; the text of the first.
    ///
    /// # Errors
    /// Trouble with the files.
    pub fn save(&self, folder: &Path, name: &str) -> Result<String, RunError> {
        let path = folder.join(format!("{name}.svg"));
        let mut svg = Svg::new(self.size());
        self.draw(&mut svg);
        svg.save(&path)?;
        let mut pixels = Pixels::new(self.size());
        self.draw(&mut pixels);
        pixels.save(&folder.join(format!("{name}.png")))?;
        std::fs::read_to_string(&path).map_err(RunError::file("read", &path))
    }
}

fn draw_bars(on: &mut dyn Canvas, unit: &str, bars: &[Bar]) {
    let (left, right) = (210.0, 120.0);
    let most = bars.iter().map(|b| b.parts.iter().map(|p| p.2).sum::<f64>()).fold(0.0, f64::max).max(1e-12);
    let width = 940.0 - left - right;
    let mut names: Vec<(&str, Rgb)> = Vec::new();
    for (name, colour, size) in bars.iter().flat_map(|b| &b.parts) {
        if *size > 0.0 && !names.iter().any(|n| n.0 == name) {
            names.push((name, *colour));
        }
    }
    let (mut x, mut y) = (left, 18.0);
    for (name, colour) in names {
        let step = 26.0 + 6.4 * name.len() as f32;
        if x + step > 930.0 {
            (x, y) = (left, y + 16.0);
        }
        on.rect([x, y - 9.0], [12.0, 12.0], colour);
        on.label(name, [x + 16.0, y + 1.0], 7.5, 0.0, INK);
        x += step;
    }
    for (i, bar) in bars.iter().enumerate() {
        let top = 64.0 + BAR_ROW * i as f32;
        on.label(&bar.label, [left - 8.0, top + 14.0], 8.0, 1.0, INK);
        let (mut at, mut sum) = (left, 0.0);
        for (_, colour, size) in &bar.parts {
            let w = (size / most) as f32 * width;
            if w > 0.0 {
                on.rect([at, top], [w, BAR_ROW - 6.0], *colour);
            }
            at += w;
            sum += size;
        }
        on.label(&format!("{} {unit}", short(sum)), [at + 6.0, top + 14.0], 8.0, 0.0, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_their_values() {
        let a = Axis::around("x", true, [1e-3, 2.0, f64::NAN, 0.0].into_iter());
        assert!(a.range[0] < 1e-3 && a.range[1] > 2.0);
        assert!(a.share(1e-3).unwrap() > 0.0 && a.share(2.0).unwrap() < 1.0 && a.share(0.0).is_none());
        for axis in
            [Axis::around("x", true, std::iter::empty()), Axis::around("x", false, [2.0, 2.0].into_iter())]
        {
            assert!(axis.range[1] > axis.range[0]);
        }
        for log in [false, true] {
            let axis = Axis::around("x", log, [0.9, 4.2].into_iter());
            let ticks = axis.ticks();
            assert!((2..=12).contains(&ticks.len()), "{ticks:?}");
        }
        assert_eq!(
            (short(0.05), short(1234.0), short(1e-7), short(2.5)),
            ("0.05".into(), "1234".into(), "1e-7".into(), "2.5".into())
        );
    }

    #[test]
    fn a_panel_is_drawn_both_ways() {
        let folder = tempfile::tempdir().unwrap();
        let series = Series {
            name: "drag".into(),
            colour: COLOURS[0],
            points: vec![([1.0, 0.1], 0.02), ([2.0, 0.025], 0.01), ([4.0, f64::NAN], 0.0)],
            mark: Mark::Dot,
            line: 1.0,
            notes: vec![(0, "order 2".into())],
        };
        let panel = Panel {
            title: "grid".into(),
            x: Axis::around("cost", true, [1.0, 4.0].into_iter()),
            y: Axis::around("error", true, [0.1, 0.025].into_iter()),
            series: vec![series],
            band: Some([0.03, 0.05]),
        };
        let svg = Figure::Panels(vec![panel; 3]).save(folder.path(), "p").unwrap();
        // Two sound points and one mark in the legend, three times; the third has no place.
        assert_eq!(svg.matches("<circle").count(), 9);
        assert!(svg.contains("order 2") && folder.path().join("p.png").metadata().unwrap().len() > 3000);
        let bars = vec![Bar {
            label: "base".into(),
            parts: vec![("flow".into(), COLOURS[0], 3.0), ("none".into(), COLOURS[1], 0.0)],
        }];
        let svg = Figure::Bars("s".into(), bars).save(folder.path(), "b").unwrap();
        assert!(svg.contains(">3 s<") && !svg.contains("none"));
    }
}
