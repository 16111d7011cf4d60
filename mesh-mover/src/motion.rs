//! A grid that follows the canopy and stays usable: total form first, then
//! increments with an updated reference, then local untangling, then an error.

mod regrid;

use comm::Comm;
use mesh::Point;

use crate::allocator::release_free_memory;
use crate::local::{Kind, LocalGrid};
use crate::memory::MotionMemory;
use crate::mover::{Effort, Mover, MoverError};
use crate::near;
use crate::quality::{lower, volume};
use crate::untangle::untangle;
pub use regrid::{Builder, Glide, NewGrid, Regridder};

/// What a moved grid must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Smallest scaled Jacobian that is accepted.
    pub min_quality: f64,
    /// Most sub-increments of one motion.
    pub max_increments: u32,
    /// Whether cells are optimised where the mover alone leaves them in bad shape.
    pub repair: bool,
}

impl Limits {
    /// Quality that a repair aims at: well above the least one, where cells can be that good.
    fn aim(&self) -> f64 {
        (4.0 * self.min_quality).min(REPAIR_BELOW.max(1.1 * self.min_quality))
    }

    /// In the first call of a window cells are repaired already below this: later calls, whose canopies
    /// differ a little, then find it done. A repair in one call and not in the next would be a
    /// jump of the grid that the coupling does not understand.
    fn soon(&self) -> f64 {
        (2.0 * self.min_quality).min(0.5 * (self.min_quality + self.aim()))
    }
}

/// The grid is based anew once its worst cell is below this and below
/// [`REBASE_LOSS`] of the quality that its reference grid had: stiffening then protects
/// the cells that are now bad, at the price of drift (see [`Motion`]). Measured on a
/// plate lifted, turned and bent in a box: with 0.3 the worst cell ends at a
/// third of the quality, with 1.0 at the same quality for twice the assemblies.
const REBASE_BELOW: f64 = 0.5;
/// See [`REBASE_BELOW`].
const REBASE_LOSS: f64 = 0.7;
/// A new reference is optimised where its cells are worse than this: the next answers go there.
const REPAIR_BELOW: f64 = 0.25;
/// The largest loss of quality in a window counts less by this in each later one.
const FADING: f64 = 0.7;
/// The canopy is on its way back to the start once it is nearer to it than this share of the
/// distance at which the start grid was given up as reference: it becomes the reference again.
const RETURN: f64 = 0.5;

/// Shape of the grid: the same values on all ranks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Smallest scaled Jacobian.
    pub quality: f64,
    /// Global cell that has it.
    pub cell: u32,
    /// Its centre, m.
    pub at: Point,
    /// Smallest ratio of a cell's volume to its volume at the start.
    pub volume_ratio: f64,
}

/// How the grid got there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// Iterations of all solves, error of the last.
    pub effort: Effort,
    /// Increments: 1 unless the total form failed.
    pub increments: u32,
    /// What came out.
    pub shape: Shape,
}

/// Why the grid cannot follow.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// The mover has no answer.
    #[error(transparent)]
    Mover(#[from] MoverError),
    /// All means failed.
    #[error(
        "the grid cannot follow the canopy: cell {} at ({:.4}, {:.4}, {:.4}) m has scaled Jacobian {:.3e} \
         (accepted: {least:.1e}) after {increments} increments and untangling",
        shape.cell, shape.at[0], shape.at[1], shape.at[2], shape.quality
    )]
    Tangled {
        /// The best grid found.
        shape: Shape,
        /// Scaled Jacobian that was asked for.
        least: f64,
        /// Increments tried.
        increments: u32,
    },
    /// The start grid is not usable.
    #[error(
        "cell {} of the start grid, at ({:.4}, {:.4}, {:.4}) m, has scaled Jacobian {:.3e} (accepted: \
         {least:.1e}): lower mesh.min_quality, or change flow.grid",
        shape.cell, shape.at[0], shape.at[1], shape.at[2], shape.quality
    )]
    BadStart {
        /// The worst cell.
        shape: Shape,
        /// Scaled Jacobian that was asked for.
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
/// **Drift.** In the total form positions depend on the canopy's position alone
/// (to the solver's tolerance; exactly for the start shape), however it got
/// there. Each new reference grid replaces that start by the grid at hand: from
/// then on the grid returns to that one, until the canopy is half way back to its
/// start: then the start grid is the reference again, and all drift is gone.
/// [`Motion::rebased`] counts the changes. A new grid (`mesh.regrid`) is a new start.
pub struct Motion {
    /// The grid's topology.
    pub grid: LocalGrid,
    mover: Box<dyn Mover>,
    limits: Limits,
    start_volumes: Vec<f64>,
    start: Positions,
    start_quality: f64,
    /// Distance of the canopy from its start where that was last given up as reference, m.
    left: f64,
    reference: Positions,
    reference_quality: f64,
    rebased: u32,
    /// Whether the reference is the start grid.
    at_start: bool,
    /// Displacement of the canopy from the reference, and of the local free nodes.
    push: Vec<f64>,
    u: Vec<f64>,
    /// Largest small motion of each canopy node, m.
    reach: Vec<f64>,
    anchor: Option<Anchor>,
    /// Canopy of the anchor (used while there is one).
    anchor_canopy: Vec<f64>,
    regridder: Option<Regridder>,
    glide: Option<Glide>,
    new_grids: u32,
    /// A new grid that was made within the window.
    news: Option<NewGrid>,
    /// What this window has come to.
    window: Stage,
    /// Quality of the last accepted window, and what a window takes from it at most (fading).
    quality: f64,
    fall: f64,
}

/// Means that a window has used. Later calls of it do not go back behind them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Nothing was asked yet.
    Fresh,
    /// One solve from the reference of the window's start.
    Linear,
    /// The reference was changed within the window: it holds increments and repairs.
    Held,
}

/// The first answer of a window: `u` holds its grid, small motions are counted from it.
#[derive(Clone, Copy)]
struct Anchor {
    /// Shape of the cells that small motions leave alone.
    far: Shape,
    effort: Effort,
}

impl Motion {
    /// Starts at `start`; a grid that was moved before continues on `reference`. Collective.
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
        let (push, u) = (vec![0.0; 3 * grid.n_canopy], vec![0.0; 3 * grid.free_node.len()]);
        let at_start = grid.comm().all(reference.grid == start.grid);
        let mut motion = Self {
            grid,
            mover,
            limits,
            start_volumes,
            start_quality: 1.0,
            left: distance(&reference.canopy, &start.canopy),
            start,
            reference,
            reference_quality: 1.0,
            rebased: 0,
            at_start,
            push,
            u,
            reach: Vec::new(),
            anchor: None,
            anchor_canopy: Vec::new(),
            regridder: None,
            glide: None,
            new_grids: 0,
            news: None,
            window: Stage::Fresh,
            quality: 1.0,
            fall: 0.0,
        };
        let shape = motion.shape(&motion.reference.grid);
        if !motion.accepts(&shape) {
            return Err(MotionError::BadStart { shape, least: limits.min_quality });
        }
        (motion.reference_quality, motion.quality) = (shape.quality, shape.quality);
        motion.start_quality =
            if at_start { shape.quality } else { motion.shape(&motion.start.grid).quality };
        motion.mover.rebase(&motion.grid, &motion.reference.grid)?;
        motion.measure();
        release_free_memory();
        Ok(motion)
    }

    /// What later windows depend on beside positions, between windows.
    pub fn memory(&self) -> MotionMemory {
        MotionMemory {
            qualities: [self.start_quality, self.reference_quality, self.quality],
            left: self.left,
            fall: self.fall,
            next_grid: self.regridder.as_ref().map(Regridder::next),
            rebased: self.rebased,
            new_grids: self.new_grids,
            at_start: self.at_start,
            mover: self.mover.memory(),
        }
    }

    /// Takes up a [`Motion::memory`] of the same start and reference.
    ///
    /// # Errors
    /// What in it does not fit.
    pub fn recall(&mut self, memory: MotionMemory) -> Result<(), String> {
        [self.start_quality, self.reference_quality, self.quality] = memory.qualities;
        (self.left, self.fall) = (memory.left, memory.fall);
        (self.rebased, self.new_grids, self.at_start) = (memory.rebased, memory.new_grids, memory.at_start);
        if let (Some(regridder), Some(next)) = (&mut self.regridder, memory.next_grid) {
            regridder.set_next(next);
        }
        self.mover.recall(memory.mover)
    }

    /// The grid that displacements are counted from.
    pub fn reference(&self) -> &Positions {
        &self.reference
    }

    /// What a moved grid must keep.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// How often the reference grid was replaced.
    pub fn rebased(&self) -> u32 {
        self.rebased
    }

    /// Moves the grid so that the canopy is at `to.canopy`; `from` is the last
    /// accepted state, where increments start. Fills `to.grid`; canopy nodes
    /// get their positions to the bit. Calls between two [`Motion::settle`] whose canopies
    /// are a small motion apart (see [`near`]) differ near the canopy only. Collective.
    ///
    /// # Errors
    /// [`MotionError`]; the accepted state is untouched.
    pub fn follow(&mut self, from: &Positions, to: &mut Positions) -> Result<Moved, MotionError> {
        let _part = timing::part("motion");
        if let Some(moved) = self.near_anchor(to) {
            return Ok(moved);
        }
        self.anchor = None;
        let stage = std::mem::replace(&mut self.window, Stage::Linear);
        let mut iterations = 0;
        match self.total(to) {
            Ok(effort) => {
                if let Some(moved) = self.judge(to, effort, stage)? {
                    return Ok(moved);
                }
                iterations += effort.iterations;
            }
            Err(MoverError::NotConverged { iterations: n, .. }) => iterations += n,
            Err(e) => return Err(e.into()),
        }
        self.ever_finer_increments(from, to, iterations)
    }

    /// What becomes of the total form's grid in `to`: taken as it is, repaired, replaced by a new grid, or
    /// (`None`) not accepted. `stage` is what the window had come to before. Collective.
    fn judge(
        &mut self,
        to: &mut Positions,
        effort: Effort,
        stage: Stage,
    ) -> Result<Option<Moved>, MotionError> {
        let _part = timing::part("cell quality");
        let mut parts = self.near_and_far(&to.grid);
        // A canopy that outruns the way to a new grid is followed there at once.
        if self.is_late(&parts[0].worse(&parts[1]), stage) && self.end_way() {
            self.place(to);
            parts = self.near_and_far(&to.grid);
        }
        let [near, far] = parts;
        let shape = near.worse(&far);
        let accepted = self.accepts(&shape);
        let early = stage == Stage::Fresh && shape.quality < self.limits.soon();
        // A window that has left the linear form is repaired where it stands.
        let wanted = if accepted { early } else { stage == Stage::Held };
        let goal = if early { self.limits.soon() } else { self.limits.min_quality };
        let mut found = None;
        if self.is_late(&shape, stage) {
            found = self.new_grid_at_once(to, &shape)?;
        }
        if found.is_none() && wanted {
            found = self.repair(to, goal)?;
        }
        if let Some(shape) = found {
            self.window = Stage::Held;
            return Ok(Some(Moved { effort, increments: 1, shape }));
        }
        if !accepted {
            return Ok(None);
        }
        if stage == Stage::Held {
            self.window = stage;
        }
        self.anchor = Some(Anchor { far, effort });
        self.anchor_canopy.clone_from(&to.canopy);
        Ok(Some(Moved { effort, increments: 1, shape }))
    }

    /// From the accepted state in 1, 2, 4 ... increments until a grid is accepted; `iterations` were made before.
    /// Collective.
    fn ever_finer_increments(
        &mut self,
        from: &Positions,
        to: &mut Positions,
        mut iterations: usize,
    ) -> Result<Moved, MotionError> {
        let _part = timing::part("increments");
        let mut worst = None;
        let mut count = 1;
        while count <= self.limits.max_increments {
            let last = 2 * count > self.limits.max_increments;
            match self.in_increments(from, to, count, last, &mut iterations)? {
                Ok(moved) => {
                    self.window = Stage::Held;
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

    /// Makes the bad cells of `to` better and takes it as the reference, so that later calls of the
    /// window start from the repaired cells; `None`, and `to` as it was, where they do not become
    /// as good as `goal`. Collective.
    fn repair(&mut self, to: &mut Positions, goal: f64) -> Result<Option<Shape>, MotionError> {
        let _part = timing::part("repair");
        if !self.limits.repair {
            return Ok(None);
        }
        let mut at = to.clone();
        untangle(&self.grid, &mut at.grid, self.limits.aim());
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

    /// Whether the reference is the start grid: nothing has drifted.
    pub fn is_total(&self) -> bool {
        self.at_start
    }

    /// Bytes held for the motion.
    pub fn bytes(&self) -> usize {
        let flat = 2 * self.reference.grid.len() + self.u.len() + self.push.len() + self.start_volumes.len();
        let flat = flat + self.glide.as_ref().map_or(0, |g| g.offset.len());
        8 * (flat + self.reach.len() + self.anchor_canopy.len()) + self.grid.bytes() + self.mover.bytes()
    }

    /// To be called with an accepted state: takes it as the new reference where
    /// quality has fallen far and the mover can stand on it. Says what came of a new grid
    /// that was due. Collective.
    pub fn settle(&mut self, accepted: &Positions, shape: &Shape) -> Option<Result<NewGrid, String>> {
        let _part = timing::part("grid acceptance");
        self.anchor = None;
        self.window = Stage::Fresh;
        self.fall = (self.quality - shape.quality).max(FADING * self.fall);
        self.quality = shape.quality;
        let news = self.news.take().map(Ok).or_else(|| self.go_on(accepted, shape));
        // On the way to a new grid that is the reference.
        if self.glide.is_none() {
            self.protect(accepted, shape);
        }
        news
    }

    /// A better reference where one is due. Collective.
    fn protect(&mut self, accepted: &Positions, shape: &Shape) {
        // All of this is not a need but a precaution: the old reference still serves where it fails.
        if has_fallen(shape.quality, self.reference_quality) {
            let mut at = accepted.clone();
            let mut quality = shape.quality;
            if self.limits.repair && quality < REPAIR_BELOW {
                untangle(&self.grid, &mut at.grid, REPAIR_BELOW);
                quality = self.shape(&at.grid).quality;
            }
            let _ = self.rebase(&at, quality);
        } else if !self.at_start && is_back(distance(&accepted.canopy, &self.start.canopy), self.left) {
            let start = self.start.clone();
            if self.rebase(&start, self.start_quality).is_ok() {
                self.at_start = true;
            }
        }
    }

    /// Shape of the grid at `x` (local nodes). Collective.
    pub fn shape(&self, x: &[f64]) -> Shape {
        let [near, far] = self.near_and_far(x);
        near.worse(&far)
    }

    /// Shapes of the cells that small motions touch, and of all others. Collective.
    fn near_and_far(&self, x: &[f64]) -> [Shape; 2] {
        let near = self.worst_in(self.grid.near_cells.iter().cloned(), x);
        let ends = self.grid.near_cells.iter().map(|r| r.start).chain([self.grid.cells.len()]);
        let starts = [0].into_iter().chain(self.grid.near_cells.iter().map(|r| r.end));
        let far = self.worst_in(starts.zip(ends).map(|(a, b)| a..b), x);
        worst_of_all(self.grid.comm(), [near, far])
    }

    /// The worst of this rank's cells in `runs`.
    fn worst_in(&self, runs: impl Iterator<Item = std::ops::Range<usize>>, x: &[f64]) -> Shape {
        let (mut quality, mut worst, mut ratio) = (f64::INFINITY, None, f64::INFINITY);
        for run in runs {
            self.grid.shapes.each(&self.grid.cells, run, x, |c, p, q| {
                if q < quality {
                    (quality, worst) = (q, Some(c));
                }
                ratio = lower(ratio, volume(p) / self.start_volumes[c]);
            });
        }
        let (cell, at) = match worst {
            Some(c) => (self.grid.cell_global[c], self.grid.centre(c, x)),
            None => (u32::MAX, [0.0; 3]),
        };
        Shape { quality, cell, at, volume_ratio: ratio }
    }

    /// The answer for a canopy that is a small motion away from the anchor's.
    fn near_anchor(&mut self, to: &mut Positions) -> Option<Moved> {
        let _part = timing::part("linear update");
        let Anchor { far, effort } = self.anchor?;
        for ((p, c), a) in self.push.iter_mut().zip(&to.canopy).zip(&self.anchor_canopy) {
            *p = c - a;
        }
        let push = self.push.as_chunks::<3>().0;
        // The same on every rank: all know the whole canopy.
        let small = |(d, r): (&[f64; 3], &f64)| d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= r * r;
        if !push.iter().zip(&self.reach).all(small) {
            return None;
        }
        self.place(to);
        for row in &self.grid.near {
            let x = &mut to.grid[3 * self.grid.free_node[row.free as usize] as usize..][..3];
            let d = &self.push[3 * row.canopy as usize..][..3];
            let share = f64::from(row.share);
            x.iter_mut().zip(d).for_each(|(x, d)| *x += share * d);
        }
        let near = self.worst_in(self.grid.near_cells.iter().cloned(), &to.grid);
        let [near] = worst_of_all(self.grid.comm(), [near]);
        let shape = near.worse(&far);
        self.accepts(&shape).then_some(Moved {
            effort: Effort { iterations: 0, ..effort },
            increments: 1,
            shape,
        })
    }

    /// Puts reference plus `u`, what is left of the way to it, and the canopy into `to`.
    fn place(&self, to: &mut Positions) {
        to.grid.copy_from_slice(&self.reference.grid);
        for (&a, u) in self.grid.free_node.iter().zip(self.u.as_chunks::<3>().0) {
            let x = &mut to.grid[3 * a as usize..][..3];
            x.iter_mut().zip(u).for_each(|(x, u)| *x += u);
        }
        if let Some(glide) = &self.glide {
            let rest = glide.rest();
            to.grid.iter_mut().zip(&glide.offset).for_each(|(x, d)| *x += rest * d);
        }
        self.grid.place_canopy(&to.canopy, &mut to.grid);
    }

    /// Measures how far small motions go on the reference grid. Collective.
    fn measure(&mut self) {
        self.reach = near::reach(&self.grid, &self.grid.free_sizes(&self.reference.grid));
    }

    fn accepts(&self, shape: &Shape) -> bool {
        shape.quality >= self.limits.min_quality && shape.volume_ratio > 0.0
    }

    /// One linear solve from the reference grid.
    fn total(&mut self, to: &mut Positions) -> Result<Effort, MoverError> {
        let _part = timing::part("solve");
        for ((p, c), r) in self.push.iter_mut().zip(&to.canopy).zip(&self.reference.canopy) {
            *p = c - r;
        }
        let effort = self.mover.displace(&self.grid, &self.push, &mut self.u)?;
        self.place(to);
        Ok(effort)
    }

    fn rebase(&mut self, at: &Positions, quality: f64) -> Result<(), MoverError> {
        let _part = timing::part("reference configuration");
        if let Err(error) = self.mover.rebase(&self.grid, &at.grid) {
            if !matches!(error, MoverError::Inverted { .. }) {
                // Back to where it stood.
                self.mover.rebase(&self.grid, &self.reference.grid)?;
            }
            return Err(error);
        }
        self.reference.clone_from(at);
        self.reference_quality = quality;
        // Increments start from where the grid is: no way is left.
        self.glide = None;
        self.rebased += 1;
        if self.at_start {
            self.left = distance(&at.canopy, &self.start.canopy);
        }
        self.at_start = false;
        self.anchor = None;
        self.measure();
        release_free_memory();
        Ok(())
    }

    /// Goes from `from` in `count` equal increments, with a new reference grid
    /// for each. The inner error is the grid that was not accepted.
    fn in_increments(
        &mut self,
        from: &Positions,
        to: &mut Positions,
        count: u32,
        repair: bool,
        iterations: &mut usize,
    ) -> Result<Result<Moved, Shape>, MotionError> {
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
                effort = self.total(to)?;
                *iterations += effort.iterations;
                shape = self.shape(&to.grid);
                if !self.accepts(&shape) && repair && self.limits.repair {
                    untangle(&self.grid, &mut to.grid, self.limits.aim());
                    shape = self.shape(&to.grid);
                    if k == count && self.accepts(&shape) {
                        // Later iterations of this window must start from the repaired grid.
                        self.rebase(to, shape.quality)?;
                    }
                }
                if !self.accepts(&shape) {
                    return Ok(Err(shape));
                }
                at.clone_from(to);
            }
            Ok(Ok(Moved { effort: Effort { iterations: *iterations, ..effort }, increments: count, shape }))
        })();
        to.canopy.copy_from_slice(&goal);
        match result {
            // A coarser increment may fail where a finer one does not.
            Err(MotionError::Mover(MoverError::NotConverged { .. })) if !repair => Ok(Err(shape)),
            Err(MotionError::Mover(MoverError::Inverted { .. })) if count > 1 => Ok(Err(shape)),
            other => other,
        }
    }
}

impl LocalGrid {
    /// Puts the canopy nodes of `x` where `canopy` (all of it) is.
    pub fn place_canopy(&self, canopy: &[f64], x: &mut [f64]) {
        for &(a, k) in &self.canopy {
            x[3 * a as usize..][..3].copy_from_slice(&canopy[3 * k as usize..][..3]);
        }
    }

    /// Whether local node `a` is free to go anywhere and owned here.
    pub(crate) fn is_mine_to_move(&self, a: u32) -> bool {
        let slides = |i: u32| self.slides.binary_search_by_key(&i, |s| s.free).is_ok();
        matches!(self.kind[a as usize], Kind::Free(i) if (i as usize) < self.n_free && !slides(i))
    }
}

impl Shape {
    /// Of two sets of cells together; ties go to the lowest cell, so that the answer does
    /// not depend on who looked first.
    fn worse(&self, other: &Self) -> Self {
        let mine = self.quality < other.quality || (self.quality == other.quality && self.cell < other.cell);
        let worst = if mine { self } else { other };
        Self { volume_ratio: self.volume_ratio.min(other.volume_ratio), ..*worst }
    }
}

/// Whether a grid of quality `now` is to be the reference in the place of one that had `reference`.
fn has_fallen(now: f64, reference: f64) -> bool {
    now < REBASE_BELOW && now < REBASE_LOSS * reference
}

/// Whether a canopy `distance` away from its start is on its way back to it, which was `left` at that distance.
fn is_back(distance: f64, left: f64) -> bool {
    distance < RETURN * left
}

/// Largest distance between two positions of a node, m.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let pairs = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    pairs.map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>()).fold(0.0, f64::max).sqrt()
}

/// The worst over ranks, of several sets of cells at once.
fn worst_of_all<const N: usize>(comm: &Comm, own: [Shape; N]) -> [Shape; N] {
    if comm.size() == 1 {
        return own;
    }
    let rows = own.map(|s| [s.quality, f64::from(s.cell), s.at[0], s.at[1], s.at[2], s.volume_ratio]);
    let all = comm.all_gather_var(rows.as_flattened());
    let mut worst = own;
    for rows in all.chunks(6 * N) {
        for (worst, r) in worst.iter_mut().zip(rows.as_chunks::<6>().0) {
            let at = [r[2], r[3], r[4]];
            *worst = worst.worse(&Shape { quality: r[0], cell: r[1] as u32, at, volume_ratio: r[5] });
        }
    }
    worst
}

#[cfg(test)]
mod tests;
