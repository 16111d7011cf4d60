//! Text and simple shapes on a plotters area, in pixels of the final figure.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::colour::Colour;
use crate::font::font;
use crate::pixels::FINE;

/// A drawing backend of figures.
pub(crate) trait Canvas: DrawingBackend {
    /// Vertical offset that centres a text, in units of the font size.
    const DROP: f64;
}

impl Canvas for SVGBackend<'_> {
    const DROP: f64 = 0.0;
}

impl Canvas for BitMapBackend<'_> {
    // SVG sets the baseline 1/8 of the font size below the middle; capitals and digits need 1/3.
    const DROP: f64 = 0.2;
}

/// Result of drawing.
pub(crate) type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// Anchor of a text: left, centre or right end, at the middle of its height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Left,
    Middle,
    Right,
}

/// Converts a length in pixels to units of the area.
pub(crate) fn fine(pixels: f64) -> i32 {
    (pixels * f64::from(FINE)).round() as i32
}

/// Converts a line width in pixels to units of the area, at least one.
pub(crate) fn pen(pixels: f64) -> u32 {
    fine(pixels).max(1) as u32
}

/// A text style of font size `size`, pixels.
pub(crate) fn text_style(size: f64, colour: Colour) -> TextStyle<'static> {
    font(size * f64::from(FINE)).color(&colour)
}

/// A drawing area with lengths in pixels; y points down.
pub(crate) struct Sheet<'a, DB: Canvas>(pub(crate) &'a DrawingArea<DB, Shift>);

impl<DB: Canvas> Sheet<'_, DB> {
    /// A single-line text, vertically centred at its point.
    pub(crate) fn text(
        &self,
        text: &str,
        [x, y]: [f64; 2],
        size: f64,
        anchor: Anchor,
        colour: Colour,
    ) -> Drawn<DB> {
        let h = match anchor {
            Anchor::Left => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::Right => HPos::Right,
        };
        let style = text_style(size, colour).pos(Pos::new(h, VPos::Center));
        self.0.draw_text(text, &style, (fine(x), fine(y + DB::DROP * size)))
    }

    /// A filled rectangle with this upper left corner and size.
    pub(crate) fn rectangle(&self, [x, y]: [f64; 2], [w, h]: [f64; 2], colour: Colour) -> Drawn<DB> {
        let corners = [(fine(x), fine(y)), (fine(x + w), fine(y + h))];
        self.0.draw(&Rectangle::new(corners, colour.filled()))
    }

    /// A line through points.
    pub(crate) fn line(&self, points: &[[f64; 2]], width: f64, colour: Colour) -> Drawn<DB> {
        let points: Vec<(i32, i32)> = points.iter().map(|p| (fine(p[0]), fine(p[1]))).collect();
        self.0.draw(&PathElement::new(points, colour.stroke_width(pen(width))))
    }

    /// A filled circle.
    pub(crate) fn dot(&self, [x, y]: [f64; 2], radius: f64, colour: Colour) -> Drawn<DB> {
        self.0.draw(&Circle::new((fine(x), fine(y)), pen(radius), colour.filled()))
    }

    /// A circle outline.
    pub(crate) fn ring(&self, [x, y]: [f64; 2], radius: f64, width: f64, colour: Colour) -> Drawn<DB> {
        self.0.draw(&Circle::new((fine(x), fine(y)), pen(radius), colour.stroke_width(pen(width))))
    }
}
