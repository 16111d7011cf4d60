//! Pressure correction as an approximate inverse of the coupled system.
//!
//! The Jacobian of the primitive residual is nearly
//! $`\begin{pmatrix} C & D \\ G & A\end{pmatrix}`$ with compressibility $`C`$,
//! divergence $`D`$, gradient $`G`$ and a transport operator $`A`$ that is the same
//! for all velocity components. One application solves the transport part by a
//! symmetric Gauss-Seidel sweep, then the pressure Schur complement
//! $`C - D\,\mathrm{diag}(A)^{-1}G`$ on the compact stencil by conjugate
//! gradients, then corrects the velocity (Patankar's SIMPLE, as a
//! preconditioner). The pressure diffusion of the flux is chosen such that the
//! compact stencil is also what the residual sees.

use comm::Halo;

use super::pressure::{PressureSystem, SolveReport};
use super::{Correction, MergedCells};
use crate::geometry::vec3::Vec3;
use crate::gradient::{self, Field};
use crate::physics::{self, BoundaryFace, FaceFlux, FluxParameters, Gas, OpenBoundary, Viscosity};
use crate::residual::{Domain, Spatial, for_viscosity};
use crate::topology::{Adjacency, OPEN_REGION, OpenSides, Side, Topology};

/// Share of the neighbours' coefficients that the response of the velocity to
/// pressure leaves out: 0 is SIMPLE, where the neighbours stand still, 1 SIMPLEC,
/// where they move equally. Near 1 is right for smooth corrections, which at large
/// Courant numbers are what takes iterations; 0 for ragged ones. On the plate of
/// 250 880 cells (first six steps): 45, 36, 33, 34, 37 iterations at 0, 0.5, 0.8, 0.9, 1.
const FOLLOWING: f64 = 0.8;

/// Central part of the transport between two cells, in shares of their stored mass over the step: the sum over a cell's
/// faces stays below its diagonal at any Courant number, so that a Gauss-Seidel sweep converges.
const STORED_SHARE: f64 = 1.0 / 3.0;
/// The same in shares of the mass flux. The Taylor-Green vortex at Courant number 0.8 takes 3.3 iterations a step with 0, 2.8
/// with 0.5 and 1.
const MOST_CENTRAL: f64 = 0.5;

/// Viscous couplings over storage, both summed over all cells, above which a correction takes [`VISCOUS_SWEEPS`] of the transport operator.
const VISCOUS: f64 = 20.0;
/// Symmetric Gauss-Seidel sweeps of a step that viscosity dominates. A cavity of tetrahedra at $`\nu\Delta t/h^2 = 1000`$ takes 65 iterations
/// a step with 3, over 100 with 1.
const VISCOUS_SWEEPS: usize = 3;

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
    held: Vec<Held>,
    porous_faces: Vec<Passing>,
    pressure: PressureSystem,
    /// Symmetric Gauss-Seidel sweeps of a correction.
    sweeps: usize,
    /// Sums over closed regions: defect of mass, kg/s, and its derivative by pressure, kg/(s Pa).
    region_sums: Vec<f64>,
    transported: Vec<[f32; 4]>,
    correction: Vec<f32>,
    /// Relative tolerance of the pressure equation.
    pub tolerance: f64,
    /// Conjugate-gradient iterations at most.
    pub max_iterations: usize,
}

/// A cell whose velocity along a far face's normal is held by the acoustic condition there.
#[derive(Debug)]
struct Held {
    cell: u32,
    /// Unit normal.
    normal: Vec3,
    /// Share of the component along it to take away.
    share: f64,
}

/// Air that passes a face of the canopy.
#[derive(Debug)]
struct Passing {
    face: usize,
    /// Inside and outside.
    cells: [usize; 2],
    /// Density times the share of the mean volume flux that passes, kg/m3.
    density: f64,
    /// Derivative of the mass flux by the jump of pressure, kg/(s Pa).
    slope: f64,
}

/// Calls `visit` for each side that air passes, with its condition; those of the last condition come first, to keep
/// the order of sums.
fn for_each_open<G: Gas<N>, const N: usize>(
    on: &Domain<'_>,
    scheme: &FluxParameters,
    mut visit: impl FnMut(&Side, &BoundaryFace<'_>, &dyn OpenBoundary<G, N>),
) {
    for OpenSides { patch, sides } in on.topology.open.iter().rev() {
        let Some(condition) = physics::open_boundary::<G, N>(*patch) else { continue };
        for side in sides {
            visit(side, &on.boundary_face(&on.scheme_at(scheme, side), side), condition);
        }
    }
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
            held: Vec::new(),
            porous_faces: Vec::with_capacity(topology.porous_faces.len()),
            pressure: PressureSystem::new(&topology.adjacency, all),
            sweeps: 1,
            region_sums: vec![0.0; 2 * topology.n_closed_regions],
            transported: vec![[0.0; 4]; all],
            correction: vec![0.0; all],
            tolerance: 0.05,
            max_iterations: 60,
        }
    }

    fn assemble_pressure<G: Gas<N>, const N: usize>(
        &mut self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        rate: f64,
    ) {
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
        // The flux of a porous face depends on the other side too; this coupling is left to the outer iterations, as
        // the resistance of the other side is at most that of a neighbour.
        for &Passing { cells, slope, .. } in &self.porous_faces {
            cells.iter().for_each(|&c| self.diagonal[c] += slope);
        }
        let diagonal = &mut self.diagonal;
        let (response, sound2) = (&self.response, &self.sound2);
        for_each_open::<G, N>(on, scheme, |side, at, condition| {
            let i = side.cell as usize;
            let sound = f64::from(sound2[i]).sqrt();
            diagonal[i] += condition.mass_by_pressure(at, f64::from(response[i]), sound);
        });
        for (p, d) in self.pressure.matrix.own.iter_mut().zip(&self.diagonal) {
            *p = *d as f32;
        }
        self.pressure.prepare(on);
    }

    /// One more symmetric Gauss-Seidel sweep of the transport operator on `-r`.
    fn transport_again<const N: usize>(&mut self, t: &Topology, r: &[[f64; N]]) {
        let rows = &t.adjacency;
        for i in (0..t.n_owned).chain((0..t.n_owned).rev()) {
            let mut s: [f32; 4] = std::array::from_fn(|d| if d + 1 < N { -r[i][d + 1] as f32 } else { 0.0 });
            let row = rows.start[i] as usize..rows.start[i + 1] as usize;
            for (k, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                for d in 0..4 {
                    s[d] += k * self.transported[j as usize][d];
                }
            }
            self.transported[i] = s.map(|s| s * self.inverse[i]);
        }
    }

    /// Symmetric Gauss-Seidel sweep of the transport operator on `-r`, from zero.
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

impl PressureCorrection {
    /// Density, sound speed and the storage part of the transport operator.
    fn assemble_storage<G: Gas<N>, const N: usize>(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        q: &[[f64; N]],
        rate: f64,
    ) {
        for (i, q) in q.iter().enumerate() {
            let density = gas.density(q);
            self.density[i] = density as f32;
            self.diagonal[i] = rate * density * on.metrics.volume[i];
        }
        for (c, q) in self.sound2.iter_mut().zip(q) {
            *c = gas.sound_speed_squared(q) as f32;
        }
    }

    /// Transport between cells, out of open boundaries, and friction on walls.
    fn assemble_transport<G: Gas<N>, V: Viscosity, const N: usize>(
        &mut self,
        spatial: &Spatial<G, V>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        face_flux: &[FaceFlux],
        rate: f64,
    ) {
        let (t, m, density) = (on.topology, on.metrics, &self.density);
        let viscosity = |i: usize| {
            let u = gradient::of_velocity(&field.gradient[i]);
            let eddy = if spatial.viscosity.transported() { on.eddy[i] } else { 0.0 };
            spatial.viscosity.dynamic(f64::from(density[i]), &u, m.size[i]) + eddy
        };
        let storage: f64 = self.diagonal[..t.n_owned].iter().sum();
        let mut couplings = 0.0;
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let face = &m.faces[f];
            let mass = f64::from(face_flux[f].mass);
            let share = f64::from(face_flux[f].blending.upwind);
            let mut both = 0.25 * share * scheme.velocity_diffusion * mass.abs();
            if V::ACTIVE {
                let viscous = 0.5 * (viscosity(i) + viscosity(j)) * face.magnitude() / face.spacing();
                couplings += 2.0 * viscous;
                both += viscous;
            }
            let [si, sj] = t.adjacency.slot[f];
            let stored = 0.5 * rate * f64::from(density[i] + density[j]) * m.volume[i].min(m.volume[j]);
            let central = (STORED_SHARE * stored).min(MOST_CENTRAL * (1.0 - share) * mass.abs());
            let upwind = 0.5 * (mass.abs() - central);
            let (ki, kj) = (both + upwind - 0.5 * mass, both + upwind + 0.5 * mass);
            self.off[si as usize] = ki as f32;
            self.off[sj as usize] = kj as f32;
            self.diagonal[i] += ki;
            self.diagonal[j] += kj;
        }
        for side in t.open_sides() {
            self.diagonal[side.cell as usize] += f64::from(-face_flux[side.face as usize].mass).max(0.0);
        }
        if V::ACTIVE {
            let mut sums = [couplings, storage];
            on.halo.comm().sum_slice(&mut sums);
            self.sweeps = if sums[0] > VISCOUS * sums[1] { VISCOUS_SWEEPS } else { 1 };
            for side in &t.no_slip {
                let face = &m.faces[side.face as usize];
                let wall = spatial.near_wall(on, scheme, field.q, side);
                self.diagonal[side.cell as usize] +=
                    wall.stiffness().unwrap_or_else(|| viscosity(side.cell as usize)) * face.magnitude()
                        / wall.height;
            }
        }
    }

    /// Transport through the canopy, and what its pressure equation needs.
    fn assemble_pores<G: Gas<N>, const N: usize>(
        &mut self,
        spatial: &Spatial<G>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        q: &[[f64; N]],
        face_flux: &[FaceFlux],
    ) {
        self.porous_faces.clear();
        for (porous_face, p) in spatial.passages(on, scheme, q) {
            let (face, i, o) =
                (porous_face.face as usize, porous_face.inside as usize, porous_face.outside as usize);
            let density = 0.5 * f64::from(self.density[i] + self.density[o]) * p.share;
            self.porous_faces.push(Passing { face, cells: [i, o], density, slope: p.slope });
            let mass = f64::from(face_flux[face].mass);
            self.diagonal[i] += (-mass).max(0.0);
            self.diagonal[o] += mass.max(0.0);
        }
    }

    /// Finds what open boundaries hold, once the transport operator is complete.
    fn assemble_held<G: Gas<N>, const N: usize>(&mut self, on: &Domain<'_>, scheme: &FluxParameters) {
        self.held.clear();
        for_each_open::<G, N>(on, scheme, |side, at, condition| {
            let i = side.cell as usize;
            let stiff = condition.force_by_velocity(at, f64::from(self.density[i] * self.sound2[i].sqrt()));
            if let Some(stiff) = stiff {
                let normal = at.metric.area / at.metric.magnitude();
                let share = stiff / (stiff + self.diagonal[i]);
                self.held.push(Held { cell: side.cell, normal, share });
            }
        });
        self.held.sort_unstable_by_key(|h| h.cell);
    }

    /// Inverse diagonal of the transport operator, and how long pressure acts. Collective.
    fn assemble_response(&mut self, on: &Domain<'_>) {
        let t = on.topology;
        for i in 0..t.n_owned {
            self.inverse[i] = (1.0 / self.diagonal[i]) as f32;
            let row = t.adjacency.start[i] as usize..t.adjacency.start[i + 1] as usize;
            let neighbours: f64 = self.off[row].iter().map(|&k| f64::from(k)).sum();
            let free = self.diagonal[i] - FOLLOWING * neighbours;
            self.response[i] = (f64::from(self.density[i]) * on.metrics.volume[i] / free) as f32;
        }
        on.halo.exchange(&mut self.response, 1);
    }

    /// Velocity (and temperature) by the transport operator alone, on all local cells. Collective.
    fn predict<const N: usize>(&mut self, on: &Domain<'_>, r: &[[f64; N]]) {
        let _part = timing::part("momentum");
        self.transport(on.topology, r);
        for _ in 1..self.sweeps {
            on.halo.exchange(self.transported.as_flattened_mut(), 4);
            self.transport_again(on.topology, r);
        }
        for held in &self.held {
            let x = &mut self.transported[held.cell as usize];
            let along = held.share * predicted(x).dot(&held.normal);
            for d in 0..3 {
                x[d] -= (along * held.normal[d]) as f32;
            }
        }
        on.halo.exchange(self.transported.as_flattened_mut(), 4);
    }

    /// Right-hand side of the pressure equation: the defect of mass and what the predicted velocity passes.
    fn assemble_source<G: Gas<N>, const N: usize>(
        &mut self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        r: &[[f64; N]],
    ) {
        let _part = timing::part("pressure source");
        let (t, m) = (on.topology, on.metrics);
        for (d, r) in self.diagonal[..t.n_owned].iter_mut().zip(r) {
            *d = -r[0];
        }
        let x = &self.transported;
        let face_flux = |i: usize, s: &Vec3| predicted(&x[i]).dot(s);
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let s = &m.faces[f].area;
            let rho = 0.5 * f64::from(self.density[i] + self.density[j]);
            let flux = 0.5 * rho * (face_flux(i, s) + face_flux(j, s));
            self.diagonal[i] -= flux;
            self.diagonal[j] += flux;
        }
        for &Passing { face, cells: [i, o], density, .. } in &self.porous_faces {
            let s = &m.faces[face].area;
            let flux = 0.5 * density * (face_flux(i, s) + face_flux(o, s));
            self.diagonal[i] -= flux;
            self.diagonal[o] += flux;
        }
        let (diagonal, density) = (&mut self.diagonal, &self.density);
        for_each_open::<G, N>(on, scheme, |side, at, condition| {
            let i = side.cell as usize;
            let share = condition.mass_by_velocity(at);
            diagonal[i] -= share * f64::from(density[i]) * side.sign * face_flux(i, &at.metric.area);
        });
        for (s, d) in self.pressure.source().iter_mut().zip(&self.diagonal) {
            *s = *d as f32;
        }
    }

    /// In each region that no air enters or leaves: shifts the correction of pressure such that its mass is right. The pressure equation
    /// determines the mean there by compressibility alone, to a tolerance that is a large error where steps are long. Collective.
    fn conserve_mass<const N: usize>(&mut self, on: &Domain<'_>, rate: f64, r: &[[f64; N]]) {
        let t = on.topology;
        let (defect, storage) = (0, t.n_closed_regions);
        self.region_sums.fill(0.0);
        for i in (0..t.n_owned).filter(|&i| t.region[i] != OPEN_REGION) {
            let (k, stored) = (t.region[i] as usize, rate * on.metrics.volume[i] / f64::from(self.sound2[i]));
            self.region_sums[defect + k] -= r[i][0] + stored * f64::from(self.correction[i]);
            self.region_sums[storage + k] += stored;
        }
        on.halo.comm().sum_slice(&mut self.region_sums);
        for (p, &k) in self.correction.iter_mut().zip(&t.region).filter(|(_, k)| **k != OPEN_REGION) {
            *p += (self.region_sums[defect + k as usize] / self.region_sums[storage + k as usize]) as f32;
        }
    }

    /// Adds this share of the corrections of pressure and velocity to `q`.
    fn correct<G: Gas<N>, const N: usize>(&self, gas: &G, on: &Domain<'_>, share: f64, q: &mut [[f64; N]]) {
        let mut held = self.held.iter().peekable();
        for i in 0..on.topology.n_owned {
            let dp = share * f64::from(self.correction[i]);
            let mut g = on.gradients.scalar(on.topology, i, &self.correction);
            while let Some(h) = held.next_if(|h| h.cell as usize == i) {
                g -= h.normal * (h.share * g.dot(&h.normal));
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
    }
}

/// Velocity of a transported correction, m/s.
#[inline(always)]
fn predicted(x: &[f32; 4]) -> Vec3 {
    Vec3::new(f64::from(x[0]), f64::from(x[1]), f64::from(x[2]))
}

impl<G: Gas<N>, const N: usize> Correction<G, N> for PressureCorrection {
    fn assemble(
        &mut self,
        spatial: &Spatial<G>,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        face_flux: &[FaceFlux],
        extra: f64,
    ) {
        let _part = timing::part("assembly");
        let rate = scheme.rate * extra;
        self.assemble_storage(&spatial.gas, on, field.q, rate);
        for_viscosity!(spatial, s => self.assemble_transport(&s, on, scheme, field, face_flux, rate));
        self.assemble_pores(spatial, on, scheme, field.q, face_flux);
        self.assemble_held::<G, N>(on, scheme);
        self.assemble_response(on);
        self.assemble_pressure::<G, N>(on, scheme, rate);
    }

    fn merged(&self) -> Option<MergedCells> {
        self.pressure.merged()
    }

    fn restore_state(&mut self, merged: MergedCells, rows: &Adjacency, halo: &Halo) -> Result<(), String> {
        self.pressure.restore_state(merged, rows, halo)
    }

    fn apply(
        &mut self,
        gas: &G,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        r: &[[f64; N]],
        share: f64,
        q: &mut [[f64; N]],
    ) -> SolveReport {
        let _part = timing::part("linear solve");
        self.predict(on, r);
        self.assemble_source::<G, N>(on, scheme, r);
        let rows = &on.topology.adjacency;
        let report =
            self.pressure.solve(rows, on.halo, &mut self.correction, self.tolerance, self.max_iterations);
        if on.topology.n_closed_regions > 0 {
            self.conserve_mass(on, scheme.rate, r);
        }
        self.correct(gas, on, share, q);
        report
    }
}
