//! Laplace's equation for each component of the displacement, for comparison.

use linalg::{BlockCsr, BlockJacobi, Cg, KrylovError, KrylovParams};

use crate::elastic::{agree, inverted};
use crate::element::conductance;
use crate::local::{Kind, LocalGrid};
use crate::mover::{Effort, Mover, MoverError};
use crate::warm_start::MoverWarmStart;

/// Laplacian smoothing with a conductivity that increases for smaller cells, common in finite-volume codes. One
/// scalar matrix for the three components.
pub struct Laplacian {
    chi: f64,
    tolerance: f64,
    system: Option<System>,
}

struct System {
    matrix: BlockCsr<1>,
    jacobi: BlockJacobi<1>,
    cg: Cg,
    canopy: Coupling,
    rhs: Vec<f64>,
    /// Last solution of each component: the next initial guess.
    last: [Vec<f64>; 3],
}

/// Owned free row, interface node, entry.
type Coupling = Vec<(u32, u32, f64)>;

impl Laplacian {
    /// With stiffening by the Jacobian to the power `chi`; `tolerance` is the residual relative to the right-hand
    /// side.
    pub fn new(chi: f64, tolerance: f64) -> Self {
        Self { chi, tolerance, system: None }
    }

    fn assemble(&self, grid: &LocalGrid, x: &[f64]) -> Result<(BlockCsr<1>, Coupling), MoverError> {
        let free = |a: &u32| match grid.kind[*a as usize] {
            Kind::Free(i) => Some(i),
            _ => None,
        };
        let lists: Vec<Vec<u32>> =
            grid.cells.iter().map(|cell| cell.iter().filter_map(free).collect()).collect();
        let mut matrix = BlockCsr::<1>::from_elements(grid.free_halo.clone(), lists.iter().map(|l| &l[..]));
        let mut canopy = Vec::new();
        for (c, cell) in grid.cells.iter().enumerate() {
            let k = conductance(&grid.corners(c, x), self.chi)
                .map_err(|e| inverted(grid, c, x, e.determinant))?;
            for (a, na) in cell.iter().enumerate() {
                let Some(row) = free(na).filter(|&i| (i as usize) < grid.n_free) else { continue };
                for (b, &nb) in cell.iter().enumerate() {
                    match grid.kind[nb as usize] {
                        Kind::Fixed => {}
                        Kind::Canopy(node) => canopy.push((row, node, k[a][b])),
                        Kind::Free(col) => {
                            let slot = matrix.slot(row as usize, col as usize);
                            matrix.values[slot.expect("the pattern holds all pairs of a cell")][0][0] +=
                                k[a][b];
                        }
                    }
                }
            }
        }
        Ok((matrix, canopy))
    }
}

impl Mover for Laplacian {
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError> {
        let (matrix, canopy) = agree(grid, self.assemble(grid, x))?;
        let jacobi = BlockJacobi::new(&matrix);
        if !grid.comm().all(jacobi.is_ok()) {
            return Err(MoverError::Singular { reason: "a diagonal entry is zero or not finite".into() });
        }
        let n_local = grid.free_node.len();
        self.system = Some(System {
            matrix,
            jacobi: jacobi.expect("all ranks have one"),
            cg: Cg::new(grid.comm()),
            canopy,
            rhs: vec![0.0; grid.n_free],
            last: [(); 3].map(|()| vec![0.0; n_local]),
        });
        Ok(())
    }

    fn bytes(&self) -> usize {
        let Some(s) = &self.system else { return 0 };
        s.matrix.bytes() + size_of_val(&s.canopy[..]) + 8 * (9 * s.rhs.len())
    }

    fn save_state(&self) -> MoverWarmStart {
        let doubles = self.system.as_ref().map(|s| s.last.to_vec()).unwrap_or_default();
        MoverWarmStart { doubles, ..MoverWarmStart::default() }
    }

    fn restore_state(&mut self, saved: MoverWarmStart) -> Result<(), String> {
        let Some(s) = &mut self.system else { return Ok(()) };
        let fits = |(last, known): (&Vec<f64>, &Vec<f64>)| last.len() == known.len();
        if saved.doubles.len() != s.last.len() || !s.last.iter().zip(&saved.doubles).all(fits) {
            return Err("its last solutions belong to another grid".into());
        }
        s.last.iter_mut().zip(saved.doubles).for_each(|(last, known)| *last = known);
        Ok(())
    }

    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError> {
        let s = self.system.as_mut().expect("a mover is used after `rebase`");
        let params =
            KrylovParams { rel_tol: self.tolerance, max_iterations: 2000, ..KrylovParams::default() };
        let comm = grid.comm();
        let mut effort = Effort { accepted: self.tolerance, ..Effort::default() };
        for (i, x) in s.last.iter_mut().enumerate() {
            s.rhs.fill(0.0);
            for (row, k, v) in &s.canopy {
                s.rhs[*row as usize] -= v * canopy[3 * *k as usize + i];
            }
            if comm.max(s.rhs.iter().fold(0.0, |m, v| f64::max(m, v.abs()))) == 0.0 {
                // No motion of this component gives exactly none.
                x.fill(0.0);
            }
            let info = s.cg.solve(&s.matrix, &s.jacobi, &s.rhs, x, params).map_err(|e| match e {
                KrylovError::NotConverged { iterations, residual, target, .. } => MoverError::NotConverged {
                    iterations,
                    error: residual / target * self.tolerance,
                    tolerance: self.tolerance,
                },
                other => MoverError::Singular { reason: other.to_string() },
            })?;
            effort.iterations += info.iterations;
            let share = if info.rhs_norm > 0.0 { info.final_residual / info.rhs_norm } else { 0.0 };
            effort.error = effort.error.max(share);
            for (u, x) in u.as_chunks_mut::<3>().0[..grid.n_free].iter_mut().zip(&*x) {
                u[i] = *x;
            }
        }
        grid.free_halo.exchange(u, 3);
        Ok(effort)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use comm::Comm;

    #[test]
    fn translation_of_the_whole_boundary_translates_all_nodes() {
        let mut grid = crate::example_grid::plate_in_box(6, 0.2, 0.8, true);
        let outer = grid.boundary.iter().flat_map(|(_, f)| *f).chain(grid.canopy_nodes.iter().copied());
        let mut nodes: Vec<u32> = outer.collect();
        nodes.sort_unstable();
        nodes.dedup();
        grid.canopy_nodes = nodes;
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
        let mut mover = Laplacian::new(1.0, 1e-10);
        mover.rebase(&local, &local.gather(&grid.coords)).unwrap();
        let displacement: Vec<f64> = (0..local.n_canopy).flat_map(|_| [1.0, -2.0, 3.0]).collect();
        let mut u = vec![0.0; 3 * local.free_node.len()];
        mover.displace(&local, &displacement, &mut u).unwrap();
        for u in u.as_chunks::<3>().0 {
            for (u, want) in u.iter().zip([1.0, -2.0, 3.0]) {
                assert!((u - want).abs() < 1e-7, "{u} {want}");
            }
        }
    }
}
