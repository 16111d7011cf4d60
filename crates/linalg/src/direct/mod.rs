//! Sparse direct solution of rank-local systems.

mod block_lu;
mod pivot;
mod sweep;
mod symbolic;

pub use block_lu::FactorError;
pub(crate) use block_lu::{BlockLu, Part};
pub(crate) use sweep::largest;
