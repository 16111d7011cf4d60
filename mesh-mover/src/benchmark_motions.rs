//! Large motions of a plate in a box, for tests and comparisons of movers.

use comm::Comm;
use mesh::FlowGrid;

use crate::local::LocalGrid;
use crate::motion::{Limits, Motion, MotionError, MotionResult, Positions};
use crate::mover::Mover;

/// Position of a point of the plate at fraction `s` of a motion.
pub type Path = fn([f64; 3], f64) -> [f64; 3];

/// The motions, for a plate `[-w, w]^2` in the plane z = 0 with w = 0.375 (see [`plate`]).
pub const MOTIONS: [(&str, Path); 6] = [
    ("translated normally by half its width", |p, s| [p[0], p[1], p[2] + HALF * s]),
    ("translated in its plane by half its width", |p, s| [p[0] + HALF * s, p[1], p[2]]),
    ("rotated by 60 degrees", rotate),
    ("compressed to half", |p, s| [p[0] * (1.0 - 0.5 * s), p[1] * (1.0 - 0.5 * s), p[2]]),
    ("a flap bent to 90 degrees", flap),
    ("combined: lifted, rotated, compressed by half as much", |p, s| {
        let q = rotate([p[0] * (1.0 - 0.25 * s), p[1] * (1.0 - 0.25 * s), p[2]], 0.5 * s);
        [q[0], q[1], q[2] + 0.5 * HALF * s]
    }),
];

/// Half the width of the plate, m.
const HALF: f64 = 0.375;

/// The grid of [`MOTIONS`]: `n` cells a side (a multiple of 16).
pub fn plate(n: usize) -> FlowGrid {
    assert!(n.is_multiple_of(16), "the plate ends on nodes");
    crate::example_grid::plate_with_margin(n, 5 * n / 16, 0.1, 0.85f64.powf(16.0 / n as f64), false)
}

fn rotate(p: [f64; 3], s: f64) -> [f64; 3] {
    let (sin, cos) = (s * std::f64::consts::FRAC_PI_3).sin_cos();
    [cos * p[0] - sin * p[2], p[1], sin * p[0] + cos * p[2]]
}

/// The half at x > 0 rolls up on a circle until its end is vertical.
fn flap(p: [f64; 3], s: f64) -> [f64; 3] {
    let k = s * std::f64::consts::FRAC_PI_2 / HALF;
    if p[0] <= 0.0 || k == 0.0 { p } else { [(k * p[0]).sin() / k, p[1], (1.0 - (k * p[0]).cos()) / k] }
}

/// A grid whose canopy is moved window by window, on one rank.
pub struct MotionTrial {
    /// Positions before the first window.
    pub start: Positions,
    /// Present positions.
    pub at: Positions,
    /// The moving grid.
    pub motion: Motion,
}

impl MotionTrial {
    /// On a grid at rest.
    ///
    /// # Errors
    /// An invalid start grid.
    pub fn new(grid: &FlowGrid, mover: Box<dyn Mover>, limits: Limits) -> Result<Self, MotionError> {
        let local = LocalGrid::new(grid, &vec![0; grid.coords.len()], &Comm::solo());
        let x = local.gather(&grid.coords);
        let canopy = grid.canopy_nodes.iter().flat_map(|&a| grid.coords[a as usize]).collect();
        let start = Positions { grid: x, canopy };
        let motion = Motion::new(local, start.clone(), start.clone(), mover, limits)?;
        Ok(Self { at: start.clone(), start, motion })
    }

    /// One window: the canopy moves to `shape` of its start position.
    ///
    /// # Errors
    /// The grid motion failed; its state is unchanged.
    pub fn window(&mut self, shape: impl Fn([f64; 3]) -> [f64; 3]) -> Result<MotionResult, MotionError> {
        let mut to = self.at.clone();
        for (c, s) in to.canopy.as_chunks_mut::<3>().0.iter_mut().zip(self.start.canopy.as_chunks::<3>().0) {
            *c = shape(*s);
        }
        let moved = self.motion.follow(&self.at, &mut to)?;
        self.at = to;
        self.motion.accept(&self.at, &moved.shape);
        Ok(moved)
    }
}
