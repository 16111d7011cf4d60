//! Element kernels: pure functions over small fixed-size arrays.
//!
//! Each kernel returns nodal forces and, where it stiffens, the 3x3 blocks of
//! its tangent, exact derivatives of these forces. No kernel knows a mesh.

pub mod cable;
pub mod load;
pub mod mass;
pub mod membrane;
pub mod quad;

#[cfg(test)]
pub(crate) mod check;
