//! The interface of grid movers.

use crate::local::LocalGrid;
use crate::near_wall_following;
use crate::warm_start::MoverWarmStart;

/// Cost of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// Krylov iterations.
    pub iterations: usize,
    /// Largest estimated error of positions, relative to an edge (see [`crate::position_error`]).
    pub error: f64,
    /// Accepted error, in the same measure; 0: nothing was iterated.
    pub accepted: f64,
}

/// Extends the motion of the canopy to the grid around it.
///
/// A mover has a reference grid, from which displacements are measured. All ranks call together.
pub trait Mover {
    /// Sets `x` (all local nodes, flat, m) as the reference grid. All ranks get the same error; after
    /// [`MoverError::Inverted`] the mover keeps its reference, after any other one it has none until the next call
    /// succeeds.
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError>;

    /// Bytes held.
    fn bytes(&self) -> usize;

    /// Warm-start data from earlier motions on the reference grid.
    fn save_state(&self) -> MoverWarmStart {
        MoverWarmStart::default()
    }

    /// Restores a [`Mover::save_state`] of the same reference grid.
    ///
    /// # Errors
    /// Data that do not match; the mover is unchanged then.
    fn restore_state(&mut self, saved: MoverWarmStart) -> Result<(), String> {
        let MoverWarmStart { singles, doubles, numbers } = saved;
        let empty = singles.is_empty() && doubles.is_empty() && numbers.is_empty();
        if empty { Ok(()) } else { Err("warm-start data for a mover that has none".into()) }
    }

    /// Displacements `u` of the local free nodes (owned and ghosts, `[n][3]`, m) for a displacement `canopy` of the
    /// whole canopy (`[n_canopy][3]`, m) from the reference grid.
    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError>;

    /// Displacements `u` of the local free nodes for a small further motion `canopy` after [`Mover::displace`], as there: without an iteration, a linear function
    /// of `canopy` that stays the same until the next [`Mover::displace`]. Collective.
    fn extend(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
        u.fill(0.0);
        near_wall_following::follow(grid, canopy, u);
        grid.free_halo.exchange(u, 3);
    }
}

/// Why a mover failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MoverError {
    /// A reference grid with an inverted cell.
    #[error(
        "cell {cell} at ({:.4}, {:.4}, {:.4}) m is inverted (Jacobian determinant {determinant:.3e} m3): \
          the grid cannot move from here; refine or smooth the grid there", at[0], at[1], at[2]
    )]
    Inverted {
        /// Global cell.
        cell: u32,
        /// Its centre, m.
        at: [f64; 3],
        /// Jacobian determinant at the Gauss point.
        determinant: f64,
    },
    /// A part of the grid without any constraint.
    #[error(
        "the stiffness of the grid is singular ({reason}): check that every cell is connected to the outer boundary"
    )]
    Singular {
        /// Message of the linear algebra.
        reason: String,
    },
    /// The linear solver did not converge.
    #[error(
        "the grid motion solver did not converge: after {iterations} iterations the estimated error of a node's position is \
         {error:.2e} of its cell (tolerance {tolerance:.1e}); \
         raise mesh.tolerance or lower mesh.stiffening_exponent"
    )]
    NotConverged {
        /// Number of iterations.
        iterations: usize,
        /// Error reached, relative to the cell.
        error: f64,
        /// Error accepted.
        tolerance: f64,
    },
}
