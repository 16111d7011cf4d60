//! Linear constraints on the velocity of faces.

use nalgebra::Vector3;

use crate::grid::{Grid, Layout, Velocity};
use crate::poisson::Box3;
use crate::projection::{Gradient, Part};

/// [`FluxConstraints::leak`] of airtight cloth. Air in a resolved pocket that cloth encloses has no other way out when the pocket shrinks. Through
/// airtight cloth passes 1e-5 of the stream in steady flow at a Courant number of 0.1, and 1e-4 for each cell of the radius of the cloth at an
/// impulsive start.
pub const AIRTIGHT: f64 = 1e-4;

/// Constraints $`\sum_f w_f u_f + r \lambda = b`$ on faces of the grid, with the force $`w_f \lambda`$ on the air at each face.
#[derive(Clone, Debug, Default)]
pub struct FluxConstraints {
    /// First entry of each row; one more than rows.
    pub offsets: Vec<usize>,
    /// Component and position in its array.
    pub faces: Vec<(u8, usize)>,
    /// Weight, m2.
    pub weights: Vec<f64>,
    /// Right-hand side b, m3/s.
    pub target: Vec<f64>,
    /// Permeability r times area, m3/(s Pa).
    pub permeability: Vec<f64>,
    /// Permeability of airtight cloth, relative to what the row's jump moves the air through its own faces.
    pub leak: Vec<f64>,
    /// Cells next to the faces.
    pub cells: Box3,
}

impl FluxConstraints {
    /// Without rows.
    pub fn new(grid: &Grid) -> Self {
        Self { offsets: vec![0], cells: [0, 1, 2].map(|d| grid.axes[d].len()..0), ..Self::default() }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.target.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.target.is_empty()
    }

    /// Adds a row of `entries`: component, cell whose lower face it is, weight.
    pub fn push(
        &mut self,
        grid: &Grid,
        entries: &[(usize, [usize; 3], f64)],
        target: f64,
        permeability: f64,
    ) {
        for (c, cell, weight) in entries {
            self.faces.push((*c as u8, grid.at(cell.map(|i| i as isize))));
            self.weights.push(*weight);
            for (d, (range, upper)) in self.cells.iter_mut().zip(cell).enumerate() {
                range.start = range.start.min(upper - usize::from(d == *c));
                range.end = range.end.max(upper + 1);
            }
        }
        self.offsets.push(self.faces.len());
        self.target.push(target);
        self.permeability.push(permeability);
        self.leak.push(AIRTIGHT);
    }

    /// Adds the rows of `other` after its own.
    pub fn append(&mut self, other: &Self) {
        let first = self.faces.len();
        self.offsets.extend(other.offsets[1..].iter().map(|at| first + at));
        self.faces.extend_from_slice(&other.faces);
        self.weights.extend_from_slice(&other.weights);
        self.target.extend_from_slice(&other.target);
        self.permeability.extend_from_slice(&other.permeability);
        self.leak.extend_from_slice(&other.leak);
        for (own, other) in self.cells.iter_mut().zip(&other.cells) {
            *own = own.start.min(other.start)..own.end.max(other.end);
        }
    }

    pub(crate) fn entries(&self, row: usize) -> impl Iterator<Item = (&(u8, usize), &f64)> {
        let range = self.offsets[row]..self.offsets[row + 1];
        self.faces[range.clone()].iter().zip(&self.weights[range])
    }

    /// Sum of the weighted velocities of a row, m3/s.
    pub fn flux(&self, u: &Velocity, row: usize) -> f64 {
        self.entries(row).map(|((c, at), w)| w * u[*c as usize][*at]).sum()
    }

    /// Adds the weights times `value` to `u`.
    pub fn spread(&self, u: &mut Velocity, row: usize, value: f64) {
        for ((c, at), w) in self.entries(row) {
            u[*c as usize][*at] += w * value;
        }
    }

    /// Sum of the weights of a row by axis, m2.
    pub fn weight_by_axis(&self, row: usize) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        self.entries(row).for_each(|((c, _), w)| sum[*c as usize] += w);
        sum
    }

    /// Sum of squared weights.
    pub fn square(&self, row: usize) -> f64 {
        self.entries(row).map(|(_, w)| w * w).sum()
    }
}

/// Pressure jumps of rows, Pa.
pub type JumpsOfRows<'a> = (&'a FluxConstraints, &'a [f64]);

/// A face of a constraint in the own planes.
#[derive(Clone, Copy, Debug)]
struct OwnFace {
    component: u8,
    at: usize,
    /// Weight, m2.
    weight: f64,
    /// Gradient of the pressure there.
    gradient: Gradient,
}

/// The faces of constraints in the planes of a part.
#[derive(Clone, Debug, Default)]
pub(crate) struct OwnFaces {
    /// First entry of each row; one more than rows.
    offsets: Vec<usize>,
    entries: Vec<OwnFace>,
}

impl OwnFaces {
    /// Sets the faces in the planes of `part` along z, with positions in arrays of `layout`.
    pub(crate) fn set(&mut self, rows: &FluxConstraints, grid: &Grid, part: &Part, layout: &Layout) {
        self.entries.clear();
        self.offsets.clear();
        self.offsets.push(0);
        let (own, of_grid) = (part.own(), grid.layout());
        for row in 0..rows.len() {
            for ((component, at), weight) in rows.entries(row) {
                let cell = of_grid.cell(*at);
                let index = cell.map(|i| i as usize);
                if own.contains(&index[2]) {
                    let gradient = part.gradient(grid, *component as usize, index);
                    let (component, weight, at) = (*component, *weight, layout.at(cell));
                    self.entries.push(OwnFace { component, at, weight, gradient });
                }
            }
            self.offsets.push(self.entries.len());
        }
    }

    fn rows(&self) -> impl Iterator<Item = &[OwnFace]> {
        self.offsets.windows(2).map(|range| &self.entries[range[0]..range[1]])
    }

    /// Share of these faces in the sum of the weighted velocities of each row, m3/s, for the velocity `u` less the gradient of `p`, with the
    /// plane `below` it.
    pub(crate) fn fluxes(&self, u: &Velocity, [p, below]: [&[f64]; 2], fluxes: &mut [f64]) {
        for (flux, entries) in fluxes.iter_mut().zip(self.rows()) {
            let of = |f: &OwnFace| f.weight * (u[f.component as usize][f.at] - f.gradient.of(p, below));
            *flux = entries.iter().map(of).sum();
        }
    }

    /// Weighted gradients of the pressure `p` of all planes at the faces of each row, summed, m3/s for a pressure over density times the step.
    pub(crate) fn gradients(&self, p: &[f64], sums: &mut [f64]) {
        for (sum, entries) in sums.iter_mut().zip(self.rows()) {
            *sum = entries.iter().map(|f| f.weight * f.gradient.of(p, &[])).sum();
        }
    }

    /// Largest speed at these faces of each row, m/s; arguments of [`Self::fluxes`].
    pub(crate) fn largest_speeds(&self, u: &Velocity, [p, below]: [&[f64]; 2], speeds: &mut [f64]) {
        for (speed, entries) in speeds.iter_mut().zip(self.rows()) {
            let of = |f: &OwnFace| (u[f.component as usize][f.at] - f.gradient.of(p, below)).abs();
            *speed = entries.iter().map(of).fold(0.0, f64::max);
        }
    }
}
