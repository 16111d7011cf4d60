//! Motion and loads between the canopy of the scene and the surface of a structure that has its own.
//!
//! A point $c$ of the canopy lies over the nearest triangle of the structure's surface, at the
//! barycentric coordinates $w_i$ and the height $h$ along its unit normal $n$, both measured on the unstressed
//! shapes. It moves with it,
//!
//! $$ c = \sum_i w_i x_i + h\,n(x), $$
//!
//! which is linear interpolation on the surface and exact for rigid motion, on it or off it. Loads go the other way
//! by place: a face of the structure takes the mean of what the canopy bears beside it, and the least change linear in
//! space gives it the sums of forces and moments of the canopy. (The transpose of the motion would keep the work as well,
//! but spreads nodal forces as unevenly as nodes fall: 6 % of the pressure between surfaces of 3 to 2 cells.)

mod near;
mod own_surface;
mod surface;
mod surface_transfer;

pub use own_surface::{OwnSurface, surface_file};
pub use surface::{Surface, TransferError};
pub use surface_transfer::Transfer;

#[cfg(test)]
mod tests;
