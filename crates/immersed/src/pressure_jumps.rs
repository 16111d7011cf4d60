//! The system of the pressure jumps.

use crate::constraints::{FluxConstraints, OwnFaces};
use crate::flow::{Flow, PredictedFluxes, PressureJumps};
use crate::grid::{Layout, Velocity};
use crate::multilevel::Multilevel;
use crate::projection::{Part, divergence};

/// Limit of iterations.
const MAX_ITERATIONS: usize = 500;

/// Velocity relative to the largest one at a cut face below which a residual is round-off.
const ROUND_OFF: f64 = 1e-13;

/// Directions that a [`SolveHistory`] has at most.
const MAX_DIRECTIONS: usize = 64;

/// Search directions of earlier solutions of the same constraints in the same step, for other motions of the surface. The next solution starts from the
/// last one, minimised along each direction in turn (Fischer, Comput. Methods Appl. Mech. Engrg. 163, 1998): the matrix is the same.
#[derive(Clone, Debug, Default)]
pub struct SolveHistory {
    /// Directions one after the other, their products with the matrix, and the products of both.
    directions: Vec<f64>,
    products: Vec<f64>,
    curvatures: Vec<f64>,
    /// The last solution, and its product with the matrix.
    jump: Vec<f64>,
    product: Vec<f64>,
    /// It keeps no directions.
    last_alone: bool,
}

impl SolveHistory {
    /// A history of the last solution alone, for constraints that are solved for one motion: directions take many times its memory.
    pub fn of_last_solution() -> Self {
        Self { last_alone: true, ..Self::default() }
    }

    /// Numbers that it holds.
    pub fn numbers(&self) -> usize {
        [&self.directions, &self.products, &self.curvatures, &self.jump, &self.product]
            .map(Vec::len)
            .iter()
            .sum()
    }

    /// Whether it has no solution yet.
    pub fn is_empty(&self) -> bool {
        self.jump.is_empty()
    }

    fn push(&mut self, direction: &[f64], product: &[f64], curvature: f64) {
        if !self.last_alone && self.curvatures.len() < MAX_DIRECTIONS && curvature > 0.0 {
            self.directions.extend_from_slice(direction);
            self.products.extend_from_slice(product);
            self.curvatures.push(curvature);
        }
    }

    /// Improves the solution `x` with the residual `r`.
    fn project(&self, x: &mut [f64], r: &mut [f64]) {
        let n = x.len();
        let pairs = self.directions.chunks_exact(n).zip(self.products.chunks_exact(n));
        for ((direction, product), curvature) in pairs.zip(&self.curvatures) {
            let step = direction.iter().zip(&*r).map(|(d, r)| d * r).sum::<f64>() / curvature;
            for i in 0..n {
                x[i] += step * direction[i];
                r[i] -= step * product[i];
            }
        }
    }
}

/// Arrays of the solutions, which all steps use.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConstraintWork {
    /// The faces of the rows in the own planes of the grid, and all of them in the box around the surface.
    in_slab: OwnFaces,
    in_box: OwnFaces,
    /// Positions of all faces of the rows in the box.
    positions: Vec<usize>,
    /// Velocity change by the jumps at the faces of the box; zero between two uses.
    impulse: Velocity,
    /// Pressures of the box.
    pressure: Vec<f64>,
    /// Pivots of the pressure equation above the box, and the end of the box along z to which they belong.
    closure: Vec<f64>,
    closed_at: usize,
    /// Velocity through the cloth over its jump, times area, and diagonal of the system.
    leak: Vec<f64>,
    diagonal: Vec<f64>,
    groups: Multilevel,
    /// Product, residual, direction, preconditioned residual.
    vectors: [Vec<f64>; 4],
}

impl Flow {
    /// Fluxes of the predicted velocity, without divergence, through the faces of `rows`.
    ///
    /// # Panics
    /// No step is predicted.
    pub fn predicted_fluxes(&mut self, rows: &FluxConstraints) -> PredictedFluxes {
        assert!(self.has_predicted_pressure, "fluxes are wanted before the step is accepted");
        let part = Part::slab(&self.grid, &self.slabs);
        let own = part.own();
        let (mut fluxes, mut speeds) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
        if let Some(device) = &mut self.device {
            device.predicted_fluxes(&self.grid, rows, &mut fluxes, &mut speeds);
            return PredictedFluxes { fluxes, speeds };
        }
        let faces = &mut self.work.in_slab;
        faces.set(rows, &self.grid, &part, &self.grid.layout());
        let pressure = &self.pressure[own.start * part.plane()..own.end * part.plane()];
        faces.fluxes(&self.predicted, [pressure, &self.below], &mut fluxes);
        faces.largest_speeds(&self.predicted, [pressure, &self.below], &mut speeds);
        self.slabs.ranks().sum(&mut fluxes);
        self.slabs.ranks().largest(&mut speeds);
        PredictedFluxes { fluxes, speeds }
    }

    /// Multipliers of the constraints at the end of the step: pressure jumps, Pa. May be repeated.
    pub fn solve_constraints(&mut self, rows: &FluxConstraints) -> PressureJumps {
        let predicted = self.predicted_fluxes(rows);
        self.solve_constraints_from(rows, &predicted, None)
    }

    /// [`Self::solve_constraints`] with the fluxes of the predicted velocity, and with what earlier solutions of the same rows in this step have left.
    pub fn solve_constraints_from(
        &mut self,
        rows: &FluxConstraints,
        predicted: &PredictedFluxes,
        history: Option<&mut SolveHistory>,
    ) -> PressureJumps {
        if rows.is_empty() {
            return PressureJumps::default();
        }
        let excess = predicted.fluxes.iter().zip(&rows.target).map(|(flux, target)| flux - target);
        let excess: Vec<f64> = excess.collect();
        if self.jump.len() != rows.len() {
            self.jump = vec![0.0; rows.len()];
        }
        let mut jump = std::mem::take(&mut self.jump);
        let work = std::mem::take(&mut self.work);
        let mut constraint = Constraint::new(self, rows, work);
        let (iterations, residual) = constraint.solve(&excess, &predicted.speeds, &mut jump, history);
        self.work = constraint.work;
        self.jump.clone_from(&jump);
        PressureJumps { jump, iterations, residual }
    }

    /// Changes of the fluxes of all `rows`, m3/s, by pressure jumps there in one step: those of its velocity without divergence, which later steps start from.
    pub fn flux_changes(&mut self, rows: &FluxConstraints, jumps: &[f64]) -> Vec<f64> {
        let mut changes = vec![0.0; rows.len()];
        if rows.is_empty() {
            return changes;
        }
        let work = std::mem::take(&mut self.work);
        let mut constraint = Constraint::new(self, rows, work);
        constraint.apply(jumps, &mut changes);
        for ((change, leak), jump) in changes.iter_mut().zip(&constraint.work.leak).zip(jumps) {
            *change = leak * jump - *change;
        }
        self.work = constraint.work;
        changes
    }

    /// Air that passes airtight cloth under these jumps in the step, m3/s: the sum of its magnitudes over the rows. What permeable cloth lets pass
    /// does not count.
    pub fn leakage(&self, rows: &FluxConstraints, jumps: &[f64]) -> f64 {
        let factor = self.factor();
        jumps.iter().enumerate().map(|(r, jump)| airtight_leak(rows, r, factor) * jump.abs()).sum()
    }

    /// Length of the step over the mass of a cell, s/kg.
    pub(crate) fn factor(&self) -> f64 {
        let volume: f64 = self.grid.axes.iter().map(|a| a.spacing).product();
        self.dt / self.settings.density / volume
    }

    /// Sets the jumps, Pa, from which the next solution of the constraints starts.
    pub fn start_from(&mut self, jumps: Vec<f64>) {
        self.jump = jumps;
    }

    /// Pressure jumps from which the next solution of the constraints starts, Pa.
    pub fn jumps(&self) -> &[f64] {
        &self.jump
    }
}

/// Flux of a row through its own faces over its jump, m3/(s Pa): the projection leaves two thirds of an impulse at a single face.
fn own_response(rows: &FluxConstraints, row: usize, factor: f64) -> f64 {
    0.67 * factor * rows.square(row)
}

/// Flux through airtight cloth over the jump of a row, m3/(s Pa).
fn airtight_leak(rows: &FluxConstraints, row: usize, factor: f64) -> f64 {
    rows.leak[row] * own_response(rows, row, factor)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The system of the pressure jumps.
struct Constraint<'a> {
    flow: &'a mut Flow,
    rows: &'a FluxConstraints,
    /// The box around the surface.
    part: Part,
    /// Layout of the faces of the box.
    layout: Layout,
    work: ConstraintWork,
    factor: f64,
    /// Number of the rows on a device.
    on_device: usize,
}

impl<'a> Constraint<'a> {
    fn new(flow: &'a mut Flow, rows: &'a FluxConstraints, mut work: ConstraintWork) -> Self {
        if work.closed_at != rows.cells[2].end {
            flow.poisson.closure(&rows.cells[2], &mut work.closure);
            work.closed_at = rows.cells[2].end;
        }
        let part = Part::whole(&flow.poisson.covering(&rows.cells));
        let (layout, length) = Layout::of_box(&part.cells());
        let factor = flow.factor();
        work.leak.clear();
        work.leak.extend((0..rows.len()).map(|r| rows.permeability[r] + airtight_leak(rows, r, factor)));
        work.diagonal.clear();
        work.diagonal
            .extend(work.leak.iter().enumerate().map(|(r, leak)| own_response(rows, r, factor) + leak));
        work.groups.set(rows, &flow.grid, &work.leak, &work.diagonal);
        if let Some(device) = &mut flow.device {
            let on_device = device.prepare(&flow.grid, rows, &work.leak, &work.closure);
            return Self { flow, rows, part, layout, work, factor, on_device };
        }
        work.in_box.set(rows, &flow.grid, &part, &layout);
        let of_grid = flow.grid.layout();
        work.positions.clear();
        work.positions.extend(rows.faces.iter().map(|(_, at)| layout.at(of_grid.cell(*at))));
        for values in &mut work.impulse {
            // What was not zero lies elsewhere in another box.
            values.resize(length.max(values.len()), 0.0);
        }
        work.pressure.resize(part.plane() * part.own().len(), 0.0);
        Self { flow, rows, part, layout, work, factor, on_device: 0 }
    }

    /// Fluxes through the surface that the jumps `x` cause.
    fn apply(&mut self, x: &[f64], y: &mut [f64]) {
        if let Some(device) = &self.flow.device {
            return device.responses(self.on_device, x, self.factor, y);
        }
        let Flow { grid, slabs, poisson, .. } = &mut *self.flow;
        let ConstraintWork { in_box, positions, impulse, pressure, closure, leak, .. } = &mut self.work;
        let Self { rows, part, .. } = self;
        let entries = |row: usize| rows.offsets[row]..rows.offsets[row + 1];
        for (row, value) in x.iter().enumerate() {
            let value = self.factor * value;
            for e in entries(row) {
                impulse[rows.faces[e].0 as usize][positions[e]] += rows.weights[e] * value;
            }
        }
        let cells = part.cells();
        divergence(grid, &self.layout, impulse, &cells, pressure);
        poisson.solve_in(pressure, &cells, closure);
        in_box.gradients(pressure, y);
        slabs.ranks().sum(y);
        for (row, (y, x)) in y.iter_mut().zip(x).enumerate() {
            let direct =
                entries(row).map(|e| rows.weights[e] * impulse[rows.faces[e].0 as usize][positions[e]]);
            *y = direct.sum::<f64>() - *y + leak[row] * x;
        }
        for ((c, _), at) in rows.faces.iter().zip(positions) {
            impulse[*c as usize][*at] = 0.0;
        }
    }

    /// Preconditioned conjugate gradients from `x`; iterations and relative residual. `speeds`: largest one at the faces of each row, m/s, for the residual that is
    /// round-off.
    fn solve(
        &mut self,
        b: &[f64],
        speeds: &[f64],
        x: &mut [f64],
        mut history: Option<&mut SolveHistory>,
    ) -> (usize, f64) {
        let [mut q, mut r, mut d, mut z] = std::mem::take(&mut self.work.vectors);
        let diagonal = std::mem::take(&mut self.work.diagonal);
        let mut groups = std::mem::take(&mut self.work.groups);
        let scale = |r: &[f64]| -> f64 { r.iter().zip(&diagonal).map(|(r, d)| r * r / d).sum() };
        let first = scale(b);
        let round_off = self.round_off(speeds, &diagonal);
        let target = (self.flow.settings.tolerance.powi(2) * first).max(round_off);
        q.resize(b.len(), 0.0);
        r.clear();
        r.extend_from_slice(b);
        self.start(x, &mut q, &mut r, history.as_deref());
        let mut residual = scale(&r);
        z.resize(b.len(), 0.0);
        groups.apply(&diagonal, &r, &mut z);
        d.clone_from(&z);
        let mut rho = dot(&r, &z);
        let mut iterations = 0;
        while residual > target && rho > 0.0 && iterations < MAX_ITERATIONS {
            self.apply(&d, &mut q);
            let curvature = dot(&d, &q);
            let alpha = rho / curvature;
            for i in 0..b.len() {
                x[i] += alpha * d[i];
                r[i] -= alpha * q[i];
            }
            if let Some(history) = &mut history {
                history.push(&d, &q, curvature);
            }
            residual = scale(&r);
            groups.apply(&diagonal, &r, &mut z);
            let before = rho;
            rho = dot(&r, &z);
            let beta = rho / before;
            d.iter_mut().zip(&z).for_each(|(d, z)| *d = z + beta * *d);
            iterations += 1;
        }
        if let Some(history) = history {
            history.jump.clear();
            history.jump.extend_from_slice(x);
            history.product.clear();
            history.product.extend(b.iter().zip(&r).map(|(b, r)| b - r));
        }
        self.work.vectors = [q, r, d, z];
        (self.work.diagonal, self.work.groups) = (diagonal, groups);
        (iterations, if first > round_off { (residual / first).sqrt() } else { 0.0 })
    }

    /// Takes the product of the first jumps with the matrix from the residual `r`. With a history they are the best ones that it has.
    fn start(&mut self, x: &mut [f64], q: &mut [f64], r: &mut [f64], history: Option<&SolveHistory>) {
        match history {
            Some(history) if history.jump.len() == x.len() => {
                x.copy_from_slice(&history.jump);
                r.iter_mut().zip(&history.product).for_each(|(r, q)| *r -= q);
                history.project(x, r);
            }
            _ if x.iter().any(|x| *x != 0.0) => {
                self.apply(x, q);
                r.iter_mut().zip(&*q).for_each(|(r, q)| *r -= q);
            }
            _ => {}
        }
    }

    /// Square of the norm of residuals that are round-off.
    fn round_off(&self, speeds: &[f64], diagonal: &[f64]) -> f64 {
        let of_row = |(r, speed): (usize, &f64)| {
            let weights: f64 = self.rows.square(r).sqrt();
            (ROUND_OFF * speed * weights).powi(2) / diagonal[r]
        };
        speeds.iter().enumerate().map(of_row).sum()
    }
}
