//! A new grid in the place of one that has become bad.
//!
//! Grids are made of the same blocks around any shape of one canopy: a new one around
//! the present shape has the same cells, and only its nodes lie elsewhere. So no state has to be
//! transferred between grids. The new grid becomes the reference; what is left of the way from the old
//! one is an offset of each node that fades smoothly over some windows. To the flow this is
//! grid motion like any other: it keeps mass, momentum and energy to the last digit, uniform
//! fields stay uniform, both time levels of BDF2 stay what they were, and nothing passes
//! through the fabric, whose nodes have no way to go.
//!
//! A canopy that deforms fast leaves less time: the way is shorter where quality falls fast, it ends within the
//! window in which the mixture of old and new becomes bad, and where the grid becomes bad within one window
//! a new one is made in that window, around the canopy that is asked for. Then nodes cross cells in
//! one window, which the flow's swept volumes bear: the conservative remap of an arbitrary
//! Lagrangian-Eulerian method is that same motion.

use case::Regrid;
use mesh::Point;

use super::{Motion, MoverError, Positions, Shape, Stage, volume};

/// Builds the nodes of a new grid around canopy positions: the same cells, nodes in global order.
pub type Builder = Box<dyn Fn(&[Point]) -> Result<Vec<Point>, String>>;

/// Makes new grids, and knows when.
pub struct Regridder {
    build: Builder,
    when: Regrid,
    /// The next one is made below this quality: lower after one that did not help.
    next: f64,
}

/// Places between old and new that are looked at before the way is taken.
const LOOKS: u32 = 8;
/// A new grid must be better than the old one by this factor.
const GAIN: f64 = 1.3;
/// On the way cells may become worse than both ends, down to this share of the worse end.
const WAY: f64 = 0.6;
/// After a new grid that did not help, the next one is made when quality has fallen to this share.
const RETRY: f64 = 0.8;
/// Below this share of the bound a new grid does not wait for the end of a window.
const AT_ONCE: f64 = 0.5;
/// A way is to end before quality has fallen to this share at the rate that it falls now.
const LEFT: f64 = 0.5;
/// Longest way, in windows: then nodes move faster than was asked for.
const MOST_STEPS: f64 = 400.0;

impl Regridder {
    /// Asks `build` for new grids as `when` says.
    pub fn new(when: Regrid, build: Builder) -> Self {
        Self { build, when, next: when.quality_threshold }
    }

    pub(super) fn next(&self) -> f64 {
        self.next
    }

    pub(super) fn set_next(&mut self, quality: f64) {
        self.next = quality;
    }
}

/// The rest of the way to a new grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Glide {
    /// Of each local node, at the start of the way, m.
    pub offset: Vec<f64>,
    /// Windows that are done.
    pub step: u32,
    /// Windows in all.
    pub steps: u32,
}

impl Glide {
    /// Share of the offset at the end of the present window: from one to zero, without a
    /// jump of velocity at either end.
    pub fn rest(&self) -> f64 {
        let s = f64::from(self.step + 1) / f64::from(self.steps.max(1));
        if s >= 1.0 { 0.0 } else { 1.0 - s * s * (3.0 - 2.0 * s) }
    }
}

/// Steepest slope of [`Glide::rest`] over the way.
const STEEPEST: f64 = 1.5;

/// A new grid, as it is told to people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewGrid {
    /// Smallest scaled Jacobian of the old grid.
    pub from: f64,
    /// Of the new one.
    pub to: f64,
    /// Windows of the way; 0: the one in which it was made.
    pub windows: u32,
}

/// Shares of the way at which the grid between old and new is looked at.
fn looks() -> impl Iterator<Item = f64> {
    (1..LOOKS).map(|k| f64::from(k) / f64::from(LOOKS))
}

/// Whether a new grid of quality `new` is worth its cost in the place of one of quality `old`.
fn is_worth(new: f64, old: f64) -> bool {
    new >= GAIN * old
}

/// Whether cells may become as bad as `between` on the way from a grid of quality `old`.
fn is_passable(between: &Shape, old: f64, min_quality: f64) -> bool {
    between.quality >= (WAY * old).max(min_quality) && between.volume_ratio > 0.0
}

/// Whether a grid of quality `quality` cannot wait for the end of a window, new ones being made `below`.
fn cannot_wait(quality: f64, below: f64) -> bool {
    quality < AT_ONCE * below
}

/// Length of the way `d` of a node in edges of length `h`.
fn in_edges(d: &[f64], h: f64) -> f64 {
    d.iter().map(|d| d.powi(2)).sum::<f64>().sqrt() / h
}

/// Windows for a way of `far` edges, of which a node may take `step` in one; fewer where quality, now `quality`,
/// has fallen by `fall` (which may be zero) in one window.
fn windows_of_way(far: f64, step: f64, quality: f64, fall: f64) -> u32 {
    let steps = (STEEPEST * far / step).ceil();
    let left = (LEFT * quality / fall).floor();
    steps.min(left).clamp(1.0, MOST_STEPS) as u32
}

impl Motion {
    /// Lets new grids be made. A way that had begun (`glide`) is gone on with.
    pub fn with_regrid(mut self, regridder: Option<Regridder>, glide: Option<Glide>) -> Self {
        self.regridder = regridder;
        self.glide = glide;
        self
    }

    /// The rest of the way to a new grid, if there is one.
    pub fn glide(&self) -> Option<&Glide> {
        self.glide.as_ref()
    }

    /// The grid that stands for the start: the first one, or the last new one.
    pub fn start(&self) -> &Positions {
        &self.start
    }

    /// How many new grids were made.
    pub fn new_grids(&self) -> u32 {
        self.new_grids
    }

    /// Ends the way to a new grid within the present window, where there is a rest of it: the next
    /// positions are those of the new grid. All later calls of the window agree.
    pub(super) fn end_way(&mut self) -> bool {
        match &mut self.glide {
            Some(glide) if glide.step + 1 < glide.steps => {
                glide.step = glide.steps - 1;
                true
            }
            _ => false,
        }
    }

    /// One window further on the way, or onto a new one where that is due. Collective.
    pub(super) fn go_on(&mut self, accepted: &Positions, shape: &Shape) -> Option<Result<NewGrid, String>> {
        if let Some(glide) = &mut self.glide {
            glide.step += 1;
            if glide.step >= glide.steps {
                self.glide = None;
            }
            return None;
        }
        let regridder = self.regridder.as_mut()?;
        if shape.quality >= regridder.next {
            return None;
        }
        regridder.next = RETRY * shape.quality;
        let built = (regridder.build)(accepted.canopy.as_chunks::<3>().0);
        // The same on every rank: all have built the same grid.
        Some(built.and_then(|nodes| self.take(&nodes, accepted, shape)))
    }

    /// Takes `nodes` as the reference and the present grid as the start of the way to it. Collective.
    fn take(&mut self, nodes: &[Point], accepted: &Positions, shape: &Shape) -> Result<NewGrid, String> {
        let _part = timing::part("new grid");
        let mut target = Positions { grid: self.grid.gather(nodes), canopy: accepted.canopy.clone() };
        self.grid.place_canopy(&accepted.canopy, &mut target.grid);
        let found = self.shape(&target.grid);
        if !is_worth(found.quality, shape.quality) {
            return Err(format!(
                "a new grid around the canopy is no better: smallest scaled Jacobian {:.4} (cell {}) for {:.4}",
                found.quality, found.cell, shape.quality
            ));
        }
        let offset: Vec<f64> = accepted.grid.iter().zip(&target.grid).map(|(a, b)| a - b).collect();
        let mut x = target.grid.clone();
        for s in looks() {
            for ((x, t), d) in x.iter_mut().zip(&target.grid).zip(&offset) {
                *x = t + s * d;
            }
            let between = self.shape(&x);
            if !is_passable(&between, shape.quality, self.limits.min_quality) {
                return Err(format!(
                    "on the straight way to a new grid cell {} would have a scaled Jacobian of {:.4}",
                    between.cell, between.quality
                ));
            }
        }
        // Outer nodes have large cells: the free ones decide.
        let sizes = self.grid.free_sizes(&accepted.grid);
        let new_sizes = self.grid.free_sizes(&target.grid);
        let ways = self.grid.free_node.iter().map(|&a| &offset[3 * a as usize..][..3]);
        let ways = ways.zip(sizes.iter().zip(&new_sizes)).map(|(d, (h, k))| in_edges(d, h.min(*k)));
        let far = self.grid.comm().max(ways.fold(0.0, f64::max));
        let step = self.regridder.as_ref().map_or(1.0, |r| r.when.step);
        let steps = windows_of_way(far, step, shape.quality, self.fall);
        self.adopt(target, found.quality).map_err(|e| e.to_string())?;
        self.glide = Some(Glide { offset, step: 0, steps });
        Ok(NewGrid { from: shape.quality, to: found.quality, windows: steps })
    }

    /// Whether the grid of a call is so bad that a new one cannot wait for the end of the window.
    pub(super) fn is_late(&self, shape: &Shape, stage: Stage) -> bool {
        let below = self.regridder.as_ref().map_or(0.0, |r| r.when.quality_threshold);
        !self.accepts(shape) || (stage == Stage::Fresh && cannot_wait(shape.quality, below))
    }

    /// A new grid around the canopy of `to` in the place of the moved one, which has `shape`: it is
    /// reached within this window, and the reference for what follows. `None`, and `to`
    /// as it was, where there is none or it does not help. Collective.
    pub(super) fn new_grid_at_once(
        &mut self,
        to: &mut Positions,
        shape: &Shape,
    ) -> Result<Option<Shape>, MoverError> {
        let Some(regridder) = &self.regridder else { return Ok(None) };
        let Ok(nodes) = (regridder.build)(to.canopy.as_chunks::<3>().0) else { return Ok(None) };
        let mut target = Positions { grid: self.grid.gather(&nodes), canopy: to.canopy.clone() };
        self.grid.place_canopy(&to.canopy, &mut target.grid);
        let found = self.shape(&target.grid);
        if !self.accepts(&found) || !is_worth(found.quality, shape.quality) {
            return Ok(None);
        }
        to.grid.copy_from_slice(&target.grid);
        self.adopt(target, found.quality)?;
        self.news = Some(NewGrid { from: shape.quality, to: found.quality, windows: 0 });
        Ok(Some(Shape { volume_ratio: 1.0, ..found }))
    }

    /// Takes a new grid as reference and start. Collective.
    fn adopt(&mut self, target: Positions, quality: f64) -> Result<(), MoverError> {
        self.rebase(&target, quality)?;
        for (c, v) in self.start_volumes.iter_mut().enumerate() {
            *v = volume(&self.grid.corners(c, &target.grid));
        }
        (self.start, self.start_quality) = (target, quality);
        (self.at_start, self.left) = (true, 0.0);
        self.new_grids += 1;
        if let Some(r) = &mut self.regridder {
            r.next = r.when.quality_threshold;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_grid_is_made_and_taken_on_the_stated_sides_of_its_bounds() {
        // A gain of 30 %.
        assert!(is_worth(0.131, 0.1) && !is_worth(0.129, 0.1));
        // Three fifths of the old quality, the accepted quality, and a volume.
        let shape = |quality, volume_ratio| Shape { quality, cell: 0, at: [0.0; 3], volume_ratio };
        let passable = |quality, min| is_passable(&shape(quality, 1.0), 0.5, min);
        assert!(passable(0.301, 0.01) && !passable(0.299, 0.01));
        assert!(passable(0.4, 0.4) && !passable(0.399, 0.4));
        assert!(!is_passable(&shape(0.5, 0.0), 0.5, 0.01) && is_passable(&shape(0.5, 1e-9), 0.5, 0.01));
        // Half of the quality below which new grids are made.
        assert!(cannot_wait(0.099, 0.2) && !cannot_wait(0.101, 0.2));
    }

    #[test]
    fn the_way_is_looked_at_evenly_between_its_ends() {
        assert_eq!(looks().collect::<Vec<_>>(), [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875]);
    }

    #[test]
    fn the_way_takes_as_many_windows_as_its_length_and_the_quality_left_allow() {
        assert_eq!(in_edges(&[2.0, -3.0, 6.0], 0.5), 14.0);
        // The steepest slope of the way is half as much again as the mean: 1.5 * 10 / 0.5.
        assert_eq!(windows_of_way(10.0, 0.5, 0.3, 0.0), 30);
        assert_eq!(windows_of_way(10.1, 0.5, 0.3, 0.0), 31);
        // Half of the quality is lost in 0.5 * 0.3 / 0.0101 windows.
        assert_eq!(windows_of_way(10.0, 0.5, 0.3, 0.0101), 14);
        assert_eq!(windows_of_way(10.0, 0.5, 0.3, 0.0075), 20);
        assert_eq!((windows_of_way(1e-9, 0.5, 0.3, 0.0), windows_of_way(10.0, 0.5, 0.3, 9.0)), (1, 1));
        assert_eq!(windows_of_way(1e9, 0.5, 0.3, 0.0), 400);
        assert_eq!(windows_of_way(10.0, 0.5, 0.3, -0.1), 1, "never none");
    }

    /// The steepest slope of the way is what [`STEEPEST`] says, in its middle, and its ends are flat.
    #[test]
    fn the_way_is_smooth() {
        let steps = 1000;
        let rest = |step| Glide { offset: Vec::new(), step, steps }.rest();
        assert_eq!((rest(steps - 1), rest(steps)), (0.0, 0.0));
        // s = 1/4 and 1/2.
        assert!((rest(249) - 0.84375).abs() < 1e-12 && (rest(499) - 0.5).abs() < 1e-12);
        let fall = |step: u32| (rest(step) - rest(step + 1)) * f64::from(steps);
        let steepest = (0..steps - 1).map(fall).fold(0.0, f64::max);
        assert!((steepest - STEEPEST).abs() < 1e-5 && fall(0) < 0.01 && fall(steps - 2) < 0.01, "{steepest}");
    }
}
