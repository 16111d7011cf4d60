//! Turbulence by one transported quantity: Spalart-Allmaras and its detached-eddy forms.
//!
//! The equation is solved apart from the flow, once for each accepted step, with that step's mass
//! fluxes. The eddy viscosity of a step is that of the last accepted step, so a
//! step repeated with other input (as coupling does) is the same function of it each time.

mod spalart_allmaras;
mod transport;
mod wall_distance;

pub(crate) use spalart_allmaras::{CV1, face_viscosity};
pub use spalart_allmaras::{
    KAPPA, Length, LengthScaleInput, ddes, des97, diffusivity, eddy_viscosity, rans, source,
};
pub use transport::{SpalartAllmaras, TransportInput, WallDistances};
pub use wall_distance::Walls;
