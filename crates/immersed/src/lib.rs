//! Incompressible flow on a rectilinear grid through which surfaces move.
//!
//! - [`axis`], [`grid`]: cells and the layout of staggered arrays,
//! - [`momentum`]: convection and viscous stress,
//! - [`poisson`]: the pressure equation,
//! - [`cut_faces`], [`constraints`]: surfaces, and what they prescribe on the faces that they cut,
//! - [`flow`]: a time step.
//!
//! Why: `docs/decisions/0048-immersed-surfaces.md`.

pub mod axis;
pub mod constraints;
pub mod cut_faces;
pub mod flow;
pub mod grid;
pub mod momentum;
pub mod poisson;
pub mod shapes;
