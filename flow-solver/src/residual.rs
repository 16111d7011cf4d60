//! The spatial residual: what leaves each cell, to second order.

use comm::Halo;

use crate::geometry::vec3::{Vec3, add, dot, scale, sub};
use crate::geometry::{FaceMetric, Metrics};
use crate::gradient::{Gradient, LeastSquares};
use crate::limiter;
use crate::physics::{self, FaceFlow, Gas, Interface, Scheme, Viscosity};
use crate::topology::{Side, Topology};

/// Models and constants of the spatial scheme.
#[derive(Clone, Copy, Debug)]
pub struct Spatial<G, V> {
    /// Equations of state.
    pub gas: G,
    /// Stress.
    pub viscosity: V,
    /// Share of the plain difference of two neighbours in a reconstructed value:
    /// 1/3 makes the scheme of third order on even grids, 0 is purely upwind.
    pub chi: f64,
    /// Venkatakrishnan's K where gradients are limited.
    pub limiter: Option<f64>,
}

/// Flux out of an open boundary.
type Condition<G, const N: usize> =
    fn(&G, &Scheme, &[f64; N], &[f64; N], &FaceMetric, f64, [f32; 2]) -> Interface<N>;

/// What the residual works on: the grid of one rank at one instant.
pub struct Domain<'a> {
    /// Cells and faces.
    pub topology: &'a Topology,
    /// Areas, volumes, grid fluxes.
    pub metrics: &'a Metrics,
    /// Weights of the gradients.
    pub gradients: &'a LeastSquares,
    /// Exchange of ghosts.
    pub halo: &'a Halo,
    /// Velocity of the middle of each face that is not between two cells, in the
    /// falling frame, m/s (walls need it).
    pub wall_velocity: &'a [Vec3],
    /// What the undisturbed wind has more than [`Scheme::wind`] on each face that is not
    /// between two cells, m/s. Empty: nothing.
    pub sheared: &'a [Vec3],
    /// Transported dynamic eddy viscosity of local cells, Pa s. Read where
    /// [`Viscosity::TRANSPORTED`].
    pub eddy: &'a [f64],
}

impl Domain<'_> {
    /// Constants of the flux with the undisturbed wind at the face of `side`.
    pub fn scheme_at(&self, scheme: &Scheme, side: &Side) -> Scheme {
        let excess = self.sheared.get(side.face as usize - self.topology.cells.len());
        Scheme { wind: add(scheme.wind, *excess.unwrap_or(&[0.0; 3])), ..*scheme }
    }
}

impl<G, V: Viscosity> Spatial<G, V> {
    /// Net outflow of each owned cell for the state `q`.
    ///
    /// Fills the ghosts of `q`, `gradient` on all local cells, and what
    /// passes each face. Entries of `residual` for
    /// ghosts are left meaningless. Collective.
    pub fn evaluate<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &mut [[f64; N]],
        gradient: &mut [Gradient<N>],
        residual: &mut [[f64; N]],
        through: &mut [FaceFlow],
    ) where
        G: Gas<N>,
    {
        // What needs no ghosts is done while they travel.
        on.halo.overlap(q.as_flattened_mut(), N, |q| {
            on.gradients.inside(on.topology, q.as_chunks().0, gradient);
        });
        on.gradients.border(on.topology, q, gradient);
        on.gradients.shorten(gradient);
        if let Some(k) = self.limiter {
            let speed = scheme.floor_squared.sqrt() * 10.0;
            let mut typical = [speed; N];
            typical[0] = self.gas.density(&self.gas.undisturbed(scheme.wind)) * speed * speed;
            limiter::venkatakrishnan(on.topology, on.metrics, q, gradient, k, typical);
        }
        residual.fill([0.0; N]);
        let n = on.topology.n_inside;
        on.halo.overlap(gradient.as_flattened_mut().as_flattened_mut(), 3 * N, |gradient| {
            let gradient = gradient.as_chunks::<N>().0.as_chunks().0;
            self.interior(on, scheme, q, gradient, residual, through, 0..n);
        });
        self.interior(on, scheme, q, gradient, residual, through, n..on.topology.cells.len());
        self.boundary(on, scheme, q, gradient, residual, through);
        self.pores(on, scheme, q, gradient, residual, through);
    }

    #[allow(clippy::too_many_arguments)]
    fn interior<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        residual: &mut [[f64; N]],
        through: &mut [FaceFlow],
        range: std::ops::Range<usize>,
    ) where
        G: Gas<N>,
    {
        let centre = &on.metrics.centre;
        let faces = on.metrics.faces[range.clone()]
            .iter()
            .zip(&mut through[range.clone()])
            .zip(&on.topology.cells[range]);
        for ((face, through), &[i, j]) in faces {
            let (i, j) = (i as usize, j as usize);
            let (di, between) = (face.offset(), sub(centre[j], centre[i]));
            let dj = sub(di, between);
            let (qi, qj, gi, gj) = (&q[i], &q[j], &gradient[i], &gradient[j]);
            let (mut l, mut r) = (*qi, *qj);
            // The plain difference counts by where the face lies between the centres:
            // a thin cell beside a thick one takes little of it.
            let near = (dot(di, face.area) / (face.magnitude() * face.spacing())).clamp(0.0, 1.0);
            let (chi_i, chi_j) = (self.chi * near, self.chi * (1.0 - near));
            for v in 0..N {
                let along_i = gi[0][v] * between[0] + gi[1][v] * between[1] + gi[2][v] * between[2];
                let along_j = gj[0][v] * between[0] + gj[1][v] * between[1] + gj[2][v] * between[2];
                let step = qj[v] - qi[v];
                l[v] += gi[0][v] * di[0] + gi[1][v] * di[1] + gi[2][v] * di[2];
                l[v] += chi_i * (step - along_i);
                r[v] += gj[0][v] * dj[0] + gj[1][v] * dj[1] + gj[2][v] * dj[2];
                r[v] -= chi_j * (step - along_j);
            }
            let Interface { mut flux, mass, tie } =
                physics::interface(&self.gas, scheme, &l, &r, face, through.past);
            (through.mass, through.tie) = (mass as f32, tie as f32);
            if V::ACTIVE {
                // Mean gradient, its part along the line of centres replaced by the difference.
                let length2 = dot(between, between);
                let mut g = [[0.0; N]; 3];
                for v in 0..N {
                    for d in 0..3 {
                        g[d][v] = 0.5 * (gi[d][v] + gj[d][v]);
                    }
                    let along = g[0][v] * between[0] + g[1][v] * between[1] + g[2][v] * between[2];
                    let missing = (qj[v] - qi[v] - along) / length2;
                    for d in 0..3 {
                        g[d][v] += missing * between[d];
                    }
                }
                let u: [Vec3; 3] = std::array::from_fn(|d| [g[d][1], g[d][2], g[d][3]]);
                let h = 0.5 * (on.metrics.size[i] + on.metrics.size[j]);
                let mut mu = self.viscosity.dynamic(self.gas.density(&l), &u, h);
                if V::TRANSPORTED {
                    mu += 0.5 * (on.eddy[i] + on.eddy[j]);
                }
                let force = physics::stress_force(mu, &u, face.area);
                let velocity = [0.5 * (l[1] + r[1]), 0.5 * (l[2] + r[2]), 0.5 * (l[3] + r[3])];
                let normal =
                    |v: usize| g[0][v] * face.area[0] + g[1][v] * face.area[1] + g[2][v] * face.area[2];
                let heat = self.gas.conduction(mu, normal, dot(force, velocity));
                for (f, h) in flux.iter_mut().zip(heat) {
                    *f -= h;
                }
                for d in 0..3 {
                    flux[1 + d] -= force[d];
                }
            }
            for v in 0..N {
                residual[i][v] += flux[v];
                residual[j][v] -= flux[v];
            }
        }
    }

    fn boundary<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        residual: &mut [[f64; N]],
        through: &mut [FaceFlow],
    ) where
        G: Gas<N>,
    {
        let t = on.topology;
        let mut gain = |side: &Side, flux: &[f64; N]| {
            for (r, f) in residual[side.cell as usize].iter_mut().zip(flux) {
                *r += f;
            }
        };
        let face_of = |side: &Side| &on.metrics.faces[side.face as usize];
        for side in t.slip.iter().chain(&t.no_slip) {
            let face = face_of(side);
            let p = self.wall_pressure(on, q, gradient, side);
            let f = physics::wall(&self.gas, p, scale(side.sign, face.area), side.sign * face.grid_flux);
            gain(side, &f.flux);
        }
        if V::ACTIVE {
            for side in &t.slip {
                // No friction, but the normal stress of air that spreads along the wall.
                let face = face_of(side);
                let cell = side.cell as usize;
                let g = &gradient[cell];
                let u: [Vec3; 3] = std::array::from_fn(|d| [g[d][1], g[d][2], g[d][3]]);
                let mut mu = self.viscosity.dynamic(self.gas.density(&q[cell]), &u, on.metrics.size[cell]);
                if V::TRANSPORTED {
                    mu += on.eddy[cell];
                }
                let force = physics::stress_force(mu, &u, face.area);
                let normal = side.sign * dot(force, face.area) / dot(face.area, face.area);
                let mut flux = self.gas.pressure_flux(0.0, [0.0; 3], 0.0);
                for d in 0..3 {
                    flux[1 + d] -= normal * face.area[d];
                }
                gain(side, &flux);
            }
            for side in &t.no_slip {
                let face = face_of(side);
                let force = scale(face.magnitude(), self.wall_traction(on, scheme, q, side));
                let wall = self.wall_velocity(on, scheme, side);
                let heat = self.gas.conduction(0.0, |_| 0.0, -dot(force, wall));
                let mut flux = heat.map(|h| -h);
                for d in 0..3 {
                    flux[1 + d] += force[d];
                }
                gain(side, &flux);
            }
        }
        for (list, condition) in [
            (&t.far_field, physics::far_field::<G, N> as Condition<G, N>),
            (&t.outlet, physics::outlet::<G, N>),
        ] {
            for side in list {
                let face = face_of(side);
                let cell = side.cell as usize;
                let d = sub(on.metrics.border(side.face), on.metrics.centre[cell]);
                let g = &gradient[cell];
                let inside =
                    std::array::from_fn(|v| q[cell][v] + g[0][v] * d[0] + g[1][v] * d[1] + g[2][v] * d[2]);
                let kept = &mut through[side.face as usize];
                let f = condition(
                    &self.gas,
                    &on.scheme_at(scheme, side),
                    &inside,
                    &q[cell],
                    face,
                    side.sign,
                    kept.past,
                );
                (kept.mass, kept.tie) = (f.mass as f32, f.tie as f32);
                gain(side, &f.flux);
            }
        }
    }

    /// Gauge pressure at a wall, Pa: linear from the cell.
    pub fn wall_pressure<const N: usize>(
        &self,
        on: &Domain<'_>,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        side: &Side,
    ) -> f64 {
        let cell = side.cell as usize;
        let d = sub(on.metrics.border(side.face), on.metrics.centre[cell]);
        let g = &gradient[cell];
        q[cell][0] + g[0][0] * d[0] + g[1][0] * d[1] + g[2][0] * d[2]
    }

    /// Shear stress of the air on a no-slip wall, Pa: on the wall, so the cell
    /// feels the opposite.
    pub fn wall_traction<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &Scheme,
        q: &[[f64; N]],
        side: &Side,
    ) -> Vec3
    where
        G: Gas<N>,
    {
        let face = &on.metrics.faces[side.face as usize];
        let cell = &q[side.cell as usize];
        let slip = sub([cell[1], cell[2], cell[3]], self.wall_velocity(on, scheme, side));
        // The sub-grid model is silent at a wall: no eddy is smaller than it.
        let mu = self.viscosity.dynamic(self.gas.density(cell), &[[0.0; 3]; 3], 0.0);
        // Its own distance: a wall of zero thickness has another cell behind it.
        let height = on.metrics.height(side);
        physics::wall_traction(mu, slip, scale(1.0 / face.magnitude(), face.area), height)
    }

    fn wall_velocity(&self, on: &Domain<'_>, scheme: &Scheme, side: &Side) -> Vec3 {
        let w = on.wall_velocity[side.face as usize - on.topology.cells.len()];
        [w[0] + scheme.frame[0], w[1] + scheme.frame[1], w[2] + scheme.frame[2]]
    }
}
