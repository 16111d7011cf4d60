//! The spatial residual: net outflow of each cell, second order.

use comm::Halo;
use mesh::lanes::{LANES, Lanes, columns, lane_by_lane, rows, value};
use nalgebra::{SimdBool, SimdComplexField, SimdPartialOrd, SimdValue, Vector3};

use crate::geometry::vec3::Vec3;
use crate::geometry::{FaceGeometry, FaceMetric, Metrics};
use crate::gradient::{self, Field, Gradient, LeastSquares};
use crate::limiter;
use crate::physics::{
    self, Blending, BoundaryFace, FaceFlux, FaceHistory, FluxParameters, Gas, Interface, Viscosity,
    ViscosityModel, WallLaw, WallTreatment, relative_speed, velocity,
};
use crate::topology::{OpenSides, Side, Topology};
use crate::turbulence::face_viscosity;

/// Models and constants of the spatial scheme. Loops over faces take it with the type of its viscosity, see
/// `for_viscosity`.
#[derive(Clone, Copy, Debug)]
pub struct Spatial<G, V = ViscosityModel> {
    /// Equations of state.
    pub gas: G,
    /// Stress.
    pub viscosity: V,
    /// Share of the plain difference of two neighbours in a reconstructed value:
    /// 1/3 makes the scheme of third order on even grids, 0 is purely upwind.
    pub chi: f64,
    /// Venkatakrishnan's K where gradients are limited.
    pub limiter: Option<f64>,
    /// Smallest upwind share of the convective flux, see [`Blending`]: 1 is upwind everywhere.
    pub upwind_share: f64,
}

/// Evaluates `$body` with `$typed`, the scheme `$spatial` with the type of its viscosity.
macro_rules! for_viscosity {
    ($spatial:expr, $typed:ident => $body:expr) => {
        match $spatial.viscosity {
            $crate::physics::ViscosityModel::Inviscid => {
                let $typed = $spatial.with($crate::physics::Inviscid);
                $body
            }
            $crate::physics::ViscosityModel::Laminar(viscosity) => {
                let $typed = $spatial.with(viscosity);
                $body
            }
            $crate::physics::ViscosityModel::Turbulent(viscosity) => {
                let $typed = $spatial.with(viscosity);
                $body
            }
        }
    };
}
pub(crate) use for_viscosity;

/// What the residual works on: the grid of one rank at one time level.
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
    /// Rigid rotation of a wall from the middle of each of these faces to the centre of its cell, m/s: a fluid that
    /// rotates with the wall has no shear. Empty: 0.
    pub wall_spin: &'a [Vec3],
    /// Difference of the undisturbed wind, or of the velocity of an inlet, from [`FluxParameters::wind`] on each face that is not
    /// between two cells, m/s. Empty: nothing.
    pub sheared: &'a [Vec3],
    /// Gauge pressure outside of each face that is not between two cells, Pa. Empty: 0.
    pub outer_pressure: &'a [f64],
    /// Transported dynamic eddy viscosity of local cells, Pa s. Read where
    /// [`ViscosityModel::transported`].
    pub eddy: &'a [f64],
    /// Transported working variable of local cells times density, Pa s, from which that of faces follows: the eddy viscosity
    /// itself grows with its fourth power next to walls, where the mean of two cells is far off.
    pub working: &'a [f64],
}

impl Domain<'_> {
    /// The face of a side.
    #[inline(always)]
    fn face(&self, side: &Side) -> &FaceMetric {
        &self.metrics.faces[side.face as usize]
    }

    /// Constants of the flux with the undisturbed wind at the face of `side`.
    pub fn scheme_at(&self, scheme: &FluxParameters, side: &Side) -> FluxParameters {
        let excess = self.sheared.get(side.face as usize - self.topology.cells.len());
        FluxParameters { wind: scheme.wind + excess.copied().unwrap_or_default(), ..*scheme }
    }

    /// The face of an open `side`; `scheme` is that of [`Domain::scheme_at`].
    pub fn boundary_face<'a>(&'a self, scheme: &'a FluxParameters, side: &Side) -> BoundaryFace<'a> {
        let pressure = self.outer_pressure.get(side.face as usize - self.topology.cells.len());
        BoundaryFace {
            scheme,
            metric: self.face(side),
            sign: side.sign,
            pressure: pressure.copied().unwrap_or_default(),
        }
    }
}

/// Gradients of all local cells, and what the second pass adds to them.
#[derive(Debug)]
pub struct Slopes<'a, const N: usize> {
    /// Of all local cells.
    pub gradient: &'a mut [Gradient<N>],
    /// Scratch of [`LeastSquares::compact_correction`] for the owned cells, zero at first; empty: one pass.
    pub correction: &'a mut [Gradient<N>],
}

impl<'a, const N: usize> Slopes<'a, N> {
    /// Gradients without a second pass, as of the upwind flux.
    pub fn one_pass(gradient: &'a mut [Gradient<N>]) -> Self {
        Self { gradient, correction: &mut [] }
    }
}

/// Second pass of the gradients of owned cells, as far as the time step resolves what crosses a cell: with long steps their wide
/// stencils cost iterations and gain nothing. Collective.
fn correct<const N: usize>(on: &Domain<'_>, scheme: &FluxParameters, q: &[[f64; N]], slopes: Slopes<'_, N>) {
    let Slopes { gradient, correction } = slopes;
    let (grid, typical) = ((on.topology, on.metrics), 10.0 * scheme.floor_squared.sqrt());
    let share = |i: usize| {
        let speed = relative_speed(scheme, velocity(&q[i])).max(typical);
        1.0 - physics::unresolved_in_time(speed / (scheme.rate * on.metrics.size[i]))
    };
    on.halo.overlap(gradient.as_flattened_mut().as_flattened_mut(), 3 * N, |gradient| {
        let gradient = gradient.as_chunks::<N>().0.as_chunks().0;
        on.gradients.compact_correction(grid, gradient, correction, share, false);
    });
    on.gradients.compact_correction(grid, gradient, correction, share, true);
    let corrections = correction.as_flattened().as_flattened();
    for (g, c) in gradient.as_flattened_mut().as_flattened_mut().iter_mut().zip(corrections) {
        *g += c;
    }
}

/// Faces between two cells, [`LANES`] of them.
struct Batch<const N: usize> {
    /// Cells that the area vectors point from, and to.
    cells: [[usize; LANES]; 2],
    face: FaceGeometry<Lanes>,
    /// From the centres of the first cells to those of the second, m.
    way: Vector3<Lanes>,
    /// States of the first and second cells.
    q: [[Lanes; N]; 2],
    /// Their gradients.
    gradient: [[[Lanes; N]; 3]; 2],
}

impl<const N: usize> Batch<N> {
    #[inline(always)]
    fn new(on: &Domain<'_>, field: Field<'_, N>, faces: &[usize; LANES]) -> Self {
        let [a, b, c, d] = *faces;
        let pair = &on.topology.cells;
        let pairs = [pair[a], pair[b], pair[c], pair[d]];
        let cells = |side: usize| [0, 1, 2, 3].map(|l| pairs[l][side] as usize);
        let (i, j) = (cells(0), cells(1));
        let face = &on.metrics.faces;
        Self {
            face: FaceGeometry::batch([&face[a], &face[b], &face[c], &face[d]]),
            way: Vector3::from(rows(&on.metrics.centre, &j)) - Vector3::from(rows(&on.metrics.centre, &i)),
            q: [rows(field.q, &i), rows(field.q, &j)],
            gradient: [slopes(field.gradient, &i), slopes(field.gradient, &j)],
            cells: [i, j],
        }
    }
}

/// Gradients of the cells of a batch.
#[inline(always)]
fn slopes<const N: usize>(gradient: &[Gradient<N>], cells: &[usize; LANES]) -> [[Lanes; N]; 3] {
    let [a, b, c, d] = cells.map(|c| &gradient[c]);
    let along = |e: usize| columns([&a[e], &b[e], &c[e], &d[e]]);
    [along(0), along(1), along(2)]
}

impl<G: Copy> Spatial<G> {
    /// The same scheme with this viscosity.
    pub(crate) fn with<V>(&self, viscosity: V) -> Spatial<G, V> {
        let Self { gas, chi, limiter, upwind_share, .. } = *self;
        Spatial { gas, viscosity, chi, limiter, upwind_share }
    }

    /// Net outflow of each owned cell for the state `q`.
    ///
    /// Fills the ghosts of `q`, `gradient` on all local cells, and what
    /// passes each face, and its blending where `scheme` renews it. Entries of `residual` for
    /// ghosts are left meaningless. Collective.
    pub fn evaluate<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        q: &mut [[f64; N]],
        slopes: Slopes<'_, N>,
        residual: &mut [[f64; N]],
        face_flux: &mut [FaceFlux],
    ) where
        G: Gas<N>,
    {
        let Slopes { gradient, correction } = slopes;
        // Faces without ghosts are evaluated during the halo exchange.
        on.halo.overlap(q.as_flattened_mut(), N, |q| {
            on.gradients.inside(on.topology, q.as_chunks().0, gradient);
        });
        on.gradients.border(on.topology, q, gradient);
        on.gradients.add_images(on.metrics, q, gradient);
        on.gradients.shorten(gradient);
        if !correction.is_empty() {
            correct(on, scheme, q, Slopes { gradient: &mut *gradient, correction });
        }
        if let Some(k) = self.limiter {
            let speed = scheme.floor_squared.sqrt() * 10.0;
            let mut typical = [speed; N];
            typical[0] = self.gas.density(&self.gas.undisturbed(scheme.wind)) * speed * speed;
            limiter::venkatakrishnan(on.topology, on.metrics, q, gradient, k, typical);
        }
        residual.fill([0.0; N]);
        let n = on.topology.n_inside;
        on.halo.overlap(gradient.as_flattened_mut().as_flattened_mut(), 3 * N, |gradient| {
            let field = Field { q, gradient: gradient.as_chunks::<N>().0.as_chunks().0 };
            for_viscosity!(self, s => s.interior(on, scheme, field, residual, face_flux, 0..n));
        });
        let field = Field { q, gradient };
        let border = n..on.topology.cells.len();
        for_viscosity!(self, s => {
            s.interior(on, scheme, field, residual, face_flux, border);
            s.walls(on, scheme, field, residual);
            s.symmetry_planes(on, scheme, field, residual, face_flux);
        });
        self.open_boundaries(on, scheme, field, residual, face_flux);
        self.porous_fluxes(on, scheme, field, residual, face_flux);
    }

    /// Sides that air passes.
    fn open_boundaries<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
        face_flux: &mut [FaceFlux],
    ) where
        G: Gas<N>,
    {
        for OpenSides { patch, sides } in &on.topology.open {
            let Some(condition) = physics::open_boundary::<G, N>(*patch) else { continue };
            for side in sides {
                let cell = side.cell as usize;
                let d = on.metrics.border(side.face) - on.metrics.centre(cell);
                let inside = gradient::extrapolated(&field.q[cell], &field.gradient[cell], &d);
                let kept = &mut face_flux[side.face as usize];
                let scheme = on.scheme_at(scheme, side);
                let at = on.boundary_face(&scheme, side);
                let f = condition.flux(&self.gas, &at, &inside, &field.q[cell], kept.previous);
                (kept.mass, kept.rhie_chow) = (f.mass as f32, f.rhie_chow as f32);
                gain(residual, side, &f.flux);
            }
        }
    }

    /// Shear stress of the air on a no-slip wall, Pa: on the wall, so the cell
    /// feels the opposite.
    pub fn wall_traction<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        q: &[[f64; N]],
        side: &Side,
    ) -> Vec3
    where
        G: Gas<N>,
    {
        self.near_wall(on, scheme, q, side).traction()
    }

    /// Viscous force of the air on a slip wall or a plane of symmetry, N: the normal stress of air that spreads along it.
    /// `missing`: what the gradient lacks of the slope of the normal velocity along the normal of a plane of symmetry, 1/s; 0 at a wall.
    pub fn slip_wall_force<const N: usize>(
        &self,
        on: &Domain<'_>,
        field: Field<'_, N>,
        side: &Side,
        missing: f64,
    ) -> Vec3
    where
        G: Gas<N>,
    {
        let flux = for_viscosity!(self, s => s.normal_stress(on, field, side, missing));
        Vec3::new(flux[1], flux[2], flux[3])
    }
}

/// The air next to a no-slip wall.
#[derive(Clone, Copy, Debug)]
pub struct NearWall {
    /// Velocity along the wall and relative to it, m/s.
    pub slip: Vec3,
    /// Distance of the cell centre, m.
    pub height: f64,
    /// Dynamic viscosity of the fluid, Pa s. The sub-grid model is silent at a wall: no eddy is smaller than it.
    pub viscosity: f64,
    /// The law of the wall, where friction follows from it.
    pub law: Option<WallLaw>,
}

impl NearWall {
    /// Shear stress on the wall, Pa.
    #[inline(always)]
    pub fn traction(&self) -> Vec3 {
        let stress = self.law.map_or(1.0, |law| law.stress);
        physics::wall_traction(self.viscosity * stress, self.slip, self.height)
    }

    /// Derivative of the shear stress by the slip times the height, Pa s, where the law of the wall gives it.
    #[inline(always)]
    pub fn stiffness(&self) -> Option<f64> {
        self.law.map(|law| self.viscosity * law.stress * law.exponent)
    }

    /// Height in wall units, $`y^+`$, at density `rho`, kg/m3.
    pub fn units(&self, rho: f64) -> f64 {
        (self.traction().norm() * rho).sqrt() * self.height / self.viscosity
    }

    /// Velocity gradient at the cell centre, 1/s.
    pub fn gradient(&self) -> f64 {
        self.slip.norm() / self.height * self.law.map_or(1.0, |law| law.gradient)
    }
}

/// What the fluxes of `faces` depend on.
#[inline(always)]
fn history(face_flux: &[FaceFlux], faces: &[usize; LANES]) -> FaceHistory<Lanes> {
    let [a, b, c, d] = faces.map(|f| &face_flux[f]);
    let row = |f: &FaceFlux| {
        let FaceFlux { previous, blending: Blending { upwind, resolved }, .. } = *f;
        [previous[0], previous[1], upwind, resolved].map(f64::from)
    };
    let [newest, second, upwind, resolved] = columns([&row(a), &row(b), &row(c), &row(d)]);
    FaceHistory { previous: [newest, second], blending: Blending { upwind, resolved } }
}

fn wall_velocity(on: &Domain<'_>, scheme: &FluxParameters, side: &Side) -> Vec3 {
    on.wall_velocity[side.face as usize - on.topology.cells.len()] + scheme.frame
}

impl<G, V: Viscosity> Spatial<G, V> {
    /// Faces between two cells.
    fn interior<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
        face_flux: &mut [FaceFlux],
        range: std::ops::Range<usize>,
    ) where
        G: Gas<N>,
    {
        for first in range.clone().step_by(LANES) {
            // The last batch repeats its last face.
            let faces = std::array::from_fn(|l| (first + l).min(range.end - 1));
            let batch = Batch::new(on, field, &faces);
            let [l, r] = self.reconstructed(&batch);
            if scheme.renews_blending {
                self.renew_blending(on, scheme, &batch, [&l, &r], &faces, face_flux);
            }
            let history = history(face_flux, &faces);
            let Interface { mut flux, mass, rhie_chow } =
                physics::interface(&self.gas, scheme, &l, &r, &batch.face, &history);
            if history.blending.upwind.simd_lt(Lanes::splat(1.0)).any() {
                let correction = self.split_form_correction(&batch, history.blending);
                for (f, c) in flux[1..4].iter_mut().zip(&correction) {
                    *f += *c;
                }
            }
            if V::ACTIVE {
                let viscous = self.viscous_flux(on, &batch, [&l, &r]);
                for (f, v) in flux.iter_mut().zip(viscous) {
                    *f -= v;
                }
            }
            let (flux, mass, rhie_chow) = (flux.map(Lanes::into_arr), mass.into_arr(), rhie_chow.into_arr());
            for (lane, face) in (first..range.end).take(LANES).enumerate() {
                let kept = &mut face_flux[face];
                (kept.mass, kept.rhie_chow) = (mass[lane] as f32, rhie_chow[lane] as f32);
                let [i, j] = [batch.cells[0][lane], batch.cells[1][lane]];
                for v in 0..N {
                    residual[i][v] += flux[v][lane];
                    residual[j][v] -= flux[v][lane];
                }
            }
        }
    }

    /// Blending of faces by the state, with the reconstructed states `l` and `r` on their two sides.
    #[inline(always)]
    fn renew_blending<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        batch: &Batch<N>,
        [l, r]: [&[Lanes; N]; 2],
        faces: &[usize; LANES],
        face_flux: &mut [FaceFlux],
    ) {
        let half = Lanes::splat(0.5);
        let Batch { cells, face, way, q, gradient: [gi, gj] } = batch;
        let step = std::array::from_fn(|v| q[1][v] - q[0][v]);
        let along =
            std::array::from_fn(|v| half * (gradient::along(gi, v, way) + gradient::along(gj, v, way)));
        let passing = ((velocity(l) + velocity(r)) * half).dot(&face.area) - face.grid_flux;
        let [volume_i, volume_j] =
            [value(&on.metrics.volume, &cells[0]), value(&on.metrics.volume, &cells[1])];
        let courant = passing.simd_abs() / (Lanes::splat(scheme.rate) * volume_i.simd_min(volume_j));
        let uneven = physics::uneven(&face.offset, way);
        let least =
            Lanes::splat(self.upwind_share).simd_max(uneven).simd_max(physics::unresolved_in_time(courant));
        let Blending { upwind, resolved } = Blending::sensed::<N>(&step, &along, half * (l[0] - r[0]), least);
        let (upwind, resolved) = (upwind.into_arr(), resolved.into_arr());
        for (lane, face) in faces.iter().enumerate() {
            let is_upwind = cells.iter().any(|side| on.topology.upwind[side[lane]]);
            face_flux[*face].blending = if is_upwind {
                Blending::UPWIND
            } else {
                Blending { upwind: upwind[lane] as f32, resolved: resolved[lane] as f32 }
            };
        }
    }

    /// States on the two sides of faces between two cells.
    #[inline(always)]
    fn reconstructed<const N: usize>(&self, batch: &Batch<N>) -> [[Lanes; N]; 2] {
        let Batch { face, way, q: [qi, qj], gradient: [gi, gj], .. } = batch;
        let [zero, one, chi] = [0.0, 1.0, self.chi].map(Lanes::splat);
        let di = face.offset;
        let dj = di - way;
        let (mut l, mut r) = (*qi, *qj);
        // The plain difference counts by where the face lies between the centres:
        // a thin cell next to a thick one takes little of it.
        let near = (di.dot(&face.area) / (face.area.norm() * face.spacing)).simd_clamp(zero, one);
        let (chi_i, chi_j) = (chi * near, chi * (one - near));
        for v in 0..N {
            let step = qj[v] - qi[v];
            l[v] += gradient::along(gi, v, &di);
            l[v] += chi_i * (step - gradient::along(gi, v, way));
            r[v] += gradient::along(gj, v, &dj);
            r[v] -= chi_j * (step - gradient::along(gj, v, way));
        }
        [l, r]
    }

    /// Fourth-order part of the central flux of momentum, N. The farther neighbours along the line of centres follow from the
    /// gradients, which are central differences on an even grid.
    #[inline(always)]
    fn split_form_correction<const N: usize>(
        &self,
        batch: &Batch<N>,
        blending: Blending<Lanes>,
    ) -> Vector3<Lanes>
    where
        G: Gas<N>,
    {
        let Batch { face, way, q: [qi, qj], gradient: [gi, gj], .. } = batch;
        let [half, one] = [0.5, 1.0].map(Lanes::splat);
        let half_step = (velocity(qj) - velocity(qi)) * half;
        let predicted = |g: &[[Lanes; N]; 3]| Vector3::from_fn(|d, _| gradient::along(g, 1 + d, way));
        let (beta, gamma) = (half_step - predicted(gi), predicted(gj) - half_step);
        let rho = half * (self.gas.density(qi) + self.gas.density(qj));
        let share = one - blending.upwind;
        physics::split_form_correction(beta, gamma, face.area) * (share * rho)
    }

    /// What stress and conduction pass from the second cell of a face to the first, between the states `l` and `r`
    /// on its sides.
    #[inline(always)]
    fn viscous_flux<const N: usize>(
        &self,
        on: &Domain<'_>,
        batch: &Batch<N>,
        [l, r]: [&[Lanes; N]; 2],
    ) -> [Lanes; N]
    where
        G: Gas<N>,
    {
        let Batch { cells, face, way, q: [qi, qj], gradient: [gi, gj] } = batch;
        let half = Lanes::splat(0.5);
        // Mean gradient, its part along the line of centres replaced by the difference.
        let length2 = way.norm_squared();
        let mut g = [[Lanes::splat(0.0); N]; 3];
        for v in 0..N {
            for d in 0..3 {
                g[d][v] = half * (gi[d][v] + gj[d][v]);
            }
            let missing = (qj[v] - qi[v] - gradient::along(&g, v, way)) / length2;
            for d in 0..3 {
                g[d][v] += missing * way[d];
            }
        }
        let u = gradient::of_velocity(&g);
        let size = half * (value(&on.metrics.size, &cells[0]) + value(&on.metrics.size, &cells[1]));
        let mut mu = self.viscosity.dynamic(self.gas.density(l), &u, size);
        if self.viscosity.transported() {
            let (a, b) = (value(on.working, &cells[0]), value(on.working, &cells[1]));
            [mu, ..] = lane_by_lane([mu, a, b], |[mu, a, b]| [face_viscosity([a, b], mu), a, b]);
        }
        let force = physics::stress_force(mu, &u, face.area);
        let work = force.dot(&((velocity(l) + velocity(r)) * half));
        let mut flux = self.gas.conduction(mu, |v| gradient::along(&g, v, &face.area), work);
        flux[1..4].copy_from_slice(force.as_slice());
        flux
    }

    /// Sides where nothing passes: the pressure, and what rubs.
    fn walls<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
    ) where
        G: Gas<N>,
    {
        let t = on.topology;
        for side in t.slip.iter().chain(&t.no_slip) {
            let face = on.face(side);
            let p = self.wall_pressure(on, field.q, field.gradient, side);
            let f = physics::wall(&self.gas, p, face.area * side.sign, side.sign * face.grid_flux);
            gain(residual, side, &f.flux);
        }
        if V::ACTIVE {
            for side in &t.slip {
                gain(residual, side, &self.normal_stress(on, field, side, 0.0));
            }
            for side in &t.no_slip {
                gain(residual, side, &self.friction(on, scheme, field, side));
            }
        }
    }

    /// Planes of symmetry: the flux between a cell and its mirror image, which passes no mass.
    fn symmetry_planes<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        residual: &mut [[f64; N]],
        face_flux: &mut [FaceFlux],
    ) where
        G: Gas<N>,
    {
        for side in &on.topology.symmetry {
            let mirror = self.mirrored(on, field, side);
            let blending = &mut face_flux[side.face as usize].blending;
            if scheme.renews_blending {
                blending.upwind = if on.topology.upwind[side.cell as usize] {
                    1.0
                } else {
                    mirror.upwind.max(self.upwind_share) as f32
                };
            }
            let p = mirror.pressure(scheme, f64::from(blending.upwind));
            let face = on.face(side);
            let f = physics::wall(&self.gas, p, face.area * side.sign, side.sign * face.grid_flux);
            gain(residual, side, &f.flux);
            if V::ACTIVE {
                gain(residual, side, &self.normal_stress(on, field, side, mirror.missing_slope()));
            }
        }
    }

    /// No friction, but the normal stress of air that spreads along a slip wall or a plane of symmetry, and its work on a wall that moves.
    /// `missing`: what the gradient of the cell lacks of the slope of the normal velocity along the normal, 1/s.
    fn normal_stress<const N: usize>(
        &self,
        on: &Domain<'_>,
        field: Field<'_, N>,
        side: &Side,
        missing: f64,
    ) -> [f64; N]
    where
        G: Gas<N>,
    {
        let face = on.face(side);
        let (area, cell) = (face.area, side.cell as usize);
        let mut u = gradient::of_velocity(&field.gradient[cell]);
        u += area * area.transpose() * (missing / area.norm_squared());
        let mut mu = self.viscosity.dynamic(self.gas.density(&field.q[cell]), &u, on.metrics.size[cell]);
        if self.viscosity.transported() {
            mu += on.eddy[cell];
        }
        let stress = physics::stress_force(mu, &u, area).dot(&area) / area.norm_squared();
        // As a pressure on the wall, whose motion does work.
        self.gas.pressure_change(-stress, area * side.sign, side.sign * face.grid_flux)
    }

    /// Friction on a no-slip wall and its work.
    fn friction<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        field: Field<'_, N>,
        side: &Side,
    ) -> [f64; N]
    where
        G: Gas<N>,
    {
        let force = self.near_wall(on, scheme, field.q, side).traction() * on.face(side).magnitude();
        let wall = wall_velocity(on, scheme, side);
        let heat = self.gas.conduction(0.0, |_| 0.0, -force.dot(&wall));
        let mut flux = heat.map(|h| -h);
        for d in 0..3 {
            flux[1 + d] += force[d];
        }
        flux
    }
}

impl<G, V: Copy + Into<ViscosityModel>> Spatial<G, V> {
    /// The air next to the no-slip wall of `side`.
    pub fn near_wall<const N: usize>(
        &self,
        on: &Domain<'_>,
        scheme: &FluxParameters,
        q: &[[f64; N]],
        side: &Side,
    ) -> NearWall
    where
        G: Gas<N>,
    {
        let (face, model, cell) = (on.face(side), self.viscosity.into(), side.cell as usize);
        let spin =
            on.wall_spin.get(side.face as usize - on.topology.cells.len()).copied().unwrap_or_default();
        let velocity = velocity(&q[cell]) - wall_velocity(on, scheme, side) - spin;
        let slip = physics::along_wall(velocity, face.area * (1.0 / face.magnitude()));
        // Its own distance: a wall of zero thickness has another cell behind it.
        let (height, viscosity) = (on.metrics.height(side), model.molecular());
        let law = match model.wall_treatment() {
            WallTreatment::Resolved => None,
            WallTreatment::Automatic => {
                Some(WallLaw::new(slip.norm(), height, viscosity / self.gas.density(&q[cell])))
            }
        };
        NearWall { slip, height, viscosity, law }
    }
}

impl<G, V> Spatial<G, V> {
    /// Gauge pressure at a wall, Pa: linear from the cell.
    pub fn wall_pressure<const N: usize>(
        &self,
        on: &Domain<'_>,
        q: &[[f64; N]],
        gradient: &[Gradient<N>],
        side: &Side,
    ) -> f64 {
        let cell = side.cell as usize;
        let d = on.metrics.border(side.face) - on.metrics.centre(cell);
        let g = &gradient[cell];
        q[cell][0] + g[0][0] * d.x + g[1][0] * d.y + g[2][0] * d.z
    }
}

/// Adds what leaves a boundary cell through `side`.
#[inline(always)]
fn gain<const N: usize>(residual: &mut [[f64; N]], side: &Side, flux: &[f64; N]) {
    for (r, f) in residual[side.cell as usize].iter_mut().zip(flux) {
        *r += f;
    }
}
