//! Slabs of a grid along z, one for each rank.
//!
//! Every rank holds the arrays of the whole grid, and what the surface needs of it. A rank computes its own planes, and the two next to them
//! follow by exchange; its values in other planes are out of date. One loop serves any number of ranks: on one rank the slab is the grid.

use std::fmt::Debug;
use std::ops::Range;
use std::rc::Rc;

use crate::grid::{GHOSTS, Grid, Velocity};

/// The ranks that compute one flow. All calls are collective.
pub trait Ranks: Debug {
    /// This rank, counted from 0.
    fn rank(&self) -> usize;
    /// Number of ranks.
    fn size(&self) -> usize;
    /// Sum of each entry over the ranks, the same digits on each.
    fn sum(&self, values: &mut [f64]);
    /// Maximum of each entry over the ranks.
    fn largest(&self, values: &mut [f64]);
    /// `send` holds `sent[r]` numbers for each rank r in turn; `receive` gets `received[r]` from each.
    fn all_to_all(&self, send: &[f64], sent: &[usize], receive: &mut [f64], received: &[usize]);
    /// Sends to the next rank (`up`) or the one before, and receives from the other side.
    fn shift(&self, up: bool, send: &[f64], receive: &mut [f64]);
    /// Completes `values`, of which rank r has set the part up to `ends[r]`.
    fn gather(&self, values: &mut [f64], ends: &[usize]);
}

/// One rank.
#[derive(Clone, Copy, Debug)]
pub struct Alone;

impl Ranks for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn sum(&self, _: &mut [f64]) {}

    fn largest(&self, _: &mut [f64]) {}

    fn all_to_all(&self, send: &[f64], _: &[usize], receive: &mut [f64], _: &[usize]) {
        receive.copy_from_slice(send);
    }

    fn shift(&self, _: bool, _: &[f64], _: &mut [f64]) {}

    fn gather(&self, _: &mut [f64], _: &[usize]) {}
}

/// More ranks than the grid has slabs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the grid has {planes} cells along z, {GHOSTS} or more for each rank of the flow: set ranks.flow to {} at most", planes / GHOSTS)]
pub struct TooManyRanks {
    /// Cells along z.
    pub planes: usize,
}

/// The part of a grid that this rank computes.
#[derive(Clone, Debug)]
pub struct Slabs {
    ranks: Rc<dyn Ranks>,
    /// Cells along z of the grid, and those of this rank.
    planes: usize,
    own: Range<usize>,
    /// Length of a plane in an array with ghosts.
    stride: usize,
}

impl Slabs {
    /// Slabs of `grid`.
    ///
    /// # Errors
    /// A slab would have fewer planes than its neighbours need of it.
    pub fn new(ranks: Rc<dyn Ranks>, grid: &Grid) -> Result<Self, TooManyRanks> {
        let planes = grid.cells()[2];
        if ranks.size() > 1 && planes / ranks.size() < GHOSTS {
            return Err(TooManyRanks { planes });
        }
        let own = share(planes, ranks.rank(), ranks.size());
        Ok(Self { ranks, planes, own, stride: grid.strides[2] })
    }

    /// The ranks.
    pub fn ranks(&self) -> &Rc<dyn Ranks> {
        &self.ranks
    }

    /// Whether there is one rank only.
    pub fn alone(&self) -> bool {
        self.ranks.size() == 1
    }

    /// Own cells along z.
    pub fn own(&self) -> Range<usize> {
        self.own.clone()
    }

    /// Own share of `count` things that are dealt out in order.
    pub fn share(&self, count: usize) -> Range<usize> {
        share(count, self.ranks.rank(), self.ranks.size())
    }

    /// Whether the slab has the lowest and the highest cells.
    pub fn ends(&self) -> [bool; 2] {
        [self.own.start == 0, self.own.end == self.planes]
    }

    /// Positions in an array of the planes `range` along z, counted from the first cell.
    pub fn positions(&self, range: Range<isize>) -> Range<usize> {
        let of = |z: isize| (z + GHOSTS as isize) as usize * self.stride;
        of(range.start)..of(range.end)
    }

    /// Planes along z that this rank sets: its own, and the ghosts and the boundary faces at the ends of the grid.
    pub fn set_planes(&self) -> Range<isize> {
        let [lowest, highest] = self.ends();
        let ghosts = |end: bool| if end { GHOSTS as isize } else { 0 };
        self.own.start as isize - ghosts(lowest)..self.own.end as isize + ghosts(highest)
    }

    /// Brings the planes next to the own ones from their ranks.
    pub fn exchange(&self, u: &mut Velocity) {
        for values in u {
            self.exchange_layers(values, GHOSTS);
        }
    }

    /// Brings `layers` planes on each side of the own ones from their ranks.
    pub fn exchange_layers(&self, values: &mut [f64], layers: usize) {
        if self.alone() {
            return;
        }
        let (start, end, ghosts) = (self.own.start as isize, self.own.end as isize, layers as isize);
        self.move_planes(true, values, end - ghosts..end, start - ghosts..start);
        self.move_planes(false, values, start..start + ghosts, end..end + ghosts);
    }

    /// Brings the lower faces of the cells above the slab, which close the slab's own cells.
    pub fn close(&self, u: &mut Velocity) {
        if !self.alone() {
            let (start, end) = (self.own.start as isize, self.own.end as isize);
            self.move_planes(false, &mut u[2], start..start + 1, end..end + 1);
        }
    }

    /// Sends the planes `own` in one direction; those of the rank on the other side become `other`.
    fn move_planes(&self, up: bool, values: &mut [f64], own: Range<isize>, other: Range<isize>) {
        let (own, other) = (self.positions(own), self.positions(other));
        let (send, receive) = if own.start < other.start {
            let (low, high) = values.split_at_mut(other.start);
            (&low[own], &mut high[..other.len()])
        } else {
            let (low, high) = values.split_at_mut(own.start);
            (&high[..own.len()], &mut low[other])
        };
        self.ranks.shift(up, send, receive);
    }

    /// Completes an array with ghosts on every rank.
    pub fn gather(&self, values: &mut [f64]) {
        if self.alone() {
            return;
        }
        let size = self.ranks.size();
        let end = |rank: usize| match rank + 1 {
            last if last == size => values.len(),
            next => (share(self.planes, next, size).start + GHOSTS) * self.stride,
        };
        let ends: Vec<usize> = (0..size).map(end).collect();
        self.ranks.gather(values, &ends);
    }

    /// Completes an array of `plane` values for each cell along z, without ghosts.
    pub fn gather_cells(&self, values: &mut [f64], plane: usize) {
        if !self.alone() {
            let size = self.ranks.size();
            let ends: Vec<usize> = (0..size).map(|r| share(self.planes, r, size).end * plane).collect();
            self.ranks.gather(values, &ends);
        }
    }
}

/// Share of rank `rank` of `count` things that are dealt out in order; of fewer things than ranks the first ranks have one each.
pub fn share(count: usize, rank: usize, size: usize) -> Range<usize> {
    let size = size.min(count.max(1));
    let rank = rank.min(size);
    if rank == size {
        return count..count;
    }
    count * rank / size..count * (rank + 1) / size
}
