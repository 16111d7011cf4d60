//! Bar charts: shares of a total for each stage, and one value for each line.

use figures::chart::{self, Columns, Figure, Part};
use figures::colour;

/// A bar chart: stacked horizontal bars of shares, or vertical columns of one value.
pub(super) struct Bars {
    pub(super) id: String,
    pub(super) title: String,
    /// Name of the quantity.
    pub(super) label: &'static str,
    pub(super) unit: &'static str,
    pub(super) note: String,
    /// Names of the parts, in the order of the colours.
    pub(super) parts: Vec<&'static str>,
    /// Name of each row, and the value of each part.
    pub(super) rows: Vec<(String, Vec<f64>)>,
    /// Vertical columns on one scale, instead of horizontal bars of the full width.
    pub(super) upright: bool,
}

impl Bars {
    fn figure(&self) -> Figure {
        if self.upright {
            let total = |(name, values): &(String, Vec<f64>)| (name.clone(), values.iter().sum());
            return Figure::Columns(Columns {
                label: format!("{}, {}", self.label, self.unit),
                unit: self.unit.into(),
                across: self.parts.first().copied().unwrap_or_default().into(),
                columns: self.rows.iter().map(total).collect(),
            });
        }
        let part = |(i, value): (usize, &f64)| Part {
            name: self.parts[i].into(),
            colour: colour::series(i),
            value: *value,
        };
        let row = |(name, values): &(String, Vec<f64>)| chart::Bar {
            label: name.clone(),
            parts: values.iter().enumerate().map(part).collect(),
        };
        Figure::Bars(chart::Bars {
            label: format!("share of the {}, percent", self.label),
            unit: self.unit.into(),
            rows: self.rows.iter().map(row).collect(),
            shares: true,
        })
    }

    /// The chart as an SVG file.
    pub(super) fn file(&self) -> String {
        self.figure().svg().file()
    }

    /// The chart as an SVG element of the page.
    pub(super) fn element(&self) -> String {
        self.figure().svg().element(&[("class", "bars"), ("role", "img"), ("aria-label", &self.title)], "")
    }
}
