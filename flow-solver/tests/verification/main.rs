//! Fluxes, schemes, boundary conditions and participants of the flow: exact and manufactured solutions, published values, symmetries. One program, so that
//! the solver is compiled for all of them once. Tests on several ranks, which share the cores badly with others, are in `ranks.rs` and `monitors.rs`.

#[path = "../common/bodies.rs"]
mod bodies;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/isotropic.rs"]
mod isotropic;
#[path = "../common/plate.rs"]
mod plate;
#[path = "../common/shapes.rs"]
mod shapes;
#[path = "../common/sphere.rs"]
mod sphere;
#[path = "../common/taylor_green.rs"]
mod vortex;
#[path = "../common/wake.rs"]
mod wake;

mod backward_step;
mod bad_cells;
mod bluff;
mod bluff_shapes;
mod boundary_values;
mod convergence;
mod corners;
mod corrections;
mod crumpled;
mod cylinder;
mod decaying_turbulence;
mod faults;
mod free_stream;
mod immersed;
mod inlet;
mod known_answers;
mod one_sided;
mod orders;
mod patch;
mod periodic;
mod permeable;
mod physics;
mod published;
mod shear;
mod surface_forces;
mod taylor_green;
mod turbulence;
