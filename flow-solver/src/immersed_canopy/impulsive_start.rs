//! The speed of the air around a canopy that starts at once.
//!
//! Air that was undisturbed turns around the canopy in the first step, ten times as fast as the stream and faster at its edges. The steps of that window must resolve this
//! speed, which its start does not have: explicit convection is unstable above a Courant number of about 0.5.

use immersed::flow::Flow;
use nalgebra::Vector3;

use super::cut::Cut;

/// Largest rate at which air crosses cells ([`Flow::largest_rate`]) after a step of `dt` s from an undisturbed flow, 1/s. `cut`: of the canopy, whose faces have the `velocities`
/// relative to the wind, m/s, taken as airtight; `grid`: velocity of the grid relative to the wind, m/s. The flow is the same afterwards.
pub fn rate_after_start(
    flow: &mut Flow,
    mut cut: Cut,
    velocities: &[Vector3<f64>],
    grid: Vector3<f64>,
    dt: f64,
) -> f64 {
    cut.faces.rows.permeability.fill(0.0);
    cut.transfer.fluxes(velocities, grid, &mut cut.faces.rows.target);
    let jumps = flow.jumps().to_vec();
    flow.predict(dt, grid);
    let solution = flow.solve_constraints(&cut.faces.rows);
    flow.accept_and_keep(&cut.faces.rows, &solution);
    let rate = flow.largest_rate(grid);
    flow.return_to_start();
    flow.release_arrays();
    flow.start_from(jumps);
    rate
}
