//! Distributed block-sparse linear algebra: operators, Krylov solvers, preconditioners.
//!
//! Vectors are plain slices of local values: `n_owned` rows owned by this rank,
//! followed by ghosts, `B` numbers to a row (block size).
//!
//! * [`BlockCsr`]: block rows of a distributed matrix, assembled through precomputed
//!   slots.
//! * [`SymmetricCsr`]: the same with half of it stored, for products that read less memory.
//! * [`Gmres`], [`Cg`]: Krylov solvers that own their workspace.
//! * [`Subsystem`]: solves for some rows across ranks, the others held.
//! * [`BlockJacobi`]: rank-local preconditioner.
//! * [`SchwarzLu`]: sparse direct factors of subdomains, one or more to a rank.
//! * [`Amg`]: smoothed aggregation multigrid for elasticity.

// Blocks are written in index notation, like the formulas they implement.
#![allow(clippy::needless_range_loop)]

mod amg;
mod block;
mod block_csr;
mod condensed;
mod direct;
mod ghost_rows;
mod ilu;
mod jacobi;
mod krylov;
mod operator;
mod prefetch;
mod schwarz;
mod subsystem;
mod symmetric;
mod vector;

pub use amg::{Amg, AmgError, AmgParams};
pub use block::Real;
pub use block_csr::BlockCsr;
pub use condensed::CondensedLu;
pub use direct::FactorError;
pub use jacobi::{BlockJacobi, SingularBlock};
pub use krylov::{Cg, Gmres, History, KrylovError, KrylovInfo, KrylovParams};
pub use operator::{Identity, Operator, Preconditioner};
pub use schwarz::SchwarzLu;
pub use subsystem::{Subsystem, SubsystemError};
pub use symmetric::SymmetricCsr;
