//! The grid around a surface.

use nalgebra::Vector3;

use crate::axis::Axis;
use crate::grid::{End, Ends, Grid};

/// Sizes of a grid; lengths but the spacing in units of the largest extent of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Width of the even cells, m.
    pub spacing: f64,
    /// Even cells on all sides of the surface.
    pub room: f64,
    /// Even cells downstream of that.
    pub wake: f64,
    /// From there to the far field, upstream and to the sides.
    pub far_field: f64,
    /// The same, downstream.
    pub far_wake: f64,
    /// Largest ratio of the widths of neighbouring cells.
    pub growth: f64,
}

/// Cells between a surface and the end of the even ones, at least: those that [`crate::cut_faces`] needs, and two for its motion in a step.
const LEAST_ROOM: f64 = 6.0;
/// Cells across a surface below which it is narrow.
const NARROW: f64 = 8.0;
/// Share of the stream along an axis from which on its ends let the air through.
const ALONG: f64 = 0.2;

impl Placement {
    /// The grid around a surface between the corners `bounds` (m) in a stream of velocity `stream` (of any length).
    pub fn grid(&self, bounds: &[Vector3<f64>; 2], stream: Vector3<f64>) -> Grid {
        let size = (bounds[1] - bounds[0]).amax();
        let stream = stream.try_normalize(0.0).unwrap_or(Vector3::z());
        let axis = |d: usize| {
            let [behind, before] = [stream[d] < -ALONG, stream[d] > ALONG];
            let room = (self.room * size).max(LEAST_ROOM * self.spacing);
            let even = |downstream: bool| room + if downstream { self.wake * size } else { 0.0 };
            let far = |downstream: bool| size * if downstream { self.far_wake } else { self.far_field };
            let core = [bounds[0][d] - even(behind), bounds[1][d] + even(before)];
            // Across the stream the middle of a narrow surface lies on a face of cells, not in a cell: the stream would else pass through the column of
            // cells inside a gathered canopy that is narrower than a cell.
            let narrow = bounds[1][d] - bounds[0][d] < NARROW * self.spacing;
            let multiple = if narrow && !behind && !before { 2 } else { 1 };
            Axis::stretched(core, self.spacing, [far(behind), far(before)], self.growth, multiple)
        };
        let ends = |d: usize| {
            Ends::Open(match stream[d] {
                s if s > ALONG => [End::Inflow, End::Outflow],
                s if s < -ALONG => [End::Outflow, End::Inflow],
                _ => [End::Slip, End::Slip],
            })
        };
        Grid::new([0, 1, 2].map(axis), [0, 1, 2].map(ends))
    }
}

/// Whether no outflow of `grid` would be an inflow in a stream of this velocity (of any length).
pub fn lets_out(grid: &Grid, stream: Vector3<f64>) -> bool {
    let stream = stream.try_normalize(0.0).unwrap_or(Vector3::z());
    (0..3).all(|d| match grid.ends[d] {
        Ends::Open([End::Outflow, _]) => stream[d] <= ALONG,
        Ends::Open([_, End::Outflow]) => stream[d] >= -ALONG,
        _ => true,
    })
}

/// Least and largest coordinates of points, m.
pub fn bounds<'a>(points: impl IntoIterator<Item = &'a Vector3<f64>>) -> [Vector3<f64>; 2] {
    let empty = [Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)];
    points.into_iter().fold(empty, |[low, high], x| [low.inf(x), high.sup(x)])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: Placement =
        Placement { spacing: 0.1, room: 0.1, wake: 0.5, far_field: 4.0, far_wake: 8.0, growth: 1.2 };

    #[test]
    fn even_cells_cover_the_surface_its_room_and_its_wake() {
        let bounds = [Vector3::new(-1.0, -2.0, 0.0), Vector3::new(1.0, 2.0, 1.0)];
        for stream in [Vector3::z(), -Vector3::z(), Vector3::new(1.0, 0.0, 1.0)] {
            let grid = SIZES.grid(&bounds, stream);
            for d in 0..3 {
                let axis = &grid.axes[d];
                let core = [axis.faces[axis.core.start], axis.faces[axis.core.end]];
                let wake = |along: f64| if along > 0.2 { 2.0 } else { 0.0 };
                assert!(core[0] <= bounds[0][d] - 0.6 - wake(-stream[d]) + 1e-9, "{core:?}");
                assert!(core[1] >= bounds[1][d] + 0.6 + wake(stream[d]) - 1e-9, "{core:?}");
                assert!(core[1] - core[0] < 0.3 + bounds[1][d] - bounds[0][d] + 1.2 + wake(stream[d].abs()));
            }
        }
        let up = SIZES.grid(&bounds, Vector3::z());
        let top = *up.axes[2].faces.last().expect("faces");
        assert!((35.0..36.0).contains(&top), "{top}");
        assert_eq!(up.ends[2], Ends::Open([End::Inflow, End::Outflow]));
        assert_eq!(up.ends[0], Ends::Open([End::Slip, End::Slip]));
    }

    #[test]
    fn a_stream_that_has_turned_enters_through_an_outflow() {
        let bounds = [Vector3::new(-1.0, -2.0, 0.0), Vector3::new(1.0, 2.0, 1.0)];
        let grid = SIZES.grid(&bounds, Vector3::new(1.0, 0.0, 2.0));
        for (stream, out) in [([1.0, 0.0, 2.0], true), ([-0.2, 9.0, 2.0], true), ([-1.0, 0.0, 2.0], false)] {
            assert_eq!(lets_out(&grid, stream.into()), out, "{stream:?}");
        }
        assert!(!lets_out(&grid, -Vector3::z()));
    }

    /// Of widths from one to seven cells, the least number of cells would be odd for three.
    #[test]
    fn the_middle_of_a_narrow_surface_lies_on_a_face() {
        for width in (1..8).map(|n| 0.1 * f64::from(n) - 0.03) {
            let bounds = [Vector3::new(-0.2, 0.3, 0.0), Vector3::new(-0.2 + width, 0.3 + width, 4.0)];
            let grid = SIZES.grid(&bounds, Vector3::z());
            for (axis, low) in grid.axes.iter().zip([-0.2, 0.3]) {
                let middle = axis.faces[axis.core.start + axis.core.len() / 2];
                assert_eq!(axis.core.len() % 2, 0, "{width}");
                assert!((middle - low - 0.5 * width).abs() < 1e-12, "{middle}");
            }
        }
    }
}
