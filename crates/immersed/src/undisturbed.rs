//! Undisturbed air whose velocity changes with height, as an exact solution of the discrete equations.
//!
//! A grid that falls sees another velocity $`U(z)`$ in each step. Differences of that velocity on cells that grow are not exact, and what they lack would act on
//! the air like a force. With the rates $`N`$ the step of the flow is therefore taken for what differs from the undisturbed air, whose change is known:
//! ```math
//! \hat u = u^n + U^{n+1} - U^n + \Delta t \left(N(u) - N(U)\right)
//! ```
//! with the difference of the rates extrapolated to the middle of the step. Without an obstacle the air remains undisturbed to round-off.
//! The stress of subgrid models is not part of $`N(U)`$: `wale` has none in a parallel shear, `smagorinsky` changes the undisturbed air by its own diffusion.

use nalgebra::Vector3;

use crate::axis::Axis;
use crate::far_field::FarField;
use crate::grid::{Ends, GHOSTS, Grid, Velocity};
use crate::momentum::Momentum;

/// The undisturbed air at the start of a step, and its rates in one column of cells.
#[derive(Clone, Debug)]
pub(crate) struct Undisturbed {
    /// Velocity at the start of the step.
    start: FarField,
    column: Grid,
    velocity: Velocity,
    rates: Velocity,
}

impl Undisturbed {
    /// Of air at rest above `grid`.
    pub(crate) fn new(grid: &Grid) -> Self {
        let one = || Axis::even(0.0, 1.0, 1);
        let axes = [one(), one(), grid.axes[2].clone()];
        let column = Grid::new(axes, [Ends::Periodic, Ends::Periodic, grid.ends[2]]);
        let still = column.uniform(Vector3::zeros());
        Self { start: FarField::default(), velocity: still.clone(), rates: still, column }
    }

    /// Sets the velocity at the start of the step to that of each height.
    pub(crate) fn set(&mut self, velocity: impl Fn(f64) -> Vector3<f64>) {
        self.start.set(&self.column.axes[2], velocity);
    }

    /// Subtracts the rates of the undisturbed air from `rates` (m/s2) in `planes` of `grid`, which moves with the velocity `frame` (m/s).
    pub(crate) fn subtract_rates(
        &mut self,
        (momentum, frame): (&Momentum, Vector3<f64>),
        grid: &Grid,
        planes: std::ops::Range<usize>,
        rates: &mut Velocity,
    ) {
        let undisturbed = self.layer_rates(momentum, frame);
        for (rates, own) in rates.iter_mut().zip(&undisturbed) {
            for k in planes.clone() {
                layer(grid, rates, k).iter_mut().for_each(|rate| *rate -= own[k]);
            }
        }
    }

    /// Rates of the undisturbed air in each plane on a grid that moves with the velocity `frame` (m/s), m/s2.
    pub(crate) fn layer_rates(&mut self, momentum: &Momentum, frame: Vector3<f64>) -> [Vec<f64>; 3] {
        for (c, values) in self.velocity.iter_mut().enumerate() {
            for (k, layer) in values.chunks_exact_mut(self.column.strides[2]).enumerate() {
                layer.fill(self.start.at(c, k as isize - GHOSTS as isize));
            }
        }
        let planes = self.column.axes[2].len();
        momentum.rates(&self.column, &self.velocity, frame, 0..planes, &mut self.rates);
        let Self { column, rates, .. } = self;
        [0, 1, 2].map(|c| (0..planes).map(|k| rates[c][column.at([0, 0, k as isize])]).collect())
    }

    /// What the undisturbed air changes over the step in each plane, to its velocity `end`, m/s.
    pub(crate) fn changes(&self, end: &FarField) -> [Vec<f64>; 3] {
        let planes = self.column.axes[2].len() as isize;
        [0, 1, 2].map(|c| (0..planes).map(|k| end.at(c, k) - self.start.at(c, k)).collect())
    }

    /// Adds the change of the undisturbed air over the step, to its velocity `end`, to `predicted` (m/s) in `planes` of `grid`.
    pub(crate) fn add_change(
        &self,
        end: &FarField,
        grid: &Grid,
        planes: std::ops::Range<usize>,
        predicted: &mut Velocity,
    ) {
        for (c, predicted) in predicted.iter_mut().enumerate() {
            for k in planes.clone() {
                let change = end.at(c, k as isize) - self.start.at(c, k as isize);
                layer(grid, predicted, k).iter_mut().for_each(|u| *u += change);
            }
        }
    }
}

/// The values of plane `k`, with the ghosts in it.
fn layer<'a>(grid: &Grid, values: &'a mut [f64], k: usize) -> &'a mut [f64] {
    let start = (k + GHOSTS) * grid.strides[2];
    &mut values[start..start + grid.strides[2]]
}
