//! The data area of a chart with its axes.

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::prelude::*;

use super::axis::{Axis, Coordinate};
use crate::colour::{GREY, GRID, INK};
use crate::font::width;
use crate::sheet::{Canvas, Drawn, fine, pen, text_style};

/// Font sizes of tick labels, axis labels and titles, pixels.
pub(super) const MARK: f64 = 11.5;
pub(super) const LABEL: f64 = 12.5;
pub(super) const TITLE: f64 = 14.0;

/// Space left of an axis label, pixels.
const EDGE: f64 = 4.0;

/// A plotters chart over two axes.
pub(super) type OnAxes<'a, DB> = ChartContext<'a, DB, Cartesian2d<Coordinate, Coordinate>>;

/// Additional margins of a plot, pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Margin {
    pub(super) top: f64,
    pub(super) right: f64,
    /// Minimum left margin of the data, for aligned plots.
    pub(super) left: f64,
}

/// Grid lines to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Grid {
    Both,
    /// At the ticks of x.
    Upright,
    /// At the ticks of y.
    Level,
    None,
}

/// A plot in an area. Lengths are pixels, relative to the area.
pub(super) struct Plot {
    area: [f64; 2],
    /// Upper left corner of the data.
    pub(super) corner: [f64; 2],
    /// Width and height of the data.
    pub(super) size: [f64; 2],
    x: Coordinate,
    y: Coordinate,
    labels: [String; 2],
}

impl Plot {
    /// Fits a plot with two axes and their labels into an area.
    pub(super) fn new(x: &Axis, y: &Axis, area: [f64; 2], margin: Margin) -> Self {
        let bottom = 22.0 + if x.label.is_empty() { 0.0 } else { 20.0 };
        let height = (area[1] - margin.top - bottom).max(10.0);
        let up =
            Coordinate::new(y, if matches_categories(y) { usize::MAX } else { (height / 40.0) as usize });
        let widest = up.labels().map(|l| width(l, MARK)).fold(0.0, f64::max);
        let left = (widest + 16.0 + if y.label.is_empty() { 0.0 } else { 22.0 }).max(margin.left);
        let across = (area[0] - left - margin.right).max(10.0);
        let most = |widest: f64| (across / (widest + 12.0)) as usize;
        let mut along = Coordinate::new(x, ((across / 75.0) as usize).min(10));
        if matches_categories(x) {
            let all = Coordinate::new(x, usize::MAX);
            along = Coordinate::new(x, most(all.labels().map(|l| width(l, MARK)).fold(0.0, f64::max)));
        }
        Self {
            area,
            corner: [left, margin.top],
            size: [across, height],
            x: along,
            y: up,
            labels: [x.label.clone(), y.label.clone()],
        }
    }

    /// Position of a pair of values, pixels; `None` if an axis cannot show it.
    pub(super) fn place(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let x = self.x.share(x)?.clamp(-0.02, 1.02);
        let y = self.y.share(y)?.clamp(-0.02, 1.02);
        Some([self.corner[0] + x * self.size[0], self.corner[1] + (1.0 - y) * self.size[1]])
    }

    /// Creates the chart without drawing.
    pub(super) fn begin<'a, DB: Canvas>(
        &self,
        area: &DrawingArea<DB, Shift>,
    ) -> Result<OnAxes<'a, DB>, DrawingAreaErrorKind<DB::ErrorType>> {
        let [w, h] = self.area;
        let right = w - self.corner[0] - self.size[0];
        let bottom = h - self.corner[1] - self.size[1];
        ChartBuilder::on(area)
            .margin_top(fine(self.corner[1]))
            .margin_left(fine(EDGE))
            .margin_right(fine(right))
            .x_label_area_size(fine(bottom))
            .y_label_area_size(fine(self.corner[0] - EDGE))
            .build_cartesian_2d(self.x.clone(), self.y.clone())
    }

    /// Draws grid, axes, ticks and labels.
    pub(super) fn axes<DB: Canvas>(&self, chart: &mut OnAxes<'_, DB>, grid: Grid) -> Drawn<DB> {
        let mut mesh = chart.configure_mesh();
        mesh.bold_line_style(GRID.stroke_width(pen(1.0)))
            .max_light_lines(0)
            .light_line_style(TRANSPARENT)
            .axis_style(GREY.stroke_width(pen(1.0)))
            .label_style(text_style(MARK, INK))
            .axis_desc_style(text_style(LABEL, INK))
            .set_all_tick_mark_size(fine(3.0))
            .y_label_offset(fine(DB::DROP * MARK))
            .x_desc(self.labels[0].clone())
            .y_desc(self.labels[1].clone());
        if matches!(grid, Grid::Level | Grid::None) {
            mesh.disable_x_mesh();
        }
        if matches!(grid, Grid::Upright | Grid::None) {
            mesh.disable_y_mesh();
        }
        mesh.draw()
    }
}

fn matches_categories(axis: &Axis) -> bool {
    matches!(axis.division, super::Division::Categories(_))
}
