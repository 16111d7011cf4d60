//! Divergence and gradient between staggered velocities and cells.

use std::ops::Range;

use crate::grid::{Ends, Grid, Layout, Velocity};
use crate::poisson::Box3;
use crate::slabs::Slabs;

/// Cells of a box, x fastest.
pub(crate) fn cells_of(cells: &Box3) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = cells.clone();
    z.flat_map(move |k| {
        let x = x.clone();
        y.clone().flat_map(move |j| x.clone().map(move |i| [i, j, k]))
    })
}

/// Fluxes of `u`, whose arrays have this layout, out of the cells of a box, negative, m3/s.
pub(crate) fn divergence(grid: &Grid, layout: &Layout, u: &Velocity, cells: &Box3, out: &mut [f64]) {
    let [x, y, z] = cells;
    let widths = &grid.axes[0].widths[x.clone()];
    let [_, sy, sz] = layout.strides;
    for (k, at_z) in z.clone().enumerate() {
        for (j, at_y) in y.clone().enumerate() {
            let start = layout.at([x.start as isize, at_y as isize, at_z as isize]);
            let [wy, wz] = [grid.axes[1].widths[at_y], grid.axes[2].widths[at_z]];
            let row = &mut out[(k * y.len() + j) * x.len()..][..x.len()];
            let of = |c: usize, shift: usize| &u[c][start + shift..][..x.len()];
            let (u0, u1, v0, v1, w0, w1) = (of(0, 0), of(0, 1), of(1, 0), of(1, sy), of(2, 0), of(2, sz));
            for i in 0..x.len() {
                row[i] = -((u1[i] - u0[i]) * (wy * wz)
                    + widths[i] * ((v1[i] - v0[i]) * wz + (w1[i] - w0[i]) * wy));
            }
        }
    }
}

/// Gradient of a pressure at one face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gradient {
    upper: usize,
    lower: usize,
    /// Whether the lower pressure is in the plane below.
    outside: bool,
    inverse: f64,
}

impl Gradient {
    /// Its value for the pressures `p` and those of the plane below.
    #[inline(always)]
    pub(crate) fn of(&self, p: &[f64], below: &[f64]) -> f64 {
        let lower = if self.outside { below[self.lower] } else { p[self.lower] };
        (p[self.upper] - lower) * self.inverse
    }
}

/// The part of a box of cells that this rank computes.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// The whole box.
    whole: Box3,
    /// Own cells along z.
    own: Range<usize>,
}

impl Part {
    /// The slab of the grid.
    pub(crate) fn slab(grid: &Grid, slabs: &Slabs) -> Self {
        Self { whole: grid.all_cells(), own: slabs.own() }
    }

    /// All of the box `cells`.
    pub(crate) fn whole(cells: &Box3) -> Self {
        Self { whole: cells.clone(), own: cells[2].clone() }
    }

    /// Own cells.
    pub(crate) fn cells(&self) -> Box3 {
        [self.whole[0].clone(), self.whole[1].clone(), self.own.clone()]
    }

    /// Cells of a plane.
    pub(crate) fn plane(&self) -> usize {
        self.whole[0].len() * self.whole[1].len()
    }

    /// Own cells along z.
    pub(crate) fn own(&self) -> Range<usize> {
        self.own.clone()
    }

    /// Brings the plane below the own ones of `p` from its rank to `below`.
    pub(crate) fn plane_below(&self, slabs: &Slabs, p: &[f64], below: &mut [f64]) {
        if !slabs.alone() {
            let last = p.len() - self.plane();
            slabs.ranks().shift(true, &p[last..], &mut below[..self.plane()]);
        }
    }

    /// The gradient of a pressure, on the own cells, at the lower face of `cell` along `c`, which lies between cells of the box: positions of the two
    /// pressures, the lower first and in `below` where it is not in the own cells, and their inverse distance.
    pub(crate) fn gradient(&self, grid: &Grid, c: usize, cell: [usize; 3]) -> Gradient {
        let [nx, ny] = [self.whole[0].len(), self.whole[1].len()];
        let [x, y] = [0, 1].map(|d| cell[d] - self.whole[d].start);
        let upper = ((cell[2] - self.own.start) * ny + y) * nx + x;
        let outside = c == 2 && cell[2] == self.own.start;
        let lower = if outside { y * nx + x } else { upper - [1, nx, nx * ny][c] };
        Gradient { upper, lower, outside, inverse: 1.0 / grid.centre_distance(c, cell[c]) }
    }

    /// Subtracts the gradient of `p`, on the own cells, from the faces between cells of the box and the unknown ones at the ends of the grid.
    /// `below`: the plane of `p` below the own ones.
    pub(crate) fn subtract_gradient(&self, grid: &Grid, p: &[f64], below: &[f64], u: &mut Velocity) {
        let n = [self.whole[0].len(), self.whole[1].len(), self.own.len()];
        for (c, u) in u.iter_mut().enumerate() {
            let inverse: Vec<f64> =
                (0..=grid.axes[c].len()).map(|i| 1.0 / grid.centre_distance(c, i)).collect();
            for k in 0..n[2] {
                for j in 0..n[1] {
                    let at = [self.whole[0].start, self.whole[1].start + j, self.own.start + k];
                    let start = grid.at(at.map(|i| i as isize));
                    let row = (k * n[1] + j) * n[0];
                    let own = &p[row..row + n[0]];
                    let values = &mut u[start..start + n[0]];
                    let before = match (c, j, k) {
                        (1, 1.., _) => &p[row - n[0]..row],
                        (2, _, 1..) => &p[row - n[0] * n[1]..][..n[0]],
                        (2, _, 0) if self.own.start > self.whole[2].start => &below[j * n[0]..][..n[0]],
                        (0, ..) => {
                            for i in 1..n[0] {
                                values[i] -= (own[i] - own[i - 1]) * inverse[at[0] + i];
                            }
                            continue;
                        }
                        _ => continue,
                    };
                    let factor = inverse[at[c]];
                    for ((value, own), before) in values.iter_mut().zip(own).zip(before) {
                        *value -= (own - before) * factor;
                    }
                }
            }
            if self.whole[c].len() == grid.axes[c].len() {
                self.subtract_at_ends(grid, p, c, &inverse, u);
            }
        }
    }

    /// Subtracts the gradient at the ends of axis `c`, which the box spans: of a periodic axis, or to zero pressure at an outflow.
    fn subtract_at_ends(&self, grid: &Grid, p: &[f64], c: usize, inverse: &[f64], u: &mut [f64]) {
        let cells = self.cells();
        let n = [0, 1, 2].map(|d| cells[d].len());
        let unknown = grid.unknown_faces(c);
        let periodic = grid.ends[c] == Ends::Periodic;
        let last = grid.axes[c].len();
        // Of the axis z this rank may have neither end.
        let low = unknown.start == 0 && cells[c].start == 0;
        let high = unknown.end == last + 1 && cells[c].end == last;
        let [a, b] = [(c + 1) % 3, (c + 2) % 3];
        for q in 0..n[b] {
            for r in 0..n[a] {
                let in_box = |i: usize| {
                    let mut cell = [0; 3];
                    (cell[a], cell[b], cell[c]) = (r, q, i);
                    cell
                };
                let pressure = |i: usize| {
                    let cell = in_box(i);
                    p[(cell[2] * n[1] + cell[1]) * n[0] + cell[0]]
                };
                let at = |i: usize| {
                    let cell = in_box(i);
                    grid.at([0, 1, 2].map(|d| (cells[d].start + cell[d]) as isize))
                };
                if low {
                    let below = if periodic { pressure(n[c] - 1) } else { 0.0 };
                    u[at(0)] -= (pressure(0) - below) * inverse[0];
                }
                if high {
                    u[at(n[c])] += pressure(n[c] - 1) * inverse[last];
                }
                if periodic {
                    u[at(n[c])] = u[at(0)];
                }
            }
        }
    }
}
