//! A grid that follows the canopy.
//!
//! The grid moves without rotation at a velocity that is fixed before a window begins: that of the frame, and a share of the
//! distance that the middle of the canopy has from its place in the grid. Both are velocities of an inertial motion of the grid during the window, so that
//! nothing is interpolated. Where the canopy comes near the end of the even cells, a new grid is made around it.

use immersed::cut_faces::MARGIN;
use immersed::flow::Flow;
use immersed::grid::Grid;
use immersed::placement::{Placement, bounds};
use immersed::regrid::NoNewGrid;
use nalgebra::Vector3;

/// Rate at which the grid closes the distance to the canopy, in speeds of the stream over extents of the canopy.
const FOLLOWING_RATE: f64 = 2.0;
/// Cells between the canopy and the nearest place that [`MARGIN`] allows, in which a new grid is made.
const EARLY: f64 = 1.0;

/// Cells of a grid at most: 25 GB.
const MAX_CELLS: usize = 100_000_000;

/// The canopy extends so far that its grid would not fit into memory.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the canopy extends over {size:.1} m, and its grid would have {cells:.1e} cells (at most {:.0e}); raise flow.immersed.spacing_m, or \
     shorten window_s if the canopy has diverged",
    MAX_CELLS as f64
)]
pub struct TooManyCells {
    /// Largest extent, m.
    pub size: f64,
    /// Cells.
    pub cells: f64,
}

/// No new grid around the canopy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoGrid {
    /// A canopy too large.
    #[error(transparent)]
    Cells(#[from] TooManyCells),
    /// A grid too small for the ranks, or too large for a GPU.
    #[error(transparent)]
    Flow(#[from] NoNewGrid),
}

/// Where the grid is.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingGrid {
    /// Sizes.
    pub placement: Placement,
    /// Position of the grid's origin in the falling frame, m.
    pub origin: Vector3<f64>,
    /// Place of the middle of the canopy in the grid, m.
    pub home: Vector3<f64>,
    /// New grids since the first.
    pub new_grids: u32,
}

impl MovingGrid {
    /// The grid around a canopy in a stream, and its place.
    ///
    /// # Errors
    /// A canopy too large for a grid of this spacing.
    pub fn around(
        placement: Placement,
        canopy: &[Vector3<f64>],
        stream: Vector3<f64>,
    ) -> Result<(Self, Grid), TooManyCells> {
        let bounds = bounds(canopy);
        let size = (bounds[1] - bounds[0]).amax();
        let along = size / placement.spacing;
        if !along.is_finite() || along > 1e6 {
            return Err(TooManyCells { size, cells: along.powi(3) });
        }
        let origin = 0.5 * (bounds[0] + bounds[1]);
        let grid = placement.grid(&bounds.map(|x| x - origin), stream);
        if grid.count() > MAX_CELLS {
            return Err(TooManyCells { size, cells: grid.count() as f64 });
        }
        Ok((Self { placement, origin, home: Vector3::zeros(), new_grids: 0 }, grid))
    }

    /// Velocity of the grid in the falling frame during the next window, in a stream of `speed` m/s.
    pub fn drift(&self, canopy: &[Vector3<f64>], speed: f64) -> Vector3<f64> {
        let bounds = bounds(canopy);
        let size = (bounds[1] - bounds[0]).amax();
        let away = 0.5 * (bounds[0] + bounds[1]) - self.origin - self.home;
        let drift = away * (FOLLOWING_RATE * speed / size.max(f64::MIN_POSITIVE));
        let fast = drift.norm();
        if fast > speed { drift * (speed / fast) } else { drift }
    }

    /// Whether all points, in the falling frame, are well within the even cells of `grid`.
    pub fn contains(&self, grid: &Grid, points: &[Vector3<f64>]) -> bool {
        let bounds = bounds(points).map(|x| x - self.origin);
        (0..3).all(|d| {
            let axis = &grid.axes[d];
            let margin = (MARGIN + EARLY) * axis.spacing;
            bounds[0][d] >= axis.faces[axis.core.start] + margin
                && bounds[1][d] <= axis.faces[axis.core.end] - margin
        })
    }

    /// A new grid around the points, with the flow of the old one. `far`: velocity of the far field at each height in the falling frame, where it is not zero.
    ///
    /// # Errors
    /// As [`Self::around`], and a grid with too few cells for the ranks or too many for a GPU.
    pub fn follow(
        &mut self,
        flow: &mut Flow,
        points: &[Vector3<f64>],
        stream: Vector3<f64>,
        far: Option<&dyn Fn(f64) -> Vector3<f64>>,
    ) -> Result<(), NoGrid> {
        let (new, grid) = Self::around(self.placement, points, stream)?;
        let shift = new.origin - self.origin;
        *flow = match far {
            Some(far) => flow.on_grid(grid, shift, Some(&|z: f64| far(new.origin.z + z)))?,
            None => flow.on_grid(grid, shift, None)?,
        };
        *self = Self { new_grids: self.new_grids + 1, ..new };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: Placement =
        Placement { spacing: 0.1, room: 0.1, wake: 0.5, far_field: 2.0, far_wake: 4.0, growth: 1.2 };

    #[test]
    fn canopy_of_kilometres_is_refused() {
        let far = [Vector3::zeros(), Vector3::new(5e3, 5e3, 5e3)];
        let error = MovingGrid::around(SIZES, &far, Vector3::z()).expect_err("too large");
        assert!(error.to_string().contains("5000.0 m") && error.cells > 1e12, "{error}");
    }

    /// A canopy that moves away is followed, at most at the speed of the stream.
    #[test]
    fn grid_follows_a_drifting_canopy() {
        let square = |x: f64| vec![Vector3::new(x - 1.0, -1.0, 0.0), Vector3::new(x + 1.0, 1.0, 0.5)];
        let (mut at, grid) = MovingGrid::around(SIZES, &square(0.0), Vector3::z()).expect("small");
        assert!(at.contains(&grid, &square(0.0)) && !at.contains(&grid, &square(1.0)));
        assert_eq!(at.drift(&square(0.0), 5.0), Vector3::zeros());
        assert!((at.drift(&square(0.1), 5.0).x - 0.5).abs() < 1e-12);
        assert!((at.drift(&square(50.0), 5.0).norm() - 5.0).abs() < 1e-12);
        assert_eq!(at.drift(&square(1.0), 0.0), Vector3::zeros());
        // A steady drift of 1 m/s stays within the room.
        let (mut x, dt) = (0.0, 0.01);
        for _ in 0..2000 {
            at.origin += at.drift(&square(x), 5.0) * dt;
            x += dt;
        }
        assert!((x - at.origin.x - 0.2).abs() < 0.02, "{}", x - at.origin.x);
    }
}
