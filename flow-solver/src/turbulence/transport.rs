//! The transport equation of the working variable on the grid of the flow.

use comm::Comm;
use serde::{Deserialize, Serialize};

use super::spalart_allmaras::{CB2, Length, LengthScaleInput, SIGMA, diffusivity, eddy_viscosity, source};
use super::wall_distance::Walls;
use crate::geometry::FaceMetric;
use crate::geometry::vec3::Vec3;
use crate::gradient::{self, Gradient};
use crate::implicit::NonlinearGmres;
use crate::physics::FaceFlux;
use crate::residual::Domain;
use crate::topology::Topology;

/// Free-stream value over the molecular viscosity: fully turbulent (3 to 5 are recommended).
pub const FREE_STREAM: f64 = 3.0;

/// Distance beyond which a wall is ignored, m.
const FAR: f64 = 1e6;

/// Wall distances are kept until some node has moved by this share of the distance that a cell
/// has from its wall.
const KEPT: f64 = 0.02;

/// Input from the flow for one step of the turbulence equation.
pub struct TransportInput<'a, const N: usize> {
    /// Density of all local cells, kg/m3.
    pub density: &'a [f64],
    /// Velocity gradients of local cells (variables 1 to 3).
    pub gradient: &'a [Gradient<N>],
    /// Mass flux of each face.
    pub face_flux: &'a [FaceFlux],
    /// Mass of owned cells at the last two time levels times the backward difference's coefficient
    /// over the step, kg/s: negative, and then positive or zero.
    pub before: &'a [[f64; 2]],
    /// Velocity gradient by the law of the wall in the cell of each no-slip side, 1/s. Empty: walls are resolved.
    pub wall_gradient: &'a [f64],
    /// Node positions, m.
    pub nodes: &'a [Vec3],
    /// The residual must fall by this factor.
    pub drop: f64,
}

/// Wall distances and cell sizes of the turbulence model, with the node positions that they are for.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WallDistances {
    /// Distance of owned cells to the nearest wall, m.
    pub wall: Vec<f64>,
    /// Largest extent of owned cells, m.
    pub delta: Vec<f64>,
    /// Node positions at which both were computed, m.
    pub at: Vec<[f64; 3]>,
}

impl WallDistances {
    /// Whether it is of `cells` owned cells and `nodes`, and of numbers only. Before the first step of transported
    /// turbulence the distances are not known.
    pub(crate) fn check(&self, cells: usize, nodes: usize) -> Result<(), &'static str> {
        let known = self.wall.len() == cells && self.at.len() == nodes;
        let unknown = self.wall.is_empty() && self.at.is_empty();
        if self.delta.len() != cells || !(known || unknown) {
            return Err("its wall distances are of another part of the grid");
        }
        let numbers = self.wall.iter().chain(&self.delta).chain(self.at.as_flattened());
        if numbers.copied().all(f64::is_finite) {
            Ok(())
        } else {
            Err("its wall distances are not finite numbers")
        }
    }
}

/// Statistics of one step of the turbulence equation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TransportReport {
    /// Iterations.
    pub iterations: usize,
    /// Residual at the start, kg m2/s2.
    pub start: f64,
    /// Residual at the end.
    pub end: f64,
    /// Residual at which it counts as converged.
    pub target: f64,
}

/// The working variable of Spalart-Allmaras on one rank.
pub struct SpalartAllmaras {
    viscosity: f64,
    length: Length,
    /// Working variable of local cells at the end of the step, m2/s.
    pub value: Vec<[f64; 1]>,
    /// Working variable at the last two accepted time levels, newest first.
    pub previous: [Vec<[f64; 1]>; 2],
    gradient: Vec<Gradient<1>>,
    /// Distance of owned cells to the nearest wall, m.
    pub wall: Vec<f64>,
    /// Largest extent of owned cells, m.
    delta: Vec<f64>,
    /// Wall triangles that were nearest to owned cells last: where the search begins.
    nearest_wall: Vec<u32>,
    /// Node positions at which `wall` was computed.
    walls_at: Vec<Vec3>,
    /// Extra length scale and vorticity of the step.
    scale: Vec<f64>,
    vorticity: Vec<f64>,
    off: Vec<f64>,
    diagonal: Vec<f64>,
    residual: Vec<[f64; 1]>,
    change: Vec<f64>,
    nonlinear_gmres: NonlinearGmres,
}

/// Corrections that are combined.
const DEPTH: usize = 8;
/// Iterations at most for a step.
const MOST: usize = 60;

impl SpalartAllmaras {
    /// Free-stream values everywhere, for a fluid of dynamic `viscosity` (Pa s) and `density`
    /// (kg/m3) far away.
    pub fn new(topology: &Topology, viscosity: f64, density: f64, length: Length) -> Self {
        let (n, all) = (topology.n_owned, topology.n_local());
        let value = vec![[FREE_STREAM * viscosity / density]; all];
        Self {
            viscosity,
            length,
            previous: [value.clone(), value.clone()],
            value,
            gradient: vec![[[0.0]; 3]; all],
            wall: Vec::new(),
            delta: vec![0.0; n],
            nearest_wall: vec![0; n],
            walls_at: Vec::new(),
            scale: vec![0.0; n],
            vorticity: vec![0.0; n],
            off: vec![0.0; topology.adjacency.cell.len() + 1],
            diagonal: vec![0.0; n],
            residual: vec![[0.0]; n],
            change: vec![0.0; all],
            nonlinear_gmres: NonlinearGmres::new(DEPTH, n),
        }
    }

    /// Returns the present wall distances.
    pub fn walls(&self) -> WallDistances {
        WallDistances {
            wall: self.wall.clone(),
            delta: self.delta.clone(),
            at: self.walls_at.iter().map(|x| (*x).into()).collect(),
        }
    }

    /// Restores [`SpalartAllmaras::walls`] of the same cells.
    pub fn restore_state(&mut self, walls: WallDistances) {
        (self.wall, self.delta) = (walls.wall, walls.delta);
        self.walls_at = walls.at.into_iter().map(Vec3::from).collect();
    }

    /// Dynamic eddy viscosity of all local cells, and working variable times density, Pa s.
    pub fn eddy(&self, density: &[f64], eddy: &mut [f64], working: &mut [f64]) {
        for (((e, w), x), rho) in eddy.iter_mut().zip(working).zip(&self.value).zip(density) {
            *e = rho * eddy_viscosity(x[0], self.viscosity / rho);
            *w = rho * x[0];
        }
    }

    /// Recomputes all wall distances once some node has moved by more than [`KEPT`] times the larger of the smallest
    /// wall distance and the smallest cell size. Collective.
    fn update_walls(&mut self, on: &Domain<'_>, nodes: &[Vec3]) {
        let comm = on.halo.comm();
        let moved = self
            .walls_at
            .iter()
            .zip(nodes)
            .map(|(a, b)| (a - b).norm())
            .fold(if self.wall.is_empty() { f64::INFINITY } else { 0.0 }, f64::max);
        let nearest = self.wall.iter().fold(FAR, |m, d| m.min(*d));
        // A canopy that heaves carries its nearest cells along: what counts is the size of cells.
        let smallest = on.metrics.size[..on.topology.n_owned].iter().fold(FAR, |m, h| m.min(*h));
        if comm.all(moved <= KEPT * nearest.max(smallest)) {
            return;
        }
        let walls = Walls::gather(comm, on.topology, nodes);
        self.wall.resize(on.topology.n_owned, FAR);
        for ((d, place), x) in self.wall.iter_mut().zip(&mut self.nearest_wall).zip(&on.metrics.centre) {
            (*d, *place) = walls.nearest(Vec3::from(*x), *place);
            *d = d.min(FAR);
        }
        self.walls_at = nodes.to_vec();
        self.delta.fill(0.0);
        let delta = &mut self.delta;
        on.topology.for_each_side(|f, c, _| {
            if let Some(d) = delta.get_mut(c) {
                *d = d.max(2.0 * (on.metrics.face_centre(on.topology, f) - on.metrics.centre(c)).norm());
            }
        });
    }

    /// Sets the vorticity of cells at a wall to the law of the wall's, where walls are not resolved: differences over such
    /// a cell are not the gradient at its centre, which production needs. Negative in all other cells.
    fn fill_wall_gradient(&mut self, on: &Domain<'_>, gradient: &[f64]) {
        self.vorticity.fill(-1.0);
        for (side, &gradient) in on.topology.no_slip.iter().zip(gradient) {
            let w = &mut self.vorticity[side.cell as usize];
            *w = w.max(gradient);
        }
    }

    /// The working variable at the end of the step. Collective.
    pub fn advance<const N: usize>(
        &mut self,
        on: &Domain<'_>,
        flow: &TransportInput<'_, N>,
    ) -> TransportReport {
        let comm = on.halo.comm();
        let n = on.topology.n_owned;
        self.update_walls(on, flow.nodes);
        self.fill_wall_gradient(on, flow.wall_gradient);
        for i in 0..n {
            let g = &flow.gradient[i];
            let resolved = gradient::vorticity(g).norm();
            let gradient = g.iter().map(|g| g[1] * g[1] + g[2] * g[2] + g[3] * g[3]).sum::<f64>().sqrt();
            // Cells at a wall hold what `fill_wall_gradient` has left there.
            let [vorticity, gradient] = match self.vorticity[i] {
                by_law if by_law >= 0.0 => [by_law; 2],
                _ => [resolved, gradient],
            };
            self.vorticity[i] = vorticity;
            let nu = self.viscosity / flow.density[i];
            let working = self.previous[0][i][0];
            let around = LengthScaleInput {
                wall: self.wall[i],
                delta: self.delta[i],
                viscosity: nu + eddy_viscosity(working, nu),
                gradient,
                chi: working / nu,
            };
            self.scale[i] = (self.length)(&around);
        }
        self.value.copy_from_slice(&self.previous[0]);
        self.nonlinear_gmres.clear();
        let mut taken = TransportReport::default();
        let mut best = f64::INFINITY;
        loop {
            let (now, noise) = self.evaluate(on, flow, comm);
            if taken.iterations == 0 {
                taken.start = now;
            }
            taken.end = now;
            best = now.min(best);
            taken.target = (flow.drop * taken.start).max(noise);
            let done = now <= taken.target;
            if done || taken.iterations == MOST || !now.is_finite() {
                return taken;
            }
            if now > 10.0 * best {
                self.nonlinear_gmres.clear();
            }
            self.nonlinear_gmres.combine(
                comm,
                self.value[..n].as_flattened_mut(),
                self.residual.as_flattened_mut(),
            );
            self.sweep(on);
            for (x, d) in self.value.iter_mut().zip(&self.change[..n]) {
                x[0] += d;
            }
            taken.iterations += 1;
        }
    }

    /// Residual (kg m2/s2) and matrix at the present value; the norms of the residual and of what
    /// round-off may leave of it. Collective.
    fn evaluate<const N: usize>(
        &mut self,
        on: &Domain<'_>,
        flow: &TransportInput<'_, N>,
        comm: &Comm,
    ) -> (f64, f64) {
        on.halo.exchange(self.value.as_flattened_mut(), 1);
        on.gradients.apply(on.topology, &self.value, &mut self.gradient);
        on.gradients.shorten(&mut self.gradient);
        on.halo.exchange(self.gradient.as_flattened_mut().as_flattened_mut(), 3);
        self.off.fill(0.0);
        self.storage_and_source(on, flow);
        self.transport(on, flow);
        self.boundaries(on, flow);
        self.porous_fluxes(on, flow);
        let (mut sum, mut noise) = (0.0, 0.0);
        for ((&[r], d), x) in self.residual.iter().zip(&self.diagonal).zip(&self.value) {
            sum += r * r;
            noise += (d * x[0]).powi(2);
        }
        let mut sums = [sum, noise];
        comm.sum_slice(&mut sums);
        (sums[0].sqrt(), 4.0 * f64::EPSILON * sums[1].sqrt())
    }

    /// Time derivative, production and destruction.
    fn storage_and_source<const N: usize>(&mut self, on: &Domain<'_>, flow: &TransportInput<'_, N>) {
        for i in 0..on.topology.n_owned {
            let x = self.value[i][0];
            let [now, older] = flow.before[i];
            // In the form that keeps a uniform value whatever is left of the mass defect.
            let r = -now * (x - self.previous[0][i][0]) - older * (x - self.previous[1][i][0]);
            let mass = flow.density[i] * on.metrics.volume[i];
            let nu = self.viscosity / flow.density[i];
            let squares = slope(&self.gradient[i]).norm_squared();
            let (w, d) = (self.vorticity[i], self.scale[i]);
            let s = source(x, nu, w, d);
            let h = 1e-6 * x.abs().max(nu);
            let slope = (source(x + h, nu, w, d) - s) / h;
            self.residual[i] = [r - mass * (s + CB2 / SIGMA * squares)];
            // Positive source terms are treated explicitly.
            self.diagonal[i] = -now - older + mass * (-slope).max(0.0);
        }
    }

    /// Convection and diffusion between cells.
    fn transport<const N: usize>(&mut self, on: &Domain<'_>, flow: &TransportInput<'_, N>) {
        let (t, m) = (on.topology, on.metrics);
        let n = t.n_owned;
        for (f, &[i, j]) in t.cells.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let face = &m.faces[f];
            let (a, b) = (self.value[i][0], self.value[j][0]);
            let flux = f64::from(flow.face_flux[f].mass);
            let way = m.centre(j) - m.centre(i);
            let slopes = [slope(&self.gradient[i]), slope(&self.gradient[j])];
            let carried = carried_upwind(flux, [a, b], slopes, &way);
            let rho = 0.5 * (flow.density[i] + flow.density[j]);
            let nu = self.viscosity / rho;
            let diffuse = 0.5 * (diffusivity(a, nu) + diffusivity(b, nu)) * rho / SIGMA;
            let along = slope_through(face, [a, b], slopes, &way);
            let k = diffuse * face.magnitude() / face.spacing();
            let (ki, kj) = (k + (-flux).max(0.0), k + flux.max(0.0));
            let [si, sj] = t.adjacency.slot[f];
            self.off[si as usize] = ki;
            self.off[sj as usize] = kj;
            if i < n {
                self.residual[i][0] += flux * (carried - a) - diffuse * along;
                self.diagonal[i] += ki;
            }
            if j < n {
                self.residual[j][0] -= flux * (carried - b) - diffuse * along;
                self.diagonal[j] += kj;
            }
        }
    }

    /// Walls and open boundaries.
    fn boundaries<const N: usize>(&mut self, on: &Domain<'_>, flow: &TransportInput<'_, N>) {
        let (t, m) = (on.topology, on.metrics);
        for side in &t.no_slip {
            let (face, i) = (&m.faces[side.face as usize], side.cell as usize);
            let k = self.viscosity / SIGMA * face.magnitude() / m.height(side);
            self.residual[i][0] += k * self.value[i][0];
            self.diagonal[i] += k;
        }
        for side in t.open_sides() {
            let i = side.cell as usize;
            let inflow = f64::from(-flow.face_flux[side.face as usize].mass).max(0.0);
            let far = FREE_STREAM * self.viscosity / flow.density[i];
            self.residual[i][0] += inflow * (self.value[i][0] - far);
            self.diagonal[i] += inflow;
        }
    }

    /// Adds the convective fluxes through porous canopy faces.
    fn porous_fluxes<const N: usize>(&mut self, on: &Domain<'_>, flow: &TransportInput<'_, N>) {
        let n = on.topology.n_owned;
        for porous_face in &on.topology.porous_faces {
            let (i, o) = (porous_face.inside as usize, porous_face.outside as usize);
            let flux = f64::from(flow.face_flux[porous_face.face as usize].mass);
            let step = self.value[i][0] - self.value[o][0];
            if flux > 0.0 && o < n {
                self.residual[o][0] -= flux * step;
                self.diagonal[o] += flux;
            } else if flux < 0.0 && i < n {
                self.residual[i][0] -= flux * step;
                self.diagonal[i] -= flux;
            }
        }
    }

    /// Symmetric Gauss-Seidel on `-residual`, twice, ghosts fetched in between. Collective.
    fn sweep(&mut self, on: &Domain<'_>) {
        let rows = &on.topology.adjacency;
        let n = on.topology.n_owned;
        self.change.fill(0.0);
        for pass in 0..2 {
            if pass > 0 {
                on.halo.exchange(&mut self.change, 1);
            }
            for k in 0..2 * n {
                let i = if k < n { k } else { 2 * n - 1 - k };
                let row = rows.start[i] as usize..rows.start[i + 1] as usize;
                let mut s = -self.residual[i][0];
                for (c, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                    s += c * self.change[j as usize];
                }
                self.change[i] = s / self.diagonal[i];
            }
        }
    }

    /// The step becomes the state that later steps start from.
    pub fn accept(&mut self) {
        self.previous.swap(0, 1);
        self.previous[0].copy_from_slice(&self.value);
    }
}

/// Gradient of the working variable.
#[inline(always)]
fn slope(g: &Gradient<1>) -> Vec3 {
    Vec3::new(g[0][0], g[1][0], g[2][0])
}

/// Value that the mass flux from the first of two cells to the second carries, with van Albada's mean of the upwind
/// cell's own slope and the one to come; `way` leads from centre to centre.
#[inline(always)]
fn carried_upwind(flux: f64, [a, b]: [f64; 2], [gi, gj]: [Vec3; 2], way: &Vec3) -> f64 {
    let (up, step, ahead) = if flux > 0.0 { (a, b - a, gi.dot(way)) } else { (b, a - b, -gj.dot(way)) };
    let own = 2.0 * ahead - step;
    let more = if own * step > 0.0 { own * step * (own + step) / (own * own + step * step) } else { 0.0 };
    up + 0.5 * more
}

/// Slope through a face times its area: the mean of the cells', its part along `way` replaced by the difference.
#[inline(always)]
fn slope_through(face: &FaceMetric, [a, b]: [f64; 2], [gi, gj]: [Vec3; 2], way: &Vec3) -> f64 {
    let mean = (gi + gj) * 0.5;
    let missing = (b - a - mean.dot(way)) / way.norm_squared();
    mean.dot(&face.area) + missing * way.dot(&face.area)
}
