//! A time step: convection, pressure and the constraints of the surface.
//!
//! With the rates $`N`$ of convection and viscous stress, extrapolated to the middle of the step (Adams-Bashforth), the step from n to n + 1 is
//! ```math
//! u^{n+1} = \hat u - \tfrac{\Delta t}{\rho} \left(G p + C^T \varphi\right), \qquad D u^{n+1} = 0, \qquad C u^{n+1} = b + r \varphi
//! ```
//! A row of $`C`$ is the flux through some cut faces, $`b`$ that of the surface, $`\varphi`$ the pressure jump there and $`r`$ the permeability of the
//! cloth times area: the immersed boundary projection of Taira and Colonius (J. Comput. Phys. 225, 2007), with faces of the grid instead
//! of regularised delta functions. With the projection $`P`$ on velocities without divergence, the jumps satisfy a symmetric positive definite
//! system,
//! ```math
//! \left(\tfrac{\Delta t}{\rho}\, C P C^T + r\right) \varphi = C P \hat u - b,
//! ```
//! which conjugate gradients solve. $`P`$ is exact; the iterations apply it in the box of cells around the surface only.

use std::rc::Rc;

use nalgebra::Vector3;

use crate::constraints::FluxConstraints;
use crate::eddy_viscosity::EddyViscosity;
use crate::friction::Friction;
use crate::grid::{Grid, Velocity};
use crate::momentum::Momentum;
use crate::poisson::Poisson;
use crate::projection::{Part, cells_of, divergence};
use crate::slabs::{Alone, Ranks, Slabs, TooManyRanks};

/// Constants of a flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Density, kg/m3.
    pub density: f64,
    /// Velocity of the far field, m/s.
    pub far: Vector3<f64>,
    /// Constants of the momentum equation.
    pub momentum: Momentum,
    /// Residual of the constraint relative to that without load, at which the iteration ends.
    pub tolerance: f64,
}

/// Solution of the constraints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PressureJumps {
    /// Pressure jump of each row, Pa.
    pub jump: Vec<f64>,
    /// Iterations.
    pub iterations: usize,
    /// Final residual relative to that without jumps.
    pub residual: f64,
}

/// A predicted step, to which several solutions of its constraints may return.
#[derive(Clone, Debug)]
pub struct Prediction {
    predicted: Velocity,
    projected: Velocity,
    rates: Velocity,
    dt: f64,
}

/// Flow on a Cartesian grid. On several ranks its calls are collective.
#[derive(Clone, Debug)]
pub struct Flow {
    /// Grid.
    pub grid: Grid,
    /// Constants.
    pub settings: Settings,
    /// Velocity of the last accepted step, m/s, in the own planes and those next to them ([`Flow::gather`]).
    pub velocity: Velocity,
    pub(crate) slabs: Slabs,
    pub(crate) poisson: Poisson,
    /// Rates of the last accepted step and the one before.
    rates: [Velocity; 2],
    previous_dt: Option<f64>,
    /// Velocity of the step before pressure and surface, and the same without divergence.
    predicted: Velocity,
    pub(crate) projected: Velocity,
    pub(crate) impulse: Velocity,
    pub(crate) pressure: Vec<f64>,
    /// Pressures of the plane below the own ones.
    pub(crate) below: Vec<f64>,
    /// Unknowns of the constraint, the start of the next solution.
    pub(crate) jump: Vec<f64>,
    pub(crate) dt: f64,
    /// Of a flow with a model of its small eddies.
    pub(crate) eddies: Option<EddyViscosity>,
}

/// State of a flow at an accepted step.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowState {
    /// Velocity, m/s, with its ghosts.
    pub velocity: Velocity,
    /// Rates of the step before, m/s2.
    pub rates: Velocity,
    /// Length of the step before, s; `None` before the first.
    pub previous_dt: Option<f64>,
    /// Pressure jumps of the rows, Pa.
    pub jump: Vec<f64>,
}

impl Flow {
    /// Flow that starts with the far field's velocity everywhere.
    pub fn new(grid: Grid, settings: Settings) -> Self {
        Self::on_ranks(grid, settings, Rc::new(Alone)).expect("one slab")
    }

    /// As [`Self::new`], computed by several ranks.
    ///
    /// # Errors
    /// A grid with too few cells for the ranks.
    pub fn on_ranks(grid: Grid, settings: Settings, ranks: Rc<dyn Ranks>) -> Result<Self, TooManyRanks> {
        let slabs = Slabs::new(ranks, &grid)?;
        let velocity = grid.uniform(settings.far);
        let zero = grid.uniform(Vector3::zeros());
        let [nx, ny, _] = grid.cells();
        Ok(Self {
            poisson: Poisson::new(&grid, &slabs),
            below: vec![0.0; nx * ny],
            slabs,
            rates: [zero.clone(), zero.clone()],
            previous_dt: None,
            predicted: velocity.clone(),
            projected: velocity.clone(),
            impulse: zero,
            pressure: vec![0.0; grid.count()],
            jump: Vec::new(),
            dt: 0.0,
            eddies: None,
            velocity,
            settings,
            grid,
        })
    }

    /// The slabs of the ranks.
    pub fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    /// Completes velocity, rates and pressure on every rank.
    pub fn gather(&mut self) {
        for values in self.velocity.iter_mut().chain(&mut self.rates[1]) {
            self.slabs.gather(values);
        }
        let [nx, ny, _] = self.grid.cells();
        self.slabs.gather_cells(&mut self.pressure, nx * ny);
    }

    /// Fills the ghosts of the velocity after its cells were set, and the planes of other ranks next to the own ones.
    pub fn fill_ghosts(&mut self) {
        self.grid.fill_ghosts(&mut self.velocity, self.settings.far, &self.slabs);
        self.slabs.exchange(&mut self.velocity);
    }

    /// Adds a velocity of `share` of the far field's across the stream in a ball around the origin, so that a symmetric wake need not wait for
    /// round-off.
    pub fn perturb(&mut self, share: f64) {
        let across = if self.settings.far.x.abs() < self.settings.far.norm() * 0.5 { 0 } else { 1 };
        for cell in cells_of(&self.grid.all_cells()) {
            let x = [0, 1, 2].map(|d| self.grid.coordinate(across, d, cell[d]));
            let near = (-x.iter().map(|x| x * x).sum::<f64>()).exp();
            self.velocity[across][self.grid.at(cell.map(|i| i as isize))] +=
                share * self.settings.far.norm() * near;
        }
        self.fill_ghosts();
    }

    /// Convection and viscosity over a step of `dt` s on a grid that moves with the velocity `frame`; the result serves all solutions of
    /// the step for different motions of the surface.
    pub fn predict(&mut self, dt: f64, frame: Vector3<f64>) {
        self.predict_with(dt, frame, None);
    }

    /// [`Self::predict`] with no slip on a surface, whose forces `friction` has afterwards.
    pub fn predict_with_friction(&mut self, dt: f64, frame: Vector3<f64>, friction: &mut Friction) {
        self.predict_with(dt, frame, Some(friction));
    }

    fn predict_with(&mut self, dt: f64, frame: Vector3<f64>, friction: Option<&mut Friction>) {
        let viscosity = self.settings.momentum.viscosity;
        let planes = self.slabs.own();
        let own = self.slabs.positions(planes.start as isize..planes.end as isize);
        self.settings.momentum.rates(&self.grid, &self.velocity, frame, planes.clone(), &mut self.rates[0]);
        if let Some(friction) = &friction {
            friction.interrupt_fluxes(viscosity, &self.velocity, &own, &mut self.rates[0]);
        }
        if let Some(eddies) = &mut self.eddies {
            eddies.update(&self.grid, &self.velocity, &self.slabs, friction.as_deref());
            eddies.add_rates(&self.grid, &self.velocity, planes, &mut self.rates[0]);
        }
        let back = self.previous_dt.map_or(0.0, |previous| 0.5 * dt / previous);
        for c in 0..3 {
            let [now, before] = [0, 1].map(|i| &self.rates[i][c][own.clone()]);
            let velocity = &self.velocity[c][own.clone()];
            for (i, u) in self.predicted[c][own.clone()].iter_mut().enumerate() {
                *u = velocity[i] + dt * ((1.0 + back) * now[i] - back * before[i]);
            }
        }
        if let Some(friction) = friction {
            friction.apply(self.settings.density, viscosity, dt, &own, &mut self.predicted);
        }
        self.dt = dt;
        self.project_prediction();
    }

    /// What [`Self::predict`] found, for [`Self::repeat`].
    pub fn prediction(&self) -> Prediction {
        Prediction {
            predicted: self.predicted.clone(),
            projected: self.projected.clone(),
            rates: self.rates[0].clone(),
            dt: self.dt,
        }
    }

    /// Returns to a prediction after steps that followed it: constraints and [`Self::accept`] come next.
    pub fn repeat(&mut self, step: &Prediction) {
        let of = |own: &mut Velocity, kept: &Velocity| {
            own.iter_mut().zip(kept).for_each(|(own, kept)| own.copy_from_slice(kept));
        };
        of(&mut self.predicted, &step.predicted);
        of(&mut self.projected, &step.projected);
        of(&mut self.rates[0], &step.rates);
        self.dt = step.dt;
    }

    /// The predicted velocity without divergence, and without the surface.
    fn project_prediction(&mut self) {
        self.grid.fill_ghosts(&mut self.predicted, self.settings.far, &self.slabs);
        self.grid.copy_to_outflow(&mut self.predicted, &self.slabs);
        self.slabs.close(&mut self.predicted);
        let set = self.slabs.set_planes();
        let closed = set.end.max(self.slabs.own().end as isize + 1);
        let copied = self.slabs.positions(set.start..closed);
        for c in 0..3 {
            self.projected[c][copied.clone()].copy_from_slice(&self.predicted[c][copied.clone()]);
        }
        let mut projected = std::mem::take(&mut self.projected);
        self.remove_divergence(&mut projected);
        self.projected = projected;
    }

    /// Removes the divergence of `u` in the own cells; their pressure over density times the step remains.
    fn remove_divergence(&mut self, u: &mut Velocity) {
        let Self { grid, slabs, poisson, pressure, below, .. } = self;
        let part = Part::slab(grid, slabs);
        let own = part.own();
        let pressure = &mut pressure[own.start * part.plane()..own.end * part.plane()];
        divergence(grid, u, &part.cells(), pressure);
        poisson.solve(pressure, slabs);
        part.plane_below(slabs, pressure, below);
        part.subtract_gradient(grid, pressure, below, u);
    }

    /// Ends the step with the pressure jumps of the constraints.
    pub fn accept(&mut self, rows: &FluxConstraints, jumps: &PressureJumps) {
        let volume: f64 = self.grid.axes.iter().map(|a| a.spacing).product();
        let factor = -self.dt / self.settings.density / volume;
        for (row, jump) in jumps.jump.iter().enumerate() {
            rows.spread(&mut self.predicted, row, factor * jump);
        }
        let mut velocity = std::mem::take(&mut self.predicted);
        self.remove_divergence(&mut velocity);
        self.predicted = std::mem::replace(&mut self.velocity, velocity);
        self.fill_ghosts();
        self.rates.swap(0, 1);
        self.previous_dt = Some(self.dt);
    }

    /// Least and largest pressure of the last accepted step, Pa; zero in the far field.
    pub fn pressure_range(&self) -> [f64; 2] {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        let part = Part::slab(&self.grid, &self.slabs);
        let own = part.own();
        let pressures = &self.pressure[own.start * part.plane()..own.end * part.plane()];
        let range = |[low, high]: [f64; 2], p: &f64| [p.min(low), p.max(high)];
        let [low, high] = pressures.iter().fold([f64::MAX, f64::MIN], range).map(|p| scale * p);
        let mut ends = [-low, high];
        self.slabs.ranks().largest(&mut ends);
        [-ends[0], ends[1]]
    }

    /// Pressure of each cell at the last accepted step, Pa, x fastest. After another solution of the constraints it is undefined. On several ranks
    /// after [`Self::gather`].
    pub fn pressures(&self) -> impl Iterator<Item = f64> {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        self.pressure.iter().map(move |p| scale * p)
    }

    fn cell_velocity(&self, cell: [usize; 3]) -> Vector3<f64> {
        let at = self.grid.at(cell.map(|i| i as isize));
        let mean =
            |c: usize, _: usize| 0.5 * (self.velocity[c][at] + self.velocity[c][at + self.grid.strides[c]]);
        Vector3::from_fn(mean)
    }

    /// Velocity at the centres of the cells, m/s, x fastest. On several ranks after [`Self::gather`].
    pub fn cell_velocities(&self) -> Vec<Vector3<f64>> {
        cells_of(&self.grid.all_cells()).map(|cell| self.cell_velocity(cell)).collect()
    }

    /// Largest value over the own cells of all ranks.
    fn largest(&self, of_cell: impl Fn([usize; 3]) -> f64) -> f64 {
        let own = Part::slab(&self.grid, &self.slabs).cells();
        let mut largest = [cells_of(&own).map(of_cell).fold(0.0, f64::max)];
        self.slabs.ranks().largest(&mut largest);
        largest[0]
    }

    /// Largest sum over the axes of velocity relative to the grid, which moves with `frame`, over width of a cell, 1/s.
    pub fn largest_rate(&self, frame: Vector3<f64>) -> f64 {
        let grid = &self.grid;
        let widths: [Vec<f64>; 3] = [0, 1, 2].map(|d| grid.axes[d].widths.iter().map(|w| 1.0 / w).collect());
        self.largest(|cell| {
            let at = grid.at(cell.map(|i| i as isize));
            let rate = |c: usize| {
                let u = &self.velocity[c];
                let fastest = (u[at] - frame[c]).abs().max((u[at + grid.strides[c]] - frame[c]).abs());
                fastest * widths[c][cell[c]]
            };
            rate(0) + rate(1) + rate(2)
        })
    }

    /// Largest velocity relative to `frame` at the centres of the cells, m/s.
    pub fn largest_speed(&self, frame: Vector3<f64>) -> f64 {
        self.largest(|cell| (self.cell_velocity(cell) - frame).norm())
    }

    /// What later steps depend on; on several ranks complete after [`Self::gather`].
    pub fn state(&self) -> FlowState {
        FlowState {
            velocity: self.velocity.clone(),
            rates: self.rates[1].clone(),
            previous_dt: self.previous_dt,
            jump: self.jump.clone(),
        }
    }

    /// Continues from a [`Self::state`] of the same grid, complete or of this rank. `None` where it is of another one.
    #[must_use]
    pub fn restore(&mut self, state: FlowState) -> Option<()> {
        let fits = |u: &Velocity| u.iter().all(|c| c.len() == self.grid.array_len());
        if !fits(&state.velocity) || !fits(&state.rates) {
            return None;
        }
        self.velocity = state.velocity;
        self.rates[1] = state.rates;
        (self.previous_dt, self.jump) = (state.previous_dt, state.jump);
        Some(())
    }

    /// Largest flux out of a cell over its faces' area, m/s.
    pub fn largest_divergence(&self) -> f64 {
        let part = Part::slab(&self.grid, &self.slabs);
        let (cells, own) = (part.cells(), part.own());
        let mut sums = vec![0.0; part.plane() * own.len()];
        divergence(&self.grid, &self.velocity, &cells, &mut sums);
        let [nx, ny, _] = self.grid.cells();
        self.largest(|cell| {
            let w = [0, 1, 2].map(|d| self.grid.axes[d].widths[cell[d]]);
            let sum = sums[((cell[2] - own.start) * ny + cell[1]) * nx + cell[0]];
            sum.abs() / (w[0] * w[1] + w[1] * w[2] + w[2] * w[0])
        })
    }
}
