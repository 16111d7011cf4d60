//! Legend of a chart, above the data.

use super::curves::Mark;
use super::plot::MARK;
use crate::colour::{Colour, INK};
use crate::font::width;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet};

/// Symbol of a legend entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sign {
    /// Line of this width (0: none) and marker.
    Curve(f64, Mark),
    /// A filled square.
    Fill,
}

/// An entry of a legend.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) colour: Colour,
    pub(super) sign: Sign,
}

/// A legend: entries in rows.
pub(super) struct Legend {
    entries: Vec<(Entry, [f64; 2])>,
    /// Height of all rows, pixels; 0 without entries.
    pub(super) height: f64,
}

const ROW: f64 = 19.0;
const SIGN: f64 = 20.0;

impl Legend {
    /// Lays out the distinct entries between two horizontal positions, pixels. Fewer than two entries give no legend.
    pub(super) fn new(entries: impl IntoIterator<Item = Entry>, [from, to]: [f64; 2]) -> Self {
        let mut placed: Vec<(Entry, [f64; 2])> = Vec::new();
        let (mut x, mut row) = (from, 0.0);
        for entry in entries {
            if entry.name.is_empty() || placed.iter().any(|(e, _)| e.name == entry.name) {
                continue;
            }
            let step = SIGN + width(&entry.name, MARK) + 22.0;
            if x > from && x + step > to {
                (x, row) = (from, row + 1.0);
            }
            placed.push((entry, [x, ROW * (row + 0.5) + 5.0]));
            x += step;
        }
        if placed.len() < 2 {
            placed.clear();
        }
        let height = if placed.is_empty() { 0.0 } else { ROW * (row + 1.0) + 8.0 };
        Self { entries: placed, height }
    }

    /// Draws the legend at the upper edge of an area.
    pub(super) fn draw<DB: Canvas>(&self, sheet: &Sheet<'_, DB>) -> Drawn<DB> {
        for (entry, [x, y]) in &self.entries {
            match entry.sign {
                Sign::Fill => sheet.rectangle([x + 2.0, y - 6.0], [12.0, 12.0], entry.colour)?,
                Sign::Curve(line, mark) => {
                    if line > 0.0 {
                        sheet.line(&[[*x, *y], [x + 16.0, *y]], line.max(1.5), entry.colour)?;
                    }
                    mark.draw(sheet, [x + 8.0, *y], entry.colour)?;
                }
            }
            sheet.text(&entry.name, [x + SIGN, *y], MARK, Anchor::Left, INK)?;
        }
        Ok(())
    }
}
