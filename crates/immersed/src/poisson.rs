//! Pressure equation by fast diagonalisation (Lynch, Rice and Thomas, Numer. Math. 6, 1964).
//!
//! On a rectilinear grid the discrete operator is a sum of products of one-dimensional ones,
//! ```math
//! L = K_x \otimes M_y \otimes M_z + M_x \otimes K_y \otimes M_z + M_x \otimes M_y \otimes K_z,
//! ```
//! with the widths $`M`$ and the differences $`K`$ of each axis. Eigenvectors of $`K v = \lambda M v`$ along x and y leave a tridiagonal
//! system along z for each pair of modes. The solution is exact to round-off, at a cost of $`4 (n_x + n_y)`$ multiplications a cell.
//! A source that fills a box only, with the solution wanted in that box only, takes the modes of the whole grid with the rows of the box.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par, Side};

use crate::grid::{End, Ends, Grid};

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
    /// Inverse pivots of the elimination from below, for each cell along z and pair of modes.
    pivots: Vec<f64>,
    work: [Vec<f64>; 2],
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
    /// Solver for the cells of `grid`. Without an outflow the pressure has mean zero in its constant mode.
    ///
    /// # Panics
    /// The axis z is periodic, or the grid has fewer than two cells along an axis.
    pub fn new(grid: &Grid) -> Self {
        let n = grid.cells();
        assert!(
            matches!(grid.ends[2], Ends::Open(_)) && n.iter().all(|n| *n > 1),
            "z is open, with two cells or more"
        );
        let ((lx, vx), (ly, vy)) = (eigen(grid, 0), eigen(grid, 1));
        let (kz, coupling) = differences(grid, 2);
        let mz = grid.axes[2].widths.clone();
        let plane = n[0] * n[1];
        let mut pivots = vec![0.0; plane * n[2]];
        for k in 0..n[2] {
            let eigenvalues = ly.iter().flat_map(|y| lx.iter().map(move |x| x + y));
            for (m, lambda) in eigenvalues.enumerate() {
                let mut d = kz[k] + lambda * mz[k];
                if k > 0 {
                    d -= coupling[k] * coupling[k] * pivots[(k - 1) * plane + m];
                }
                // The constant mode of a closed grid: its last pivot vanishes.
                pivots[k * plane + m] = if d > 1e-12 * kz[k].max(coupling[k]) { 1.0 / d } else { 0.0 };
            }
        }
        let work = [vec![0.0; plane * n[2]], vec![0.0; plane * n[2]]];
        Self { n, modes: [vx, vy], eigenvalues: [lx, ly], coupling, diagonal: [kz, mz], pivots, work }
    }

    /// Solves for `p` in place of the source, both without ghosts, x fastest.
    pub fn solve(&mut self, p: &mut [f64]) {
        let all = [0, 1, 2].map(|d| 0..self.n[d]);
        self.solve_in(p, &all, &[]);
    }

    /// Inverse pivots of the last cell of `range` along z, with all cells above it eliminated; for [`Self::solve_in`].
    pub fn closure(&self, range: &Range<usize>) -> Vec<f64> {
        let (plane, n) = (self.n[0] * self.n[1], self.n[2]);
        let [kz, mz] = &self.diagonal;
        let mut closure = vec![0.0; plane];
        for j in 0..self.n[1] {
            for i in 0..self.n[0] {
                let m = j * self.n[0] + i;
                let lambda = self.eigenvalues[0][i] + self.eigenvalues[1][j];
                let mut above = 0.0;
                for k in (range.end..n).rev() {
                    let d = kz[k] + lambda * mz[k] - above;
                    above = self.coupling[k] * self.coupling[k] / d;
                }
                let pivot = self.pivots[(range.end - 1) * plane + m];
                let own = if pivot > 0.0 { 1.0 / pivot - above } else { 0.0 };
                closure[m] = if own > 0.0 { 1.0 / own } else { 0.0 };
            }
        }
        closure
    }

    /// Solves in place for a source that vanishes outside `cells`, in these cells only; `closure` is that of their range along z,
    /// or empty where they reach the end.
    pub fn solve_in(&mut self, p: &mut [f64], cells: &Box3, closure: &[f64]) {
        let [bx, by, bz] = [cells[0].len(), cells[1].len(), cells[2].len()];
        let [nx, ny, _] = self.n;
        assert_eq!(p.len(), bx * by * bz);
        let [first, second] = &mut self.work;
        let vx = MatRef::from_column_major_slice(&self.modes[0], nx, nx).subrows(cells[0].start, bx);
        let vy = MatRef::from_column_major_slice(&self.modes[1], ny, ny).subrows(cells[1].start, by);
        let of_x = &mut first[..nx * by * bz];
        let source = MatRef::from_column_major_slice(p, bx, by * bz);
        let out = MatMut::from_column_major_slice_mut(of_x, nx, by * bz);
        matmul(out, Accum::Replace, vx.transpose(), source, 1.0, Par::Seq);
        for k in 0..bz {
            let out = MatMut::from_column_major_slice_mut(&mut second[k * nx * ny..][..nx * ny], nx, ny);
            let rows = MatRef::from_column_major_slice(&of_x[k * nx * by..][..nx * by], nx, by);
            matmul(out, Accum::Replace, rows, vy, 1.0, Par::Seq);
        }
        along_z(&mut second[..nx * ny * bz], nx * ny, &self.pivots, &self.coupling, &cells[2], closure);
        for k in 0..bz {
            let out = MatMut::from_column_major_slice_mut(&mut of_x[k * nx * by..][..nx * by], nx, by);
            let modes = MatRef::from_column_major_slice(&second[k * nx * ny..][..nx * ny], nx, ny);
            matmul(out, Accum::Replace, modes, vy.transpose(), 1.0, Par::Seq);
        }
        let result = MatMut::from_column_major_slice_mut(p, bx, by * bz);
        let rows = MatRef::from_column_major_slice(of_x, nx, by * bz);
        matmul(result, Accum::Replace, vx, rows, 1.0, Par::Seq);
    }
}

/// The tridiagonal systems along z of all pairs of modes: planes of `plane` modes, for the cells of `range`.
fn along_z(
    q: &mut [f64],
    plane: usize,
    pivots: &[f64],
    coupling: &[f64],
    range: &Range<usize>,
    closure: &[f64],
) {
    for (k, at) in range.clone().enumerate().skip(1) {
        let (below, own) = q.split_at_mut(k * plane);
        let (below, own, g) = (&below[(k - 1) * plane..], &mut own[..plane], coupling[at]);
        for ((own, below), pivot) in own.iter_mut().zip(below).zip(&pivots[(at - 1) * plane..]) {
            *own += g * pivot * below;
        }
    }
    let last = range.len() - 1;
    let end = if closure.is_empty() { &pivots[(range.end - 1) * plane..range.end * plane] } else { closure };
    for (own, pivot) in q[last * plane..].iter_mut().zip(end) {
        *own *= pivot;
    }
    for (k, at) in range.clone().enumerate().take(last).rev() {
        let (own, above) = q.split_at_mut((k + 1) * plane);
        let g = coupling[at + 1];
        for ((own, above), pivot) in own[k * plane..].iter_mut().zip(above.iter()).zip(&pivots[at * plane..])
        {
            *own = pivot * (*own + g * above);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;

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
            Poisson::new(&grid).solve(&mut p);
            let error = apply(&grid, &p).iter().zip(&source).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-11, "{x:?} {top:?}: {error:e}");
        }
    }

    #[test]
    fn solution_in_a_box_is_that_of_the_whole_grid() {
        let grid = grid(OPEN, End::Outflow);
        let n = grid.cells();
        let mut poisson = Poisson::new(&grid);
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
        poisson.solve(&mut whole);
        let closure = poisson.closure(&cells[2]);
        poisson.solve_in(&mut inside, &cells, &closure);
        for (m, value) in inside.iter().enumerate() {
            assert!((value - whole[place(m)]).abs() < 1e-12, "{m}");
        }
    }
}
