//! The one idea behind every way to move a grid.

use crate::local::LocalGrid;
use crate::memory::MoverMemory;

/// What an answer took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// Krylov iterations.
    pub iterations: usize,
    /// Largest estimated error of positions, in shares of an edge (see [`crate::felt`]).
    pub error: f64,
    /// Error that is accepted, in the same measure; 0: nothing was iterated.
    pub accepted: f64,
}

/// Carries the motion of the canopy into the grid around it.
///
/// A mover stands on a reference grid, whose displacements it knows. All ranks call together.
pub trait Mover {
    /// Takes `x` (all local nodes, flat, m) as the reference grid. All ranks get the same
    /// error; after [`MoverError::Inverted`] the mover stands where it stood, after another one it
    /// has no reference until the next call succeeds.
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError>;

    /// Bytes held.
    fn bytes(&self) -> usize;

    /// What was learnt on the reference grid from earlier motions.
    fn memory(&self) -> MoverMemory {
        MoverMemory::default()
    }

    /// Takes up a [`Mover::memory`] of the same reference grid.
    ///
    /// # Errors
    /// What in it does not fit; nothing is taken up then.
    fn recall(&mut self, memory: MoverMemory) -> Result<(), String> {
        let MoverMemory { singles, doubles, numbers } = memory;
        let empty = singles.is_empty() && doubles.is_empty() && numbers.is_empty();
        if empty { Ok(()) } else { Err("a mover that learns nothing has learnt something".into()) }
    }

    /// Displacements `u` of the local free nodes (owned and ghosts, `[n][3]`, m)
    /// when the canopy (all of it, `[n_canopy][3]`, m) is displaced by `canopy`
    /// from the reference grid.
    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError>;
}

/// Why a mover has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MoverError {
    /// A reference grid with a cell that is turned inside out.
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
    /// A part of the grid that nothing holds in place.
    #[error("the stiffness of the grid is singular ({reason}): is every cell joined to the outer boundary?")]
    Singular {
        /// What the linear algebra found.
        reason: String,
    },
    /// The linear solver made no progress.
    #[error(
        "the grid motion solver did not converge: after {iterations} iterations a node's position is \
         uncertain by {error:.2e} of its cell (accepted: {tolerance:.1e}); \
         raise mesh.tolerance or lower mesh.stiffening_exponent"
    )]
    NotConverged {
        /// Iterations made.
        iterations: usize,
        /// Error reached, in shares of the cell.
        error: f64,
        /// Error accepted.
        tolerance: f64,
    },
}
