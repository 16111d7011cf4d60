//! Coupling schemes: the order of the solves in a window.

pub mod added_mass_staggered;
pub mod block_quasi_newton;
pub mod extrapolate;
pub mod gauss_seidel;
pub mod inner_solve;
pub mod jacobi;
pub mod predictor;
pub mod relaxed_load;
pub mod staggered;
