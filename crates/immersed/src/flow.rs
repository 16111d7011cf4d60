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

use nalgebra::Vector3;

use crate::constraints::FluxConstraints;
use crate::friction::Friction;
use crate::grid::{Grid, Velocity};
use crate::momentum::Momentum;
use crate::poisson::{Box3, Poisson};

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

/// Flow on a Cartesian grid.
#[derive(Clone, Debug)]
pub struct Flow {
    /// Grid.
    pub grid: Grid,
    /// Constants.
    pub settings: Settings,
    /// Velocity of the last accepted step, m/s.
    pub velocity: Velocity,
    poisson: Poisson,
    /// Rates of the last accepted step and the one before.
    rates: [Velocity; 2],
    previous_dt: Option<f64>,
    /// Velocity of the step before pressure and surface, and the same without divergence.
    predicted: Velocity,
    projected: Velocity,
    impulse: Velocity,
    pressure: Vec<f64>,
    /// Unknowns of the constraint, the start of the next solution.
    jump: Vec<f64>,
    dt: f64,
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

/// Positions of the values of one component of a grid along one axis among those of another.
struct Interpolation(Vec<Option<(isize, f64)>>);

impl Interpolation {
    fn new(from: &Grid, to: &Grid, c: usize, d: usize, origin: f64) -> Self {
        let count = |grid: &Grid| grid.axes[d].len() + usize::from(c == d);
        let old: Vec<f64> = (0..count(from)).map(|i| from.coordinate(c, d, i)).collect();
        let of = |i: usize| {
            let x = to.coordinate(c, d, i) + origin;
            let above = old.partition_point(|o| *o <= x);
            match above {
                0 => None,
                // At the last point, or half a cell beyond it.
                n if n == old.len() => (x <= old[n - 1] + 1e-9).then_some((n as isize - 2, 1.0)),
                n => Some((n as isize - 1, (x - old[n - 1]) / (old[n] - old[n - 1]))),
            }
        };
        Self((0..count(to)).map(of).collect())
    }
}

/// Value of a component at a point of another grid; `None` outside of this one.
fn interpolated(grid: &Grid, u: &[f64], lines: &[Interpolation; 3], cell: [usize; 3]) -> Option<f64> {
    let [x, y, z] = [lines[0].0[cell[0]]?, lines[1].0[cell[1]]?, lines[2].0[cell[2]]?];
    let mut sum = 0.0;
    for corner in 0..8isize {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let share = |(_, s): (isize, f64), upper: isize| if upper == 1 { s } else { 1.0 - s };
        let weight = share(x, i) * share(y, j) * share(z, k);
        if weight != 0.0 {
            sum += weight * u[grid.at([x.0 + i, y.0 + j, z.0 + k])];
        }
    }
    Some(sum)
}

/// Limit of iterations of the constraint.
const MAX_ITERATIONS: usize = 500;

/// Velocity relative to the largest one at a cut face below which a residual is round-off.
const ROUND_OFF: f64 = 1e-13;

impl Flow {
    /// Flow that starts with the far field's velocity everywhere.
    pub fn new(grid: Grid, settings: Settings) -> Self {
        let velocity = grid.uniform(settings.far);
        let zero = grid.uniform(Vector3::zeros());
        Self {
            poisson: Poisson::new(&grid),
            rates: [zero.clone(), zero.clone()],
            previous_dt: None,
            predicted: velocity.clone(),
            projected: velocity.clone(),
            impulse: zero,
            pressure: vec![0.0; grid.count()],
            jump: Vec::new(),
            dt: 0.0,
            velocity,
            settings,
            grid,
        }
    }

    /// Fills the ghosts of the velocity after its cells were set.
    pub fn fill_ghosts(&mut self) {
        self.grid.fill_ghosts(&mut self.velocity, self.settings.far);
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
        self.grid.fill_ghosts(&mut self.velocity, self.settings.far);
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
        self.settings.momentum.rates(&self.grid, &self.velocity, frame, &mut self.rates[0]);
        if let Some(friction) = &friction {
            friction.interrupt_fluxes(viscosity, &self.velocity, &mut self.rates[0]);
        }
        let back = self.previous_dt.map_or(0.0, |previous| 0.5 * dt / previous);
        for c in 0..3 {
            let [now, before] = [&self.rates[0][c], &self.rates[1][c]];
            for (i, u) in self.predicted[c].iter_mut().enumerate() {
                *u = self.velocity[c][i] + dt * ((1.0 + back) * now[i] - back * before[i]);
            }
        }
        if let Some(friction) = friction {
            friction.apply(self.settings.density, viscosity, dt, &mut self.predicted);
        }
        self.grid.fill_ghosts(&mut self.predicted, self.settings.far);
        self.grid.copy_to_outflow(&mut self.predicted);
        for c in 0..3 {
            self.projected[c].copy_from_slice(&self.predicted[c]);
        }
        let all = self.grid.all_cells();
        self.dt = dt;
        divergence(&self.grid, &self.projected, &all, &mut self.pressure);
        self.poisson.solve(&mut self.pressure);
        subtract_gradient(&self.grid, &self.pressure, &all, &mut self.projected);
    }

    /// Multipliers of the constraints at the end of the step: pressure jumps, Pa. May be repeated.
    pub fn solve_constraints(&mut self, rows: &FluxConstraints) -> PressureJumps {
        if rows.is_empty() {
            return PressureJumps::default();
        }
        let residual: Vec<f64> =
            (0..rows.len()).map(|r| rows.flux(&self.projected, r) - rows.target[r]).collect();
        if self.jump.len() != rows.len() {
            self.jump = vec![0.0; rows.len()];
        }
        let mut jump = std::mem::take(&mut self.jump);
        let (iterations, residual) = Constraint::new(self, rows).solve(&residual, &mut jump);
        self.jump.clone_from(&jump);
        PressureJumps { jump, iterations, residual }
    }

    /// Sets the jumps, Pa, from which the next solution of the constraints starts.
    pub fn start_from(&mut self, jumps: Vec<f64>) {
        self.jump = jumps;
    }

    /// Ends the step with the pressure jumps of the constraints.
    pub fn accept(&mut self, rows: &FluxConstraints, jumps: &PressureJumps) {
        let volume: f64 = self.grid.axes.iter().map(|a| a.spacing).product();
        let factor = -self.dt / self.settings.density / volume;
        for (row, jump) in jumps.jump.iter().enumerate() {
            rows.spread(&mut self.predicted, row, factor * jump);
        }
        let all = self.grid.all_cells();
        divergence(&self.grid, &self.predicted, &all, &mut self.pressure);
        self.poisson.solve(&mut self.pressure);
        subtract_gradient(&self.grid, &self.pressure, &all, &mut self.predicted);
        std::mem::swap(&mut self.velocity, &mut self.predicted);
        self.grid.fill_ghosts(&mut self.velocity, self.settings.far);
        self.rates.swap(0, 1);
        self.previous_dt = Some(self.dt);
    }

    /// Least and largest pressure of the last accepted step, Pa; zero in the far field.
    pub fn pressure_range(&self) -> [f64; 2] {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        let range = |[low, high]: [f64; 2], p: &f64| [p.min(low), p.max(high)];
        self.pressure.iter().fold([f64::MAX, f64::MIN], range).map(|p| scale * p)
    }

    /// Pressure of each cell at the last accepted step, Pa, x fastest. After another solution of the constraints it is undefined.
    pub fn pressures(&self) -> impl Iterator<Item = f64> {
        let scale = if self.dt > 0.0 { self.settings.density / self.dt } else { 0.0 };
        self.pressure.iter().map(move |p| scale * p)
    }

    /// Velocity at the centres of the cells, m/s, x fastest.
    pub fn cell_velocities(&self) -> Vec<Vector3<f64>> {
        let grid = &self.grid;
        cells_of(&grid.all_cells())
            .map(|cell| {
                let at = grid.at(cell.map(|i| i as isize));
                Vector3::from_fn(|c, _| 0.5 * (self.velocity[c][at] + self.velocity[c][at + grid.strides[c]]))
            })
            .collect()
    }

    /// Largest sum over the axes of velocity relative to the grid, which moves with `frame`, over width of a cell, 1/s.
    pub fn largest_rate(&self, frame: Vector3<f64>) -> f64 {
        let grid = &self.grid;
        let widths: [Vec<f64>; 3] = [0, 1, 2].map(|d| grid.axes[d].widths.iter().map(|w| 1.0 / w).collect());
        let mut largest = 0.0f64;
        for cell in cells_of(&grid.all_cells()) {
            let at = grid.at(cell.map(|i| i as isize));
            let rate = |c: usize| {
                let u = &self.velocity[c];
                let fastest = (u[at] - frame[c]).abs().max((u[at + grid.strides[c]] - frame[c]).abs());
                fastest * widths[c][cell[c]]
            };
            largest = largest.max(rate(0) + rate(1) + rate(2));
        }
        largest
    }

    /// Pressure jumps from which the next solution of the constraints starts, Pa.
    pub fn jumps(&self) -> &[f64] {
        &self.jump
    }

    /// Largest velocity relative to `frame` at the centres of the cells, m/s.
    pub fn largest_speed(&self, frame: Vector3<f64>) -> f64 {
        self.cell_velocities().iter().fold(0.0, |most: f64, v| most.max((v - frame).norm()))
    }

    /// What later steps depend on.
    pub fn state(&self) -> FlowState {
        FlowState {
            velocity: self.velocity.clone(),
            rates: self.rates[1].clone(),
            previous_dt: self.previous_dt,
            jump: self.jump.clone(),
        }
    }

    /// Continues from a [`Self::state`] of the same grid. `None` where it is of another one.
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

    /// The same flow on another grid, whose origin lies at `origin` (m) in the coordinates of this one: interpolated linearly, the far field's velocity
    /// where this grid ends. The next step removes what divergence that leaves; it is of first order in time.
    pub fn on_grid(&self, grid: Grid, origin: Vector3<f64>) -> Self {
        let mut flow = Self::new(grid, self.settings);
        for c in 0..3 {
            let lines = [0, 1, 2].map(|d| Interpolation::new(&self.grid, &flow.grid, c, d, origin[d]));
            let extent = |d: usize| flow.grid.axes[d].len() + usize::from(c == d);
            for k in 0..extent(2) {
                for j in 0..extent(1) {
                    for i in 0..extent(0) {
                        let value = interpolated(&self.grid, &self.velocity[c], &lines, [i, j, k]);
                        let at = flow.grid.at([i, j, k].map(|i| i as isize));
                        flow.velocity[c][at] = value.unwrap_or(self.settings.far[c]);
                    }
                }
            }
        }
        flow.fill_ghosts();
        flow
    }

    /// Largest flux out of a cell over its faces' area, m/s.
    pub fn largest_divergence(&self) -> f64 {
        let mut sums = vec![0.0; self.grid.count()];
        divergence(&self.grid, &self.velocity, &self.grid.all_cells(), &mut sums);
        let mut largest = 0.0f64;
        for (m, (sum, cell)) in sums.iter().zip(cells_of(&self.grid.all_cells())).enumerate() {
            let _ = m;
            let w = [0, 1, 2].map(|d| self.grid.axes[d].widths[cell[d]]);
            largest = largest.max(sum.abs() / (w[0] * w[1] + w[1] * w[2] + w[2] * w[0]));
        }
        largest
    }
}

/// Cells of a box, x fastest.
fn cells_of(cells: &Box3) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = cells.clone();
    z.flat_map(move |k| {
        let x = x.clone();
        y.clone().flat_map(move |j| x.clone().map(move |i| [i, j, k]))
    })
}

/// Fluxes of `u` out of the cells of a box, negative, m3/s.
fn divergence(grid: &Grid, u: &Velocity, cells: &Box3, out: &mut [f64]) {
    let [x, y, z] = cells;
    let widths = &grid.axes[0].widths[x.clone()];
    let [_, sy, sz] = grid.strides;
    for (k, at_z) in z.clone().enumerate() {
        for (j, at_y) in y.clone().enumerate() {
            let start = grid.at([x.start as isize, at_y as isize, at_z as isize]);
            let [wy, wz] = [grid.axes[1].widths[at_y], grid.axes[2].widths[at_z]];
            let row = &mut out[(k * y.len() + j) * x.len()..][..x.len()];
            let of = |c: usize, shift: usize| &u[c][start + shift..][..x.len()];
            let (u0, u1, v0, v1, w0, w1) = (of(0, 0), of(0, 1), of(1, 0), of(1, sy), of(2, 0), of(2, sz));
            for i in 0..x.len() {
                row[i] = -((u1[i] - u0[i]) * (wy * wz)
                    + widths[i] * ((v1[i] - v0[i]) * wz + (w1[i] - w0[i]) * wy));
            }
        }
    }
}

/// Subtracts the gradient of `p`, on the cells of a box, from the faces between them and the unknown ones at the ends of the grid.
fn subtract_gradient(grid: &Grid, p: &[f64], cells: &Box3, u: &mut Velocity) {
    let n = [0, 1, 2].map(|d| cells[d].len());
    let strides = [1, n[0], n[0] * n[1]];
    for c in 0..3 {
        let inverse: Vec<f64> = (0..=grid.axes[c].len()).map(|i| 1.0 / grid.centre_distance(c, i)).collect();
        let whole = n[c] == grid.axes[c].len();
        for k in 0..n[2] {
            for j in 0..n[1] {
                let at = [cells[0].start, cells[1].start + j, cells[2].start + k];
                let start = grid.at(at.map(|i| i as isize));
                let row = (k * n[1] + j) * n[0];
                let own = &p[row..row + n[0]];
                let values = &mut u[c][start..start + n[0]];
                if c == 0 {
                    for i in 1..n[0] {
                        values[i] -= (own[i] - own[i - 1]) * inverse[cells[0].start + i];
                    }
                } else if [0, j, k][c] > 0 {
                    let below = &p[row - strides[c]..][..n[0]];
                    let factor = inverse[at[c]];
                    for ((value, own), below) in values.iter_mut().zip(own).zip(below) {
                        *value -= (own - below) * factor;
                    }
                }
            }
        }
        if whole {
            subtract_at_ends(grid, p, cells, c, &inverse, u);
        }
    }
}

/// Subtracts the gradient at the ends of axis `c`, which the box spans: of a periodic axis, or to zero pressure at an outflow.
fn subtract_at_ends(grid: &Grid, p: &[f64], cells: &Box3, c: usize, inverse: &[f64], u: &mut Velocity) {
    let n = [0, 1, 2].map(|d| cells[d].len());
    let unknown = grid.unknown_faces(c);
    let periodic = grid.ends[c] == crate::grid::Ends::Periodic;
    let [a, b] = [(c + 1) % 3, (c + 2) % 3];
    for q in 0..n[b] {
        for r in 0..n[a] {
            let in_box = |i: usize| {
                let mut cell = [0; 3];
                (cell[a], cell[b], cell[c]) = (r, q, i);
                cell
            };
            let pressure = |i: usize| {
                let cell = in_box(i);
                p[(cell[2] * n[1] + cell[1]) * n[0] + cell[0]]
            };
            let at = |i: usize| {
                let cell = in_box(i);
                grid.at([0, 1, 2].map(|d| (cells[d].start + cell[d]) as isize))
            };
            if unknown.start == 0 {
                let below = if periodic { pressure(n[c] - 1) } else { 0.0 };
                u[c][at(0)] -= (pressure(0) - below) * inverse[0];
            }
            if unknown.end == n[c] + 1 {
                u[c][at(n[c])] += pressure(n[c] - 1) * inverse[n[c]];
            }
            if periodic {
                u[c][at(n[c])] = u[c][at(0)];
            }
        }
    }
}

/// The system of the pressure jumps.
struct Constraint<'a> {
    flow: &'a mut Flow,
    rows: &'a FluxConstraints,
    closure: Vec<f64>,
    /// Velocity through the cloth over its jump, times area.
    leak: Vec<f64>,
    diagonal: Vec<f64>,
    factor: f64,
}

impl<'a> Constraint<'a> {
    fn new(flow: &'a mut Flow, rows: &'a FluxConstraints) -> Self {
        let closure = flow.poisson.closure(&rows.cells[2]);
        let volume: f64 = flow.grid.axes.iter().map(|a| a.spacing).product();
        let factor = flow.dt / flow.settings.density / volume;
        // The projection leaves two thirds of an impulse at a single face.
        let own = |r: usize| 0.67 * factor * rows.square(r);
        let leak = (0..rows.len()).map(|r| rows.permeability[r] + rows.leak[r] * own(r)).collect::<Vec<_>>();
        let diagonal = (0..rows.len()).map(|r| own(r) + leak[r]).collect();
        Self { flow, rows, closure, leak, diagonal, factor }
    }

    /// Fluxes through the surface that the jumps `x` cause.
    fn apply(&mut self, x: &[f64], y: &mut [f64]) {
        let Flow { grid, poisson, impulse, pressure, .. } = &mut *self.flow;
        let cells = &self.rows.cells;
        for values in impulse.iter_mut() {
            clear(grid, cells, values);
        }
        for (row, value) in x.iter().enumerate() {
            self.rows.spread(impulse, row, self.factor * value);
        }
        let count = cells.iter().map(ExactSizeIterator::len).product();
        let sums = &mut pressure[..count];
        divergence(grid, impulse, cells, sums);
        poisson.solve_in(sums, cells, &self.closure);
        subtract_gradient(grid, sums, cells, impulse);
        for (row, y) in y.iter_mut().enumerate() {
            *y = self.rows.flux(impulse, row) + self.leak[row] * x[row];
        }
    }

    /// Conjugate gradients from `x`; iterations and relative residual.
    fn solve(&mut self, b: &[f64], x: &mut [f64]) -> (usize, f64) {
        let n = b.len();
        let scale = |r: &[f64], d: &[f64]| -> f64 { r.iter().zip(d).map(|(r, d)| r * r / d).sum() };
        let first = scale(b, &self.diagonal);
        let target = (self.flow.settings.tolerance.powi(2) * first).max(self.round_off());
        let (mut q, mut r) = (vec![0.0; n], b.to_vec());
        if x.iter().any(|x| *x != 0.0) {
            self.apply(x, &mut q);
            r.iter_mut().zip(&q).for_each(|(r, q)| *r -= q);
        }
        let mut rho = scale(&r, &self.diagonal);
        let mut d: Vec<f64> = r.iter().zip(&self.diagonal).map(|(r, m)| r / m).collect();
        let mut iterations = 0;
        while rho > target && rho > 0.0 && iterations < MAX_ITERATIONS {
            self.apply(&d, &mut q);
            let alpha = rho / d.iter().zip(&q).map(|(d, q)| d * q).sum::<f64>();
            for i in 0..n {
                x[i] += alpha * d[i];
                r[i] -= alpha * q[i];
            }
            let before = rho;
            rho = scale(&r, &self.diagonal);
            let beta = rho / before;
            for i in 0..n {
                d[i] = r[i] / self.diagonal[i] + beta * d[i];
            }
            iterations += 1;
        }
        (iterations, if first > self.round_off() { (rho / first).sqrt() } else { 0.0 })
    }

    /// Square of the norm of residuals that are round-off.
    fn round_off(&self) -> f64 {
        let of_row = |r: usize| {
            let speed = self.rows.largest_speed(&self.flow.projected, r);
            let weights: f64 = self.rows.square(r).sqrt();
            (ROUND_OFF * speed * weights).powi(2) / self.diagonal[r]
        };
        (0..self.rows.len()).map(of_row).sum()
    }
}

/// Sets the faces of a box of cells to zero.
fn clear(grid: &Grid, cells: &Box3, values: &mut [f64]) {
    for k in cells[2].start..=cells[2].end {
        for j in cells[1].start..=cells[1].end {
            let start = grid.at([cells[0].start as isize, j as isize, k as isize]);
            values[start..=start + cells[0].len()].fill(0.0);
        }
    }
}
