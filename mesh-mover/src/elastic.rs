//! The pseudo-solid: linear elasticity, stiffer where cells are small, badly shaped, or near the canopy.

use linalg::{Amg, AmgParams, BlockCsr, Operator};
use mesh::Point;

use crate::element::stiffness;
use crate::error_estimate::CheapErrorEstimate;
use crate::local::{Kind, LocalGrid};
use crate::mover::{Effort, Mover, MoverError};
use crate::near_wall_following;
use crate::position_error::PositionErrorNorm;
use crate::slide;
use crate::solution_projection::SolutionProjection;
use crate::solve::{Scratch, StoppingCriterion, correct};
use crate::warm_start::MoverWarmStart;

/// Parameters of the pseudo-solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Exponent of the stiffening by the Jacobian; 0: uniform.
    pub chi: f64,
    /// Exponent of the stiffening by shape: a cell of scaled Jacobian q in the reference grid is stiffer by
    /// q^-exponent; 0: none.
    pub shape_exponent: f64,
    /// Exponent of the stiffening near the canopy: a cell at the distance d from it is stiffer by d^-exponent (see
    /// [`crate::canopy_distance`]); 0: none.
    pub distance_exponent: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Accepted error of positions, relative to an edge (see [`PositionErrorNorm`]).
    pub tolerance: f64,
    /// Largest number of iterations of a solve.
    pub max_iterations: usize,
}

/// The Jacobian detects compressed cells but not sheared ones. Measured on a plate lifted by half its width, rotated
/// by 60 degrees and bent to 90 degrees with updated references: worst scaled Jacobian 0.015, 0.004, 0.009 without
/// stiffening by shape (in up to 8 increments a window), 0.17, 0.09, 0.09 with 3 (in one each).
const SHAPE_EXPONENT: f64 = 3.0;

/// The edge of a sheet in a uniform solid is a crack tip: the strain is singular there, and cells degrade there
/// first. A solid that is stiffer near the sheet moves the surroundings of the edge with it. Worst scaled Jacobian
/// over the six motions of [`crate::benchmark_motions`], without repair: 0.06 with 0, 0.10 with 1, 0.14 to 0.19 with
/// 2, 0.23 with 3 (but less range for in-plane motion), with fewer iterations than without.
const DISTANCE_EXPONENT: f64 = 2.0;

/// Lower bound of the scaled Jacobian in the stiffening, which limits the contrast.
const LEAST_SHAPE: f64 = 0.02;

impl From<&case::MeshMotion> for Solid {
    fn from(m: &case::MeshMotion) -> Self {
        Self {
            chi: m.stiffening_exponent,
            shape_exponent: SHAPE_EXPONENT,
            distance_exponent: DISTANCE_EXPONENT,
            poisson: m.poisson_ratio,
            tolerance: m.tolerance,
            max_iterations: 1000,
        }
    }
}

/// Linear elasticity on the reference grid (paper, equation 8). The unknowns are the free nodes; the canopy enters by
/// its coupling blocks.
pub struct Elastic {
    solid: Solid,
    system: Option<System>,
}

/// The linear system of one reference grid.
struct System {
    /// Owned free row, interface node, and coupling block.
    canopy: Vec<(u32, u32, [[f64; 3]; 3])>,
    /// Contains the matrix, in single precision: equivalent to a relative change of the stiffness by 1e-7.
    amg: Amg<f32>,
    error_estimate: CheapErrorEstimate,
    position_error: PositionErrorNorm,
    warm_start_basis: SolutionProjection,
    scratch: Scratch,
    rhs: Vec<f64>,
    /// Motion of the canopy that no past solution contains.
    missing: Vec<f64>,
}

impl Elastic {
    /// A mover without a reference grid; [`Mover::rebase`] must be called first.
    pub fn new(solid: Solid) -> Self {
        Self { solid, system: None }
    }
}

impl Mover for Elastic {
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError> {
        let (matrix, canopy) = agree(grid, assemble(grid, x, &self.solid))?;
        let at = |a: &u32| -> Point { [0, 1, 2].map(|i| x[3 * *a as usize + i]) };
        let coords: Vec<Point> = grid.free_node[..grid.n_free].iter().map(at).collect();
        // Fails on all ranks.
        let singular = |e: &dyn std::error::Error| MoverError::Singular { reason: e.to_string() };
        let (n, n_local) = (matrix.n_owned(), matrix.n_local());
        // The old system is dropped before the new one is assembled: two would determine the peak memory.
        self.system = None;
        let amg = Amg::of_matrix(matrix, &coords, AmgParams::default()).map_err(|e| singular(&e))?;
        self.system = Some(System {
            canopy,
            amg,
            error_estimate: CheapErrorEstimate::default(),
            position_error: PositionErrorNorm::new(grid, x),
            warm_start_basis: SolutionProjection::new(n, 3 * grid.n_canopy),
            scratch: Scratch::new(n, n_local),
            rhs: vec![0.0; n],
            missing: vec![0.0; 3 * grid.n_canopy],
        });
        Ok(())
    }

    fn bytes(&self) -> usize {
        let Some(s) = &self.system else { return 0 };
        let vectors = 8 * (5 * s.scratch.r.len() + s.rhs.len() + s.missing.len()) + s.position_error.bytes();
        s.amg.bytes() + size_of_val(&s.canopy[..]) + vectors + s.warm_start_basis.bytes()
    }

    fn save_state(&self) -> MoverWarmStart {
        let Some(s) = &self.system else { return MoverWarmStart::default() };
        let (singles, doubles) = s.warm_start_basis.save_state();
        MoverWarmStart { singles, doubles, numbers: s.error_estimate.save_state().to_vec() }
    }

    fn restore_state(&mut self, saved: MoverWarmStart) -> Result<(), String> {
        let Some(s) = &mut self.system else { return Ok(()) };
        let [gain, samples] = saved.numbers[..] else {
            return Err("the history of its error estimate is missing".into());
        };
        s.warm_start_basis.restore_state(&saved.singles, &saved.doubles)?;
        s.error_estimate.restore_state([gain, samples]);
        Ok(())
    }

    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError> {
        let Some(s) = self.system.as_mut() else {
            return Err(MoverError::Singular {
                reason: "the last reference grid has no stiffness matrix".into(),
            });
        };
        let comm = grid.comm();
        let n = s.rhs.len();
        s.guess(grid, canopy, &mut u[..n]);
        s.amg.matrix().apply(u, &mut s.scratch.r);
        for (r, b) in s.scratch.r.iter_mut().zip(&s.rhs) {
            *r = b - *r;
        }
        let goal =
            StoppingCriterion { tolerance: self.solid.tolerance, max_iterations: self.solid.max_iterations };
        let end = correct(&s.amg, &mut s.error_estimate, comm, &s.position_error, goal, &mut s.scratch);
        if end.error.is_nan() || end.error > goal.tolerance {
            return Err(MoverError::NotConverged {
                iterations: end.iterations,
                error: end.error,
                tolerance: goal.tolerance,
            });
        }
        let Scratch { d, z, p, r, .. } = &mut s.scratch;
        for ((u, d), z) in u[..n].iter_mut().zip(&*d).zip(&*z) {
            *u += d + z;
        }
        slide::project(&grid.slides, &mut u[..n]);
        if end.iterations > 0 {
            near_wall_following::follow(grid, &s.missing, d);
            p[..n].copy_from_slice(d);
            s.amg.matrix().apply(p, r);
            s.warm_start_basis.add_solution(comm, d, r, &mut s.missing);
        }
        grid.free_halo.exchange(u, 3);
        Ok(Effort { iterations: end.iterations, error: end.error, accepted: goal.tolerance })
    }

    fn extend(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
        let Some(s) = self.system.as_mut() else { return };
        let n = s.rhs.len();
        s.guess(grid, canopy, &mut u[..n]);
        slide::project(&grid.slides, &mut u[..n]);
        grid.free_halo.exchange(u, 3);
    }
}

impl System {
    /// Displacements `u` of the owned free nodes for a motion of the canopy: the combination of past solutions in it, the rest
    /// ([`System::missing`]) at the nearest rings. Collective.
    fn guess(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
        self.rhs.fill(0.0);
        for (row, k, block) in &self.canopy {
            let b = &mut self.rhs[3 * *row as usize..][..3];
            let g = &canopy[3 * *k as usize..][..3];
            for (b, a) in b.iter_mut().zip(block) {
                *b -= a[0] * g[0] + a[1] * g[1] + a[2] * g[2];
            }
        }
        self.missing.copy_from_slice(canopy);
        self.warm_start_basis.guess(grid.comm(), &self.rhs, u, &mut self.missing);
        near_wall_following::follow(grid, &self.missing, u);
    }
}

pub(crate) type Coupling = Vec<(u32, u32, [[f64; 3]; 3])>;

/// Stiffness of the owned free rows at node positions `x`: its free columns, and the coupling columns of the canopy.
fn assemble(grid: &LocalGrid, x: &[f64], solid: &Solid) -> Result<(BlockCsr<3, f32>, Coupling), MoverError> {
    let _part = timing::part("assembly");
    let mut free = Vec::with_capacity(8 * grid.cells.len());
    let mut ends = Vec::with_capacity(grid.cells.len() + 1);
    ends.push(0);
    let mut pairs: Vec<(u32, u32)> = Vec::new();
    for cell in &grid.cells {
        for &a in cell {
            if let Kind::Free(i) = grid.kind[a as usize] {
                free.push(i);
                if (i as usize) < grid.n_free {
                    pairs.extend(cell.iter().filter_map(|&b| match grid.kind[b as usize] {
                        Kind::Canopy(k) => Some((i, k)),
                        _ => None,
                    }));
                }
            }
        }
        ends.push(free.len());
    }
    pairs.sort_unstable();
    pairs.dedup();
    let lists = ends.windows(2).map(|w| &free[w[0]..w[1]]);
    let mut matrix = BlockCsr::<3, f32>::from_elements(grid.free_halo.clone(), lists);
    let mut canopy: Coupling = pairs.iter().map(|&(i, k)| (i, k, [[0.0; 3]; 3])).collect();

    // E = 1 in a cell of mean size: only ratios matter.
    let nu = solid.poisson;
    let scale = (grid.mean_volume / 8.0).powf(solid.chi);
    let [lambda, mu] = lame(scale, nu);

    for (c, cell) in grid.cells.iter().enumerate() {
        let corners = grid.corners(c, x);
        let f = grid.quality(c, x).clamp(LEAST_SHAPE, 1.0).powf(-solid.shape_exponent)
            * f64::from(grid.depth[c]).powf(-solid.distance_exponent);
        let (lambda, mu) = (f * lambda, f * mu);
        let k =
            stiffness(&corners, lambda, mu, solid.chi).map_err(|e| inverted(grid, c, x, e.determinant))?;
        for (a, &na) in cell.iter().enumerate() {
            let Kind::Free(row) = grid.kind[na as usize] else { continue };
            if row as usize >= grid.n_free {
                continue;
            }
            for (b, &nb) in cell.iter().enumerate() {
                let block = |i: usize, j: usize| k[3 * a + i][3 * b + j];
                match grid.kind[nb as usize] {
                    Kind::Fixed => continue,
                    Kind::Free(col) => {
                        let slot = matrix.slot(row as usize, col as usize);
                        let t = &mut matrix.values[slot.expect("the pattern holds all pairs of a cell")];
                        (0..9).for_each(|e| t[e / 3][e % 3] += block(e / 3, e % 3) as f32);
                    }
                    Kind::Canopy(k) => {
                        let at = pairs.binary_search(&(row, k));
                        let t = &mut canopy[at.expect("the pattern holds all pairs of a cell")].2;
                        (0..9).for_each(|e| t[e / 3][e % 3] += block(e / 3, e % 3));
                    }
                }
            }
        }
    }
    slide::constrain(&grid.slides, &mut matrix, &mut canopy);
    Ok((matrix, canopy))
}

/// Lamé's constants `[lambda, mu]` for Young's modulus `young` and Poisson's ratio `nu`.
fn lame(young: f64, nu: f64) -> [f64; 2] {
    let mu = young * 0.5 / (1.0 + nu);
    let lambda = young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu));
    [lambda, mu]
}

/// The first error in rank order on every rank, so that all return together. Collective.
pub(crate) fn agree<T>(grid: &LocalGrid, result: Result<T, MoverError>) -> Result<T, MoverError> {
    let row = match &result {
        Err(MoverError::Inverted { cell, at, determinant }) => {
            vec![f64::from(*cell), at[0], at[1], at[2], *determinant]
        }
        // Other errors come from solves, which end in the same way on all ranks.
        _ => Vec::new(),
    };
    match grid.comm().all_gather_var(&row).as_chunks::<5>().0.first() {
        Some(&[cell, x, y, z, determinant]) => {
            Err(MoverError::Inverted { cell: cell as u32, at: [x, y, z], determinant })
        }
        None => result,
    }
}

pub(crate) fn inverted(grid: &LocalGrid, c: usize, x: &[f64], determinant: f64) -> MoverError {
    let at: Point = grid.centre(c, x);
    MoverError::Inverted { cell: grid.cell_global[c], at, determinant }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar under tension: stress `E` along it at unit strain and none across it.
    #[test]
    fn uniaxial_tension_has_the_modulus_and_poisson_ratio() {
        for (young, nu) in [(1.0, 0.0), (3.0, 0.3), (0.2, 0.45)] {
            let [lambda, mu] = lame(young, nu);
            let trace = 1.0 - 2.0 * nu;
            assert!((lambda * trace + 2.0 * mu - young).abs() < 1e-14 * young);
            assert!((lambda * trace - 2.0 * mu * nu).abs() < 1e-14 * young);
        }
    }

    /// Rows of the matrix are sums over the cells around a node, each with its stiffening by distance and size; cells
    /// with right angles have no stiffening by shape, others have.
    #[test]
    fn rows_are_sums_of_the_stiffened_cell_matrices() {
        for (wiggle, chi, shape_exponent, distance_exponent) in
            [(0.0, 1.5, 3.0, 2.0), (0.1, 0.0, 3.0, 0.0), (0.1, 0.0, 0.0, 2.0), (0.1, 2.0, 0.0, 0.0)]
        {
            let grid = crate::example_grid::plate_in_box(4, wiggle, 0.8, false);
            let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &comm::Comm::solo());
            let x = local.gather(&grid.coords);
            let (poisson, tolerance, max_iterations) = (0.3, 1e-3, 100);
            let solid = Solid { chi, shape_exponent, distance_exponent, poisson, tolerance, max_iterations };
            let (matrix, canopy) = assemble(&local, &x, &solid).unwrap();
            // The box of 2 m has 64 cells; J of a cell is an eighth of its volume.
            let young = (8.0 / 64.0 / 8.0f64).powf(chi);
            let (lambda, mu) = (young * 0.3 / (1.3 * 0.4), young / 2.6);
            let mut expected = std::collections::HashMap::<(u32, u32), [[f64; 3]; 3]>::new();
            for (c, cell) in local.cells.iter().enumerate() {
                let f = local.quality(c, &x).powf(-shape_exponent)
                    * f64::from(local.depth[c]).powf(-distance_exponent);
                let k = stiffness(&local.corners(c, &x), f * lambda, f * mu, chi).unwrap();
                for a in 0..8 {
                    for b in 0..8 {
                        let block = expected.entry((cell[a], cell[b])).or_default();
                        (0..9).for_each(|e| block[e / 3][e % 3] += k[3 * a + e / 3][3 * b + e % 3]);
                    }
                }
            }
            let close = |found: &[[f64; 3]; 3], a: u32, b: u32| {
                let size = expected[&(a, a)][0][0];
                let block = expected[&(a, b)];
                (0..9).for_each(|e| {
                    let (f, w) = (found[e / 3][e % 3], block[e / 3][e % 3]);
                    assert!((f - w).abs() < 2e-6 * size, "{a} {b} {e}: {f} {w}");
                });
            };
            for (i, &a) in local.free_node[..local.n_free].iter().enumerate() {
                for (j, &b) in local.free_node[..local.n_free].iter().enumerate() {
                    if let Some(slot) = matrix.slot(i, j) {
                        close(&matrix.values[slot].map(|row| row.map(f64::from)), a, b);
                    }
                }
            }
            assert!(canopy.len() > 20);
            let node = |k: u32| local.canopy.iter().find(|c| c.1 == k).expect("a canopy node").0;
            canopy.iter().for_each(|(i, k, block)| close(block, local.free_node[*i as usize], node(*k)));
        }
    }
}
