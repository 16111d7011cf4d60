//! Line and scatter charts.

use plotters::coord::Shift;
use plotters::prelude::{Color, DashedLineSeries, DrawingArea};

use super::axis::Axis;
use super::legend::{Entry, Sign};
use super::plot::{Grid, MARK, Margin, OnAxes, Plot, TITLE};
use crate::colour::{BAND, Colour, GREY, INK};
use crate::font::width;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet, fine, pen};

/// Marker of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A filled circle.
    Dot,
    /// A circle outline.
    Ring,
    /// None.
    None,
}

impl Mark {
    pub(super) fn draw<DB: Canvas>(self, sheet: &Sheet<'_, DB>, at: [f64; 2], colour: Colour) -> Drawn<DB> {
        match self {
            Mark::Dot => sheet.dot(at, 3.4, colour),
            Mark::Ring => sheet.ring(at, 5.6, 1.6, colour),
            Mark::None => Ok(()),
        }
    }
}

/// A data series.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name in the legend; none if empty.
    pub name: String,
    /// Colour.
    pub colour: Colour,
    /// Points; a point that cannot be shown interrupts the line.
    pub points: Vec<[f64; 2]>,
    /// Half widths of error bars; none if empty.
    pub bands: Vec<f64>,
    /// Marker.
    pub mark: Mark,
    /// Line width, pixels; 0: no line.
    pub line: f64,
    /// Labels of points by index.
    pub notes: Vec<(usize, String)>,
}

impl Series {
    /// A curve.
    pub fn curve(name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        let (name, bands, notes) = (name.into(), Vec::new(), Vec::new());
        Self { name, colour, points, bands, mark: Mark::None, line: 1.8, notes }
    }

    /// Points without a line.
    pub fn dots(name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        Self { mark: Mark::Dot, line: 0.0, ..Self::curve(name, colour, points) }
    }
}

/// A labelled value of the y axis.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The value.
    pub value: f64,
    /// Label.
    pub label: String,
    /// Colour.
    pub colour: Colour,
    /// Whether a dashed line is drawn.
    pub dashed: bool,
}

impl Reference {
    /// A reference value with a dashed line.
    pub fn dashed(value: f64, label: String) -> Self {
        Self { value, label, colour: GREY, dashed: true }
    }

    /// The label of the final value of a curve, in its colour.
    pub fn reached(value: f64, label: String, colour: Colour) -> Self {
        Self { value, label, colour, dashed: false }
    }
}

/// A panel: series on common axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Title; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series, drawn in order.
    pub series: Vec<Series>,
    /// Shaded band of y values: from, to.
    pub band: Option<[f64; 2]>,
    /// Reference values.
    pub references: Vec<Reference>,
}

impl Panel {
    /// Entries of the legend.
    pub(super) fn legend(&self) -> impl Iterator<Item = Entry> {
        self.series.iter().map(|s| Entry {
            name: s.name.clone(),
            colour: s.colour,
            sign: Sign::Curve(s.line, s.mark),
        })
    }

    /// The plot in an area of size `area`, with minimum margins (left, right) of the data, pixels.
    pub(super) fn plot(&self, area: [f64; 2], [left, least]: [f64; 2]) -> Plot {
        let top = if self.title.is_empty() { 10.0 } else { 30.0 };
        let named = self.references.iter().map(|r| width(&r.label, MARK) + 12.0);
        Plot::new(&self.x, &self.y, area, Margin { top, right: named.fold(16.0, f64::max).max(least), left })
    }

    pub(super) fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>, plot: &Plot) -> Drawn<DB> {
        let sheet = Sheet(area);
        if !self.title.is_empty() {
            sheet.text(&self.title, [plot.corner[0], 16.0], TITLE, Anchor::Left, INK)?;
        }
        self.draw_band(&sheet, plot)?;
        let mut chart = plot.begin(area)?;
        plot.axes(&mut chart, Grid::Both)?;
        self.draw_references(&sheet, plot, &mut chart)?;
        for s in &self.series {
            s.draw(&sheet, plot, &self.y)?;
        }
        let mut notes = Notes::new(plot, &self.series);
        self.series.iter().try_for_each(|s| s.annotate(&sheet, plot, &mut notes))
    }

    fn draw_band<DB: Canvas>(&self, sheet: &Sheet<'_, DB>, plot: &Plot) -> Drawn<DB> {
        let Some([low, high]) = self.band else { return Ok(()) };
        let [first, _] = self.x.range;
        let (Some(a), Some(b)) = (plot.place([first, low]), plot.place([first, high])) else { return Ok(()) };
        let [top, bottom] = [b[1], a[1]].map(|y| y.clamp(plot.corner[1], plot.corner[1] + plot.size[1]));
        sheet.rectangle([plot.corner[0], top], [plot.size[0], (bottom - top).max(1.0)], BAND)
    }

    fn draw_references<DB: Canvas>(
        &self,
        sheet: &Sheet<'_, DB>,
        plot: &Plot,
        chart: &mut OnAxes<'_, DB>,
    ) -> Drawn<DB> {
        let [first, last] = self.x.range;
        let mut sorted: Vec<&Reference> = self.references.iter().collect();
        sorted.sort_by(|a, b| b.value.total_cmp(&a.value));
        // Labels of close values are placed below each other.
        let mut free = f64::MIN;
        for r in sorted {
            let Some([x, y]) = plot.place([last, r.value]) else { continue };
            if r.dashed {
                let ends = [(first, r.value), (last, r.value)];
                let style = r.colour.stroke_width(pen(1.2));
                chart.draw_series(DashedLineSeries::new(ends, fine(6.0), fine(4.0), style))?;
            }
            let at = y.max(free);
            free = at + 14.0;
            sheet.text(&r.label, [x + 6.0, at], MARK, Anchor::Left, r.colour)?;
        }
        Ok(())
    }
}

impl Series {
    fn draw<DB: Canvas>(&self, sheet: &Sheet<'_, DB>, plot: &Plot, y: &Axis) -> Drawn<DB> {
        let placed: Vec<Option<[f64; 2]>> = self.points.iter().map(|p| plot.place(*p)).collect();
        if self.line > 0.0 {
            for run in placed.split(Option::is_none).filter(|run| run.len() > 1) {
                let run: Vec<[f64; 2]> = run.iter().flatten().copied().collect();
                sheet.line(&run, self.line, self.colour)?;
            }
        }
        for (i, at) in placed.iter().enumerate() {
            let Some(at) = at else { continue };
            if let Some(half) = self.bands.get(i).filter(|h| **h > 0.0 && h.is_finite()) {
                self.draw_error_bar(sheet, plot, y, (self.points[i], *half))?;
            }
            self.mark.draw(sheet, *at, self.colour)?;
        }
        Ok(())
    }

    fn draw_error_bar<DB: Canvas>(
        &self,
        sheet: &Sheet<'_, DB>,
        plot: &Plot,
        axis: &Axis,
        ([x, y], half): ([f64; 2], f64),
    ) -> Drawn<DB> {
        let low = if axis.logarithmic() { (y - half).max(axis.range[0]) } else { y - half };
        let (Some(a), Some(b)) = (plot.place([x, low]), plot.place([x, y + half])) else { return Ok(()) };
        sheet.line(&[a, b], 1.0, self.colour)?;
        for end in [a, b] {
            sheet.line(&[[end[0] - 3.0, end[1]], [end[0] + 3.0, end[1]]], 1.0, self.colour)?;
        }
        Ok(())
    }

    fn annotate<DB: Canvas>(&self, sheet: &Sheet<'_, DB>, plot: &Plot, notes: &mut Notes) -> Drawn<DB> {
        for (at, text) in &self.notes {
            let Some(point) = self.points.get(*at).and_then(|p| plot.place(*p)) else { continue };
            let left = notes.place(point, width(text, MARK));
            sheet.text(text, left, MARK, Anchor::Left, self.colour)?;
        }
        Ok(())
    }
}

/// Places point labels inside the plot without overlap of lines or other labels.
struct Notes {
    low: [f64; 2],
    high: [f64; 2],
    /// Left end, vertical centre and width of each label.
    placed: Vec<([f64; 2], f64)>,
    /// Points on lines, a few pixels apart.
    lines: Vec<[f64; 2]>,
}

impl Notes {
    const HEIGHT: f64 = 13.0;

    fn new(plot: &Plot, series: &[Series]) -> Self {
        let high = [0, 1].map(|c| plot.corner[c] + plot.size[c]);
        let mut lines = Vec::new();
        for s in series.iter().filter(|s| s.line > 0.0) {
            let placed: Vec<[f64; 2]> = s.points.iter().filter_map(|p| plot.place(*p)).collect();
            for ends in placed.windows(2) {
                let way = [0, 1].map(|c| ends[1][c] - ends[0][c]);
                let steps = (way[0].hypot(way[1]) / 4.0).ceil().max(1.0);
                let at = |i: usize| [0, 1].map(|c| ends[0][c] + way[c] * i as f64 / steps);
                lines.extend((0..=steps as usize).map(at));
            }
        }
        Self { low: plot.corner, high, placed: Vec::new(), lines }
    }

    /// Left end and vertical centre of a label of this width: the first free position next to the point.
    fn place(&mut self, [x, y]: [f64; 2], width: f64) -> [f64; 2] {
        let sides = [x + 7.0, x - 7.0 - width];
        let levels = [-9.0, 10.0, -22.0, 23.0, -35.0, 36.0];
        let choices: Vec<[f64; 2]> = levels.iter().flat_map(|dy| sides.map(|x| [x, y + dy])).collect();
        let inside = |[x, y]: [f64; 2]| {
            x >= self.low[0] + 2.0
                && x + width <= self.high[0] - 2.0
                && y >= self.low[1] + 6.0
                && y <= self.high[1] - 6.0
        };
        let clear = |[x, y]: [f64; 2]| {
            let covered = |p: &[f64; 2]| {
                p[0] > x - 2.0 && p[0] < x + width + 2.0 && (p[1] - y).abs() < 0.5 * Self::HEIGHT
            };
            !self.lines.iter().any(covered)
        };
        let free = |[x, y]: [f64; 2]| {
            self.placed.iter().all(|([a, b], w)| x > a + w || *a > x + width || (y - b).abs() >= Self::HEIGHT)
        };
        let found = choices.iter().find(|c| inside(**c) && free(**c) && clear(**c));
        let found = found.or_else(|| choices.iter().find(|c| inside(**c) && free(**c)));
        let chosen = *found.or_else(|| choices.iter().find(|c| inside(**c))).unwrap_or(&choices[0]);
        self.placed.push((chosen, width));
        chosen
    }
}
