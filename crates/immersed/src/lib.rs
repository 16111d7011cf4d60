//! Incompressible flow on a rectilinear grid through which surfaces move.
//!
//! - [`axis`], [`grid`], [`placement`]: cells around a surface and the layout of staggered arrays,
//! - [`far_field`]: the velocity of the undisturbed air, which may change with height,
//! - [`momentum`]: convection and viscous stress,
//! - [`eddy_viscosity`]: models of the eddies that cells do not resolve, and their stress,
//! - [`poisson`]: the pressure equation,
//! - [`cut_faces`], [`constraints`]: surfaces, and what they prescribe on the faces that they cut,
//! - [`friction`]: no slip on surfaces in viscous flow,
//! - [`free_edges`]: upwind differences at their free edges,
//! - [`pockets`]: air that a surface encloses in few cells,
//! - [`face_transfer`]: velocities and forces between constraints and the faces of a surface,
//! - [`slabs`]: the part of a grid that each rank computes,
//! - [`device`]: steps on another device, such as a GPU,
//! - [`flow`], [`pressure_jumps`]: a time step.
//!
//! Why: `docs/decisions/0048-immersed-surfaces.md`.

pub mod axis;
mod axis_modes;
pub mod constraints;
pub mod cut_faces;
pub mod device;
mod eddy_stress;
pub mod eddy_viscosity;
pub mod face_transfer;
pub mod far_field;
pub mod flow;
mod flow_eddies;
pub mod free_edges;
pub mod friction;
pub mod grid;
pub mod momentum;
mod multilevel;
pub mod placement;
pub mod pockets;
pub mod poisson;
pub mod pressure_jumps;
mod projection;
pub mod regrid;
pub mod shapes;
pub mod slabs;
mod undisturbed;
pub mod wall_rates;
