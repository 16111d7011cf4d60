//! Sparse direct solution of rank-local systems.

mod block_lu;
mod pivot;
mod sweep;
mod symbolic;

pub(crate) use block_lu::BlockLu;
pub use block_lu::FactorError;
pub(crate) use sweep::largest;
