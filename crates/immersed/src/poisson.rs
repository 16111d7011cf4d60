//! Pressure equation by fast diagonalisation (Lynch, Rice and Thomas, Numer. Math. 6, 1964).
//!
//! On a rectilinear grid the discrete operator is a sum of products of one-dimensional ones,
//! ```math
//! L = K_x \otimes M_y \otimes M_z + M_x \otimes K_y \otimes M_z + M_x \otimes M_y \otimes K_z,
//! ```
//! with the widths $`M`$ and the differences $`K`$ of each axis. Eigenvectors of $`K v = \lambda M v`$ along x and y leave a tridiagonal
//! system along z for each pair of modes. The solution is exact to round-off, at a cost of $`4 (n_x + n_y)`$ multiplications a cell.
//! A source that fills a box only, with the solution wanted in that box only, takes the modes of the whole grid with the rows of the box.
//!
//! On several ranks each transforms its own planes of the box and solves along z for its own modes; between the two all ranks exchange
//! their shares.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par, Side};

use crate::grid::{End, Ends, Grid};
use crate::slabs::{Slabs, share};

/// Cells from the first to the last along x, y, z.
pub type Box3 = [Range<usize>; 3];

/// Direct solver of $`L p = b`$, with $`b`$ the integral of the source over each cell.
#[derive(Clone, Debug)]
pub struct Poisson {
    n: [usize; 3],
    /// Eigenvectors along x and y, columns, with $`V^T M V = I`$.
    modes: [Vec<f64>; 2],
    /// Eigenvalues along x and y, 1/m2.
    eigenvalues: [Vec<f64>; 2],
    /// Inverse distances of the centres along z; entry k couples cells k - 1 and k.
    coupling: Vec<f64>,
    /// Diagonal of $`K_z`$ and widths along z.
    diagonal: [Vec<f64>; 2],
    /// Pairs of modes for which this rank solves along z, x fastest.
    own_modes: Range<usize>,
    /// Inverse pivots of the elimination from below, for each cell along z and own pair of modes.
    pivots: Vec<f64>,
    /// A plane of modes in x, and planes of modes in x and y of a box.
    plane: Vec<f64>,
    planes: Vec<f64>,
    /// What ranks exchange: own planes, one rank after the other, and lines of own modes along z; empty on one rank.
    packed: Vec<f64>,
    lines: Vec<f64>,
}

/// Differences of one axis: diagonal and coupling of cells i - 1 and i (that of the ends of a periodic axis last).
fn differences(grid: &Grid, d: usize) -> (Vec<f64>, Vec<f64>) {
    let n = grid.axes[d].len();
    let mut coupling: Vec<f64> = (0..=n).map(|i| 1.0 / grid.centre_distance(d, i)).collect();
    let mut diagonal = vec![0.0; n];
    for i in 0..n {
        diagonal[i] = coupling[i] + coupling[i + 1];
    }
    if let Ends::Open([low, high]) = grid.ends[d] {
        // No flux through a boundary that sets the velocity; zero pressure at an outflow stays in the diagonal.
        if low != End::Outflow {
            diagonal[0] -= coupling[0];
        }
        if high != End::Outflow {
            diagonal[n - 1] -= coupling[n];
        }
        (coupling[0], coupling[n]) = (0.0, 0.0);
    }
    (diagonal, coupling)
}

/// Eigenvalues and eigenvectors of $`K v = \lambda M v`$ of one axis.
fn eigen(grid: &Grid, d: usize) -> (Vec<f64>, Vec<f64>) {
    let n = grid.axes[d].len();
    let (diagonal, coupling) = differences(grid, d);
    let root: Vec<f64> = grid.axes[d].widths.iter().map(|w| w.sqrt()).collect();
    let mut matrix = faer::Mat::<f64>::zeros(n, n);
    for i in 0..n {
        matrix[(i, i)] += diagonal[i] / (root[i] * root[i]);
        let before = if i == 0 { n - 1 } else { i - 1 };
        let value = coupling[i] / (root[i] * root[before]);
        matrix[(i, before)] -= value;
        matrix[(before, i)] -= value;
    }
    let found = matrix.self_adjoint_eigen(Side::Lower).expect("a symmetric matrix of finite numbers");
    let mut vectors = vec![0.0; n * n];
    for j in 0..n {
        for i in 0..n {
            vectors[j * n + i] = found.U()[(i, j)] / root[i];
        }
    }
    // Round-off must not make the constant mode negative.
    let values = (0..n).map(|j| found.S().column_vector()[j].max(0.0)).collect();
    (values, vectors)
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
        let ((lx, vx), (ly, vy)) = (eigen(grid, 0), eigen(grid, 1));
        let (kz, coupling) = differences(grid, 2);
        let mz = grid.axes[2].widths.clone();
        let plane = n[0] * n[1];
        let own_modes = slabs.share(plane);
        let own = own_modes.len();
        let mut pivots = vec![0.0; own * n[2]];
        for k in 0..n[2] {
            for m in 0..own {
                let mode = own_modes.start + m;
                let mut d = kz[k] + (ly[mode / n[0]] + lx[mode % n[0]]) * mz[k];
                if k > 0 {
                    d -= coupling[k] * coupling[k] * pivots[(k - 1) * own + m];
                }
                // The constant mode of a closed grid: its last pivot vanishes.
                pivots[k * own + m] = if d > 1e-12 * kz[k].max(coupling[k]) { 1.0 / d } else { 0.0 };
            }
        }
        let planes = (0..slabs.ranks().size()).map(|r| share(n[2], r, slabs.ranks().size()).len()).max();
        // A single rank solves along z where its modes are.
        let shared = if slabs.alone() { [0; 2] } else { [plane * planes.unwrap_or(0), own * n[2]] };
        let [packed, lines] = shared.map(|length| vec![0.0; length]);
        Self {
            n,
            modes: [vx, vy],
            eigenvalues: [lx, ly],
            coupling,
            diagonal: [kz, mz],
            own_modes,
            pivots,
            plane: vec![0.0; plane],
            planes: Vec::new(),
            packed,
            lines,
        }
    }

    /// Inverse distances of the centres along z; entry k couples cells k - 1 and k.
    pub(crate) fn coupling(&self) -> &[f64] {
        &self.coupling
    }

    /// Eigenvectors along x (0) or y (1), columns.
    pub(crate) fn modes(&self, d: usize) -> &[f64] {
        &self.modes[d]
    }

    /// Inverse pivots of the own modes for each cell along z.
    pub(crate) fn pivots(&self) -> &[f64] {
        &self.pivots
    }

    /// Solves for `p` in place of the source, both in the own planes without ghosts, x fastest.
    pub fn solve(&mut self, p: &mut [f64], slabs: &Slabs) {
        let all = [0, 1, 2].map(|d| 0..self.n[d]);
        self.solve_in(p, &all, &[], slabs);
    }

    /// Inverse pivots of the last cell of `range` along z, with all cells above it eliminated, for the own modes, to `closure`; for
    /// [`Self::solve_in`].
    pub fn closure(&self, range: &Range<usize>, closure: &mut Vec<f64>) {
        let n = self.n[2];
        let [kz, mz] = &self.diagonal;
        let own = self.own_modes.len();
        closure.resize(own, 0.0);
        for (m, mode) in self.own_modes.clone().enumerate() {
            let lambda = self.eigenvalues[0][mode % self.n[0]] + self.eigenvalues[1][mode / self.n[0]];
            let mut above = 0.0;
            for k in (range.end..n).rev() {
                let d = kz[k] + lambda * mz[k] - above;
                above = self.coupling[k] * self.coupling[k] / d;
            }
            let pivot = self.pivots[(range.end - 1) * own + m];
            let inverse = if pivot > 0.0 { 1.0 / pivot - above } else { 0.0 };
            closure[m] = if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
        }
    }

    /// Solves in place for a source that vanishes outside `cells`, in these cells only; `closure` is that of their range along z,
    /// or empty where they reach the end. `p` has the planes of `cells` that are this rank's share of them.
    pub fn solve_in(&mut self, p: &mut [f64], cells: &Box3, closure: &[f64], slabs: &Slabs) {
        let [bx, by, bz] = [cells[0].len(), cells[1].len(), cells[2].len()];
        let [nx, ny, _] = self.n;
        let planes = slabs.share(bz).len();
        assert_eq!(p.len(), bx * by * planes);
        let vx = MatRef::from_column_major_slice(&self.modes[0], nx, nx).subrows(cells[0].start, bx);
        let vy = MatRef::from_column_major_slice(&self.modes[1], ny, ny).subrows(cells[1].start, by);
        let of_x = &mut self.plane[..nx * by];
        // Where the box has all cells of a plane, modes take the place of values.
        let (apart, all) = (bx < nx || by < ny, nx * ny * planes);
        if apart && self.planes.len() < all {
            self.planes.resize(all, 0.0);
        }
        for k in 0..planes {
            let source = MatRef::from_column_major_slice(&p[k * bx * by..][..bx * by], bx, by);
            let out = MatMut::from_column_major_slice_mut(of_x, nx, by);
            matmul(out, Accum::Replace, vx.transpose(), source, 1.0, Par::Seq);
            let modes = if apart { &mut self.planes[..] } else { &mut *p };
            let out = MatMut::from_column_major_slice_mut(&mut modes[k * nx * ny..][..nx * ny], nx, ny);
            matmul(out, Accum::Replace, MatRef::from_column_major_slice(of_x, nx, by), vy, 1.0, Par::Seq);
        }
        let modes = if apart { &mut self.planes[..all] } else { &mut *p };
        let own = self.own_modes.len();
        let along = AlongZ { own, pivots: &self.pivots, coupling: &self.coupling, range: &cells[2], closure };
        if slabs.alone() {
            along.solve(modes);
        } else {
            let (lines, packed) = (&mut self.lines[..own * bz], &mut self.packed[..all]);
            let exchange = Exchange::new(slabs, nx * ny, bz);
            exchange.to_lines(modes, packed, lines);
            along.solve(lines);
            exchange.to_planes(lines, packed, modes);
        }
        for k in 0..planes {
            let modes = if apart { &self.planes[..] } else { &*p };
            let modes = MatRef::from_column_major_slice(&modes[k * nx * ny..][..nx * ny], nx, ny);
            let out = MatMut::from_column_major_slice_mut(of_x, nx, by);
            matmul(out, Accum::Replace, modes, vy.transpose(), 1.0, Par::Seq);
            let result = MatMut::from_column_major_slice_mut(&mut p[k * bx * by..][..bx * by], bx, by);
            matmul(result, Accum::Replace, vx, MatRef::from_column_major_slice(of_x, nx, by), 1.0, Par::Seq);
        }
    }
}

/// Exchange between planes of all modes and lines along z of own modes.
struct Exchange<'a> {
    slabs: &'a Slabs,
    /// Modes of each rank, in a plane.
    modes: Vec<Range<usize>>,
    /// Numbers that go to each rank from planes, and that come from each to lines.
    sent: Vec<usize>,
    received: Vec<usize>,
}

impl<'a> Exchange<'a> {
    fn new(slabs: &'a Slabs, plane: usize, height: usize) -> Self {
        let size = slabs.ranks().size();
        let modes: Vec<_> = (0..size).map(|r| share(plane, r, size)).collect();
        let own = slabs.share(plane).len();
        let planes = slabs.share(height).len();
        let sent = modes.iter().map(|m| m.len() * planes).collect();
        let received = (0..size).map(|r| share(height, r, size).len() * own).collect();
        Self { slabs, modes, sent, received }
    }

    fn plane(&self) -> usize {
        self.modes.last().map_or(0, |m| m.end)
    }

    fn to_lines(&self, planes: &[f64], packed: &mut [f64], lines: &mut [f64]) {
        let mut rest = &mut packed[..];
        for modes in &self.modes {
            for plane in planes.chunks_exact(self.plane()) {
                let (own, after) = rest.split_at_mut(modes.len());
                own.copy_from_slice(&plane[modes.clone()]);
                rest = after;
            }
        }
        self.slabs.ranks().all_to_all(packed, &self.sent, lines, &self.received);
    }

    fn to_planes(&self, lines: &[f64], packed: &mut [f64], planes: &mut [f64]) {
        self.slabs.ranks().all_to_all(lines, &self.received, packed, &self.sent);
        let mut rest = &packed[..];
        for modes in &self.modes {
            for plane in planes.chunks_exact_mut(self.plane()) {
                let (own, after) = rest.split_at(modes.len());
                plane[modes.clone()].copy_from_slice(own);
                rest = after;
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
    range: &'a Range<usize>,
    closure: &'a [f64],
}

impl AlongZ<'_> {
    /// Solves in place; `q` has a plane of own modes for each cell of the range.
    fn solve(&self, q: &mut [f64]) {
        let Self { own: plane, pivots, coupling, range, closure } = *self;
        for (k, at) in range.clone().enumerate().skip(1) {
            let (below, own) = q.split_at_mut(k * plane);
            let (below, own, g) = (&below[(k - 1) * plane..], &mut own[..plane], coupling[at]);
            for ((own, below), pivot) in own.iter_mut().zip(below).zip(&pivots[(at - 1) * plane..]) {
                *own += g * pivot * below;
            }
        }
        let last = range.len() - 1;
        let end =
            if closure.is_empty() { &pivots[(range.end - 1) * plane..range.end * plane] } else { closure };
        for (own, pivot) in q[last * plane..].iter_mut().zip(end) {
            *own *= pivot;
        }
        for (k, at) in range.clone().enumerate().take(last).rev() {
            let (own, above) = q.split_at_mut((k + 1) * plane);
            let (g, own) = (coupling[at + 1], &mut own[k * plane..]);
            for ((own, above), pivot) in own.iter_mut().zip(above.iter()).zip(&pivots[at * plane..]) {
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

    #[test]
    fn solution_in_a_box_is_that_of_the_whole_grid() {
        let grid = grid(OPEN, End::Outflow);
        let n = grid.cells();
        let slabs = Slabs::new(Rc::new(Alone), &grid).expect("one slab");
        let mut poisson = Poisson::new(&grid, &slabs);
        let cells = [2..7, 1..n[1] - 1, 3..8];
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
        poisson.solve_in(&mut inside, &cells, &closure, &slabs);
        for (m, value) in inside.iter().enumerate() {
            assert!((value - whole[place(m)]).abs() < 1e-12, "{m}");
        }
    }
}
