//! Text and simple shapes on a plotters area, in pixels of the finished figure.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::colour::Colour;
use crate::font::font;
use crate::pixels::FINE;

/// A backend that figures are drawn on.
pub(crate) trait Canvas: DrawingBackend {
    /// How much lower a text must be asked for to stand on the middle of its height, in ems.
    const DROP: f64;
}

impl Canvas for SVGBackend<'_> {
    const DROP: f64 = 0.0;
}

impl Canvas for BitMapBackend<'_> {
    // It sets the baseline an eighth of the em below the middle; a third is where capitals and figures need it.
    const DROP: f64 = 0.2;
}

/// What drawing returns.
pub(crate) type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// Where a text has its given point: which end, on the middle of its height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Left,
    Middle,
    Right,
}

/// Units of an area for a length in pixels.
pub(crate) fn fine(pixels: f64) -> i32 {
    (pixels * f64::from(FINE)).round() as i32
}

/// Units of an area for the width of a line in pixels; at least one.
pub(crate) fn pen(pixels: f64) -> u32 {
    fine(pixels).max(1) as u32
}

/// A style of text whose em is `size` pixels.
pub(crate) fn text_style(size: f64, colour: Colour) -> TextStyle<'static> {
    font(size * f64::from(FINE)).color(&colour)
}

/// An area with lengths in pixels; y runs down.
pub(crate) struct Sheet<'a, DB: Canvas>(pub(crate) &'a DrawingArea<DB, Shift>);

impl<DB: Canvas> Sheet<'_, DB> {
    /// A text in one line; its point lies on the middle of its height.
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

    /// A filled rectangle from its upper left corner.
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

    /// A circle as a line.
    pub(crate) fn ring(&self, [x, y]: [f64; 2], radius: f64, width: f64, colour: Colour) -> Drawn<DB> {
        self.0.draw(&Circle::new((fine(x), fine(y)), pen(radius), colour.stroke_width(pen(width))))
    }
}
