//! Membranes and cables: total Lagrangian finite elements under MPI.
//!
//! Section 1 of the paper: constant-strain membranes and cables of St.
//! Venant-Kirchhoff material with a tension field, follower pressure, implicit
//! time integration, Newton's method, GMRES.

pub mod elements;
pub mod materials;
pub mod vec3;
