//! Heat maps: coloured cells with a marker and a number.

use plotters::coord::Shift;
use plotters::prelude::DrawingArea;

use super::axis::Axis;
use super::plot::{Grid, MARK, Margin, Plot, TITLE};
use crate::colour::{COOL, Colour, GREY, GRID, INK, PAPER, ink_on, shade};
use crate::colour_bar::ColourBar;
use crate::font::width;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet};

/// Marker of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldMark {
    /// A filled circle.
    Dot,
    /// A circle outline.
    Ring,
    /// A cross.
    Cross,
}

/// A cell of a heat map.
#[derive(Clone, Debug)]
pub struct Field {
    /// Column from the left, row from below.
    pub at: [usize; 2],
    /// Position on the colour scale, 0 to 1.
    pub share: f64,
    /// Marker.
    pub mark: FieldMark,
    /// Text.
    pub text: String,
}

/// A heat map.
#[derive(Clone, Debug)]
pub struct HeatMap {
    /// Title.
    pub title: String,
    /// Horizontal categories.
    pub x: Axis,
    /// Vertical categories.
    pub y: Axis,
    /// Cells; missing cells are grey.
    pub fields: Vec<Field>,
}

/// Heat maps with a common legend.
#[derive(Clone, Debug)]
pub struct HeatMaps {
    /// Title of the figure.
    pub title: String,
    /// Maps, row by row.
    pub maps: Vec<HeatMap>,
    /// Number of maps per row.
    pub columns: usize,
    /// Meaning of the markers.
    pub marks: Vec<(FieldMark, String)>,
    /// Label of the colour scale.
    pub scale: String,
    /// Labels and positions, 0 to 1, on the scale.
    pub scale_marks: Vec<(f64, String)>,
}

const FIELD: [f64; 2] = [72.0, 42.0];
const HEAD: f64 = 96.0;
const BAR: f64 = 150.0;
/// Distance of the colour bar from the right edge, pixels.
const BAR_FROM_RIGHT: f64 = 250.0;

fn count(axis: &Axis) -> f64 {
    (axis.range[1] - axis.range[0]).abs()
}

impl HeatMaps {
    fn map_size(&self) -> [f64; 2] {
        let Some(first) = self.maps.first() else { return [400.0, 100.0] };
        [FIELD[0] * count(&first.x) + 100.0, FIELD[1] * count(&first.y) + 86.0]
    }

    pub(super) fn size(&self) -> [f64; 2] {
        let [w, h] = self.map_size();
        let rows = self.maps.len().div_ceil(self.columns.max(1)) as f64;
        let least = width(&self.title, TITLE) + 24.0;
        [(w * self.columns as f64).max(760.0).max(least), HEAD + h * rows]
    }

    pub(super) fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        let sheet = Sheet(area);
        sheet.text(&self.title, [12.0, 20.0], TITLE, Anchor::Left, INK)?;
        self.draw_legend(&sheet)?;
        let [w, h] = self.map_size();
        for (i, map) in self.maps.iter().enumerate() {
            let (column, row) = (i % self.columns, i / self.columns);
            let corner = [w * column as f64, HEAD + h * row as f64];
            map.draw(&super::part(area, corner, [w, h]), [w, h])?;
        }
        Ok(())
    }

    fn draw_legend<DB: Canvas>(&self, sheet: &Sheet<'_, DB>) -> Drawn<DB> {
        let (mut x, y) = (12.0, 62.0);
        for (mark, name) in &self.marks {
            sheet.rectangle([x, y - 10.0], [20.0, 20.0], GREY)?;
            mark.draw(sheet, [x + 10.0, y], PAPER)?;
            sheet.text(name, [x + 26.0, y], MARK, Anchor::Left, INK)?;
            x += 46.0 + width(name, MARK);
        }
        let bar = ColourBar { title: &self.scale, scale: COOL, marks: self.scale_marks.clone() };
        let left = (self.size()[0] - BAR_FROM_RIGHT).max(x + 10.0);
        bar.draw(sheet, [left, y - 6.0], [BAR, 12.0], MARK)
    }
}

impl HeatMap {
    fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>, size: [f64; 2]) -> Drawn<DB> {
        let sheet = Sheet(area);
        let plot = Plot::new(&self.x, &self.y, size, Margin { top: 34.0, right: 14.0, left: 0.0 });
        sheet.text(&self.title, [plot.corner[0], 20.0], TITLE, Anchor::Left, INK)?;
        sheet.rectangle(plot.corner, plot.size, GRID)?;
        for field in &self.fields {
            field.draw(&sheet, &plot)?;
        }
        plot.axes(&mut plot.begin(area)?, Grid::None)
    }
}

impl Field {
    fn draw<DB: Canvas>(&self, sheet: &Sheet<'_, DB>, plot: &Plot) -> Drawn<DB> {
        let [column, row] = self.at.map(|i| i as f64);
        let (Some(a), Some(b)) = (plot.place([column, row + 1.0]), plot.place([column + 1.0, row])) else {
            return Ok(());
        };
        let size = [b[0] - a[0] - 2.0, b[1] - a[1] - 2.0];
        let colour = shade(COOL, self.share);
        let ink = ink_on(colour);
        sheet.rectangle([a[0] + 1.0, a[1] + 1.0], size, colour)?;
        let middle = a[1] + 0.5 * (b[1] - a[1]);
        self.mark.draw(sheet, [a[0] + 0.28 * size[0], middle], ink)?;
        sheet.text(&self.text, [a[0] + 0.48 * size[0], middle], MARK, Anchor::Left, ink)
    }
}

impl FieldMark {
    fn draw<DB: Canvas>(self, sheet: &Sheet<'_, DB>, [x, y]: [f64; 2], colour: Colour) -> Drawn<DB> {
        match self {
            FieldMark::Dot => sheet.dot([x, y], 5.5, colour),
            FieldMark::Ring => sheet.ring([x, y], 5.0, 2.2, colour),
            FieldMark::Cross => {
                sheet.line(&[[x - 5.0, y - 5.0], [x + 5.0, y + 5.0]], 2.8, colour)?;
                sheet.line(&[[x - 5.0, y + 5.0], [x + 5.0, y - 5.0]], 2.8, colour)
            }
        }
    }
}
