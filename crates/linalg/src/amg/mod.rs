//! Smoothed aggregation multigrid for elasticity.

mod aggregate;
mod coarsen;
mod coarsest;
mod galerkin;
mod level;
mod prolongation;
mod spectrum;

use crate::block::Real;
use crate::{BlockCsr, FactorError, Preconditioner, SingularBlock, SymmetricCsr};
use coarsen::{Step, coarsen};
use coarsest::Coarsest;
use level::Level;

/// Unknowns of a coarse node: three translations and three rotations.
const MODES: usize = 6;

/// Parameters of [`Amg`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmgParams {
    /// A coupling counts as strong when its norm exceeds this share of the geometric
    /// mean of the diagonal blocks' norms.
    pub strength: f64,
    /// Coarsening ends at this many nodes (over all ranks), solved directly.
    pub coarsest_nodes: usize,
    /// Levels at most, the finest included.
    pub max_levels: usize,
}

impl Default for AmgParams {
    fn default() -> Self {
        Self { strength: 0.08, coarsest_nodes: 100, max_levels: 12 }
    }
}

/// Multigrid cannot be set up for a matrix.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub enum AmgError {
    /// A smoother needs the inverse of each diagonal block.
    #[error("multigrid level {level}: {source}")]
    Singular {
        /// Level, counted from the finest.
        level: usize,
        /// The block.
        source: SingularBlock,
    },
    /// Another rank has a singular diagonal block.
    #[error("multigrid level {level}: a diagonal block of another rank is singular or not finite")]
    OtherRank {
        /// Level, counted from the finest.
        level: usize,
    },
    /// The coarsest matrix is singular.
    #[error("the coarsest multigrid level is singular (check that a node is fixed): {0}")]
    Coarsest(#[from] FactorError),
}

/// A symmetric V(1,1) cycle of smoothed aggregation multigrid (Vanek, Mandel, Brezina,
/// Computing 56, 1996) for a symmetric positive definite elasticity matrix, a
/// preconditioner of CG.
///
/// Aggregates lie within a rank and carry the six rigid-body modes of their nodes; the
/// prolongation is smoothed across ranks, so iteration counts hardly depend on the rank
/// count. Smoothers are block Gauss-Seidel, forward before and backward after the coarse
/// correction, Jacobi-like between ranks with the l1 safeguard (Baker, Falgout, Kolev,
/// Yang, SISC 33, 2011). The hierarchy is stored in precision `T`.
pub struct Amg<T: Real = f32> {
    fine: Level<3, T>,
    coarse: Vec<Level<MODES, T>>,
    coarsest: Coarsest,
    /// The matrix was divided by this, so that any unit of stiffness fits in `T`.
    scale: f64,
}

impl<T: Real> Amg<T> {
    /// Builds the hierarchy of `a`, whose Dirichlet rows and columns have been
    /// eliminated. `coords` are the positions of the owned nodes (longer is allowed).
    /// Collective; when it fails it fails on every rank.
    pub fn new(a: &BlockCsr<3>, coords: &[[f64; 3]], params: AmgParams) -> Result<Self, AmgError> {
        let comm = a.halo().comm().clone();
        let diagonal = |i: usize| a.values[a.diagonal_slot(i)];
        let largest = (0..a.n_rows()).flat_map(|i| diagonal(i).into_iter().flatten()).fold(0.0, f64::max);
        let scale = comm.max(largest);
        let scale = if scale > 0.0 && scale.is_finite() { scale } else { 1.0 };

        Self::build(a.map(|v| v / scale), scale, coords, params)
    }

    /// As [`Amg::new`], but keeps the matrix as it is as its finest level, where
    /// [`Amg::matrix`] lends it: a solver then holds it once, and no copy in a higher precision
    /// is ever made. In single precision its entries should be near one (1e-15 to 1e15).
    pub fn of_matrix(a: BlockCsr<3, T>, coords: &[[f64; 3]], params: AmgParams) -> Result<Self, AmgError> {
        Self::build(a, 1.0, coords, params)
    }

    fn build<S: Real>(
        a: BlockCsr<3, S>,
        scale: f64,
        coords: &[[f64; 3]],
        mut params: AmgParams,
    ) -> Result<Self, AmgError> {
        let comm = a.halo().comm().clone();
        let modes = rigid_modes(&a, coords);
        let Ok((mut fine, mut next)) = Level::new(a, &modes, &params, 0, f64::INFINITY)? else {
            unreachable!("any number of coarse nodes will do")
        };
        drop(modes);
        let mut coarse = Vec::new();
        loop {
            let nodes = comm.sum(next.a.n_rows() as f64) as usize;
            if nodes <= params.coarsest_nodes || coarse.len() + 2 >= params.max_levels {
                break;
            }
            // Coarse matrices are denser and less anisotropic.
            params.strength *= 0.5;
            let Step { a, modes } = next;
            // Coarsening that hardly reduces the problem costs more than it helps.
            match Level::new(a, &modes, &params, coarse.len() + 1, 0.9)? {
                Ok((level, step)) => {
                    coarse.push(level);
                    next = step;
                }
                Err(a) => {
                    next = Step { a, modes };
                    break;
                }
            }
        }
        let coarsest = Coarsest::new(&next.a)?;
        fine.reserve();
        coarse.iter_mut().for_each(Level::reserve);
        Ok(Self { fine, coarse, coarsest, scale })
    }

    /// Nodes of each level on this rank, the finest first.
    pub fn nodes(&self) -> Vec<usize> {
        let mut nodes = vec![self.fine.n_rows()];
        nodes.extend(self.coarse.iter().map(Level::n_rows));
        nodes.push(self.coarsest.n_rows());
        nodes
    }

    /// The matrix of the finest level: the one given to [`Amg::of_matrix`], or the one given to
    /// [`Amg::new`] divided by its largest entry. Half of it is stored.
    pub fn matrix(&self) -> &SymmetricCsr<3, T> {
        self.fine.matrix()
    }

    /// Inverses of the finest smoother's diagonal blocks (with the l1 safeguard between ranks).
    pub fn inverse_blocks(&self) -> &[[[T; 3]; 3]] {
        self.fine.inverse()
    }

    /// Bytes of the hierarchy on this rank.
    pub fn bytes(&self) -> usize {
        self.fine.bytes() + self.coarse.iter().map(Level::bytes).sum::<usize>() + self.coarsest.bytes()
    }

    fn descend(&self, depth: usize, r: &[T], x: &mut [T]) {
        match self.coarse.get(depth) {
            Some(level) => level.cycle(r, x, |r, x| self.descend(depth + 1, r, x)),
            None => self.coarsest.solve(r, x),
        }
    }
}

impl<T: Real> Preconditioner for Amg<T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let n = self.fine.n_rows() * 3;
        let mut local = self.fine.buffers();
        let (rhs, x) = &mut *local;
        // The residual is brought to unit size: late in a solve it may underflow in f32.
        let size = self.fine.comm().max(r[..n].iter().fold(0.0, |m: f64, v| m.max(v.abs())));
        if !size.is_normal() {
            // Zero stays zero and NaN stays NaN: the Krylov solver reports it.
            z[..n].copy_from_slice(&r[..n]);
            return;
        }
        let inverse = 1.0 / size;
        for (rhs, r) in rhs.iter_mut().zip(&r[..n]) {
            *rhs = T::from_f64(r * inverse);
        }
        self.fine.cycle(rhs, x, |r, x| self.descend(0, r, x));
        let factor = size / self.scale;
        for (z, x) in z[..n].iter_mut().zip(x.iter()) {
            *z = x.to_f64() * factor;
        }
    }
}

/// The six rigid motions of each owned node, rotations about the mean position and
/// scaled by the extent; components that a Dirichlet condition fixes are zero.
fn rigid_modes<S: Real>(a: &BlockCsr<3, S>, coords: &[[f64; 3]]) -> Vec<[[f64; MODES]; 3]> {
    let n = a.n_rows();
    let mut sums = [0.0; 4];
    for x in &coords[..n] {
        (0..3).for_each(|c| sums[c] += x[c]);
        sums[3] += 1.0;
    }
    let comm = a.halo().comm();
    comm.sum_slice(&mut sums);
    let centre = [0, 1, 2].map(|c| sums[c] / sums[3].max(1.0));
    let extent =
        coords[..n].iter().flat_map(|x| (0..3).map(|c| (x[c] - centre[c]).abs())).fold(0.0, f64::max);
    let extent = comm.max(extent);
    let extent = if extent > 0.0 { extent } else { 1.0 };
    (0..n)
        .map(|i| {
            let [x, y, z] = [0, 1, 2].map(|c| (coords[i][c] - centre[c]) / extent);
            let mut modes =
                [[1.0, 0.0, 0.0, 0.0, z, -y], [0.0, 1.0, 0.0, -z, 0.0, x], [0.0, 0.0, 1.0, y, -x, 0.0]];
            for (r, mode) in modes.iter_mut().enumerate() {
                if is_decoupled(a, i, r) {
                    *mode = [0.0; MODES];
                }
            }
            modes
        })
        .collect()
}

/// Whether row `r` of node `i` holds nothing but its diagonal entry.
fn is_decoupled<const F: usize, S: Real>(a: &BlockCsr<F, S>, i: usize, r: usize) -> bool {
    let diagonal = a.diagonal_slot(i);
    a.row(i).all(|s| (0..F).all(|c| a.values[s][r][c].to_f64() == 0.0 || (s == diagonal && c == r)))
}

#[cfg(test)]
mod tests;
