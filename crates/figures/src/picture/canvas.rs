//! A few shapes, drawn as SVG or as pixels by the same calls.

use std::fmt::Write;
use std::path::Path;

use coupling::error::RunError;
use tiny_skia::{PathBuilder, Pixmap, Rect, Stroke, Transform};

use super::colour::{COOL, PAPER, pick};
use super::raster::Rgb;
use super::text;

/// Colour of a value from 0 to 1.
pub fn shade(t: f64) -> Rgb {
    pick(COOL, t)
}

/// What can be drawn on. Lengths are pixels, y runs down.
pub trait Canvas {
    /// A filled rectangle from its upper left corner.
    fn rect(&mut self, from: [f32; 2], size: [f32; 2], fill: Rgb);
    /// A line.
    fn line(&mut self, from: [f32; 2], to: [f32; 2], width: f32, colour: Rgb);
    /// A circle, filled or as a line of this width.
    fn circle(&mut self, centre: [f32; 2], radius: f32, line: Option<f32>, colour: Rgb);
    /// A label; `anchor` 0 puts its left end at `at` (on the baseline), 0.5 its middle.
    fn label(&mut self, text: &str, at: [f32; 2], size: f32, anchor: f32, colour: Rgb);
}

/// An SVG file in the making.
pub struct Svg {
    size: [u32; 2],
    body: String,
}

impl Svg {
    /// An empty one, `size` pixels wide and high.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, body: String::new() }
    }

    /// Writes the file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save(self, path: &Path) -> Result<(), RunError> {
        let [w, h] = self.size;
        let text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">\n\
             <rect width=\"{w}\" height=\"{h}\" fill=\"white\"/>\n{}</svg>\n",
            self.body
        );
        std::fs::write(path, text).map_err(RunError::file("write", path))
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = writeln!(self.body, "{element}");
    }
}

fn hex(colour: Rgb) -> String {
    let [r, g, b] = colour.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

impl Canvas for Svg {
    fn rect(&mut self, [x, y]: [f32; 2], [w, h]: [f32; 2], fill: Rgb) {
        let fill = hex(fill);
        self.push(format_args!("<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"{fill}\"/>"));
    }

    fn line(&mut self, a: [f32; 2], b: [f32; 2], width: f32, colour: Rgb) {
        let stroke = hex(colour);
        self.push(format_args!(
            "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{stroke}\" stroke-width=\"{width}\"/>",
            a[0], a[1], b[0], b[1]
        ));
    }

    fn circle(&mut self, [x, y]: [f32; 2], radius: f32, line: Option<f32>, colour: Rgb) {
        let colour = hex(colour);
        let style = match line {
            None => format!("fill=\"{colour}\""),
            Some(width) => format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\""),
        };
        self.push(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" {style}/>"));
    }

    fn label(&mut self, text: &str, [x, y]: [f32; 2], size: f32, anchor: f32, colour: Rgb) {
        let (fill, size) = (hex(colour), 1.4 * size);
        let anchor = if anchor == 0.0 {
            "start"
        } else if anchor == 1.0 {
            "end"
        } else {
            "middle"
        };
        let text = text.replace('&', "&amp;").replace('<', "&lt;");
        self.push(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-family=\"sans-serif\" font-size=\"{size:.1}\" \
             text-anchor=\"{anchor}\" fill=\"{fill}\">{text}</text>"
        ));
    }
}

/// Pixels, to be written as PNG.
pub struct Pixels(Pixmap);

impl Pixels {
    /// Of a size above zero.
    pub fn new([w, h]: [u32; 2]) -> Self {
        let mut pixmap = Pixmap::new(w.max(1), h.max(1)).expect("a size above zero and far below the limits");
        let [r, g, b] = PAPER.map(|c| (c * 255.0) as u8);
        pixmap.fill(tiny_skia::Color::from_rgba8(r, g, b, 255));
        Self(pixmap)
    }

    /// Writes the file, as PNG.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), RunError> {
        let bytes = super::png(&self.0).map_err(|e| RunError::File {
            action: "write",
            path: path.into(),
            source: std::io::Error::other(e),
        })?;
        std::fs::write(path, bytes).map_err(RunError::file("write", path))
    }

    fn stroke(&mut self, pen: PathBuilder, width: f32, colour: Rgb) {
        if let Some(path) = pen.finish() {
            let stroke = Stroke { width, ..Stroke::default() };
            self.0.stroke_path(&path, &text::paint(colour), &stroke, Transform::identity(), None);
        }
    }
}

impl Canvas for Pixels {
    fn rect(&mut self, [x, y]: [f32; 2], [w, h]: [f32; 2], fill: Rgb) {
        if let Some(rect) = Rect::from_xywh(x, y, w, h) {
            self.0.fill_rect(rect, &text::paint(fill), Transform::identity(), None);
        }
    }

    fn line(&mut self, a: [f32; 2], b: [f32; 2], width: f32, colour: Rgb) {
        let mut pen = PathBuilder::new();
        pen.move_to(a[0], a[1]);
        pen.line_to(b[0], b[1]);
        self.stroke(pen, width, colour);
    }

    fn circle(&mut self, [x, y]: [f32; 2], radius: f32, line: Option<f32>, colour: Rgb) {
        let mut pen = PathBuilder::new();
        pen.push_circle(x, y, radius);
        match line {
            Some(width) => self.stroke(pen, width, colour),
            None => {
                if let Some(path) = pen.finish() {
                    let paint = text::paint(colour);
                    let rule = tiny_skia::FillRule::Winding;
                    self.0.fill_path(&path, &paint, rule, Transform::identity(), None);
                }
            }
        }
    }

    fn label(&mut self, label: &str, [x, y]: [f32; 2], size: f32, anchor: f32, colour: Rgb) {
        let left = x - anchor * text::width(label, size);
        text::write(&mut self.0, label, [left, y], size, colour);
    }
}
