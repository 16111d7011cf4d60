//! The picture of a flow: a vertical slice with the canopy.

use std::path::PathBuf;

use coupling::error::RunError;
use mesh::vtk::read::Piece;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::legend::{Legend, Range};
use super::raster::{Position, Raster};
use super::slice::{NodeSpeeds, Patch, Plane};
use super::view::{DARK, bounds};
use crate::colour::{COOL, INK, PAPER, Rgb};
use crate::pixels::Image;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet, fine, pen};
use crate::snapshots::{RunSnapshots, field};

const WHITE: Rgb = [1.0; 3];
/// Height of the strip below the slice, em.
pub(super) const BELOW: f64 = 4.25;

/// A part of the slice: lower left and upper right corner, m.
pub(super) type Window = [[f64; 2]; 2];

/// A slice of the flow and its visible part.
pub(super) struct Flow {
    patches: Vec<Patch>,
    canopy: Vec<[[f64; 2]; 2]>,
    window: Window,
}

/// How a cut is drawn.
pub(super) struct Look<'a> {
    pub(super) caption: &'a str,
    /// Pixels.
    pub(super) width: u32,
    /// Em of the text, pixels.
    pub(super) text: f64,
    /// Speed at the upper end of the colour bar, m/s.
    pub(super) fastest: f64,
    /// Arrows across.
    pub(super) arrows: u32,
    /// Marks at the left edge with their heights in the cut, m.
    pub(super) marks: &'a [(f64, String)],
}

/// Colours of the cut up to a speed, m/s.
fn legend(fastest: f64) -> Legend {
    Legend {
        title: "speed relative to the canopy, m/s".into(),
        scale: COOL,
        range: Range { low: 0.0, high: fastest.max(1e-9) },
    }
}

impl Flow {
    /// Slices a snapshot of the flow, given as several files. Shows `window`, else the surroundings of the canopy, or the
    /// whole slice without a canopy.
    pub(super) fn read(
        results: &RunSnapshots,
        files: &[PathBuf],
        canopy: Option<Piece>,
        diagonal: bool,
        window: Option<Window>,
    ) -> Result<Self, RunError> {
        let pieces = files.iter().map(|f| results.piece(f)).collect::<Result<Vec<_>, _>>()?;
        // A few canopy widths around the canopy, or everything where there is none.
        let around = match &canopy {
            Some(canopy) => bounds(canopy.points.iter().copied()),
            None => bounds(pieces.iter().flat_map(|p| p.points.iter().copied())),
        };
        let [low, high] = around;
        let size = (high[0] - low[0]).max(high[1] - low[1]);
        let plane = Plane::new(diagonal, size);
        let fields = pieces.iter().zip(files).map(|(piece, file)| {
            let velocity = field(piece, "velocity_frame_m_s", 3, file)?;
            Ok((piece, &velocity.values[..]))
        });
        let fields = fields.collect::<Result<Vec<_>, RunError>>()?;
        let nodes = NodeSpeeds::new(plane, &fields, canopy.as_ref());
        let mut patches: Vec<Patch> =
            fields.iter().flat_map(|(piece, velocity)| plane.patches(piece, velocity, &nodes)).collect();
        let middle = plane.flat([0, 1, 2].map(|c| 0.5 * (low[c] + high[c])));
        let window = if let Some(window) = window {
            window
        } else if canopy.is_some() {
            [
                [middle[0] - 1.75 * size, low[2] - 0.95 * size],
                [middle[0] + 1.75 * size, high[2] + 1.25 * size],
            ]
        } else {
            let ends = patches.iter().flat_map(|p| &p.outline).map(|p| [p[0], 0.0, p[1]]);
            bounds(ends).map(|p| [p[0], p[2]])
        };
        let canopy = canopy.map(|c| plane.lines(&c)).unwrap_or_default();
        // A large cell may cover a corner of the window and have none of its own in it.
        patches.retain(|patch| {
            let [low, high] = bounds(patch.outline.iter().map(|p| [p[0], 0.0, p[1]]));
            low[0] < window[1][0] && high[0] > window[0][0] && low[2] < window[1][1] && high[2] > window[0][1]
        });
        if patches.is_empty() {
            return Err(RunError::Input(
                "the slice intersects no cell of the flow. Choose the other plane (with or without --diagonal)".into(),
            ));
        }
        Ok(Self { patches, canopy, window })
    }

    /// The slice through a canopy without a flow.
    pub(super) fn none(canopy: &Piece, diagonal: bool, window: Window) -> Self {
        let canopy = Plane::new(diagonal, window[1][0] - window[0][0]).lines(canopy);
        Self { patches: Vec::new(), canopy, window }
    }

    /// The slice coloured by speed, `width` pixels wide.
    pub(super) fn picture(&self, caption: &str, width: u32) -> Image {
        let text = 0.02 * f64::from(width);
        self.draw(&Look { caption, width, text, fastest: self.fastest(), arrows: 36, marks: &[] })
    }

    /// Speed that hardly any cell exceeds, m/s.
    pub(super) fn fastest(&self) -> f64 {
        Range::of(self.patches.iter().map(|p| p.speed), 0.002).high
    }

    /// The cut as `look` says.
    pub(super) fn draw(&self, look: &Look<'_>) -> Image {
        let w = f64::from(look.width);
        let [low, high] = self.window;
        let scale = w / (high[0] - low[0]).max(1e-9);
        let field_height = (scale * (high[1] - low[1])).clamp(0.2 * w, 2.0 * w).round();
        let mut raster = Raster::new(look.width, (field_height + BELOW * look.text) as u32);
        let place = |p: [f64; 2]| -> Position { [scale * (p[0] - low[0]), scale * (high[1] - p[1]), 0.0] };
        let legend = legend(look.fastest);
        for patch in &self.patches {
            let middle = patch.middle();
            let n = patch.outline.len();
            for (i, j) in (0..n).map(|i| (i, (i + 1) % n)) {
                let corners = [middle.0, patch.outline[i], patch.outline[j]].map(place);
                let colours = [middle.1, patch.speeds[i], patch.speeds[j]].map(|s| legend.colour(s));
                raster.triangle(corners, colours);
            }
        }
        let pen = (0.004 * w).max(1.5);
        for (colour, pen) in [(WHITE, 1.9 * pen), (DARK, pen)] {
            for line in &self.canopy {
                raster.line(line.map(place), pen, colour);
            }
        }
        let mut samples = raster.finish();
        let drawn = self.write_on(&samples.area(), place, field_height, look);
        drawn.expect(super::IN_MEMORY);
        samples.average()
    }

    /// Draws arrows, colour bar and caption.
    fn write_on<DB: Canvas>(
        &self,
        area: &DrawingArea<DB, Shift>,
        place: impl Fn([f64; 2]) -> Position,
        h: f64,
        look: &Look<'_>,
    ) -> Drawn<DB> {
        let (w, text) = (f64::from(look.width), look.text);
        let style = PAPER.mix(0.75).stroke_width(pen((0.0011 * w).max(0.8)));
        for arrow in self.arrows(&place, look) {
            let points: Vec<(i32, i32)> = arrow.iter().map(|p| (fine(p[0]), fine(p[1]))).collect();
            area.draw(&PathElement::new(points, style))?;
        }
        let sheet = Sheet(area);
        for (height, label) in look.marks {
            let [_, y, _] = place([self.window[0][0], *height]);
            if (2.4 * text..h - text).contains(&y) {
                sheet.line(&[[0.0, y], [0.6 * text, y]], 0.12 * text, PAPER)?;
                sheet.text(label, [0.9 * text, y], 0.85 * text, Anchor::Left, PAPER)?;
            }
        }
        if !look.marks.is_empty() {
            sheet.text("height, m", [0.6 * text, 1.1 * text], 0.85 * text, Anchor::Left, PAPER)?;
        }
        sheet.rectangle([0.0, h], [w, BELOW * text], PAPER)?;
        legend(look.fastest).draw(&sheet, [1.5 * text, h + 1.7 * text], [0.42 * w, 0.9 * text], text)?;
        sheet.text(look.caption, [w - 1.5 * text, h + 2.15 * text], text, Anchor::Right, INK)
    }

    /// Arrows of the in-plane velocity on a regular lattice, with the length of the spacing at the largest speed. Each
    /// arrow is a polyline through its tail, tip and head.
    fn arrows(&self, place: impl Fn([f64; 2]) -> Position, look: &Look<'_>) -> Vec<Vec<[f64; 2]>> {
        let [low, high] = self.window;
        let (columns, fastest) = (look.arrows, look.fastest);
        let spacing = (high[0] - low[0]) / f64::from(columns);
        let rows = ((high[1] - low[1]) / spacing) as usize;
        let mut arrows = Vec::new();
        for i in 0..columns as usize * rows {
            let (row, column) = (i / columns as usize, i % columns as usize);
            let at = [low[0] + (column as f64 + 0.5) * spacing, low[1] + (row as f64 + 0.5) * spacing];
            // The first columns belong to the marks and their title.
            let labels = if row + 1 == rows { 4 } else { 2 };
            if column < labels && !look.marks.is_empty() {
                continue;
            }
            let Some(patch) = self.patches.iter().find(|p| p.contains(at)) else { continue };
            let v = patch.velocity.map(|v| 0.85 * spacing * v / fastest.max(1e-9));
            if v[0].hypot(v[1]) < 0.06 * spacing {
                continue;
            }
            let end = |side: f64| place([at[0] + side * 0.5 * v[0], at[1] + side * 0.5 * v[1]]);
            let ([x0, y0, _], [x1, y1, _]) = (end(-1.0), end(1.0));
            let along = [x1 - x0, y1 - y0];
            let wing = |side: f64| {
                [x1 - 0.3 * along[0] - side * 0.18 * along[1], y1 - 0.3 * along[1] + side * 0.18 * along[0]]
            };
            arrows.push(vec![[x0, y0], [x1, y1]]);
            arrows.push(vec![wing(1.0), [x1, y1], wing(-1.0)]);
        }
        arrows
    }
}
