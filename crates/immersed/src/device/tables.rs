//! What the kernels know of the grid.

use super::Address;
use super::queue::{Buffer, Queue};
use crate::far_field::FarField;
use crate::grid::{End, Ends, GHOSTS, Grid};
use crate::momentum::{Line, shares};
use crate::poisson::Poisson;

/// Numbers of one axis after another in one buffer.
#[derive(Debug, Default)]
pub(crate) struct Packed(Vec<f64>);

impl Packed {
    pub(crate) fn values(&self) -> &[f64] {
        &self.0
    }

    /// Adds numbers; returns the place of the first.
    pub(crate) fn push(&mut self, values: impl IntoIterator<Item = f64>) -> usize {
        let start = self.0.len();
        self.0.extend(values);
        start
    }
}

/// Constant numbers of a grid on the device.
#[derive(Debug)]
pub(crate) struct Tables {
    /// Cells along x, y, z and the distances of neighbours along y and z, as the kernels have them.
    pub(crate) grid: [usize; 5],
    /// Conditions at the low and the high end of each axis as the kernels number them.
    pub(crate) ends: [[usize; 2]; 3],
    packed: Buffer,
    distance: [[usize; 3]; 3],
    width: [[usize; 3]; 3],
    shares: [usize; 3],
    widths: [usize; 3],
    inverse_widths: [usize; 3],
    inverse: [usize; 3],
    coupling: usize,
    /// The far field in each plane with its ghosts, what it changes in a step and the rates of the undisturbed air, three components each.
    layers: Buffer,
    planes: usize,
    pub(crate) modes: [Buffer; 2],
    pub(crate) pivots: Buffer,
}

impl Tables {
    pub(crate) fn new(queue: &Queue, grid: &Grid, poisson: &Poisson) -> Self {
        let code = |end: End| match end {
            End::Inflow => 0,
            End::Slip => 1,
            End::Outflow => 2,
        };
        let ends = grid.ends.map(|ends| match ends {
            Ends::Open(both) => both.map(code),
            Ends::Periodic => [3; 2],
        });
        let mut packed = Packed::default();
        let axes = [0, 1, 2];
        let mut of_line = |c: usize, d: usize| {
            let line = Line::new(grid, c, d);
            [packed.push(line.distance), packed.push(line.width)]
        };
        let lines = axes.map(|c| axes.map(|d| of_line(c, d)));
        let n = grid.cells();
        let shares = axes.map(|c| packed.push((0..n[c]).flat_map(|i| shares(grid, c, i))));
        let widths = axes.map(|d| packed.push(grid.axes[d].widths.iter().copied()));
        let inverse_widths = axes.map(|d| packed.push(grid.axes[d].widths.iter().map(|w| 1.0 / w)));
        let inverse = axes.map(|d| packed.push((0..=n[d]).map(|i| 1.0 / grid.centre_distance(d, i))));
        let coupling = packed.push(poisson.coupling().iter().copied());
        let planes = n[2] + 2 * GHOSTS;
        Self {
            grid: [n[0], n[1], n[2], grid.strides[1], grid.strides[2]],
            ends,
            packed: queue.numbers(&packed.0),
            distance: lines.map(|of_c| of_c.map(|l| l[0])),
            width: lines.map(|of_c| of_c.map(|l| l[1])),
            shares,
            widths,
            inverse_widths,
            inverse,
            coupling,
            layers: queue.buffer(9 * planes),
            planes,
            modes: [0, 1].map(|d| queue.numbers(&poisson.modes(d))),
            pivots: queue.numbers(poisson.pivots()),
        }
    }

    /// Words of the lines of component `c`: distances, widths, shares.
    pub(crate) fn lines(&self, c: usize) -> [Address; 7] {
        let [[a, b, e], [f, g, h]] = [self.distance[c], self.width[c]];
        [a, b, e, f, g, h, self.shares[c]].map(|at| self.packed.at(at))
    }

    pub(crate) fn widths(&self) -> [Address; 3] {
        self.widths.map(|at| self.packed.at(at))
    }

    pub(crate) fn inverse_widths(&self) -> [Address; 3] {
        self.inverse_widths.map(|at| self.packed.at(at))
    }

    /// Inverse distances of the centres.
    pub(crate) fn inverse(&self) -> [Address; 3] {
        self.inverse.map(|at| self.packed.at(at))
    }

    pub(crate) fn coupling(&self) -> Address {
        self.packed.at(self.coupling)
    }

    /// The far field of each component, from the lowest ghost on.
    pub(crate) fn far(&self) -> [Address; 3] {
        [0, 1, 2].map(|c| self.layers.at(c * self.planes))
    }

    /// What the far field changes in a step, in each plane of component `c`.
    pub(crate) fn change(&self, c: usize) -> Address {
        self.layers.at((3 + c) * self.planes)
    }

    /// Rates of the undisturbed air in each plane of component `c`.
    pub(crate) fn undisturbed(&self, c: usize) -> Address {
        self.layers.at((6 + c) * self.planes)
    }

    /// Sets the far field.
    pub(crate) fn set_far(&self, queue: &Queue, far: &FarField) {
        let ghosts = GHOSTS as isize;
        let layers = (0..3).flat_map(|c| (0..self.planes as isize).map(move |k| far.at(c, k - ghosts)));
        queue.upload(self.layers.at(0), &layers.collect::<Vec<_>>());
    }

    /// Sets what the undisturbed air changes in a step, and its `rates` where they are new, three components of all planes each.
    pub(crate) fn set_undisturbed(
        &self,
        queue: &Queue,
        changes: &[Vec<f64>; 3],
        rates: Option<&[Vec<f64>; 3]>,
    ) {
        for c in 0..3 {
            queue.upload(self.change(c), &changes[c]);
            if let Some(rates) = rates {
                queue.upload(self.undisturbed(c), &rates[c]);
            }
        }
    }

    /// Whether the axes are periodic.
    pub(crate) fn periodic(&self) -> [usize; 3] {
        self.ends.map(|ends| usize::from(ends[0] == 3))
    }

    /// Whether the low and the high ends are outflows.
    pub(crate) fn outflows(&self) -> [usize; 6] {
        let of = |side: usize| self.ends.map(|ends| usize::from(ends[side] == 2));
        let ([a, b, c], [d, e, f]) = (of(0), of(1));
        [a, b, c, d, e, f]
    }
}
