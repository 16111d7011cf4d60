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

use std::ops::Range;
use std::rc::Rc;

use nalgebra::Vector3;

use crate::constraints::{FluxConstraints, JumpsOfRows};
use crate::device::DeviceFlow;
use crate::eddy_viscosity::EddyViscosity;
use crate::far_field::FarField;
use crate::free_edges::EdgeFluxes;
use crate::friction::{Friction, WallStep};
use crate::grid::{GHOSTS, Grid, Velocity};
use crate::momentum::Momentum;
use crate::poisson::Poisson;
use crate::pressure_jumps::ConstraintWork;
use crate::projection::{Part, cells_of, divergence};
use crate::slabs::{Alone, Ranks, Slabs, TooManyRanks};
use crate::undisturbed::Undisturbed;
use crate::wall_rates::{WallRates, WallValue};

/// Constants of a flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Density, kg/m3.
    pub density: f64,
    /// Velocity of the far field, m/s; [`Flow::set_far_by_height`] sets another one in each plane.
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

/// Fluxes of the predicted velocity through the faces of constraints, which all solutions of a step share.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PredictedFluxes {
    /// Flux of each row, m3/s.
    pub(crate) fluxes: Vec<f64>,
    /// Largest speed at the faces of each row, m/s.
    pub(crate) speeds: Vec<f64>,
}

impl PredictedFluxes {
    /// The same after [`Flow::flux_changes`] of the steps before.
    #[must_use]
    pub fn changed_by(mut self, changes: &[f64]) -> Self {
        self.fluxes.iter_mut().zip(changes).for_each(|(flux, change)| *flux += change);
        self
    }
}

/// An accepted step that [`Flow::return_to_start`] may undo, and all steps after it.
#[derive(Clone, Debug)]
struct KeptStep {
    /// Velocity at its start, rates of the step before it, and its own.
    velocity: Velocity,
    before: Velocity,
    rates: Velocity,
    previous_dt: Option<f64>,
}

/// Flow on a Cartesian grid. On several ranks its calls are collective.
#[derive(Debug)]
pub struct Flow {
    /// Grid.
    pub grid: Grid,
    /// Constants.
    pub settings: Settings,
    /// Velocity of the last accepted step, m/s, in the own planes and those next to them ([`Flow::gather`]).
    pub velocity: Velocity,
    pub(crate) far_field: FarField,
    /// Where the velocity of the far field changes with height.
    pub(crate) undisturbed: Option<Undisturbed>,
    pub(crate) slabs: Slabs,
    pub(crate) poisson: Poisson,
    /// Rates of the last accepted step; empty after a step that is kept, which has them.
    pub(crate) before: Velocity,
    pub(crate) previous_dt: Option<f64>,
    /// Rates of the step that is predicted, and its velocity before pressure and surface; empty or not in use where none is predicted.
    rates: Velocity,
    pub(crate) predicted: Velocity,
    /// Rates at the values next to the surface in the last accepted step.
    pub(crate) wall_rates: WallRates,
    /// Those at the start of the step to which the flow may return.
    pub(crate) kept_wall_rates: WallRates,
    /// Own values next to the surface in the predicted step.
    pub(crate) at_walls: Vec<WallValue>,
    /// Time step over density times the pressure of the last accepted step, or that of the predicted velocity; without ghosts.
    pub(crate) pressure: Vec<f64>,
    /// Room for the pressure of a step while jumps of earlier steps change its velocity.
    own_pressure: Vec<f64>,
    /// Pressures of the plane below the own ones.
    pub(crate) below: Vec<f64>,
    /// Whether the pressure is that of the predicted velocity.
    pub(crate) has_predicted_pressure: bool,
    kept: Option<KeptStep>,
    /// Arrays that are free.
    spare: Vec<Velocity>,
    pub(crate) work: ConstraintWork,
    /// Unknowns of the constraint, the start of the next solution.
    pub(crate) jump: Vec<f64>,
    pub(crate) dt: f64,
    /// Of a flow with a model of its small eddies.
    pub(crate) eddies: Option<EddyViscosity>,
    /// Of a flow whose steps another device computes; the arrays above follow by [`Self::gather`].
    pub(crate) device: Option<Box<DeviceFlow>>,
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
    /// Rates at the values next to the surface.
    pub wall_rates: WallRates,
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
        let [nx, ny, _] = grid.cells();
        Ok(Self {
            poisson: Poisson::new(&grid, &slabs),
            below: vec![0.0; nx * ny],
            slabs,
            before: grid.uniform(Vector3::zeros()),
            previous_dt: None,
            rates: Velocity::default(),
            predicted: Velocity::default(),
            wall_rates: WallRates::default(),
            kept_wall_rates: WallRates::default(),
            at_walls: Vec::new(),
            has_predicted_pressure: false,
            kept: None,
            spare: Vec::new(),
            work: ConstraintWork::default(),
            pressure: vec![0.0; grid.count()],
            own_pressure: Vec::new(),
            jump: Vec::new(),
            dt: 0.0,
            eddies: None,
            far_field: settings.far.into(),
            undisturbed: None,
            device: None,
            velocity,
            settings,
            grid,
        })
    }

    /// The slabs of the ranks.
    pub fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    /// Completes velocity, rates and pressure on every rank, and brings them from a device.
    pub fn gather(&mut self) {
        self.download();
        for values in self.velocity.iter_mut().chain(&mut self.before) {
            self.slabs.gather(values);
        }
        let [nx, ny, _] = self.grid.cells();
        self.slabs.gather_cells(&mut self.pressure, nx * ny);
        if !self.slabs.alone() {
            let own = self.own_positions();
            self.wall_rates.gather(self.slabs.ranks(), &own);
        }
    }

    /// Fills the ghosts of the velocity after its cells were set, and the planes of other ranks next to the own ones.
    pub fn fill_ghosts(&mut self) {
        self.grid.fill_ghosts(&mut self.velocity, &self.far_field, &self.slabs);
        self.slabs.exchange(&mut self.velocity);
        self.upload();
    }

    /// Lets the velocity of the far field change with height: at `start` and `end` of the next step it is that of each height z (m, in the grid), m/s. The vertical
    /// component must be the same at all heights, because the flow is incompressible. To be set before each prediction of a step.
    pub fn set_far_by_height(
        &mut self,
        start: impl Fn(f64) -> Vector3<f64>,
        end: impl Fn(f64) -> Vector3<f64>,
    ) {
        self.far_field.set(&self.grid.axes[2], end);
        self.undisturbed.get_or_insert_with(|| Undisturbed::new(&self.grid)).set(start);
    }

    /// Sets the velocity to that of the far field.
    pub fn start_undisturbed(&mut self) {
        let ghosts = GHOSTS as isize;
        let plane = self.grid.strides[2];
        for (c, values) in self.velocity.iter_mut().enumerate() {
            for (k, layer) in values.chunks_exact_mut(plane).enumerate() {
                layer.fill(self.far_field.at(c, k as isize - ghosts));
            }
        }
        self.upload();
    }

    /// Whether the velocity is that of the far field everywhere, but for the round-off of an interpolation.
    pub fn is_undisturbed(&mut self) -> bool {
        self.download();
        let change = |cell: [usize; 3]| {
            let at = self.grid.at(cell.map(|i| i as isize));
            let of = |c: usize| (self.velocity[c][at] - self.far_field.at(c, cell[2] as isize)).abs();
            of(0).max(of(1)).max(of(2))
        };
        self.largest(change) <= 1e-12 * self.largest_speed(Vector3::zeros())
    }

    /// Sets each component of the velocity, m/s, to its `value` at its place, m.
    pub fn set_velocity(&mut self, value: impl Fn(Vector3<f64>) -> Vector3<f64>) {
        for cell in cells_of(&self.grid.all_cells()) {
            let at = self.grid.at(cell.map(|i| i as isize));
            for c in 0..3 {
                let x = Vector3::from_fn(|d, _| self.grid.coordinate(c, d, cell[d]));
                self.velocity[c][at] = value(x)[c];
            }
        }
        self.fill_ghosts();
    }

    /// Adds a velocity of `share` of the far field's across the stream in a ball around the origin, so that a symmetric wake need not wait for
    /// round-off.
    pub fn perturb(&mut self, share: f64) {
        self.download();
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
        self.predict_around(dt, frame, &EdgeFluxes::default(), None);
    }

    /// [`Self::predict`] around a surface with free `edges`, and with no slip on it where there is `friction`, which has the forces afterwards.
    pub fn predict_around(
        &mut self,
        dt: f64,
        frame: Vector3<f64>,
        edges: &EdgeFluxes,
        friction: Option<&mut Friction>,
    ) {
        if let Some(mut device) = self.device.take() {
            self.predict_on(&mut device, (dt, frame), edges, friction);
            self.device = Some(device);
            return;
        }
        let viscosity = self.settings.momentum.viscosity;
        let (planes, own) = (self.slabs.own(), self.own_positions());
        let mut rates = self.array_or(|flow| &mut flow.rates);
        let momentum = &self.settings.momentum;
        momentum.rates(&self.grid, &self.velocity, frame, planes.clone(), &mut rates);
        edges.add_rates(momentum, &self.grid, &self.velocity, frame, &own, &mut rates);
        if let Some(friction) = &friction {
            friction.interrupt_fluxes(viscosity, &self.velocity, &own, &mut rates);
        }
        if let Some(eddies) = &mut self.eddies {
            eddies.update(&self.grid, &self.velocity, &self.slabs, friction.as_deref());
            eddies.add_rates(&self.grid, &self.velocity, planes, &mut rates);
        }
        if let Some(air) = &mut self.undisturbed {
            air.subtract_rates((&self.settings.momentum, frame), &self.grid, self.slabs.own(), &mut rates);
        }
        self.rates = rates;
        self.dt = dt;
        let start: Vec<f64> =
            friction.iter().flat_map(|f| self.at_values(&self.velocity, f.values())).collect();
        if self.kept.is_some() {
            // The start of a later step is not returned to.
            self.extrapolate_in_place(&own);
        } else {
            self.extrapolate(&own);
        }
        self.add_change_of_far_field();
        self.at_walls.clear();
        if let Some(friction) = friction {
            let step = WallStep {
                density: self.settings.density,
                viscosity,
                dt,
                start: &start,
                rates: &self.wall_rates,
            };
            friction.apply(&step, &own, &mut self.predicted);
            self.at_walls.extend(friction.values().filter(|(_, at)| own.contains(&(*at as usize))));
        }
        self.close_prediction();
        let mut predicted = std::mem::take(&mut self.predicted);
        self.solve_pressure(&predicted);
        std::mem::swap(&mut self.predicted, &mut predicted);
        self.has_predicted_pressure = true;
    }

    /// Own positions in an array with ghosts.
    fn own_positions(&self) -> Range<usize> {
        let planes = self.slabs.own();
        self.slabs.positions(planes.start as isize..planes.end as isize)
    }

    /// Values of a field.
    fn at_values<'a>(
        &'a self,
        field: &'a Velocity,
        values: impl Iterator<Item = WallValue> + 'a,
    ) -> impl Iterator<Item = f64> + 'a {
        values.map(|(c, at)| field[usize::from(c)][at as usize])
    }

    /// Takes an array of the flow, or another one where it is empty.
    fn array_or(&mut self, of: impl Fn(&mut Self) -> &mut Velocity) -> Velocity {
        let own = std::mem::take(of(self));
        if own[0].is_empty() {
            self.spare.pop().unwrap_or_else(|| self.grid.uniform(Vector3::zeros()))
        } else {
            own
        }
    }

    /// Keeps an array for later use.
    fn recycle(&mut self, array: Velocity) {
        if !array[0].is_empty() {
            self.spare.push(array);
        }
    }

    /// Frees the arrays that no accepted step needs; the next prediction allocates them again.
    pub fn release_arrays(&mut self) {
        self.release_kept();
        (self.spare, self.own_pressure) = Default::default();
        (self.rates, self.predicted) = Default::default();
        if let Some(device) = &mut self.device {
            device.release_arrays();
        }
    }

    /// Share of the rates of the step before in those of the middle of this one, negative.
    pub(crate) fn share_before(&self) -> f64 {
        self.previous_dt.map_or(0.0, |previous| 0.5 * self.dt / previous)
    }

    /// The predicted velocity at the positions `own` from velocity and rates.
    fn extrapolate(&mut self, own: &Range<usize>) {
        let mut predicted = self.array_or(|flow| &mut flow.predicted);
        let (dt, back) = (self.dt, self.share_before());
        for (c, predicted) in predicted.iter_mut().enumerate() {
            let [now, before] = [&self.rates, &self.before].map(|rates| &rates[c][own.clone()]);
            let velocity = &self.velocity[c][own.clone()];
            for (i, u) in predicted[own.clone()].iter_mut().enumerate() {
                *u = velocity[i] + dt * ((1.0 + back) * now[i] - back * before[i]);
            }
        }
        self.predicted = predicted;
    }

    /// What the undisturbed air changes over the step.
    fn add_change_of_far_field(&mut self) {
        if let Some(air) = &self.undisturbed {
            air.add_change(&self.far_field, &self.grid, self.slabs.own(), &mut self.predicted);
        }
    }

    /// [`Self::extrapolate`] in the array of the velocity, which is empty afterwards.
    fn extrapolate_in_place(&mut self, own: &Range<usize>) {
        assert!(!self.velocity[0].is_empty(), "a step after one that is kept is predicted once");
        let mut predicted = std::mem::take(&mut self.velocity);
        let (dt, back) = (self.dt, self.share_before());
        let before = match &self.kept {
            Some(kept) if self.before[0].is_empty() => &kept.rates,
            _ => &self.before,
        };
        for (c, predicted) in predicted.iter_mut().enumerate() {
            let [now, before] = [&self.rates, before].map(|rates| &rates[c][own.clone()]);
            for (i, u) in predicted[own.clone()].iter_mut().enumerate() {
                *u += dt * ((1.0 + back) * now[i] - back * before[i]);
            }
        }
        let unused = std::mem::replace(&mut self.predicted, predicted);
        self.recycle(unused);
    }

    /// Returns to the start of the step that was kept; without one nothing changes.
    pub fn return_to_start(&mut self) {
        if let Some(mut device) = self.device.take() {
            self.return_to_start_on(&mut device);
            self.device = Some(device);
            return;
        }
        if let Some(kept) = self.kept.take() {
            self.recycle(kept.rates);
            self.wall_rates = std::mem::take(&mut self.kept_wall_rates);
            self.restart_from(kept.velocity, kept.before, kept.previous_dt);
        }
    }

    fn restart_from(&mut self, velocity: Velocity, before: Velocity, previous_dt: Option<f64>) {
        self.previous_dt = previous_dt;
        let velocity = std::mem::replace(&mut self.velocity, velocity);
        let before = std::mem::replace(&mut self.before, before);
        self.recycle(velocity);
        self.recycle(before);
    }

    /// Ends the possibility to return to the step that was kept.
    pub fn release_kept(&mut self) {
        if let Some(device) = &mut self.device {
            device.release_kept();
        }
        let Some(kept) = self.kept.take() else { return };
        if self.before[0].is_empty() {
            self.before = kept.rates;
        } else {
            self.recycle(kept.rates);
        }
        self.recycle(kept.velocity);
        self.recycle(kept.before);
    }

    /// Fills the ghosts of the predicted velocity.
    fn close_prediction(&mut self) {
        self.grid.fill_ghosts(&mut self.predicted, &self.far_field, &self.slabs);
        self.grid.copy_to_outflow(&mut self.predicted, &self.slabs);
        self.slabs.close(&mut self.predicted);
    }

    /// The pressure that removes the divergence of `u` in the own cells, over density and times the step.
    fn solve_pressure(&mut self, u: &Velocity) {
        let Self { grid, slabs, poisson, pressure, below, .. } = self;
        let part = Part::slab(grid, slabs);
        let own = part.own();
        let pressure = &mut pressure[own.start * part.plane()..own.end * part.plane()];
        divergence(grid, &grid.layout(), u, &part.cells(), pressure);
        poisson.solve(pressure, slabs);
        part.plane_below(slabs, pressure, below);
    }

    /// Subtracts the gradient of the pressure from `u`.
    fn subtract_gradient(&self, u: &mut Velocity) {
        let part = Part::slab(&self.grid, &self.slabs);
        part.subtract_gradient(&self.grid, self.pressure_of(&part), &self.below, u);
    }

    /// The pressures of a part.
    fn pressure_of(&self, part: &Part) -> &[f64] {
        &self.pressure[part.own().start * part.plane()..part.own().end * part.plane()]
    }

    /// Sets the rates next to the surface from the velocity after the jumps and those at the values before, and the pressure.
    fn set_wall_rates(&mut self, velocity: &Velocity, predicted: &[f64]) {
        let part = Part::slab(&self.grid, &self.slabs);
        let (pressure, layout) = (self.pressure_of(&part), self.grid.layout());
        let rate = |((c, at), predicted): (WallValue, &f64)| {
            let at = at as usize;
            let cell = layout.cell(at).map(|i| i as usize);
            let gradient = part.gradient(&self.grid, usize::from(c), cell).of(pressure, &self.below);
            (velocity[usize::from(c)][at] - predicted - gradient) / self.dt
        };
        let rates = self.at_walls.iter().copied().zip(predicted).map(rate).collect();
        self.keep_wall_rates(rates);
    }

    /// Takes the rates at the values next to the surface; a first step has an impulse instead.
    pub(crate) fn keep_wall_rates(&mut self, rates: Vec<f64>) {
        let values = std::mem::take(&mut self.at_walls);
        self.wall_rates = self.previous_dt.map_or_else(WallRates::default, |_| WallRates::new(values, rates));
    }

    /// Ends the step with the pressure jumps of the constraints.
    pub fn accept(&mut self, rows: &FluxConstraints, jumps: &PressureJumps) {
        self.accept_after(rows, jumps, None);
    }

    /// As [`Self::accept`], of a step whose prediction started before pressure jumps of `earlier` steps changed, by these differences. They change its velocity, and not its pressure.
    pub fn accept_after(
        &mut self,
        rows: &FluxConstraints,
        jumps: &PressureJumps,
        earlier: Option<JumpsOfRows<'_>>,
    ) {
        if let Some(mut device) = self.device.take() {
            self.end_on(&mut device, (rows, jumps), earlier, false);
            self.device = Some(device);
            return;
        }
        let arrays = self.end_step(rows, jumps, earlier);
        arrays.into_iter().for_each(|array| self.recycle(array));
    }

    /// As [`Self::accept`], of a step to which the flow may return: until [`Self::release_kept`] later steps have no own array for the velocity at
    /// their start.
    pub fn accept_and_keep(&mut self, rows: &FluxConstraints, jumps: &PressureJumps) {
        if let Some(mut device) = self.device.take() {
            self.end_on(&mut device, (rows, jumps), None, true);
            self.device = Some(device);
            return;
        }
        let previous_dt = self.previous_dt;
        self.kept_wall_rates.clone_from(&self.wall_rates);
        let [velocity, before] = self.end_step(rows, jumps, None);
        self.kept = Some(KeptStep { velocity, before, rates: std::mem::take(&mut self.before), previous_dt });
    }

    /// Ends the step; returns velocity and rates of the step before.
    fn end_step(
        &mut self,
        rows: &FluxConstraints,
        jumps: &PressureJumps,
        earlier: Option<JumpsOfRows<'_>>,
    ) -> [Velocity; 2] {
        let mut velocity = std::mem::take(&mut self.predicted);
        let predicted: Vec<f64> = self.at_values(&velocity, self.at_walls.iter().copied()).collect();
        self.add_impulses(rows, &jumps.jump, &mut velocity);
        self.solve_pressure(&velocity);
        self.set_wall_rates(&velocity, &predicted);
        if let Some((rows, changes)) = earlier {
            self.own_pressure.clone_from(&self.pressure);
            self.add_impulses(rows, changes, &mut velocity);
            self.solve_pressure(&velocity);
        }
        self.subtract_gradient(&mut velocity);
        if earlier.is_some() {
            std::mem::swap(&mut self.pressure, &mut self.own_pressure);
        }
        self.has_predicted_pressure = false;
        let velocity = std::mem::replace(&mut self.velocity, velocity);
        self.fill_ghosts();
        self.previous_dt = Some(self.dt);
        let rates = std::mem::take(&mut self.rates);
        [velocity, std::mem::replace(&mut self.before, rates)]
    }

    /// Adds the velocity changes at the faces of `rows` by pressure jumps there, Pa.
    fn add_impulses(&self, rows: &FluxConstraints, jumps: &[f64], velocity: &mut Velocity) {
        let factor = self.factor();
        for (row, jump) in jumps.iter().enumerate() {
            rows.spread(velocity, row, -factor * jump);
        }
    }

    /// Least and largest pressure of the last accepted step, Pa; zero in the far field.
    pub fn pressure_range(&self) -> [f64; 2] {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        if let Some(device) = &self.device {
            return device.largest(Vector3::zeros()).pressures.map(|p| scale * p);
        }
        let part = Part::slab(&self.grid, &self.slabs);
        let own = part.own();
        let pressures = &self.pressure[own.start * part.plane()..own.end * part.plane()];
        let range = |[low, high]: [f64; 2], p: &f64| [p.min(low), p.max(high)];
        let [low, high] = pressures.iter().fold([f64::MAX, f64::MIN], range).map(|p| scale * p);
        let mut ends = [-low, high];
        self.slabs.ranks().largest(&mut ends);
        [-ends[0], ends[1]]
    }

    /// Pressure of each cell at the last accepted step, Pa, x fastest. After another prediction it is undefined. On several ranks after
    /// [`Self::gather`].
    pub fn pressures(&self) -> impl Iterator<Item = f64> {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        self.pressure.iter().map(move |p| scale * p)
    }

    /// Velocity at the centre of a cell, m/s. On several ranks after [`Self::gather`].
    pub fn cell_velocity(&self, cell: [usize; 3]) -> Vector3<f64> {
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
        if let Some(device) = &self.device {
            return device.largest(frame).rate;
        }
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
        if let Some(device) = &self.device {
            return device.largest(frame).speed;
        }
        self.largest(|cell| (self.cell_velocity(cell) - frame).norm())
    }

    /// Rates of the last accepted step, m/s2, and its length, s; on several ranks complete after [`Self::gather`].
    pub fn last_step(&self) -> (&Velocity, Option<f64>) {
        (&self.before, self.previous_dt)
    }

    /// Rates at the values next to the surface in the last accepted step; on several ranks complete after [`Self::gather`].
    pub fn wall_rates(&self) -> &WallRates {
        &self.wall_rates
    }

    /// What later steps depend on; on several ranks complete after [`Self::gather`].
    pub fn state(&self) -> FlowState {
        FlowState {
            velocity: self.velocity.clone(),
            rates: self.before.clone(),
            previous_dt: self.previous_dt,
            jump: self.jump.clone(),
            wall_rates: self.wall_rates.clone(),
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
        self.before = state.rates;
        self.kept = None;
        if let Some(device) = &mut self.device {
            device.release_kept();
        }
        self.upload();
        (self.previous_dt, self.jump, self.wall_rates) = (state.previous_dt, state.jump, state.wall_rates);
        Some(())
    }

    /// Largest flux out of a cell over its faces' area, m/s.
    pub fn largest_divergence(&self) -> f64 {
        let part = Part::slab(&self.grid, &self.slabs);
        let (cells, own) = (part.cells(), part.own());
        let mut sums = vec![0.0; part.plane() * own.len()];
        divergence(&self.grid, &self.grid.layout(), &self.velocity, &cells, &mut sums);
        let [nx, ny, _] = self.grid.cells();
        self.largest(|cell| {
            let w = [0, 1, 2].map(|d| self.grid.axes[d].widths[cell[d]]);
            let sum = sums[((cell[2] - own.start) * ny + cell[1]) * nx + cell[0]];
            sum.abs() / (w[0] * w[1] + w[1] * w[2] + w[2] * w[0])
        })
    }
}
