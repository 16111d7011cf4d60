//! Replacement of a bad grid by a new one.
//!
//! Grids are built from the same blocks around any shape of one canopy: a new one around the present shape has the
//! same cells and different node positions, so no state is transferred between grids. The new grid becomes the
//! reference; the difference to the old one is an offset of each node that decreases smoothly to zero over some
//! windows. For the flow this is ordinary grid motion: it conserves mass, momentum and energy to round-off, uniform
//! fields stay uniform, both time levels of BDF2 are unchanged, and nothing passes through the fabric, whose nodes
//! have no offset.
//!
//! A rapidly deforming canopy leaves less time: the transition is shorter where the quality decreases fast, and it is
//! completed within a window in which the blend of old and new becomes bad. Where the grid becomes bad within one
//! window, a new one is built in that window, around the requested canopy. Nodes then cross cells in one window,
//! which the flow's swept volumes represent: the conservative remap of an arbitrary Lagrangian-Eulerian method is the
//! same motion.

use case::Regrid;
use mesh::Point;

use super::{MeshQuality, Motion, MoverError, Positions, WindowProgress, volume};

/// Builds the nodes of a new grid around canopy positions: the same cells, nodes in global order.
pub type Builder = Box<dyn Fn(&[Point]) -> Result<Vec<Point>, String>>;

/// Builds new grids and decides when.
pub struct Regridder {
    build: Builder,
    when: Regrid,
    /// Quality below which the next new grid is built after one without improvement.
    next: Option<f64>,
}

/// Threshold of a scene without one: this share of the quality of the grid when it was built. In a grid that had worn to
/// a fourth a window took ten times longer than after a new one (decision 66).
const AUTOMATIC_SHARE: f64 = 0.5;

/// Intermediate grids between old and new that are checked before a transition.
const TRANSITION_SAMPLES: u32 = 8;
/// Factor by which a new grid must be better than the old one.
const MIN_IMPROVEMENT: f64 = 1.3;
/// Fraction of the old quality that intermediate grids must keep.
const MIN_TRANSITION_QUALITY: f64 = 0.6;
/// After a new grid without improvement, the next one is built when the quality has fallen to this fraction.
const RETRY_QUALITY: f64 = 0.8;
/// Below this fraction of the bound a new grid is built within the window.
const IMMEDIATE_QUALITY: f64 = 0.5;
/// A transition must end before the quality has fallen to this fraction at its present rate.
const MIN_REMAINING_QUALITY: f64 = 0.5;
/// Longest transition, windows: beyond it nodes move faster than `step`.
const MAX_STEPS: f64 = 400.0;

impl Regridder {
    /// With new grids from `build` under the conditions `when`.
    pub fn new(when: Regrid, build: Builder) -> Self {
        Self { build, when, next: None }
    }

    /// Quality below which a grid of quality `built` at its start is replaced.
    fn threshold(&self, built: f64) -> f64 {
        self.when.quality_threshold.unwrap_or(AUTOMATIC_SHARE * built)
    }

    /// Quality below which the next new grid is built, if one without improvement has lowered it.
    pub(super) fn next(&self) -> Option<f64> {
        self.next
    }

    pub(super) fn set_next(&mut self, quality: f64) {
        self.next = Some(quality);
    }
}

/// Transition to a new grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridTransition {
    /// Offset of each local node at the start of the transition, m.
    pub offset: Vec<f64>,
    /// Completed windows.
    pub step: u32,
    /// Number of windows.
    pub steps: u32,
}

impl GridTransition {
    /// Fraction of the offset at the end of the present window: a smooth step from one to zero, with zero slope at
    /// both ends.
    pub fn remaining_fraction(&self) -> f64 {
        let s = f64::from(self.step + 1) / f64::from(self.steps.max(1));
        if s >= 1.0 { 0.0 } else { 1.0 - s * s * (3.0 - 2.0 * s) }
    }
}

/// Largest slope of [`GridTransition::remaining_fraction`] over the transition.
const STEEPEST: f64 = 1.5;

/// A new grid, for messages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewGrid {
    /// Smallest scaled Jacobian of the old grid.
    pub from: f64,
    /// Smallest scaled Jacobian of the new grid.
    pub to: f64,
    /// Windows of the transition; 0: replaced within one window.
    pub windows: u32,
}

/// Fractions of the transition at which the intermediate grid is checked.
fn transition_samples() -> impl Iterator<Item = f64> {
    (1..TRANSITION_SAMPLES).map(|k| f64::from(k) / f64::from(TRANSITION_SAMPLES))
}

/// Whether a new grid of quality `new` is better than one of quality `old` by enough.
fn is_improvement(new: f64, old: f64) -> bool {
    new >= MIN_IMPROVEMENT * old
}

/// Whether an intermediate grid of quality `between` is acceptable in a transition from a grid of quality `old`.
fn is_acceptable(between: &MeshQuality, old: f64, min_quality: f64) -> bool {
    between.quality >= (MIN_TRANSITION_QUALITY * old).max(min_quality) && between.volume_ratio > 0.0
}

/// Whether a grid of quality `quality` is replaced within the window, where new ones are built `below`.
fn is_urgent(quality: f64, below: f64) -> bool {
    quality < IMMEDIATE_QUALITY * below
}

/// Length of the displacement `d` of a node in edges of length `h`.
fn length_in_edges(d: &[f64], h: f64) -> f64 {
    d.iter().map(|d| d.powi(2)).sum::<f64>().sqrt() / h
}

/// Windows of a transition over `far` edges, of which a node may move `step` in one window; fewer where the quality,
/// now `quality`, has fallen by `quality_loss` (which may be zero) in one window.
fn transition_windows(far: f64, step: f64, quality: f64, quality_loss: f64) -> u32 {
    let steps = (STEEPEST * far / step).ceil();
    let remaining = (MIN_REMAINING_QUALITY * quality / quality_loss).floor();
    steps.min(remaining).clamp(1.0, MAX_STEPS) as u32
}

impl Motion {
    /// Enables new grids. A transition in progress (`transition`) continues.
    pub fn with_regrid(mut self, regridder: Option<Regridder>, transition: Option<GridTransition>) -> Self {
        self.regridder = regridder;
        self.transition = transition;
        self
    }

    /// The transition in progress, if any.
    pub fn transition(&self) -> Option<&GridTransition> {
        self.transition.as_ref()
    }

    /// The start grid: the first one, or the last new one.
    pub fn start(&self) -> &Positions {
        &self.start
    }

    /// Number of new grids.
    pub fn new_grids(&self) -> u32 {
        self.new_grids
    }

    /// Completes the transition within the present window, where it is not complete: the next positions are those of
    /// the new grid, for all later solves of the window.
    pub(super) fn finish_transition(&mut self) -> bool {
        match &mut self.transition {
            Some(transition) if transition.step + 1 < transition.steps => {
                transition.step = transition.steps - 1;
                true
            }
            _ => false,
        }
    }

    /// Advances the transition by one window, or starts a new one where that is due. Collective.
    pub(super) fn advance_transition(
        &mut self,
        accepted: &Positions,
        shape: &MeshQuality,
    ) -> Option<Result<NewGrid, String>> {
        if let Some(transition) = &mut self.transition {
            transition.step += 1;
            if transition.step >= transition.steps {
                self.transition = None;
            }
            return None;
        }
        let regridder = self.regridder.as_mut()?;
        let due = regridder.next.unwrap_or_else(|| regridder.threshold(self.start_quality));
        if shape.quality >= due {
            return None;
        }
        regridder.next = Some(RETRY_QUALITY * shape.quality);
        let built = (regridder.build)(accepted.canopy.as_chunks::<3>().0);
        // The same on every rank: all have built the same grid.
        Some(built.and_then(|nodes| self.start_transition(&nodes, accepted, shape)))
    }

    /// Makes `nodes` the reference and starts the transition from the present grid. Collective.
    fn start_transition(
        &mut self,
        nodes: &[Point],
        accepted: &Positions,
        shape: &MeshQuality,
    ) -> Result<NewGrid, String> {
        let _part = timing::part("new grid");
        let mut target = Positions { grid: self.grid.gather(nodes), canopy: accepted.canopy.clone() };
        self.grid.set_canopy_positions(&accepted.canopy, &mut target.grid);
        let found = self.shape(&target.grid);
        if !is_improvement(found.quality, shape.quality) {
            return Err(format!(
                "the new grid around the canopy is not better: smallest scaled Jacobian {:.4} (cell {}) instead of {:.4}",
                found.quality, found.cell, shape.quality
            ));
        }
        let offset: Vec<f64> = accepted.grid.iter().zip(&target.grid).map(|(a, b)| a - b).collect();
        let mut x = target.grid.clone();
        for s in transition_samples() {
            for ((x, t), d) in x.iter_mut().zip(&target.grid).zip(&offset) {
                *x = t + s * d;
            }
            let between = self.shape(&x);
            if !is_acceptable(&between, shape.quality, self.limits.min_quality) {
                return Err(format!(
                    "in the transition to a new grid cell {} would have a scaled Jacobian of {:.4}",
                    between.cell, between.quality
                ));
            }
        }
        // Outer nodes have large cells: the free ones determine the length.
        let sizes = self.grid.free_sizes(&accepted.grid);
        let new_sizes = self.grid.free_sizes(&target.grid);
        let ways = self.grid.free_node.iter().map(|&a| &offset[3 * a as usize..][..3]);
        let ways = ways.zip(sizes.iter().zip(&new_sizes)).map(|(d, (h, k))| length_in_edges(d, h.min(*k)));
        let far = self.grid.comm().max(ways.fold(0.0, f64::max));
        let step = self.regridder.as_ref().map_or(1.0, |r| r.when.step);
        let steps = transition_windows(far, step, shape.quality, self.quality_loss);
        self.set_new_grid(target, found.quality).map_err(|e| e.to_string())?;
        self.transition = Some(GridTransition { offset, step: 0, steps });
        Ok(NewGrid { from: shape.quality, to: found.quality, windows: steps })
    }

    /// Whether a grid is so bad that it must be replaced within the window.
    pub(super) fn needs_new_grid_now(&self, shape: &MeshQuality, stage: WindowProgress) -> bool {
        let below = self.regridder.as_ref().map_or(0.0, |r| r.threshold(self.start_quality));
        !self.accepts(shape) || (stage == WindowProgress::NotStarted && is_urgent(shape.quality, below))
    }

    /// Replaces the moved grid, of quality `shape`, by a new grid around the canopy of `to`: reached within this
    /// window, and the reference for later ones. `None`, with `to` unchanged, where there is none or it is not
    /// better. Collective.
    pub(super) fn replace_grid(
        &mut self,
        to: &mut Positions,
        shape: &MeshQuality,
    ) -> Result<Option<MeshQuality>, MoverError> {
        let Some(regridder) = &self.regridder else { return Ok(None) };
        let Ok(nodes) = (regridder.build)(to.canopy.as_chunks::<3>().0) else { return Ok(None) };
        let mut target = Positions { grid: self.grid.gather(&nodes), canopy: to.canopy.clone() };
        self.grid.set_canopy_positions(&to.canopy, &mut target.grid);
        let found = self.shape(&target.grid);
        if !self.accepts(&found) || !is_improvement(found.quality, shape.quality) {
            return Ok(None);
        }
        to.grid.copy_from_slice(&target.grid);
        self.set_new_grid(target, found.quality)?;
        self.new_grid = Some(NewGrid { from: shape.quality, to: found.quality, windows: 0 });
        Ok(Some(MeshQuality { volume_ratio: 1.0, ..found }))
    }

    /// Makes a new grid the reference and the start. Collective.
    fn set_new_grid(&mut self, target: Positions, quality: f64) -> Result<(), MoverError> {
        self.rebase(&target, quality)?;
        for (c, v) in self.start_volumes.iter_mut().enumerate() {
            *v = volume(&self.grid.corners(c, &target.grid));
        }
        (self.start, self.start_quality) = (target, quality);
        (self.at_start, self.rebase_distance) = (true, 0.0);
        self.new_grids += 1;
        if let Some(r) = &mut self.regridder {
            r.next = None;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_grids_are_built_and_accepted_on_the_stated_sides_of_their_bounds() {
        // Improvement by 30 %.
        assert!(is_improvement(0.131, 0.1) && !is_improvement(0.129, 0.1));
        // Three fifths of the old quality, the accepted quality, and a positive volume.
        let shape = |quality, volume_ratio| MeshQuality { quality, cell: 0, at: [0.0; 3], volume_ratio };
        let passable = |quality, min| is_acceptable(&shape(quality, 1.0), 0.5, min);
        assert!(passable(0.301, 0.01) && !passable(0.299, 0.01));
        assert!(passable(0.4, 0.4) && !passable(0.399, 0.4));
        assert!(!is_acceptable(&shape(0.5, 0.0), 0.5, 0.01) && is_acceptable(&shape(0.5, 1e-9), 0.5, 0.01));
        // Half of the quality below which new grids are built.
        assert!(is_urgent(0.099, 0.2) && !is_urgent(0.101, 0.2));
    }

    #[test]
    fn intermediate_grids_are_checked_at_equal_distances() {
        assert_eq!(transition_samples().collect::<Vec<_>>(), [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875]);
    }

    #[test]
    fn transition_length_follows_from_distance_and_remaining_quality() {
        assert_eq!(length_in_edges(&[2.0, -3.0, 6.0], 0.5), 14.0);
        // The largest slope of the transition is 1.5 times the mean: 1.5 * 10 / 0.5.
        assert_eq!(transition_windows(10.0, 0.5, 0.3, 0.0), 30);
        assert_eq!(transition_windows(10.1, 0.5, 0.3, 0.0), 31);
        // Half of the quality is lost in 0.5 * 0.3 / 0.0101 windows.
        assert_eq!(transition_windows(10.0, 0.5, 0.3, 0.0101), 14);
        assert_eq!(transition_windows(10.0, 0.5, 0.3, 0.0075), 20);
        assert_eq!(
            (transition_windows(1e-9, 0.5, 0.3, 0.0), transition_windows(10.0, 0.5, 0.3, 9.0)),
            (1, 1)
        );
        assert_eq!(transition_windows(1e9, 0.5, 0.3, 0.0), 400);
        assert_eq!(transition_windows(10.0, 0.5, 0.3, -0.1), 1, "at least one");
    }

    /// The largest slope is [`STEEPEST`], at the middle, and both ends are flat.
    #[test]
    fn transition_is_smooth() {
        let steps = 1000;
        let remaining_fraction =
            |step| GridTransition { offset: Vec::new(), step, steps }.remaining_fraction();
        assert_eq!((remaining_fraction(steps - 1), remaining_fraction(steps)), (0.0, 0.0));
        // s = 1/4 and 1/2.
        assert!(
            (remaining_fraction(249) - 0.84375).abs() < 1e-12
                && (remaining_fraction(499) - 0.5).abs() < 1e-12
        );
        let quality_loss =
            |step: u32| (remaining_fraction(step) - remaining_fraction(step + 1)) * f64::from(steps);
        let steepest = (0..steps - 1).map(quality_loss).fold(0.0, f64::max);
        assert!(
            (steepest - STEEPEST).abs() < 1e-5 && quality_loss(0) < 0.01 && quality_loss(steps - 2) < 0.01,
            "{steepest}"
        );
    }
}
