//! Error of single cells, which the norm of the residual over all cells does not show where cells differ much in size.

use super::*;
use crate::extreme::Extreme;
use crate::physics::velocity;

/// Share of the typical speed up to which the residual of a converged step may still change the velocity of any one cell, whatever the drop of
/// the residual of all cells: beyond it single cells run away (decision 90).
const LARGEST_CELL_ERROR: f64 = 0.1;

/// Largest error of one cell.
#[derive(Clone, Copy, Debug, Default)]
pub struct CellError {
    /// Change of its velocity, over the typical speed $`U`$, that its residual would cause:
    /// ```math
    /// \frac{|r_i|}{U D_i}, \qquad D_i = \frac{c_0}{\Delta t}\rho V_i + \sum_f \left(\max(\dot m_f, 0) + \mu \frac{A_f}{\delta_f}\right),
    /// ```
    /// with the flow $`\dot m_f`$ out of the cell: the diagonal of its momentum equation.
    pub share: f64,
    /// Largest `share` of a converged step.
    pub allowed: f64,
    /// Centre of the cell, m.
    pub at: [f64; 3],
}

impl CellError {
    /// Whether no cell has a larger error than a converged step allows.
    pub fn is_small(&self) -> bool {
        self.share <= self.allowed
    }
}

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// The largest error of a cell at the residual of the last evaluation. Collective.
    pub(super) fn cell_error(&mut self) -> CellError {
        let speed = self.typical_speed();
        self.fill_inertia();
        // What passes and rubs only makes the error smaller.
        let error = self.largest_error(speed);
        if error.is_small() {
            return error;
        }
        self.add_face_rates();
        self.largest_error(speed)
    }

    /// Speed relative to the frame, m/s, that most of the kinetic energy has, $`\sqrt{\sum_i V_i u_i^4 / \sum_i V_i u_i^2}`$, and at least the
    /// speed scale of the scene: a small cell that runs away does not raise it. Collective.
    fn typical_speed(&self) -> f64 {
        let mut sums = [0.0; 2];
        for (q, v) in self.q[..self.topology.n_owned].iter().zip(&self.metrics.volume) {
            let energy = v * (velocity(q) - self.scheme.frame).norm_squared();
            sums[0] += energy * energy / v;
            sums[1] += energy;
        }
        self.halo.comm().sum_slice(&mut sums);
        let weighted = if sums[1] > 0.0 { (sums[0] / sums[1]).sqrt() } else { 0.0 };
        weighted.max(10.0 * self.settings.reference_speed)
    }

    fn largest_error(&self, speed: f64) -> CellError {
        let mut largest = Extreme::default();
        for (cell, (r, d)) in self.residual.iter().zip(&self.diagonal).enumerate() {
            let norm = r[..4].iter().map(|x| x * x).sum::<f64>().sqrt();
            largest.compare(norm / (d * speed), cell);
        }
        let (share, at) = largest.over_ranks(self.halo.comm(), &self.metrics.centre);
        CellError { share, allowed: LARGEST_CELL_ERROR, at }
    }

    fn fill_inertia(&mut self) {
        let cells = self.q.iter().zip(&self.metrics.volume);
        for (d, (q, v)) in self.diagonal.iter_mut().zip(cells) {
            *d = self.scheme.rate * v * self.spatial.gas.density(q);
        }
    }

    fn add_face_rates(&mut self) {
        let n = self.topology.n_owned;
        let viscosity = self.spatial.viscosity.molecular();
        let (between, diagonal, eddy) = (self.topology.cells.len(), &mut self.diagonal, &self.eddy);
        let (faces, flux) = (&self.metrics.faces, &self.face_flux);
        self.topology.for_each_side(|f, i, sign| {
            if i >= n {
                return;
            }
            let mass = f64::from(flux[f].mass);
            // At boundaries its sign does not follow the area vector.
            let out = if f < between { (sign * mass).max(0.0) } else { mass.abs() };
            let mu = viscosity + eddy.get(i).copied().unwrap_or_default();
            diagonal[i] += out + mu * faces[f].magnitude() / faces[f].spacing();
        });
    }
}
