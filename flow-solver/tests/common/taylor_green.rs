//! Three-dimensional Taylor-Green vortex at Reynolds number 1600 in one octant of its box; its faces are planes of
//! symmetry. Units: initial speed, and wavelength over 2 pi.
#![allow(dead_code)]

use std::f64::consts::PI;

use flow_solver::geometry::vec3::Vec3;
use flow_solver::gradient;
use flow_solver::physics::Laminar;
use flow_solver::{Solver, Step};
use mesh::{BoxShape, FlowGrid, Patch, box_grid_of};

use super::common;

/// Kinematic viscosity.
pub const VISCOSITY: f64 = 1.0 / 1600.0;

/// Reference kinetic energy per mass at t = 5, 9, 12: spectral solution on 512 cubed (first international workshop on
/// high-order CFD methods, case C3.5).
pub const REFERENCE: [(f64, f64); 3] = [(5.0, 0.1184), (9.0, 0.0864), (12.0, 0.0544)];

/// Deviation from the reference at its three instants of energies at multiples of `dt`, linear in between; none before.
pub fn deviations(energies: &[f64], dt: f64) -> Vec<f64> {
    let at = |t: f64| {
        let k = ((t / dt) as usize).min(energies.len() - 2);
        energies[k] + (t / dt - k as f64) * (energies[k + 1] - energies[k])
    };
    let reached = REFERENCE.iter().filter(|(t, _)| *t <= (energies.len() - 1) as f64 * dt + 1e-9);
    reached.map(|(t, reference)| at(*t) / reference - 1.0).collect()
}

/// The vortex at the start, on `n` cells along each edge of the octant, with the smallest upwind share `upwind`.
pub fn at_start(
    shape: BoxShape,
    n: usize,
    drop: f64,
    upwind: f64,
) -> Solver<flow_solver::physics::Isothermal, 4> {
    at_start_in([0.0; 3], [PI; 3], [Patch::Symmetry; 6], shape, n, drop, upwind)
}

/// As [`at_start`] in the box from `low` to `high` with these `sides`, on `n` cells along each edge.
pub fn at_start_in(
    low: [f64; 3],
    high: [f64; 3],
    sides: [Patch; 6],
    shape: BoxShape,
    n: usize,
    drop: f64,
    upwind: f64,
) -> Solver<flow_solver::physics::Isothermal, 4> {
    on_grid(&box_grid_of(shape, [n; 3], low, high, sides), drop, upwind)
}

/// As [`at_start`] on `grid`.
pub fn on_grid(grid: &FlowGrid, drop: f64, upwind: f64) -> Solver<flow_solver::physics::Isothermal, 4> {
    let mut settings = common::settings([0.0; 3], drop);
    settings.reference_speed = 0.1;
    settings.moving = false;
    let rho = settings.air.density;
    let mut s = common::isothermal(grid, Laminar { viscosity: VISCOSITY * rho }, settings);
    s.spatial.upwind_share = upwind;
    let state = |x: [f64; 3]| {
        let p = rho / 16.0 * ((2.0 * x[0]).cos() + (2.0 * x[1]).cos()) * ((2.0 * x[2]).cos() + 2.0);
        let u = x[0].sin() * x[1].cos() * x[2].cos();
        let v = -x[0].cos() * x[1].sin() * x[2].cos();
        [p, u, v, 0.0]
    };
    for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
        *q = state(*x);
    }
    for level in &mut s.previous {
        level.q.copy_from_slice(&s.q);
    }
    s
}

/// Kinetic energy per mass.
pub fn energy(s: &Solver<flow_solver::physics::Isothermal, 4>) -> f64 {
    let of_cell = |(q, v): (&[f64; 4], &f64)| 0.5 * v * (q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    let owned = s.topology.n_owned;
    s.q[..owned].iter().zip(&s.metrics.volume).map(of_cell).sum::<f64>() / PI.powi(3)
}

/// Dissipation by the viscosity of the resolved flow, per mass.
pub fn viscous_dissipation(s: &Solver<flow_solver::physics::Isothermal, 4>) -> f64 {
    let of_cell = |(g, v): (&gradient::Gradient<4>, &f64)| {
        let g = gradient::of_velocity(g);
        2.0 * VISCOSITY * v * ((g + g.transpose()) * 0.5).norm_squared()
    };
    s.gradient.iter().zip(&s.metrics.volume).map(of_cell).sum::<f64>() / PI.powi(3)
}

/// Advances by `dt`; returns the iterations.
pub fn step(s: &mut Solver<flow_solver::physics::Isothermal, 4>, dt: f64) -> usize {
    let step = Step { dt, frame: Vec3::zeros(), repeat: false, moved: false };
    let iterations = s.advance(&step).expect("a step that converges").iterations;
    s.accept(dt, false);
    iterations
}
