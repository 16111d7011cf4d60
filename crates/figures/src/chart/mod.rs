//! Line charts, bar charts and heat maps with axes, legend and labels, as SVG (with selectable text) and PNG.
//!
//! A [`Figure`] describes the content. `plotters` draws it on the SVG or bitmap backend with the same code. The legend is
//! above the data, labels of references are next to the data, and every axis has a unit.

mod axis;
mod bars;
mod curves;
mod heat_map;
mod legend;
mod plot;
#[cfg(test)]
mod tests;

use std::path::Path;

use coupling::error::RunError;
use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, IntoDrawingArea, SVGBackend};

pub(crate) use self::axis::linear_marks;
pub use self::axis::{Axis, Division, short};
pub use self::bars::{Bar, Bars, Columns, Part};
pub use self::curves::{Mark, Panel, Reference, Series};
pub use self::heat_map::{Field, FieldMark, HeatMap, HeatMaps};
use self::legend::Legend;
use crate::colour::PAPER;
use crate::pixels::{FINE, Samples};
use crate::sheet::{Canvas, Drawn, Sheet, fine};

/// Width of a single figure, pixels.
pub const WIDTH: f64 = 960.0;

/// Panels in rows with a common legend.
#[derive(Clone, Debug)]
pub struct Panels {
    /// Panels, row by row.
    pub panels: Vec<Panel>,
    /// Number of panels per row.
    pub columns: usize,
    /// Width and height of each panel, pixels.
    pub size: [f64; 2],
}

/// A figure.
///
/// # Examples
///
/// A curve of the descent speed as SVG:
///
/// ```
/// use figures::chart::{Axis, Figure, Panel, Panels, Series};
/// use figures::colour;
///
/// let points: Vec<[f64; 2]> = (0..=20).map(|i| f64::from(i) * 0.1).map(|t| [t, 4.0 - t.exp2()]).collect();
/// let panel = Panel {
///     title: "Descent".into(),
///     x: Axis::spanning("time (s)", points.iter().map(|p| p[0])),
///     y: Axis::around("descent speed (m/s)", false, points.iter().map(|p| p[1])),
///     series: vec![Series::curve("computed", colour::series(0), points)],
///     band: None,
///     references: Vec::new(),
/// };
/// let figure = Figure::Panels(Panels::single(panel, [640.0, 320.0]));
/// let svg = figure.svg().file();
/// assert!(svg.starts_with("<svg") && svg.contains("descent speed (m/s)"));
/// assert_eq!(figure.size()[0], 640);
/// ```
#[derive(Clone, Debug)]
pub enum Figure {
    /// Curves and points.
    Panels(Panels),
    /// Stacked bars.
    Bars(Bars),
    /// Columns.
    Columns(Columns),
    /// Heat maps.
    HeatMaps(HeatMaps),
}

/// Tooltip of a part of an SVG.
pub(crate) struct Hover {
    /// Upper left corner, pixels.
    pub(crate) corner: [f64; 2],
    /// Width and height, pixels.
    pub(crate) size: [f64; 2],
    pub(crate) text: String,
}

/// Position of the data of a panel in an SVG, in SVG units.
#[derive(Clone, Copy, Debug)]
pub struct DataBox {
    /// Left, top, width, height.
    pub place: [f64; 4],
    /// Minimum and maximum x, minimum and maximum y.
    pub span: [f64; 4],
    /// SVG units per pixel.
    pub pixel: f64,
}

impl Panels {
    /// A figure of one panel.
    pub fn single(panel: Panel, size: [f64; 2]) -> Self {
        Self { panels: vec![panel], columns: 1, size }
    }

    fn legend(&self) -> Legend {
        let columns = self.columns.min(self.panels.len()).max(1);
        let width = self.size[0] * columns as f64;
        let left = self.sides()[0].max(12.0);
        Legend::new(self.panels.iter().flat_map(Panel::legend), [left, width - 12.0])
    }

    fn whole(&self) -> [f64; 2] {
        let columns = self.columns.min(self.panels.len()).max(1);
        let rows = self.panels.len().div_ceil(columns).max(1);
        [self.size[0] * columns as f64, self.legend().height + self.size[1] * rows as f64]
    }

    fn corner(&self, panel: usize) -> [f64; 2] {
        let (column, row) = (panel % self.columns.max(1), panel / self.columns.max(1));
        [self.size[0] * column as f64, self.legend().height + self.size[1] * row as f64]
    }

    /// Common left and right margins of the data, so that the axes of all panels are aligned.
    fn sides(&self) -> [f64; 2] {
        let alone = self.panels.iter().map(|p| p.plot(self.size, [0.0; 2]));
        alone.fold([0.0; 2], |[left, right], plot| {
            let beside = self.size[0] - plot.corner[0] - plot.size[0];
            [f64::max(left, plot.corner[0]), f64::max(right, beside)]
        })
    }

    /// Position of the data of a panel.
    pub fn data_box(&self, panel: usize) -> Option<DataBox> {
        let drawn = self.panels.get(panel)?;
        let plot = drawn.plot(self.size, self.sides());
        let corner = self.corner(panel);
        let pixel = f64::from(FINE);
        let [left, top] = [0, 1].map(|c| pixel * (corner[c] + plot.corner[c]));
        let [width, height] = plot.size.map(|s| pixel * s);
        let ([x0, x1], [y0, y1]) = (drawn.x.range, drawn.y.range);
        Some(DataBox { place: [left, top, width, height], span: [x0, x1, y0, y1], pixel })
    }

    fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        self.legend().draw(&Sheet(area))?;
        let sides = self.sides();
        for (i, panel) in self.panels.iter().enumerate() {
            panel.draw(&part(area, self.corner(i), self.size), &panel.plot(self.size, sides))?;
        }
        Ok(())
    }
}

/// The part of an area from `corner`, pixels.
fn part<DB: Canvas>(
    area: &DrawingArea<DB, Shift>,
    [x, y]: [f64; 2],
    [w, h]: [f64; 2],
) -> DrawingArea<DB, Shift> {
    let (width, height) = area.dim_in_pixel();
    let right = width as i32 - fine(x + w);
    let bottom = height as i32 - fine(y + h);
    area.margin(fine(y), bottom.max(0), fine(x), right.max(0))
}

impl Figure {
    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        let size = match self {
            Self::Panels(panels) => panels.whole(),
            Self::Bars(bars) => bars.size(),
            Self::Columns(_) => Columns::SIZE,
            Self::HeatMaps(maps) => maps.size(),
        };
        size.map(|s| s.ceil() as u32)
    }

    fn draw<DB: Canvas>(&self, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        match self {
            Self::Panels(panels) => panels.draw(area),
            Self::Bars(bars) => bars.draw(area),
            Self::Columns(columns) => columns.draw(area),
            Self::HeatMaps(maps) => maps.draw(area),
        }?;
        area.present()
    }

    fn hovers(&self) -> Vec<Hover> {
        match self {
            Self::Bars(bars) => bars.hovers(),
            Self::Columns(columns) => columns.hovers(),
            Self::Panels(_) | Self::HeatMaps(_) => Vec::new(),
        }
    }

    /// The figure as SVG.
    pub fn svg(&self) -> Svg {
        let size = self.size();
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, (size[0] * FINE, size[1] * FINE)).into_drawing_area();
        self.draw(&area).expect("drawing in memory with an embedded font does not fail");
        drop(area);
        // The outer element is written by `Svg`.
        let inner = text.split_once('>').map_or("", |(_, rest)| rest).trim().trim_end_matches("</svg>");
        let mut body = inner.to_owned();
        for hover in self.hovers() {
            let ([x, y], [w, h]) = (hover.corner.map(fine), hover.size.map(fine));
            let text = escape(&hover.text);
            body += &format!(
                "<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill-opacity=\"0\"><title>{text}</title></rect>\n"
            );
        }
        Svg { size, body }
    }

    /// The bytes of a PNG file.
    pub fn png(&self) -> Vec<u8> {
        let mut samples = Samples::new(self.size(), PAPER);
        self.draw(&samples.area()).expect("drawing in memory with an embedded font does not fail");
        samples.average().png()
    }

    /// Writes `<name>.svg` and `<name>.png` to `folder` and returns the SVG.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn save(&self, folder: &Path, name: &str) -> Result<Svg, RunError> {
        let svg = self.svg();
        svg.save(&folder.join(format!("{name}.svg")))?;
        let path = folder.join(format!("{name}.png"));
        std::fs::write(&path, self.png()).map_err(RunError::file("write", &path))?;
        Ok(svg)
    }
}

/// Escapes a text for XML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// An SVG drawing.
#[derive(Clone, Debug)]
pub struct Svg {
    size: [u32; 2],
    body: String,
}

impl Svg {
    /// Content of an SVG file with white background.
    pub fn file(&self) -> String {
        self.wrapped(&[], "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n", "")
    }

    /// The SVG element of a page, without background, with `attributes` and further elements `more` at its end.
    pub fn element(&self, attributes: &[(&str, &str)], more: &str) -> String {
        self.wrapped(attributes, "", more)
    }

    fn wrapped(&self, attributes: &[(&str, &str)], before: &str, after: &str) -> String {
        let [w, h] = self.size;
        let named: String =
            attributes.iter().map(|(name, value)| format!(" {name}=\"{}\"", escape(value))).collect();
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {} {}\"{named}>\n\
             {before}{}{after}</svg>\n",
            w * FINE,
            h * FINE,
            self.body
        )
    }

    /// Writes [`Svg::file`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), RunError> {
        std::fs::write(path, self.file()).map_err(RunError::file("write", path))
    }
}
