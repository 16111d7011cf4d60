//! Bar charts: stacked horizontal bars, or columns of one value.

use plotters::coord::Shift;
use plotters::prelude::DrawingArea;

use super::axis::{Axis, short};
use super::legend::{Entry, Legend, Sign};
use super::plot::{Grid, MARK, Margin, Plot};
use super::{Hover, WIDTH};
use crate::colour::{Colour, INK, series};
use crate::font::width;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet};

/// A part of a bar.
#[derive(Clone, Debug)]
pub struct Part {
    /// Name in the legend.
    pub name: String,
    /// Colour.
    pub colour: Colour,
    /// Value.
    pub value: f64,
}

/// A stacked bar.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Label on the left.
    pub label: String,
    /// Parts from the left.
    pub parts: Vec<Part>,
}

impl Bar {
    fn total(&self) -> f64 {
        self.parts.iter().map(|p| p.value).sum()
    }
}

/// A chart of stacked bars.
#[derive(Clone, Debug)]
pub struct Bars {
    /// Label of the values with unit.
    pub label: String,
    /// Unit of the values.
    pub unit: String,
    /// Bars from the top.
    pub rows: Vec<Bar>,
    /// Whether each bar has the full width and its parts are shares.
    pub shares: bool,
}

const ROW: f64 = 30.0;

impl Bars {
    pub(super) fn size(&self) -> [f64; 2] {
        [WIDTH, self.legend().height + ROW * self.rows.len().max(1) as f64 + 54.0]
    }

    fn legend(&self) -> Legend {
        let parts = self.rows.iter().flat_map(|r| &r.parts).filter(|p| p.value > 0.0);
        let entry = |p: &Part| Entry { name: p.name.clone(), colour: p.colour, sign: Sign::Fill };
        Legend::new(parts.map(entry), [8.0, WIDTH - 8.0])
    }

    fn total_label(&self, row: &Bar) -> String {
        format!("{} {}", short(row.total()), self.unit)
    }

    fn plot(&self) -> Plot {
        let names = self.rows.iter().map(|r| r.label.clone()).collect();
        let rows = Axis::categories("", names).reversed();
        let most = self.rows.iter().map(Bar::total).fold(f64::MIN_POSITIVE, f64::max);
        let end = if self.shares { 100.0 } else { 1.02 * most };
        let across = Axis::spanning(&self.label, [0.0, end].into_iter());
        let totals = self.rows.iter().map(|r| width(&self.total_label(r), MARK) + 14.0);
        let margin =
            Margin { top: self.legend().height + 6.0, right: totals.fold(20.0, f64::max), left: 0.0 };
        Plot::new(&across, &rows, self.size(), margin)
    }

    /// Corner, size, row and index of each part.
    fn places(&self, plot: &Plot) -> Vec<([f64; 2], [f64; 2], usize, usize)> {
        let mut all = Vec::new();
        for (r, row) in self.rows.iter().enumerate() {
            let scale = if self.shares { 100.0 / row.total().max(f64::MIN_POSITIVE) } else { 1.0 };
            let mut from = 0.0;
            for (i, part) in row.parts.iter().enumerate() {
                let to = from + scale * part.value;
                let top = r as f64 + 0.14;
                if let (Some(a), Some(b)) = (plot.place([from, top]), plot.place([to, top + 0.72]))
                    && b[0] - a[0] > 0.05
                {
                    all.push((a, [b[0] - a[0], b[1] - a[1]], r, i));
                }
                from = to;
            }
        }
        all
    }

    pub(super) fn hovers(&self) -> Vec<Hover> {
        let text = |row: usize, part: usize| {
            let bar = &self.rows[row];
            let share = 100.0 * bar.parts[part].value / bar.total().max(f64::MIN_POSITIVE);
            let Part { name, value, .. } = &bar.parts[part];
            format!("{}, {name}: {} {} ({share:.1} %)", bar.label, short(*value), self.unit)
        };
        let places = self.places(&self.plot());
        places.into_iter().map(|(corner, size, r, i)| Hover { corner, size, text: text(r, i) }).collect()
    }

    pub(super) fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        let sheet = Sheet(area);
        let plot = self.plot();
        self.legend().draw(&sheet)?;
        plot.axes(&mut plot.begin(area)?, Grid::Upright)?;
        let mut ends = vec![plot.corner[0]; self.rows.len()];
        for (corner, size, r, i) in self.places(&plot) {
            sheet.rectangle(corner, size, self.rows[r].parts[i].colour)?;
            ends[r] = corner[0] + size[0];
        }
        for (r, (row, end)) in self.rows.iter().zip(ends).enumerate() {
            let Some([_, y]) = plot.place([0.0, r as f64 + 0.5]) else { continue };
            sheet.text(&self.total_label(row), [end + 7.0, y], MARK, Anchor::Left, INK)?;
        }
        Ok(())
    }
}

/// A column chart.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Label of the values with unit.
    pub label: String,
    /// Unit of the values.
    pub unit: String,
    /// Label of the column axis.
    pub across: String,
    /// Name and value of each column.
    pub columns: Vec<(String, f64)>,
}

impl Columns {
    pub(super) const SIZE: [f64; 2] = [WIDTH, 260.0];

    fn plot(&self) -> Plot {
        let names = self.columns.iter().map(|c| c.0.clone()).collect();
        let across = Axis::categories(&self.across, names);
        let values = self.columns.iter().map(|c| c.1).filter(|v| v.is_finite());
        let most = values.fold(f64::MIN_POSITIVE, f64::max);
        let up = Axis::spanning(&self.label, [0.0, 1.12 * most].into_iter());
        Plot::new(&across, &up, Self::SIZE, Margin { top: 12.0, right: 16.0, left: 0.0 })
    }

    /// Corner, size and index of each column.
    fn places(&self, plot: &Plot) -> Vec<([f64; 2], [f64; 2], usize)> {
        let one = |(i, (_, value)): (usize, &(String, f64))| {
            let (left, right) = (i as f64 + 0.15, i as f64 + 0.85);
            let (a, b) = (plot.place([left, *value])?, plot.place([right, 0.0])?);
            Some((a, [b[0] - a[0], (b[1] - a[1]).max(0.0)], i))
        };
        self.columns.iter().enumerate().filter_map(one).collect()
    }

    pub(super) fn hovers(&self) -> Vec<Hover> {
        let places = self.places(&self.plot());
        let text = |i: usize| {
            let (name, value) = &self.columns[i];
            format!("{} {name}: {} {}", self.across, short(*value), self.unit)
        };
        places.into_iter().map(|(corner, size, i)| Hover { corner, size, text: text(i) }).collect()
    }

    pub(super) fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        let sheet = Sheet(area);
        let plot = self.plot();
        plot.axes(&mut plot.begin(area)?, Grid::Level)?;
        let texts = self.values();
        // Values are written above all columns or above none.
        let step = plot.size[0] / self.columns.len().max(1) as f64;
        let room = texts.iter().all(|text| width(text, MARK) + 4.0 < step);
        for (corner, size, i) in self.places(&plot) {
            sheet.rectangle(corner, size, series(0))?;
            if room {
                let middle = [corner[0] + 0.5 * size[0], corner[1] - 9.0];
                sheet.text(&texts[i], middle, MARK, Anchor::Middle, INK)?;
            }
        }
        Ok(())
    }

    /// All values with the number of decimals that gives the largest value three digits.
    fn values(&self) -> Vec<String> {
        let sizes = self.columns.iter().map(|c| c.1.abs()).filter(|v| v.is_finite());
        let most = sizes.fold(0.0, f64::max);
        if !(1e-3..1e5).contains(&most) {
            return self.columns.iter().map(|c| short(c.1)).collect();
        }
        let decimals = (2.0 - most.log10().floor()).max(0.0) as usize;
        self.columns.iter().map(|c| format!("{:.decimals$}", c.1)).collect()
    }
}
