//! Grid motion that follows the canopy and keeps the cells valid: one linear solve from the reference first, then
//! increments with an updated reference, then local untangling, then an error.

mod regrid;

use comm::Comm;
use mesh::Point;

use crate::allocator::release_free_memory;
use crate::local::{Kind, LocalGrid};
use crate::mover::{Effort, Mover, MoverError};
use crate::near_wall_following;
use crate::quality::{lower, volume};
use crate::untangle::untangle;
use crate::warm_start::MotionWarmStart;
pub use regrid::{Builder, GridTransition, NewGrid, Regridder};

/// Requirements on a moved grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Smallest scaled Jacobian that is accepted.
    pub min_quality: f64,
    /// Most sub-increments of one motion.
    pub max_increments: u32,
    /// Whether bad cells are optimised after a solve.
    pub repair: bool,
}

impl Limits {
    /// Quality aimed at by a repair: well above the minimum, where cells can be that good.
    fn target(&self) -> f64 {
        (4.0 * self.min_quality).min(REPAIR_BELOW.max(1.1 * self.min_quality))
    }

    /// In the first solve of a window cells below this quality are already repaired, so that later solves, whose
    /// canopies differ a little, need no repair. A repair in one solve and not in the next would be a jump of the
    /// grid that the coupling cannot resolve.
    fn early_threshold(&self) -> f64 {
        (2.0 * self.min_quality).min(0.5 * (self.min_quality + self.target()))
    }
}

/// The reference grid is replaced once the worst cell is below this and below [`REBASE_LOSS`] of the quality of the
/// reference: the stiffening then protects the cells that are bad now, at the cost of drift (see [`Motion`]). Measured
/// on a plate lifted, rotated and bent in a box: with 0.3 the worst cell ends at a third of the quality, with 1.0 at the
/// same quality for twice the assemblies.
const REBASE_BELOW: f64 = 0.5;
/// See [`REBASE_BELOW`].
const REBASE_LOSS: f64 = 0.7;
/// A new reference is optimised where its cells are worse than this: the next motions start there.
const REPAIR_BELOW: f64 = 0.25;
/// Decay of the largest loss of quality per window.
const DECAY: f64 = 0.7;
/// The canopy counts as returning once its distance from the start is below this fraction of the distance at which
/// the start grid was replaced as reference: the start grid becomes the reference again.
const RETURN_DISTANCE: f64 = 0.5;

/// Quality of the grid: the same values on all ranks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshQuality {
    /// Smallest scaled Jacobian.
    pub quality: f64,
    /// Global cell that has it.
    pub cell: u32,
    /// Its centre, m.
    pub at: Point,
    /// Smallest ratio of a cell's volume to its volume at the start.
    pub volume_ratio: f64,
}

/// Result of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionResult {
    /// Iterations of all solves, error of the last.
    pub effort: Effort,
    /// Increments: 1 unless the single solve failed.
    pub increments: u32,
    /// Quality of the resulting grid.
    pub shape: MeshQuality,
}

/// Why the grid motion failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// The mover failed.
    #[error(transparent)]
    Mover(#[from] MoverError),
    /// No method gave a valid grid.
    #[error(
        "the grid cannot follow the canopy: cell {} at ({:.4}, {:.4}, {:.4}) m has scaled Jacobian {:.3e} \
         (minimum {least:.1e}) after {increments} increments and untangling",
        shape.cell, shape.at[0], shape.at[1], shape.at[2], shape.quality
    )]
    Tangled {
        /// The best grid found.
        shape: MeshQuality,
        /// Required scaled Jacobian.
        least: f64,
        /// Increments tried.
        increments: u32,
    },
    /// The start grid is not valid.
    #[error(
        "cell {} of the start grid, at ({:.4}, {:.4}, {:.4}) m, has scaled Jacobian {:.3e} (minimum \
         {least:.1e}): lower mesh.min_quality, or change flow.grid",
        shape.cell, shape.at[0], shape.at[1], shape.at[2], shape.quality
    )]
    BadStart {
        /// The worst cell.
        shape: MeshQuality,
        /// Required scaled Jacobian.
        least: f64,
    },
}

/// Positions of grid and canopy.
#[derive(Clone, Debug, PartialEq)]
pub struct Positions {
    /// Local nodes of the grid, flat, m.
    pub grid: Vec<f64>,
    /// All canopy nodes, flat, m.
    pub canopy: Vec<f64>,
}

/// The moving grid.
///
/// **Drift.** While the start grid is the reference, positions depend on the canopy's position alone (to the solver's
/// tolerance; exactly for the start shape), not on its path. Each later reference replaces the start by the present
/// grid; the grid then returns to that one, until the canopy is half way back to its start: then the start grid is
/// the reference again and all drift is removed. [`Motion::rebased`] counts the changes. A new grid (`mesh.regrid`)
/// is a new start.
pub struct Motion {
    /// The grid's topology.
    pub grid: LocalGrid,
    mover: Box<dyn Mover>,
    limits: Limits,
    start_volumes: Vec<f64>,
    start: Positions,
    start_quality: f64,
    /// Distance of the canopy from its start when that was last replaced as reference, m.
    rebase_distance: f64,
    reference: Positions,
    reference_quality: f64,
    rebased: u32,
    /// Whether the reference is the start grid.
    at_start: bool,
    /// Displacement of the canopy from the reference, and of the local free nodes.
    canopy_displacement: Vec<f64>,
    u: Vec<f64>,
    /// Further displacement of the local free nodes for a small motion.
    small: Vec<f64>,
    /// Largest small motion of each canopy node, m.
    follow_limit: Vec<f64>,
    /// Of the first solution of a window: `u` contains its grid; small motions are relative to it.
    first_solution: Option<Effort>,
    /// Canopy of the first solution (used while there is one).
    first_canopy: Vec<f64>,
    regridder: Option<Regridder>,
    transition: Option<GridTransition>,
    new_grids: u32,
    /// A new grid that was built within the window.
    new_grid: Option<NewGrid>,
    /// Methods that this window has used.
    window: WindowProgress,
    /// Quality of the last accepted window, and the largest recent loss of quality per window.
    quality: f64,
    quality_loss: f64,
}

/// Methods that a window has used. Its later solves start from their result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WindowProgress {
    /// No solve yet.
    NotStarted,
    /// One solve from the reference at the window's start.
    SingleSolve,
    /// The reference was changed within the window: it contains increments and repairs.
    ReferenceChanged,
}

impl Motion {
    /// Starts at `start`; a grid that was moved before continues from `reference`. Collective.
    ///
    /// # Errors
    /// A start grid that is inverted or below the limit.
    pub fn new(
        grid: LocalGrid,
        start: Positions,
        reference: Positions,
        mover: Box<dyn Mover>,
        limits: Limits,
    ) -> Result<Self, MotionError> {
        let volume = |c: usize| volume(&grid.corners(c, &start.grid));
        let start_volumes = (0..grid.cells.len()).map(volume).collect();
        let (canopy_displacement, u) = (vec![0.0; 3 * grid.n_canopy], vec![0.0; 3 * grid.free_node.len()]);
        let small = u.clone();
        let at_start = grid.comm().all(reference.grid == start.grid);
        let mut motion = Self {
            grid,
            mover,
            limits,
            start_volumes,
            start_quality: 1.0,
            rebase_distance: distance(&reference.canopy, &start.canopy),
            start,
            reference,
            reference_quality: 1.0,
            rebased: 0,
            at_start,
            canopy_displacement,
            u,
            small,
            follow_limit: Vec::new(),
            first_solution: None,
            first_canopy: Vec::new(),
            regridder: None,
            transition: None,
            new_grids: 0,
            new_grid: None,
            window: WindowProgress::NotStarted,
            quality: 1.0,
            quality_loss: 0.0,
        };
        let shape = motion.shape(&motion.reference.grid);
        if !motion.accepts(&shape) {
            return Err(MotionError::BadStart { shape, least: limits.min_quality });
        }
        (motion.reference_quality, motion.quality) = (shape.quality, shape.quality);
        motion.start_quality =
            if at_start { shape.quality } else { motion.shape(&motion.start.grid).quality };
        motion.mover.rebase(&motion.grid, &motion.reference.grid)?;
        motion.update_follow_limits();
        release_free_memory();
        Ok(motion)
    }

    /// State that later windows depend on in addition to positions, between windows.
    pub fn save_state(&self) -> MotionWarmStart {
        MotionWarmStart {
            qualities: [self.start_quality, self.reference_quality, self.quality],
            rebase_distance: self.rebase_distance,
            quality_loss: self.quality_loss,
            next_grid: self.regridder.as_ref().and_then(Regridder::next),
            rebased: self.rebased,
            new_grids: self.new_grids,
            at_start: self.at_start,
            mover: self.mover.save_state(),
        }
    }

    /// Restores a [`Motion::save_state`] of the same start and reference.
    ///
    /// # Errors
    /// Data that do not match.
    pub fn restore_state(&mut self, saved: MotionWarmStart) -> Result<(), String> {
        [self.start_quality, self.reference_quality, self.quality] = saved.qualities;
        (self.rebase_distance, self.quality_loss) = (saved.rebase_distance, saved.quality_loss);
        (self.rebased, self.new_grids, self.at_start) = (saved.rebased, saved.new_grids, saved.at_start);
        if let (Some(regridder), Some(next)) = (&mut self.regridder, saved.next_grid) {
            regridder.set_next(next);
        }
        self.mover.restore_state(saved.mover)
    }

    /// The grid that displacements are counted from.
    pub fn reference(&self) -> &Positions {
        &self.reference
    }

    /// Requirements on a moved grid.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Number of reference changes.
    pub fn rebased(&self) -> u32 {
        self.rebased
    }

    /// Moves the grid so that the canopy is at `to.canopy`; `from` is the last accepted state, from which increments
    /// start. Fills `to.grid`; positions of canopy nodes are exact bitwise. Solves between two [`Motion::accept`]
    /// whose canopies differ by a small motion (see [`near_wall_following`]) differ by [`Mover::extend`]. Collective.
    ///
    /// # Errors
    /// [`MotionError`]; the accepted state is unchanged.
    pub fn follow(&mut self, from: &Positions, to: &mut Positions) -> Result<MotionResult, MotionError> {
        let _part = timing::part("motion");
        if let Some(moved) = self.linear_update(to) {
            return Ok(moved);
        }
        self.first_solution = None;
        let stage = std::mem::replace(&mut self.window, WindowProgress::SingleSolve);
        let mut iterations = 0;
        match self.solve_from_reference(to) {
            Ok(effort) => {
                if let Some(moved) = self.evaluate(to, effort, stage)? {
                    return Ok(moved);
                }
                iterations += effort.iterations;
            }
            Err(MoverError::NotConverged { iterations: n, .. }) => iterations += n,
            Err(e) => return Err(e.into()),
        }
        self.refine_increments(from, to, iterations)
    }

    /// Decides on the grid of the single solve in `to`: accept, repair, replace by a new grid, or reject (`None`).
    /// `stage` is the window's progress before. Collective.
    fn evaluate(
        &mut self,
        to: &mut Positions,
        effort: Effort,
        stage: WindowProgress,
    ) -> Result<Option<MotionResult>, MotionError> {
        let _part = timing::part("cell quality");
        let mut shape = self.shape(&to.grid);
        // A canopy too fast for a gradual transition: complete the transition at once.
        if self.needs_new_grid_now(&shape, stage) && self.finish_transition() {
            self.set_positions(to);
            shape = self.shape(&to.grid);
        }
        let accepted = self.accepts(&shape);
        let early = stage == WindowProgress::NotStarted && shape.quality < self.limits.early_threshold();
        // After a change of the reference within the window, repair the present grid.
        let needs_repair = if accepted { early } else { stage == WindowProgress::ReferenceChanged };
        let goal = if early { self.limits.early_threshold() } else { self.limits.min_quality };
        let mut found = None;
        if self.needs_new_grid_now(&shape, stage) {
            found = self.replace_grid(to, &shape)?;
        }
        if found.is_none() && needs_repair {
            found = self.repair(to, goal)?;
        }
        if let Some(shape) = found {
            self.window = WindowProgress::ReferenceChanged;
            return Ok(Some(MotionResult { effort, increments: 1, shape }));
        }
        if !accepted {
            return Ok(None);
        }
        if stage == WindowProgress::ReferenceChanged {
            self.window = stage;
        }
        self.first_solution = Some(effort);
        self.first_canopy.clone_from(&to.canopy);
        Ok(Some(MotionResult { effort, increments: 1, shape }))
    }

    /// From the accepted state in 1, 2, 4 ... increments until a grid is accepted; `iterations` were made before.
    /// Collective.
    fn refine_increments(
        &mut self,
        from: &Positions,
        to: &mut Positions,
        mut iterations: usize,
    ) -> Result<MotionResult, MotionError> {
        let _part = timing::part("increments");
        let mut worst = None;
        let mut count = 1;
        while count <= self.limits.max_increments {
            let last = 2 * count > self.limits.max_increments;
            match self.move_in_increments(from, to, count, last, &mut iterations)? {
                Ok(moved) => {
                    self.window = WindowProgress::ReferenceChanged;
                    return Ok(moved);
                }
                Err(shape) => worst = Some(shape),
            }
            count *= 2;
        }
        let shape = worst.unwrap_or_else(|| self.shape(&to.grid));
        Err(MotionError::Tangled {
            shape,
            least: self.limits.min_quality,
            increments: self.limits.max_increments,
        })
    }

    /// Optimises the bad cells of `to` and makes it the reference, so that later solves of the window start from the
    /// repaired cells; `None`, with `to` unchanged, where they do not reach `goal`. Collective.
    fn repair(&mut self, to: &mut Positions, goal: f64) -> Result<Option<MeshQuality>, MotionError> {
        let _part = timing::part("repair");
        if !self.limits.repair {
            return Ok(None);
        }
        let mut at = to.clone();
        untangle(&self.grid, &mut at.grid, self.limits.target());
        let found = self.shape(&at.grid);
        if found.quality < goal || !self.accepts(&found) {
            return Ok(None);
        }
        match self.rebase(&at, found.quality) {
            Ok(()) => {}
            Err(MoverError::Inverted { .. }) => return Ok(None),
            Err(e) => return Err(e.into()),
        }
        to.grid.copy_from_slice(&at.grid);
        Ok(Some(found))
    }

    /// Whether the reference is the start grid: no drift.
    pub fn is_start_reference(&self) -> bool {
        self.at_start
    }

    /// Bytes held for the motion.
    pub fn bytes(&self) -> usize {
        let flat = 2 * self.reference.grid.len()
            + self.u.len()
            + self.small.len()
            + self.canopy_displacement.len()
            + self.start_volumes.len();
        let flat = flat + self.transition.as_ref().map_or(0, |g| g.offset.len());
        8 * (flat + self.follow_limit.len() + self.first_canopy.len())
            + self.grid.bytes()
            + self.mover.bytes()
    }

    /// Accepts a state: makes it the new reference where the quality has decreased and the mover supports it. Returns
    /// the result of a new grid that was due. Collective.
    pub fn accept(&mut self, accepted: &Positions, shape: &MeshQuality) -> Option<Result<NewGrid, String>> {
        let _part = timing::part("grid acceptance");
        self.first_solution = None;
        self.window = WindowProgress::NotStarted;
        self.quality_loss = (self.quality - shape.quality).max(DECAY * self.quality_loss);
        self.quality = shape.quality;
        let new_grid = self.new_grid.take().map(Ok).or_else(|| self.advance_transition(accepted, shape));
        // During a transition the new grid is the reference.
        if self.transition.is_none() {
            self.update_reference(accepted, shape);
        }
        new_grid
    }

    /// Replaces the reference where that is due. Collective.
    fn update_reference(&mut self, accepted: &Positions, shape: &MeshQuality) {
        // A precaution only: the old reference remains where this fails.
        if needs_rebase(shape.quality, self.reference_quality) {
            let mut at = accepted.clone();
            let mut quality = shape.quality;
            if self.limits.repair && quality < REPAIR_BELOW {
                untangle(&self.grid, &mut at.grid, REPAIR_BELOW);
                quality = self.shape(&at.grid).quality;
            }
            let _ = self.rebase(&at, quality);
        } else if !self.at_start
            && is_returning(distance(&accepted.canopy, &self.start.canopy), self.rebase_distance)
        {
            let start = self.start.clone();
            if self.rebase(&start, self.start_quality).is_ok() {
                self.at_start = true;
            }
        }
    }

    /// Quality of the grid at `x` (local nodes). Collective.
    pub fn shape(&self, x: &[f64]) -> MeshQuality {
        let (mut quality, mut worst, mut ratio) = (f64::INFINITY, None, f64::INFINITY);
        self.grid.shapes.each(&self.grid.cells, x, |c, q, volume| {
            if q < quality {
                (quality, worst) = (q, Some(c));
            }
            ratio = lower(ratio, volume / self.start_volumes[c]);
        });
        let (cell, at) = match worst {
            Some(c) => (self.grid.cell_global[c], self.grid.centre(c, x)),
            None => (u32::MAX, [0.0; 3]),
        };
        worst_of_all(self.grid.comm(), MeshQuality { quality, cell, at, volume_ratio: ratio })
    }

    /// The solution for a canopy that differs from the first solution's by a small motion.
    fn linear_update(&mut self, to: &mut Positions) -> Option<MotionResult> {
        let _part = timing::part("linear update");
        let effort = self.first_solution?;
        for ((p, c), a) in self.canopy_displacement.iter_mut().zip(&to.canopy).zip(&self.first_canopy) {
            *p = c - a;
        }
        let canopy_displacement = self.canopy_displacement.as_chunks::<3>().0;
        // The same on every rank: all know the whole canopy.
        let small = |(d, r): (&[f64; 3], &f64)| d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= r * r;
        if !canopy_displacement.iter().zip(&self.follow_limit).all(small) {
            return None;
        }
        self.mover.extend(&self.grid, &self.canopy_displacement, &mut self.small);
        self.set_positions(to);
        for (&a, u) in self.grid.free_node.iter().zip(self.small.as_chunks::<3>().0) {
            to.grid[3 * a as usize..][..3].iter_mut().zip(u).for_each(|(x, u)| *x += u);
        }
        let shape = self.shape(&to.grid);
        self.accepts(&shape).then_some(MotionResult {
            effort: Effort { iterations: 0, ..effort },
            increments: 1,
            shape,
        })
    }

    /// Sets `to` to the reference plus `u`, plus the remaining offset of a transition, plus the canopy.
    fn set_positions(&self, to: &mut Positions) {
        to.grid.copy_from_slice(&self.reference.grid);
        for (&a, u) in self.grid.free_node.iter().zip(self.u.as_chunks::<3>().0) {
            let x = &mut to.grid[3 * a as usize..][..3];
            x.iter_mut().zip(u).for_each(|(x, u)| *x += u);
        }
        if let Some(transition) = &self.transition {
            let fraction = transition.remaining_fraction();
            to.grid.iter_mut().zip(&transition.offset).for_each(|(x, d)| *x += fraction * d);
        }
        self.grid.set_canopy_positions(&to.canopy, &mut to.grid);
    }

    /// Determines the limits of small motions on the reference grid. Collective.
    fn update_follow_limits(&mut self) {
        self.follow_limit =
            near_wall_following::follow_limit(&self.grid, &self.grid.free_sizes(&self.reference.grid));
    }

    fn accepts(&self, shape: &MeshQuality) -> bool {
        shape.quality >= self.limits.min_quality && shape.volume_ratio > 0.0
    }

    /// One linear solve from the reference grid.
    fn solve_from_reference(&mut self, to: &mut Positions) -> Result<Effort, MoverError> {
        let _part = timing::part("solve");
        for ((p, c), r) in self.canopy_displacement.iter_mut().zip(&to.canopy).zip(&self.reference.canopy) {
            *p = c - r;
        }
        let effort = self.mover.displace(&self.grid, &self.canopy_displacement, &mut self.u)?;
        self.set_positions(to);
        Ok(effort)
    }

    fn rebase(&mut self, at: &Positions, quality: f64) -> Result<(), MoverError> {
        let _part = timing::part("reference configuration");
        if let Err(error) = self.mover.rebase(&self.grid, &at.grid) {
            if !matches!(error, MoverError::Inverted { .. }) {
                // Restore the previous reference.
                self.mover.rebase(&self.grid, &self.reference.grid)?;
            }
            return Err(error);
        }
        self.reference.clone_from(at);
        self.reference_quality = quality;
        // Increments start from the present grid: a transition ends.
        self.transition = None;
        self.rebased += 1;
        if self.at_start {
            self.rebase_distance = distance(&at.canopy, &self.start.canopy);
        }
        self.at_start = false;
        self.first_solution = None;
        self.update_follow_limits();
        release_free_memory();
        Ok(())
    }

    /// Moves from `from` in `count` equal increments, with a new reference grid for each. The inner error is the
    /// quality of a grid that was not accepted.
    fn move_in_increments(
        &mut self,
        from: &Positions,
        to: &mut Positions,
        count: u32,
        repair: bool,
        iterations: &mut usize,
    ) -> Result<Result<MotionResult, MeshQuality>, MotionError> {
        let goal = to.canopy.clone();
        let mut at = from.clone();
        let mut shape = self.shape(&at.grid);
        let mut effort = Effort::default();
        let result = (|| {
            for k in 1..=count {
                self.rebase(&at, shape.quality)?;
                let s = f64::from(k) / f64::from(count);
                for ((c, a), b) in to.canopy.iter_mut().zip(&from.canopy).zip(&goal) {
                    *c = if k == count { *b } else { a + s * (b - a) };
                }
                effort = self.solve_from_reference(to)?;
                *iterations += effort.iterations;
                shape = self.shape(&to.grid);
                if !self.accepts(&shape) && repair && self.limits.repair {
                    untangle(&self.grid, &mut to.grid, self.limits.target());
                    shape = self.shape(&to.grid);
                    if k == count && self.accepts(&shape) {
                        // Later solves of this window must start from the repaired grid.
                        self.rebase(to, shape.quality)?;
                    }
                }
                if !self.accepts(&shape) {
                    return Ok(Err(shape));
                }
                at.clone_from(to);
            }
            Ok(Ok(MotionResult {
                effort: Effort { iterations: *iterations, ..effort },
                increments: count,
                shape,
            }))
        })();
        to.canopy.copy_from_slice(&goal);
        match result {
            // A coarser increment may fail where a finer one succeeds.
            Err(MotionError::Mover(MoverError::NotConverged { .. })) if !repair => Ok(Err(shape)),
            Err(MotionError::Mover(MoverError::Inverted { .. })) if count > 1 => Ok(Err(shape)),
            other => other,
        }
    }
}

impl LocalGrid {
    /// Sets the canopy nodes of `x` to `canopy` (all of it).
    pub fn set_canopy_positions(&self, canopy: &[f64], x: &mut [f64]) {
        for &(a, k) in &self.canopy {
            x[3 * a as usize..][..3].copy_from_slice(&canopy[3 * k as usize..][..3]);
        }
    }

    /// Whether local node `a` is free, unconstrained and owned here.
    pub(crate) fn is_owned_and_movable(&self, a: u32) -> bool {
        let slides = |i: u32| self.slides.binary_search_by_key(&i, |s| s.free).is_ok();
        matches!(self.kind[a as usize], Kind::Free(i) if (i as usize) < self.n_free && !slides(i))
    }
}

impl MeshQuality {
    /// The worse of two sets of cells; ties are resolved by the lower cell index, so that the result does not depend
    /// on the order.
    fn worse(&self, other: &Self) -> Self {
        let mine = self.quality < other.quality || (self.quality == other.quality && self.cell < other.cell);
        let worst = if mine { self } else { other };
        Self { volume_ratio: self.volume_ratio.min(other.volume_ratio), ..*worst }
    }
}

/// Whether a grid of quality `now` replaces a reference of quality `reference`.
fn needs_rebase(now: f64, reference: f64) -> bool {
    now < REBASE_BELOW && now < REBASE_LOSS * reference
}

/// Whether a canopy at `distance` from its start is returning to it, after the reference was changed at
/// `rebase_distance`.
fn is_returning(distance: f64, rebase_distance: f64) -> bool {
    distance < RETURN_DISTANCE * rebase_distance
}

/// Largest distance between two positions of a node, m.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let pairs = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    pairs.map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>()).fold(0.0, f64::max).sqrt()
}

/// The worst over all ranks.
fn worst_of_all(comm: &Comm, own: MeshQuality) -> MeshQuality {
    if comm.size() == 1 {
        return own;
    }
    let row = [own.quality, f64::from(own.cell), own.at[0], own.at[1], own.at[2], own.volume_ratio];
    let all = comm.all_gather_var(&row);
    all.as_chunks::<6>().0.iter().fold(own, |worst, r| {
        let at = [r[2], r[3], r[4]];
        worst.worse(&MeshQuality { quality: r[0], cell: r[1] as u32, at, volume_ratio: r[5] })
    })
}

#[cfg(test)]
mod tests;
