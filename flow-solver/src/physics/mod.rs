//! Point physics: small arrays in, small arrays out.
//!
//! Unknowns are primitive, $`Q = (p', u, v, w[, T'])`$: gauge pressure relative to
//! the undisturbed air (so no digits are lost at Mach 0.014), velocity relative
//! to the ground, temperature difference from the undisturbed air.
//!
//! What the loop over faces calls is written for one face and for a batch of them ([`mesh::lanes::Real`]).

mod blending;
mod flux;
mod gas;
mod law_of_the_wall;
mod open_boundary;
mod permeability;
mod precondition;
mod viscosity;

pub use blending::{Blending, uneven, unresolved_in_time};
pub(crate) use flux::relative_speed;
pub use flux::{
    FaceFlux, FaceHistory, FluxParameters, Interface, VELOCITY_DIFFUSION, interface, split_form_correction,
    wall,
};
pub use gas::{Air, Gas, IdealGas, Isothermal};
pub use law_of_the_wall::{WallLaw, WallTreatment, velocity_ratio, velocity_slope};
pub use open_boundary::{BoundaryFace, FarField, OpenBoundary, Outlet, open_boundary};
pub use permeability::Permeability;
pub use precondition::{preconditioner, reference_speed, spectral_radius};
pub use viscosity::{
    EddyViscosity, Inviscid, Laminar, Turbulent, Viscosity, ViscosityModel, along_wall, stress_force,
    wall_traction,
};

use mesh::lanes::Real;
use nalgebra::Vector3;

/// Velocity of the state `q`, m/s.
#[inline(always)]
pub fn velocity<T: Real, const N: usize>(q: &[T; N]) -> Vector3<T> {
    Vector3::new(q[1], q[2], q[3])
}
