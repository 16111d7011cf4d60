//! Pressure correction as an approximate inverse of the coupled system.
//!
//! The Jacobian of the primitive residual is nearly
//! $\begin{pmatrix} C & D \\ G & A\end{pmatrix}$ with compressibility $C$,
//! divergence $D$, gradient $G$ and a transport operator $A$ that is the same
//! for all velocity components. One application solves the transport part by a
//! symmetric Gauss-Seidel sweep, then the pressure Schur complement
//! $C - D\,\mathrm{diag}(A)^{-1}G$ on the compact stencil by conjugate
//! gradients, then corrects the velocity (Patankar's SIMPLE, as a
//! preconditioner). The pressure diffusion of the flux is chosen such that the
//! compact stencil is also what the residual sees.

use comm::Halo;

use super::pressure::{PressureSystem, SolveReport};
use super::{Correction, MergedCells};
use crate::geometry::vec3::dot;
use crate::gradient::Gradient;
use crate::physics::{FaceFlow, Gas, Scheme, Viscosity};
use crate::residual::{Domain, Spatial};
use crate::topology::{Adjacency, Topology};

/// Share of the neighbours' coefficients that the response of the velocity to
/// pressure leaves out: 0 is SIMPLE, where the neighbours stand still, 1 SIMPLEC,
/// where they move alike. Near 1 is right for smooth corrections, which at large
/// Courant numbers are what takes iterations; 0 for ragged ones. On the plate of
/// 250 880 cells (first six steps): 45, 36, 33, 34, 37 iterations at 0, 0.5, 0.8, 0.9, 1.
const FOLLOWING: f64 = 0.8;

/// Matrices and workspace of the pressure correction.
#[derive(Debug)]
pub struct PressureCorrection {
    /// Transport coefficient of each entry of the adjacency, kg/s.
    off: Vec<f32>,
    /// Inverse diagonal of the transport operator, s/kg.
    inverse: Vec<f32>,
    /// `density * volume / diagonal` of all local cells, s: how long pressure acts.
    response: Vec<f32>,
    diagonal: Vec<f64>,
    density: Vec<f32>,
    /// Sound speed squared of owned cells.
    sound2: Vec<f32>,
    /// Cells whose velocity along a far face's normal is held by the acoustic
    /// condition there: cell, unit normal, share of that component to take away.
    held: Vec<(u32, [f64; 3], f64)>,
    /// Passages through the canopy: face, cells inside and outside, share of the mean mass
    /// flux that passes (kg/m3) and its derivative by the jump of pressure, kg/(s Pa).
    pores: Vec<(usize, [usize; 2], f64, f64)>,
    pressure: PressureSystem,
    transported: Vec<[f32; 4]>,
    correction: Vec<f32>,
    /// Relative tolerance of the pressure equation.
    pub tolerance: f64,
    /// Conjugate-gradient iterations at most.
    pub max_iterations: usize,
}

impl PressureCorrection {
    /// Workspace for a grid.
    pub fn new(topology: &Topology) -> Self {
        let (n, all, entries) = (topology.n_owned, topology.n_local(), topology.adjacency.cell.len());
        Self {
            off: vec![0.0; entries + 1],
            inverse: vec![0.0; n],
            response: vec![0.0; all],
            diagonal: vec![0.0; all],
            density: vec![0.0; all],
            sound2: vec![0.0; n],
            held: Vec::with_capacity(topology.far_field.len()),
            pores: Vec::with_capacity(topology.pores.len()),
            pressure: PressureSystem::new(&topology.adjacency, all),
            transported: vec![[0.0; 4]; all],
            correction: vec![0.0; all],
            tolerance: 0.05,
            max_iterations: 60,
        }
    }

    fn assemble_pressure(&mut self, on: &Domain<'_>, scheme: &Scheme, rate: f64) {
        let (t, m) = (on.topology, on.metrics);
        // Sums in double precision: reuse the transport diagonal's storage.
        for i in 0..t.n_owned {
            self.diagonal[i] = rate * m.volume[i] / f64::from(self.sound2[i]);
        }
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let face = &m.faces[f];
            let k = 0.5 * f64::from(self.response[i] + self.response[j]) * face.magnitude() / face.spacing();
            let [si, sj] = t.adjacency.slot[f];
            self.pressure.matrix.off[si as usize] = k as f32;
            self.pressure.matrix.off[sj as usize] = k as f32;
        }
        // What passes a pore depends on the other side too; left to the outer iterations, as
        // the other side resists no more than a neighbour does.
        for &(_, [i, o], _, slope) in &self.pores {
            self.diagonal[i] += slope;
            self.diagonal[o] += slope;
        }
        for side in t.outlet.iter() {
            let face = &m.faces[side.face as usize];
            let i = side.cell as usize;
            self.diagonal[i] += f64::from(self.response[i]) * face.magnitude() / face.spacing();
        }
        for side in t.far_field.iter() {
            let face = &m.faces[side.face as usize];
            let i = side.cell as usize;
            let leaving = crate::physics::leaving(&on.scheme_at(scheme, side), face, side.sign);
            let open = f64::from(self.response[i]) / face.spacing();
            let closed = 0.5 / f64::from(self.sound2[i]).sqrt();
            self.diagonal[i] += face.magnitude() * (leaving * open + (1.0 - leaving) * closed);
        }
        for (p, d) in self.pressure.matrix.own.iter_mut().zip(&self.diagonal) {
            *p = *d as f32;
        }
        self.pressure.prepare(on);
    }

    /// One symmetric Gauss-Seidel sweep of the transport operator on `-r`.
    fn transport<const N: usize>(&mut self, t: &Topology, r: &[[f64; N]]) {
        let rows = &t.adjacency;
        let x = &mut self.transported;
        for i in 0..t.n_owned {
            let mut s: [f32; 4] = std::array::from_fn(|d| if d + 1 < N { -r[i][d + 1] as f32 } else { 0.0 });
            let row = rows.start[i] as usize..rows.upper[i] as usize;
            for (k, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                for d in 0..4 {
                    s[d] += k * x[j as usize][d];
                }
            }
            x[i] = s.map(|s| s * self.inverse[i]);
        }
        for i in (0..t.n_owned).rev() {
            let mut s = [0.0f32; 4];
            let row = rows.upper[i] as usize..rows.ghost[i] as usize;
            for (k, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                for d in 0..4 {
                    s[d] += k * x[j as usize][d];
                }
            }
            for d in 0..4 {
                x[i][d] += s[d] * self.inverse[i];
            }
        }
    }
}

impl<G: Gas<N>, V: Viscosity, const N: usize> Correction<G, V, N> for PressureCorrection {
    fn assemble(
        &mut self,
        spatial: &Spatial<G, V>,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        through: &[FaceFlow],
        extra: f64,
    ) {
        let (t, m) = (on.topology, on.metrics);
        let n = t.n_owned;
        let rate = scheme.rate * extra;
        for (i, q) in q.iter().enumerate() {
            let density = spatial.gas.density(q);
            self.density[i] = density as f32;
            self.diagonal[i] = rate * density * m.volume[i];
        }
        for (c, q) in self.sound2.iter_mut().zip(q) {
            *c = spatial.gas.sound_speed_squared(q) as f32;
        }
        let viscosity = |i: usize| {
            let g = &gradient[i];
            let u = std::array::from_fn(|d| [g[d][1], g[d][2], g[d][3]]);
            let eddy = if V::TRANSPORTED { on.eddy[i] } else { 0.0 };
            spatial.viscosity.dynamic(f64::from(self.density[i]), &u, m.size[i]) + eddy
        };
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let face = &m.faces[f];
            let mass = f64::from(through[f].mass);
            let mut both = 0.25 * scheme.velocity_diffusion * mass.abs();
            if V::ACTIVE {
                both += 0.5 * (viscosity(i) + viscosity(j)) * face.magnitude() / face.spacing();
            }
            let [si, sj] = t.adjacency.slot[f];
            let (ki, kj) = (both + (-mass).max(0.0), both + mass.max(0.0));
            self.off[si as usize] = ki as f32;
            self.off[sj as usize] = kj as f32;
            self.diagonal[i] += ki;
            self.diagonal[j] += kj;
        }
        for side in t.far_field.iter().chain(&t.outlet) {
            self.diagonal[side.cell as usize] += f64::from(-through[side.face as usize].mass).max(0.0);
        }
        if V::ACTIVE {
            for side in &t.no_slip {
                let face = &m.faces[side.face as usize];
                self.diagonal[side.cell as usize] +=
                    viscosity(side.cell as usize) * face.magnitude() / m.height(side);
            }
        }
        self.pores.clear();
        for (pore, p) in spatial.passages(on, scheme, q) {
            let (f, i, o) = (pore.face as usize, pore.inside as usize, pore.outside as usize);
            let density = 0.5 * f64::from(self.density[i] + self.density[o]);
            self.pores.push((f, [i, o], density * p.share, p.slope));
            let mass = f64::from(through[f].mass);
            self.diagonal[i] += (-mass).max(0.0);
            self.diagonal[o] += mass.max(0.0);
        }
        self.held.clear();
        for side in &t.far_field {
            let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
            let leaving = crate::physics::leaving(&on.scheme_at(scheme, side), face, side.sign);
            // The characteristic pressure there grows by rho c / 2 for each m/s.
            let stiff =
                (1.0 - leaving) * 0.5 * f64::from(self.density[i] * self.sound2[i].sqrt()) * face.magnitude();
            let normal = face.area.map(|a| a / face.magnitude());
            self.held.push((side.cell, normal, stiff / (stiff + self.diagonal[i])));
        }
        self.held.sort_unstable_by_key(|h| h.0);
        for i in 0..n {
            self.inverse[i] = (1.0 / self.diagonal[i]) as f32;
            let row = t.adjacency.start[i] as usize..t.adjacency.start[i + 1] as usize;
            let neighbours: f64 = self.off[row].iter().map(|&k| f64::from(k)).sum();
            let free = self.diagonal[i] - FOLLOWING * neighbours;
            self.response[i] = (f64::from(self.density[i]) * m.volume[i] / free) as f32;
        }
        on.halo.exchange(&mut self.response, 1);
        self.assemble_pressure(on, scheme, rate);
    }

    fn merged(&self) -> Option<MergedCells> {
        self.pressure.merged()
    }

    fn recall(&mut self, merged: MergedCells, rows: &Adjacency, halo: &Halo) -> Result<(), String> {
        self.pressure.recall(merged, rows, halo)
    }

    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        scheme: &Scheme,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport {
        let (t, m) = (on.topology, on.metrics);
        let n = t.n_owned;
        self.transport(t, r);
        for &(i, normal, share) in &self.held {
            let x = &mut self.transported[i as usize];
            let along = share * (0..3).map(|d| f64::from(x[d]) * normal[d]).sum::<f64>();
            for d in 0..3 {
                x[d] -= (along * normal[d]) as f32;
            }
        }
        on.halo.exchange(self.transported.as_flattened_mut(), 4);
        for (d, r) in self.diagonal[..n].iter_mut().zip(r) {
            *d = -r[0];
        }
        let x = &self.transported;
        let through =
            |i: usize, s: &[f64; 3]| dot([f64::from(x[i][0]), f64::from(x[i][1]), f64::from(x[i][2])], *s);
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let s = &m.faces[f].area;
            let rho = 0.5 * f64::from(self.density[i] + self.density[j]);
            let flux = 0.5 * rho * (through(i, s) + through(j, s));
            self.diagonal[i] -= flux;
            self.diagonal[j] += flux;
        }
        for &(f, [i, o], density, _) in &self.pores {
            let s = &m.faces[f].area;
            let flux = 0.5 * density * (through(i, s) + through(o, s));
            self.diagonal[i] -= flux;
            self.diagonal[o] += flux;
        }
        for (list, far) in [(&t.outlet, false), (&t.far_field, true)] {
            for side in list {
                let face = &m.faces[side.face as usize];
                let i = side.cell as usize;
                let share = if far {
                    0.5 + 0.5 * crate::physics::leaving(&on.scheme_at(scheme, side), face, side.sign)
                } else {
                    1.0
                };
                self.diagonal[i] -= share * f64::from(self.density[i]) * side.sign * through(i, &face.area);
            }
        }
        for (s, d) in self.pressure.source().iter_mut().zip(&self.diagonal) {
            *s = *d as f32;
        }
        let report = self.pressure.solve(
            &t.adjacency,
            on.halo,
            &mut self.correction,
            self.tolerance,
            self.max_iterations,
        );
        let mut held = self.held.iter().peekable();
        for i in 0..n {
            let dp = share * f64::from(self.correction[i]);
            let mut g = on.gradients.scalar(t, i, &self.correction);
            while let Some(&&(cell, normal, share)) = held.peek()
                && cell as usize == i
            {
                let along = share * dot(g, normal);
                for d in 0..3 {
                    g[d] -= along * normal[d];
                }
                held.next();
            }
            let push = f64::from(self.response[i] / self.density[i]);
            let adiabatic = gas.compression(&q[i]);
            let x = &self.transported[i];
            let q = &mut q[i];
            for d in 0..3 {
                q[1 + d] += share * (f64::from(x[d]) - push * g[d]);
            }
            q[0] += dp;
            if N > 4 {
                q[N - 1] += share * f64::from(x[3]) + adiabatic[N - 1] * dp;
            }
        }
        report
    }
}
