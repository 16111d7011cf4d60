//! Distributed block-sparse linear algebra: operators, Krylov solvers, preconditioners.
//!
//! Vectors are plain slices of local values: `n_owned` rows owned by this rank,
//! followed by ghosts, `B` numbers to a row (block size).

mod operator;

pub use operator::{Operator, Preconditioner};
