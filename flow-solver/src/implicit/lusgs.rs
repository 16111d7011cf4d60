//! The paper's lower-upper symmetric Gauss-Seidel step in preconditioned pseudo time.
//!
//! Equation (7) of the paper, with flux Jacobians split as
//! $`A^\pm = \tfrac12(A \pm \lambda\Gamma)`$ (Yoon and Jameson 1988), $`\Gamma`$ the
//! Weiss-Smith matrix and $`\lambda`$ the largest preconditioned wave speed:
//! ```math
//! D_i = V\Big(\frac{\Gamma}{\Delta\tau} + \frac{c_0}{\Delta t}\frac{\partial W}{\partial Q}\Big)
//! {}+ \tfrac12\sum_f \lambda_f S_f\,\Gamma,
//! ```
//! one forward sweep over lower and one backward sweep over upper neighbours.

use super::{Correction, SolveReport};
use crate::gradient::{self, Field};
use crate::physics::{
    FaceFlux, FluxParameters, Gas, Viscosity, preconditioner, reference_speed, relative_speed,
    spectral_radius, velocity,
};
use crate::residual::{Domain, Spatial, for_viscosity};
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
            let s = face.area * sign;
            let volume = velocity(qj).dot(&s);
            let relative_flux = volume - sign * face.grid_flux;
            let rho = gas.density(qj);
            let inflow = rho * velocity(dq).dot(&s);
            let (exact, gamma) = (gas.jacobian(qj), preconditioner(gas, qj, self.reference[j]));
            let carried = gas.carried(qj);
            // Work of the pressure in the energy row, force in the momentum rows.
            let push = gas.pressure_change(dq[0], s, volume);
            for r in 0..N {
                let mut a = inflow * carried[r] + push[r];
                for c in 0..N {
                    a += (relative_flux * exact[r][c] - self.wave[f as usize] * gamma[r][c]) * dq[c];
                }
                sum[r] += 0.5 * a;
            }
        }
        gas.primitive_residual(&q[i], &sum)
    }
}

/// Kinematic viscosity of each local cell, m2/s.
fn kinematic<'a, G: Gas<N>, V: Viscosity, const N: usize>(
    spatial: &'a Spatial<G, V>,
    on: &'a Domain<'_>,
    field: Field<'a, N>,
) -> impl Fn(usize) -> f64 + 'a {
    move |i| {
        if !V::ACTIVE {
            return 0.0;
        }
        let u = gradient::of_velocity(&field.gradient[i]);
        let rho = spatial.gas.density(&field.q[i]);
        let eddy = if spatial.viscosity.transported() { on.eddy[i] } else { 0.0 };
        (spatial.viscosity.dynamic(rho, &u, on.metrics.size[i]) + eddy) / rho
    }
}

impl<const N: usize> LuSgs<N> {
    /// Wave speeds times areas of the faces between cells, and their sums over all faces of each cell.
    fn sum_waves<G: Gas<N>, V: Viscosity>(
        &mut self,
        spatial: &Spatial<G, V>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
    ) {
        let (t, m, gas, q) = (on.topology, on.metrics, &spatial.gas, field.q);
        let nu = kinematic(spatial, on, field);
        let sound = |i: usize| gas.sound_speed_squared(&q[i]).sqrt();
        self.wave_sum.fill(0.0);
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let face = &m.faces[f];
            let radius = |k: usize| {
                let un = (velocity(&q[k]).dot(&face.area) - face.grid_flux) / face.magnitude();
                spectral_radius(un, self.reference[k], sound(k)) + 2.0 * nu(k) / face.spacing()
            };
            let (i, j) = (i as usize, j as usize);
            let wave = radius(i).max(radius(j)) * face.magnitude();
            self.wave[f] = wave;
            self.wave_sum[i] += wave;
            self.wave_sum[j] += wave;
        }
        for side in t.open_sides() {
            // An open boundary answers with the speed of sound, not the reference speed.
            let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
            self.wave_sum[i] += (velocity(&q[i]).norm() + sound(i)) * face.magnitude();
        }
        for (porous_face, p) in spatial.passages(on, scheme, q) {
            for i in [porous_face.inside as usize, porous_face.outside as usize] {
                // Such that the row of pressure gains the derivative of the passage.
                self.wave_sum[i] += 2.0 * p.slope * self.reference[i] * self.reference[i];
            }
        }
        if V::ACTIVE {
            for side in &t.no_slip {
                let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
                let wall = spatial.near_wall(on, scheme, q, side);
                let stiffness = wall.stiffness().map_or_else(|| nu(i), |mu| mu / gas.density(&q[i]));
                self.wave_sum[i] += 2.0 * stiffness * face.magnitude() / wall.height;
            }
        }
    }

    /// Reference speeds of the local cells, and the waves of their faces.
    fn set_speeds<G: Gas<N>, V: Viscosity>(
        &mut self,
        spatial: &Spatial<G, V>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
    ) {
        let nu = kinematic(spatial, on, field);
        for (i, q) in field.q.iter().enumerate() {
            let c = spatial.gas.sound_speed_squared(q).sqrt();
            let speed = relative_speed(scheme, velocity(q));
            self.reference[i] = reference_speed(speed, on.metrics.size[i], scheme.rate, nu(i), c);
        }
        self.sum_waves(spatial, on, scheme, field);
    }

    /// Inverses of the diagonal blocks.
    fn invert_blocks<G: Gas<N>>(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        q: &[[f64; N]],
        extra: f64,
    ) {
        for i in 0..on.topology.n_owned {
            let v = on.metrics.volume[i];
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
}

impl<G: Gas<N>, const N: usize> Correction<G, N> for LuSgs<N> {
    fn assemble(
        &mut self,
        spatial: &Spatial<G>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        _: &[FaceFlux],
        extra: f64,
    ) {
        let _part = timing::part("assembly");
        for_viscosity!(spatial, s => self.set_speeds(&s, on, scheme, field));
        self.invert_blocks(&spatial.gas, on, scheme, field.q, extra);
    }

    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        _: &FluxParameters,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport {
        let _part = timing::part("linear solve");
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
    fn inverse_times_matrix_is_the_identity() {
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
