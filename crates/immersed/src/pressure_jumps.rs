//! The system of the pressure jumps.

use crate::constraints::{FluxConstraints, OwnFaces};
use crate::flow::{Flow, PressureJumps};
use crate::grid::Grid;
use crate::poisson::Box3;
use crate::projection::{Part, divergence};

/// Limit of iterations.
const MAX_ITERATIONS: usize = 500;

/// Velocity relative to the largest one at a cut face below which a residual is round-off.
const ROUND_OFF: f64 = 1e-13;

impl Flow {
    /// Multipliers of the constraints at the end of the step: pressure jumps, Pa. May be repeated.
    pub fn solve_constraints(&mut self, rows: &FluxConstraints) -> PressureJumps {
        if rows.is_empty() {
            return PressureJumps::default();
        }
        let faces = OwnFaces::new(rows, &self.slabs, self.slabs.own());
        let (mut residual, mut speeds) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
        faces.fluxes(&self.projected, &mut residual);
        faces.largest_speeds(&self.projected, &mut speeds);
        self.slabs.ranks().sum(&mut residual);
        self.slabs.ranks().largest(&mut speeds);
        residual.iter_mut().zip(&rows.target).for_each(|(flux, target)| *flux -= target);
        if self.jump.len() != rows.len() {
            self.jump = vec![0.0; rows.len()];
        }
        let mut jump = std::mem::take(&mut self.jump);
        let (iterations, residual) = Constraint::new(self, rows).solve(&residual, &speeds, &mut jump);
        self.jump.clone_from(&jump);
        PressureJumps { jump, iterations, residual }
    }

    /// Air that passes airtight cloth under these jumps in the step, m3/s: the sum of its magnitudes over the rows. What permeable cloth lets pass
    /// does not count.
    pub fn leakage(&self, rows: &FluxConstraints, jumps: &[f64]) -> f64 {
        let factor = self.factor();
        jumps.iter().enumerate().map(|(r, jump)| airtight_leak(rows, r, factor) * jump.abs()).sum()
    }

    /// Length of the step over the mass of a cell, s/kg.
    fn factor(&self) -> f64 {
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

/// The system of the pressure jumps.
struct Constraint<'a> {
    flow: &'a mut Flow,
    rows: &'a FluxConstraints,
    /// Planes of the box around the surface that this rank computes, and the faces of the rows in them.
    part: Part,
    faces: OwnFaces,
    closure: Vec<f64>,
    /// Velocity through the cloth over its jump, times area.
    leak: Vec<f64>,
    diagonal: Vec<f64>,
    factor: f64,
}

impl<'a> Constraint<'a> {
    fn new(flow: &'a mut Flow, rows: &'a FluxConstraints) -> Self {
        let closure = flow.poisson.closure(&rows.cells[2]);
        let part = Part::share(&rows.cells, &flow.slabs);
        let faces = OwnFaces::new(rows, &flow.slabs, part.own());
        let factor = flow.factor();
        let leak = (0..rows.len())
            .map(|r| rows.permeability[r] + airtight_leak(rows, r, factor))
            .collect::<Vec<_>>();
        let diagonal = (0..rows.len()).map(|r| own_response(rows, r, factor) + leak[r]).collect();
        Self { flow, rows, part, faces, closure, leak, diagonal, factor }
    }

    /// Fluxes through the surface that the jumps `x` cause.
    fn apply(&mut self, x: &[f64], y: &mut [f64]) {
        let Flow { grid, slabs, poisson, impulse, pressure, below, .. } = &mut *self.flow;
        let cells = &self.rows.cells;
        for values in impulse.iter_mut() {
            clear(grid, cells, values);
        }
        for (row, value) in x.iter().enumerate() {
            self.rows.spread(impulse, row, self.factor * value);
        }
        let own = self.part.cells();
        let sums = &mut pressure[..self.part.plane() * own[2].len()];
        divergence(grid, impulse, &own, sums);
        poisson.solve_in(sums, cells, &self.closure, slabs);
        self.part.plane_below(slabs, sums, below);
        self.part.subtract_gradient(grid, sums, below, impulse);
        self.faces.fluxes(impulse, y);
        slabs.ranks().sum(y);
        for ((y, leak), x) in y.iter_mut().zip(&self.leak).zip(x) {
            *y += leak * x;
        }
    }

    /// Conjugate gradients from `x`; iterations and relative residual. `speeds`: largest one at the faces of each row, m/s, for the residual that is
    /// round-off.
    fn solve(&mut self, b: &[f64], speeds: &[f64], x: &mut [f64]) -> (usize, f64) {
        let n = b.len();
        let scale = |r: &[f64], d: &[f64]| -> f64 { r.iter().zip(d).map(|(r, d)| r * r / d).sum() };
        let first = scale(b, &self.diagonal);
        let round_off = self.round_off(speeds);
        let target = (self.flow.settings.tolerance.powi(2) * first).max(round_off);
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
        (iterations, if first > round_off { (rho / first).sqrt() } else { 0.0 })
    }

    /// Square of the norm of residuals that are round-off.
    fn round_off(&self, speeds: &[f64]) -> f64 {
        let of_row = |(r, speed): (usize, &f64)| {
            let weights: f64 = self.rows.square(r).sqrt();
            (ROUND_OFF * speed * weights).powi(2) / self.diagonal[r]
        };
        speeds.iter().enumerate().map(of_row).sum()
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
