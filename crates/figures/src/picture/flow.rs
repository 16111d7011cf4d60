//! The picture of a flow: a vertical slice with the canopy.

use std::path::PathBuf;

use coupling::error::RunError;
use mesh::vtk::read::Piece;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::legend::{Legend, Range};
use super::raster::{Place, Raster};
use super::slice::{Patch, Plane};
use super::view::{DARK, bounds};
use crate::colour::{COOL, INK, PAPER, Rgb};
use crate::pixels::Image;
use crate::sheet::{Anchor, Canvas, Drawn, Sheet, fine, pen};
use crate::snapshots::{RunSnapshots, field};

const WHITE: Rgb = [1.0; 3];
/// Height of the strip below the slice, relative to the width.
const BELOW: f64 = 0.085;

/// A slice of the flow and its visible part.
pub(super) struct Flow {
    patches: Vec<Patch>,
    canopy: Vec<[[f64; 2]; 2]>,
    /// Lower left and upper right corner, m.
    window: [[f64; 2]; 2],
}

impl Flow {
    /// Slices a snapshot of the flow, given as several files, around a canopy, or as a whole without one.
    pub(super) fn read(
        results: &RunSnapshots,
        files: &[PathBuf],
        canopy: Option<Piece>,
        diagonal: bool,
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
        let mut patches = Vec::new();
        for (piece, file) in pieces.iter().zip(files) {
            let velocity = field(piece, "velocity_frame_m_s", 3, file)?;
            patches.extend(plane.patches(piece, &velocity.values));
        }
        let middle = plane.flat([0, 1, 2].map(|c| 0.5 * (low[c] + high[c])));
        let window = if canopy.is_some() {
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

    /// The slice coloured by speed, `width` pixels wide.
    pub(super) fn picture(&self, caption: &str, width: u32) -> Image {
        let w = f64::from(width);
        let [low, high] = self.window;
        let scale = w / (high[0] - low[0]).max(1e-9);
        let field_height = (scale * (high[1] - low[1])).clamp(0.2 * w, 2.0 * w).round();
        let mut raster = Raster::new(width, (field_height + BELOW * w) as u32);
        let place = |p: [f64; 2]| -> Place { [scale * (p[0] - low[0]), scale * (high[1] - p[1]), 0.0] };
        let fastest = Range::of(self.patches.iter().map(|p| p.speed), 0.002).high;
        let legend = Legend {
            title: "speed relative to the canopy, m/s".into(),
            scale: COOL,
            range: Range { low: 0.0, high: fastest.max(1e-9) },
        };
        for patch in &self.patches {
            let corners: Vec<Place> = patch.outline.iter().map(|&p| place(p)).collect();
            raster.polygon(&corners, legend.colour(patch.speed));
        }
        let pen = (0.004 * w).max(1.5);
        for (colour, pen) in [(WHITE, 1.9 * pen), (DARK, pen)] {
            for line in &self.canopy {
                raster.line(line.map(place), pen, colour);
            }
        }
        let mut samples = raster.finish();
        let drawn = self.write_on(&samples.area(), place, (caption, w, field_height), &legend);
        drawn.expect(super::IN_MEMORY);
        samples.average()
    }

    /// Draws arrows, colour bar and caption.
    fn write_on<DB: Canvas>(
        &self,
        area: &DrawingArea<DB, Shift>,
        place: impl Fn([f64; 2]) -> Place,
        (caption, w, h): (&str, f64, f64),
        legend: &Legend,
    ) -> Drawn<DB> {
        let style = PAPER.mix(0.75).stroke_width(pen((0.0011 * w).max(0.8)));
        for arrow in self.arrows(place, legend.range.high) {
            let points: Vec<(i32, i32)> = arrow.iter().map(|p| (fine(p[0]), fine(p[1]))).collect();
            area.draw(&PathElement::new(points, style))?;
        }
        let sheet = Sheet(area);
        sheet.rectangle([0.0, h], [w, BELOW * w], PAPER)?;
        let text = 0.02 * w;
        legend.draw(&sheet, [0.03 * w, h + 0.034 * w], [0.42 * w, 0.018 * w], text)?;
        sheet.text(caption, [0.97 * w, h + 0.043 * w], text, Anchor::Right, INK)
    }

    /// Arrows of the in-plane velocity on a regular lattice, with the length of the spacing at `fastest`. Each arrow is a
    /// polyline through its tail, tip and head.
    fn arrows(&self, place: impl Fn([f64; 2]) -> Place, fastest: f64) -> Vec<Vec<[f64; 2]>> {
        let [low, high] = self.window;
        let columns = 36;
        let spacing = (high[0] - low[0]) / f64::from(columns);
        let rows = ((high[1] - low[1]) / spacing) as usize;
        let mut arrows = Vec::new();
        for i in 0..columns as usize * rows {
            let (row, column) = (i / columns as usize, i % columns as usize);
            let at = [low[0] + (column as f64 + 0.5) * spacing, low[1] + (row as f64 + 0.5) * spacing];
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
