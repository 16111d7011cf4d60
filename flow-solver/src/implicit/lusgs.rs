//! The paper's lower-upper symmetric Gauss-Seidel step in preconditioned pseudo time.
//!
//! Equation (7) of the paper, with flux Jacobians split as
//! $A^\pm = \tfrac12(A \pm \lambda\Gamma)$ (Yoon and Jameson 1988), $\Gamma$ the
//! Weiss-Smith matrix and $\lambda$ the largest preconditioned wave speed:
//! $$D_i = V\Big(\frac{\Gamma}{\Delta\tau} + \frac{c_0}{\Delta t}\frac{\partial W}{\partial Q}\Big)
//! {}+ \tfrac12\sum_f \lambda_f S_f\,\Gamma,$$
//! one forward sweep over lower and one backward sweep over upper neighbours.

use super::{Correction, SolveReport};
use crate::geometry::vec3::{dot, norm, scale};
use crate::gradient::Gradient;
use crate::physics::{
    FaceFlow, Gas, Scheme, Viscosity, preconditioner, reference_speed, relative_speed, spectral_radius,
};
use crate::residual::{Domain, Spatial};
use crate::topology::Topology;

/// Workspace of LU-SGS sweeps.
#[derive(Clone, Debug)]
pub struct LuSgs<const N: usize> {
    /// Pseudo-time Courant number.
    pub courant: f64,
    /// Face of each entry of the adjacency, and which way it points.
    face: Vec<(u32, f64)>,
    /// Wave speed times area of each face between cells, m3/s.
    wave: Vec<f64>,
    wave_sum: Vec<f64>,
    /// Reference speed of each local cell, m/s.
    reference: Vec<f64>,
    inverse: Vec<[[f64; N]; N]>,
    change: Vec<[f64; N]>,
}

impl<const N: usize> LuSgs<N> {
    /// Workspace for a grid.
    pub fn new(topology: &Topology, courant: f64) -> Self {
        let (n, all) = (topology.n_owned, topology.n_local());
        let mut face = vec![(0, 0.0); topology.adjacency.cell.len() + 1];
        for (f, &[i, j]) in topology.adjacency.slot.iter().enumerate() {
            face[i as usize] = (f as u32, 1.0);
            face[j as usize] = (f as u32, -1.0);
        }
        Self {
            courant,
            face,
            wave: vec![0.0; topology.cells.len()],
            wave_sum: vec![0.0; all],
            reference: vec![0.0; all],
            inverse: vec![[[0.0; N]; N]; n],
            change: vec![[0.0; N]; all],
        }
    }

    /// Sum of `A^- dq` over some neighbours of cell `i`, as a primitive residual of `i`.
    #[inline(always)]
    fn neighbours<G: Gas<N>>(
        &self,
        gas: &G,
        on: &Domain<'_>,
        q: &[[f64; N]],
        i: usize,
        entries: std::ops::Range<usize>,
    ) -> [f64; N] {
        let mut sum = [0.0; N];
        for k in entries {
            let j = on.topology.adjacency.cell[k] as usize;
            let (f, sign) = self.face[k];
            let face = &on.metrics.faces[f as usize];
            let (qj, dq) = (&q[j], &self.change[j]);
            let s = scale(sign, face.area);
            let u = [qj[1], qj[2], qj[3]];
            let through = dot(u, s) - sign * face.grid_flux;
            let rho = gas.density(qj);
            let inflow = rho * dot([dq[1], dq[2], dq[3]], s);
            let (exact, gamma) = (gas.jacobian(qj), preconditioner(gas, qj, self.reference[j]));
            let carried = gas.carried(qj);
            // Work of the pressure in the energy row, force in the momentum rows.
            let push = gas.pressure_change(dq[0], s, dot(u, s));
            for r in 0..N {
                let mut a = inflow * carried[r] + push[r];
                for c in 0..N {
                    a += (through * exact[r][c] - self.wave[f as usize] * gamma[r][c]) * dq[c];
                }
                sum[r] += 0.5 * a;
            }
        }
        gas.primitive_residual(&q[i], &sum)
    }
}

impl<G: Gas<N>, V: Viscosity, const N: usize> Correction<G, V, N> for LuSgs<N> {
    fn assemble(
        &mut self,
        spatial: &Spatial<G, V>,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        _: &[FaceFlow],
        extra: f64,
    ) {
        let (t, m, gas) = (on.topology, on.metrics, &spatial.gas);
        let velocity = |i: usize| [q[i][1], q[i][2], q[i][3]];
        let nu = |i: usize| {
            if !V::ACTIVE {
                return 0.0;
            }
            let g = &gradient[i];
            let u = std::array::from_fn(|d| [g[d][1], g[d][2], g[d][3]]);
            let rho = gas.density(&q[i]);
            let eddy = if V::TRANSPORTED { on.eddy[i] } else { 0.0 };
            (spatial.viscosity.dynamic(rho, &u, m.size[i]) + eddy) / rho
        };
        for i in 0..q.len() {
            let c = gas.sound_speed_squared(&q[i]).sqrt();
            let speed = relative_speed(scheme, velocity(i));
            self.reference[i] = reference_speed(speed, m.size[i], scheme.rate, nu(i), c);
        }
        self.wave_sum.fill(0.0);
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let face = &m.faces[f];
            let radius = |k: usize| {
                let un = (dot(velocity(k), face.area) - face.grid_flux) / face.magnitude();
                spectral_radius(un, self.reference[k], gas.sound_speed_squared(&q[k]).sqrt())
                    + 2.0 * nu(k) / face.spacing()
            };
            let (i, j) = (i as usize, j as usize);
            let wave = radius(i).max(radius(j)) * face.magnitude();
            self.wave[f] = wave;
            self.wave_sum[i] += wave;
            self.wave_sum[j] += wave;
        }
        for side in t.far_field.iter().chain(&t.outlet) {
            // An open boundary answers with the speed of sound, not the reference speed.
            let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
            let c = gas.sound_speed_squared(&q[i]).sqrt();
            self.wave_sum[i] += (norm(velocity(i)) + c) * face.magnitude();
        }
        for (pore, p) in spatial.passages(on, scheme, q) {
            for i in [pore.inside as usize, pore.outside as usize] {
                // Such that the row of pressure gains the derivative of the passage.
                self.wave_sum[i] += 2.0 * p.slope * self.reference[i] * self.reference[i];
            }
        }
        if V::ACTIVE {
            for side in &t.no_slip {
                let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
                self.wave_sum[i] += 2.0 * nu(i) * face.magnitude() / m.height(side);
            }
        }
        for i in 0..t.n_owned {
            let v = m.volume[i];
            let pseudo = extra * self.wave_sum[i] / self.courant + 0.5 * self.wave_sum[i];
            let (exact, gamma) = (gas.jacobian(&q[i]), preconditioner(gas, &q[i], self.reference[i]));
            let mut d = [[0.0; N]; N];
            for c in 0..N {
                let column: [f64; N] =
                    std::array::from_fn(|r| pseudo * gamma[r][c] + scheme.rate * v * exact[r][c]);
                let column = gas.primitive_residual(&q[i], &column);
                for r in 0..N {
                    d[r][c] = column[r];
                }
            }
            self.inverse[i] = inverse(d);
        }
    }

    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        _: &Scheme,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport {
        let rows = &on.topology.adjacency;
        let n = on.topology.n_owned;
        for i in 0..n {
            let lower = rows.start[i] as usize..rows.upper[i] as usize;
            let sum = self.neighbours(gas, on, q, i, lower);
            let b: [f64; N] = std::array::from_fn(|v| -r[i][v] - sum[v]);
            self.change[i] = product(&self.inverse[i], &b);
        }
        for i in (0..n).rev() {
            let upper = rows.upper[i] as usize..rows.ghost[i] as usize;
            let sum = self.neighbours(gas, on, q, i, upper);
            let back = product(&self.inverse[i], &sum);
            for (c, b) in self.change[i].iter_mut().zip(back) {
                *c -= b;
            }
        }
        for (q, d) in q[..n].iter_mut().zip(&self.change) {
            for (q, d) in q.iter_mut().zip(d) {
                *q += share * d;
            }
        }
        SolveReport { iterations: 1, drop: 0.0 }
    }
}

fn product<const N: usize>(a: &[[f64; N]; N], b: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|r| (0..N).map(|c| a[r][c] * b[c]).sum())
}

/// Inverse by Gauss-Jordan elimination; rows are diagonally dominant enough to
/// need no pivoting (diagonal but for pressure and temperature).
fn inverse<const N: usize>(mut a: [[f64; N]; N]) -> [[f64; N]; N] {
    let mut b = [[0.0; N]; N];
    for (i, row) in b.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for k in 0..N {
        let p = 1.0 / a[k][k];
        for c in 0..N {
            a[k][c] *= p;
            b[k][c] *= p;
        }
        for r in 0..N {
            if r != k {
                let f = a[r][k];
                for c in 0..N {
                    a[r][c] -= f * a[k][c];
                    b[r][c] -= f * b[k][c];
                }
            }
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_times_matrix_is_one() {
        let a = [[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.2, 0.1, 2.0]];
        let b = inverse(a);
        for (r, row) in a.iter().enumerate() {
            for c in 0..3 {
                let s: f64 = (0..3).map(|k| row[k] * b[k][c]).sum();
                assert!((s - f64::from(u8::from(r == c))).abs() < 1e-14);
            }
        }
    }
}
