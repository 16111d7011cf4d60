//! Transfer of motion and loads between the canopy of the scene and the surface of a structure that has its own.
//!
//! A point $`c`$ of the canopy is projected on the nearest triangle of the structure's surface, with the barycentric
//! coordinates $`w_i`$ and the height $`h`$ along its unit normal $`n`$, both in the unstressed configuration. It moves
//! with it,
//!
//! ```math
//! c = \sum_i w_i x_i + h\,n(x),
//! ```
//!
//! which is linear interpolation on the surface and exact for rigid motion, on it or off it. Loads are transferred by
//! sampling: a face of the structure gets the mean of the canopy's load at its sampling points, and the smallest
//! correction linear in space makes the sums of forces and moments equal to those of the canopy. (The transpose of
//! the motion would also conserve the work, but distributes nodal forces unevenly: 6 % of the pressure between
//! surfaces of 3 to 2 cells.)

mod nearest_triangle;
mod own_surface;
mod surface;
mod surface_transfer;

pub use own_surface::{OwnSurface, surface_file};
pub use surface::{Surface, TransferError};
pub use surface_transfer::Transfer;

#[cfg(test)]
mod tests;
