//! Pressure equation by fast diagonalisation (Lynch, Rice and Thomas, Numer. Math. 6, 1964).
//!
//! On a rectilinear grid the discrete operator is a sum of products of one-dimensional ones,
//! ```math
//! L = K_x \otimes M_y \otimes M_z + M_x \otimes K_y \otimes M_z + M_x \otimes M_y \otimes K_z,
//! ```
//! with the widths $`M`$ and the differences $`K`$ of each axis. Eigenvectors of $`K v = \lambda M v`$ along x and y leave a tridiagonal
//! system along z for each pair of modes. The solution is exact to round-off, at a cost of $`4 (n_x + n_y)`$ multiplications a cell, half of them along
//! an axis that is its own mirror image (`axis_modes`).
//!
//! A source that fills a box only, with the solution wanted in that box only, takes the modes of the whole grid with the rows of the box.
//!
//! On several ranks each solves along z for its own modes. Of the whole grid each rank transforms its own planes, and all ranks exchange their
//! shares before and after. Of a box every rank knows the source, so that each transforms it to its own modes and adds what they contribute.

use std::ops::Range;

use crate::axis_modes::{AxisModes, differences};
use crate::grid::{Ends, Grid};
use crate::slabs::{Slabs, share};

/// Cells from the first to the last along x, y, z.
pub type Box3 = [Range<usize>; 3];

/// Direct solver of $`L p = b`$, with $`b`$ the integral of the source over each cell.
#[derive(Clone, Debug)]
pub struct Poisson {
    n: [usize; 3],
    /// Along x and y.
    modes: [AxisModes; 2],
    eigenvalues: [Vec<f64>; 2],
    /// Inverse distances of the centres along z; entry k couples cells k - 1 and k.
    coupling: Vec<f64>,
    /// Diagonal of $`K_z`$ and widths along z.
    diagonal: [Vec<f64>; 2],
    /// Modes in y for which this rank solves along z, with all modes in x.
    own: Range<usize>,
    /// Inverse pivots of the elimination from below, for each cell along z and own pair of modes, x fastest.
    pivots: Vec<f64>,
    work: Work,
    exchange: Exchange,
}

/// Arrays of the transforms.
#[derive(Clone, Debug, Default)]
struct Work {
    /// A plane of modes in y, and half a plane of one parity.
    plane: Vec<f64>,
    half: Vec<f64>,
    /// Own modes of a box.
    modes: Vec<f64>,
}

impl Poisson {
    /// Solver for the cells of `grid`, of which this rank has a slab. Without an outflow the pressure has mean zero in its constant mode.
    ///
    /// # Panics
    /// The axis z is periodic, or the grid has fewer than two cells along an axis.
    pub fn new(grid: &Grid, slabs: &Slabs) -> Self {
        let n = grid.cells();
        assert!(
            matches!(grid.ends[2], Ends::Open(_)) && n.iter().all(|n| *n > 1),
            "z is open, with two cells or more"
        );
        let modes = [0, 1].map(|d| AxisModes::new(grid, d));
        let (kz, coupling) = differences(grid, 2);
        let mut poisson = Self {
            n,
            eigenvalues: modes.each_ref().map(AxisModes::eigenvalues),
            modes,
            coupling,
            diagonal: [kz, grid.axes[2].widths.clone()],
            own: slabs.share(n[1]),
            pivots: Vec::new(),
            work: Work::default(),
            exchange: Exchange::new(slabs, n),
        };
        poisson.set_pivots();
        poisson
    }

    fn set_pivots(&mut self) {
        let [kz, mz] = &self.diagonal;
        let own = self.own_modes();
        self.pivots = vec![0.0; own * self.n[2]];
        for k in 0..self.n[2] {
            for m in 0..own {
                let mut d = kz[k] + self.eigenvalue(m) * mz[k];
                if k > 0 {
                    d -= self.coupling[k] * self.coupling[k] * self.pivots[(k - 1) * own + m];
                }
                // The constant mode of a closed grid: its last pivot vanishes.
                let least = 1e-12 * kz[k].max(self.coupling[k]);
                self.pivots[k * own + m] = if d > least { 1.0 / d } else { 0.0 };
            }
        }
    }

    /// Number of own pairs of modes.
    fn own_modes(&self) -> usize {
        self.own.len() * self.n[0]
    }

    /// Sum of the eigenvalues of the own pair `m`, 1/m2.
    fn eigenvalue(&self, m: usize) -> f64 {
        self.eigenvalues[1][self.own.start + m / self.n[0]] + self.eigenvalues[0][m % self.n[0]]
    }

    /// Inverse distances of the centres along z; entry k couples cells k - 1 and k.
    pub(crate) fn coupling(&self) -> &[f64] {
        &self.coupling
    }

    /// Eigenvectors along x (0) or y (1), columns.
    pub(crate) fn modes(&self, d: usize) -> Vec<f64> {
        self.modes[d].vectors()
    }

    /// Inverse pivots of the own modes for each cell along z.
    pub(crate) fn pivots(&self) -> &[f64] {
        &self.pivots
    }

    /// The smallest box with `cells` for which [`Self::solve_in`] solves.
    pub(crate) fn covering(&self, cells: &Box3) -> Box3 {
        let [x, y, z] = cells;
        [self.modes[0].covering(x), self.modes[1].covering(y), z.clone()]
    }

    /// Inverse pivots of the last cell of `range` along z, with all cells above it eliminated, for the own modes, to `closure`; for
    /// [`Self::solve_in`].
    pub fn closure(&self, range: &Range<usize>, closure: &mut Vec<f64>) {
        let n = self.n[2];
        let [kz, mz] = &self.diagonal;
        let own = self.own_modes();
        closure.resize(own, 0.0);
        for (m, closure) in closure.iter_mut().enumerate() {
            let lambda = self.eigenvalue(m);
            let mut above = 0.0;
            for k in (range.end..n).rev() {
                let d = kz[k] + lambda * mz[k] - above;
                above = self.coupling[k] * self.coupling[k] / d;
            }
            let pivot = self.pivots[(range.end - 1) * own + m];
            let inverse = if pivot > 0.0 { 1.0 / pivot - above } else { 0.0 };
            *closure = if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
        }
    }

    /// Solves for `p` in place of the source, both in the own planes without ghosts, x fastest.
    pub fn solve(&mut self, p: &mut [f64], slabs: &Slabs) {
        let [nx, ny, nz] = self.n;
        let ([x, y], [modes_x, modes_y]) = ([0..nx, 0..ny], &self.modes);
        let Work { plane, half, .. } = &mut self.work;
        plane.resize(nx * ny, 0.0);
        for values in p.chunks_exact_mut(nx * ny) {
            modes_y.rows_to_modes(&y, &y, values, plane, half);
            modes_x.columns_to_modes(&x, plane, values, half);
        }
        let own = self.own.len() * nx;
        let along =
            AlongZ { own, pivots: &self.pivots, coupling: &self.coupling, range: 0..nz, closure: &[] };
        self.exchange.with_lines(p, slabs, |lines| along.solve(lines));
        let Work { plane, half, .. } = &mut self.work;
        for values in p.chunks_exact_mut(nx * ny) {
            modes_x.modes_to_columns(&x, values, plane, half);
            modes_y.modes_to_rows(&y, &y, plane, values, half);
        }
    }

    /// Solves in place for a source that vanishes outside `cells`, in these cells only; `closure` is that of their range along z,
    /// or empty where they reach the end. Every rank has the whole source, and gets what its own modes contribute: the solution is the sum over the ranks.
    ///
    /// # Panics
    /// The box is not `covering` itself.
    pub fn solve_in(&mut self, p: &mut [f64], cells: &Box3, closure: &[f64]) {
        assert_eq!(*cells, self.covering(cells), "a box of which a part could be folded");
        let ([x, y, z], [modes_x, modes_y]) = (cells, &self.modes);
        let own = self.own.len() * self.n[0];
        if own == 0 {
            return p.fill(0.0);
        }
        let Work { plane, half, modes } = &mut self.work;
        let modes = at_least(modes, own * z.len());
        let plane = at_least(plane, x.len() * self.own.len());
        for (values, modes) in p.chunks_exact(x.len() * y.len()).zip(modes.chunks_exact_mut(own)) {
            modes_y.rows_to_modes(y, &self.own, values, plane, half);
            modes_x.columns_to_modes(x, plane, modes, half);
        }
        let along = AlongZ { own, pivots: &self.pivots, coupling: &self.coupling, range: z.clone(), closure };
        along.solve(&mut modes.chunks_exact_mut(own).collect::<Vec<_>>());
        for (values, modes) in p.chunks_exact_mut(x.len() * y.len()).zip(modes.chunks_exact(own)) {
            modes_x.modes_to_columns(x, modes, plane, half);
            modes_y.modes_to_rows(y, &self.own, plane, values, half);
        }
    }
}

/// The first `length` numbers of `array`, which grows to that length.
fn at_least(array: &mut Vec<f64>, length: usize) -> &mut [f64] {
    array.resize(length.max(array.len()), 0.0);
    &mut array[..length]
}

/// Exchange between own planes of all modes and lines along z of own modes.
#[derive(Clone, Debug)]
struct Exchange {
    /// Modes of a plane, and the own ones.
    plane: usize,
    own: Range<usize>,
    /// Number of planes of the ranks before this one.
    before: usize,
    /// The modes of the other ranks; those of this one stay where they are.
    others: Vec<Range<usize>>,
    /// Numbers that go to each rank, and that come from it.
    sent: Vec<usize>,
    received: Vec<usize>,
    /// Own planes of the modes of other ranks, one rank after the other, and planes of other ranks of own modes.
    packed: Vec<f64>,
    lines: Vec<f64>,
}

impl Exchange {
    fn new(slabs: &Slabs, [nx, ny, nz]: [usize; 3]) -> Self {
        let (rank, size) = (slabs.ranks().rank(), slabs.ranks().size());
        let modes = |r: usize| {
            let columns = share(ny, r, size);
            columns.start * nx..columns.end * nx
        };
        let (own, planes) = (modes(rank), slabs.own().len());
        let other = |r: usize, count: usize| if r == rank { 0 } else { count };
        let sent: Vec<_> = (0..size).map(|r| other(r, modes(r).len() * planes)).collect();
        let received: Vec<_> = (0..size).map(|r| other(r, share(nz, r, size).len() * own.len())).collect();
        Self {
            plane: nx * ny,
            own,
            before: slabs.own().start,
            others: (0..size).filter(|r| *r != rank).map(modes).collect(),
            packed: vec![0.0; sent.iter().sum()],
            lines: vec![0.0; received.iter().sum()],
            sent,
            received,
        }
    }

    /// Calls `solve` with the own modes of all planes, in place in the own `planes` of all modes.
    fn with_lines(&mut self, planes: &mut [f64], slabs: &Slabs, solve: impl FnOnce(&mut [&mut [f64]])) {
        if !slabs.alone() {
            let mut packed = &mut self.packed[..];
            for modes in &self.others {
                for plane in planes.chunks_exact(self.plane) {
                    let (of_plane, rest) = packed.split_at_mut(modes.len());
                    of_plane.copy_from_slice(&plane[modes.clone()]);
                    packed = rest;
                }
            }
            slabs.ranks().all_to_all(&self.packed, &self.sent, &mut self.lines, &self.received);
        }
        let own = self.own.len().max(1);
        let (before, after) = self.lines.split_at_mut(self.before * self.own.len());
        let of_own = planes.chunks_exact_mut(self.plane).map(|plane| &mut plane[self.own.clone()]);
        let lines = before.chunks_exact_mut(own).chain(of_own).chain(after.chunks_exact_mut(own));
        solve(&mut lines.collect::<Vec<_>>());
        if !slabs.alone() {
            slabs.ranks().all_to_all(&self.lines, &self.received, &mut self.packed, &self.sent);
            let mut packed = &self.packed[..];
            for modes in &self.others {
                for plane in planes.chunks_exact_mut(self.plane) {
                    let (of_plane, rest) = packed.split_at(modes.len());
                    plane[modes.clone()].copy_from_slice(of_plane);
                    packed = rest;
                }
            }
        }
    }
}

/// The tridiagonal systems along z of own modes, for the cells of a range.
struct AlongZ<'a> {
    /// Number of own modes.
    own: usize,
    pivots: &'a [f64],
    coupling: &'a [f64],
    range: Range<usize>,
    closure: &'a [f64],
}

impl AlongZ<'_> {
    /// Solves in place; `q` has a plane of own modes for each cell of the range.
    fn solve(&self, q: &mut [&mut [f64]]) {
        let Self { own: plane, pivots, coupling, range, closure } = self;
        if *plane == 0 {
            return;
        }
        let pivots = |at: usize| &pivots[at * plane..][..*plane];
        for (k, at) in range.clone().enumerate().skip(1) {
            let (below, own) = q.split_at_mut(k);
            let (below, own, g) = (&below[k - 1], &mut own[0], coupling[at]);
            for ((own, below), pivot) in own.iter_mut().zip(&**below).zip(pivots(at - 1)) {
                *own += g * pivot * below;
            }
        }
        let last = range.len() - 1;
        let end = if closure.is_empty() { pivots(range.end - 1) } else { closure };
        for (own, pivot) in q[last].iter_mut().zip(end) {
            *own *= pivot;
        }
        for (k, at) in range.clone().enumerate().take(last).rev() {
            let (own, above) = q.split_at_mut(k + 1);
            let (g, own, above) = (coupling[at + 1], &mut own[k], &above[0]);
            for ((own, above), pivot) in own.iter_mut().zip(&**above).zip(pivots(at)) {
                *own = pivot * (*own + g * above);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::axis::Axis;
    use crate::grid::End;
    use crate::slabs::Alone;

    const OPEN: Ends = Ends::Open([End::Slip, End::Slip]);

    fn grid(x: Ends, top: End) -> Grid {
        let axis = |a: f64, b: f64| Axis::stretched([a, b], 0.25, [0.9, 1.3], 1.3, 1);
        Grid::new(
            [axis(-1.0, 1.0), axis(-0.5, 1.0), axis(-1.0, 0.5)],
            [x, OPEN, Ends::Open([End::Inflow, top])],
        )
    }

    /// Sum of the fluxes of the gradient of `p` out of each cell, negative.
    fn apply(grid: &Grid, p: &[f64]) -> Vec<f64> {
        let n = grid.cells();
        let index = |c: [usize; 3]| (c[2] * n[1] + c[1]) * n[0] + c[0];
        let mut out = vec![0.0; p.len()];
        for k in 0..n[2] {
            for j in 0..n[1] {
                for i in 0..n[0] {
                    let c = [i, j, k];
                    for d in 0..3 {
                        let area: f64 =
                            (0..3).filter(|e| *e != d).map(|e| grid.axes[e].widths[c[e]]).product();
                        let mut flux = |face: usize, other: Option<f64>| {
                            let other = other.map(|q| q - p[index(c)]);
                            out[index(c)] -= area * other.unwrap_or(0.0) / grid.centre_distance(d, face);
                        };
                        let at = |m: usize| {
                            let mut o = c;
                            o[d] = m;
                            Some(p[index(o)])
                        };
                        let end = |low: usize| match grid.ends[d] {
                            Ends::Periodic => at(if low == 0 { n[d] - 1 } else { 0 }),
                            Ends::Open(ends) => (ends[low] == End::Outflow).then_some(0.0),
                        };
                        flux(c[d], if c[d] == 0 { end(0) } else { at(c[d] - 1) });
                        flux(c[d] + 1, if c[d] + 1 == n[d] { end(1) } else { at(c[d] + 1) });
                    }
                }
            }
        }
        out
    }

    fn noise(count: usize) -> Vec<f64> {
        let mut state = 1u64;
        (0..count)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            })
            .collect()
    }

    #[test]
    fn solution_satisfies_the_equation_to_round_off() {
        for (x, top) in [(OPEN, End::Outflow), (Ends::Periodic, End::Outflow), (OPEN, End::Slip)] {
            let grid = grid(x, top);
            let mut source = noise(grid.count());
            if top == End::Slip {
                let mean = source.iter().sum::<f64>() / source.len() as f64;
                source.iter_mut().for_each(|s| *s -= mean);
            }
            let mut p = source.clone();
            let slabs = Slabs::new(Rc::new(Alone), &grid).expect("one slab");
            Poisson::new(&grid, &slabs).solve(&mut p, &slabs);
            let error = apply(&grid, &p).iter().zip(&source).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-11, "{x:?} {top:?}: {error:e}");
        }
    }

    /// Axes along x and y that are their own mirror image, with even and odd numbers of cells, and axes that are none.
    fn grids() -> Vec<Grid> {
        let axis = |reach: f64, far: [f64; 2]| Axis::stretched([-reach, reach], 0.25, far, 1.3, 1);
        let z = axis(1.0, [0.9, 1.3]);
        let of = |x: Axis, y: Axis, ends: Ends| {
            Grid::new([x, y, z.clone()], [ends, OPEN, Ends::Open([End::Inflow, End::Outflow])])
        };
        let (even, odd, other) = (axis(1.0, [0.9; 2]), axis(1.1, [1.3; 2]), axis(1.0, [0.9, 1.3]));
        assert!(even.len() % 2 == 0 && odd.len() % 2 == 1);
        let outflow = Ends::Open([End::Inflow, End::Outflow]);
        vec![
            of(even.clone(), odd.clone(), OPEN),
            of(odd, even.clone(), Ends::Open([End::Outflow; 2])),
            of(Axis::even(0.0, 1.0, 7), other, Ends::Periodic),
            of(even.clone(), even, outflow),
        ]
    }

    #[test]
    fn folded_axes_give_the_solution_to_round_off() {
        let folded: Vec<_> =
            grids().iter().map(|g| [0, 1].map(|d| AxisModes::new(g, d).is_folded())).collect();
        assert_eq!(folded, [[true, true], [true, true], [true, false], [false, true]]);
        for grid in grids() {
            let source = noise(grid.count());
            let mut p = source.clone();
            let slabs = Slabs::new(Rc::new(Alone), &grid).expect("one slab");
            Poisson::new(&grid, &slabs).solve(&mut p, &slabs);
            let error = apply(&grid, &p).iter().zip(&source).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-11, "{error:e}");
        }
    }

    #[test]
    fn solution_in_a_box_is_that_of_the_whole_grid() {
        for grid in grids() {
            let n = grid.cells();
            let slabs = Slabs::new(Rc::new(Alone), &grid).expect("one slab");
            let mut poisson = Poisson::new(&grid, &slabs);
            for cells in [[2..6, 1..n[1] - 1, 3..8], [1..2, n[1] - 3..n[1] - 2, 2..4]] {
                let cells = poisson.covering(&cells);
                let [bx, by, bz] = [cells[0].len(), cells[1].len(), cells[2].len()];
                let mut inside = noise(bx * by * bz);
                let mut whole = vec![0.0; grid.count()];
                let place = |m: usize| {
                    let (i, j, k) = (m % bx, m / bx % by, m / bx / by);
                    ((cells[2].start + k) * n[1] + cells[1].start + j) * n[0] + cells[0].start + i
                };
                for (m, value) in inside.iter().enumerate() {
                    whole[place(m)] = *value;
                }
                poisson.solve(&mut whole, &slabs);
                let mut closure = Vec::new();
                poisson.closure(&cells[2], &mut closure);
                poisson.solve_in(&mut inside, &cells, &closure);
                for (m, value) in inside.iter().enumerate() {
                    assert!((value - whole[place(m)]).abs() < 1e-12, "{cells:?} {m}");
                }
            }
        }
    }
}
