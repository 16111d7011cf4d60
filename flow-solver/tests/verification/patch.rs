//! The spatial residual of fields whose fluxes are known: linear ones on any grid, means of parabolas, single rows.
//!
//! Gradients are exact for linear fields, so that both sides of a face have the value at its centre and what
//! pressure and velocity jumps add is zero: the flux is that of the field itself. What does not
//! vanish there (the part of the plain difference, the difference along the line of centres in a stress,
//! limits) is seen on rows of cells, where the formulas are those of one dimension.

#![allow(clippy::needless_range_loop)]

use crate::common::{Noise, isothermal, settings, solver_of, solver_with_cloth};
use flow_solver::geometry::vec3::{Mat3, Vec3};
use flow_solver::gradient::Gradient;
use flow_solver::permeable::Permeability;
use flow_solver::physics::{
    self, Air, EddyViscosity, FaceFlux, Gas, IdealGas, Inviscid, Isothermal, Laminar, Turbulent, Viscosity,
    WallTreatment,
};
use flow_solver::residual::{Domain, Slopes};
use flow_solver::topology::OpenSides;
use flow_solver::{Loads, Solver};
use mesh::{BoxShape, FlowGrid, Patch, box_grid, box_grid_of, plate_grid};

/// No plane of symmetry: a linear field is not symmetric, see [`gradients_at_planes_of_symmetry_are_exact_for_symmetric_fields`].
const PATCHES: [Patch; 6] =
    [Patch::FarField, Patch::Slip, Patch::Wall, Patch::Outlet, Patch::Slip, Patch::FarField];

/// Wind, so that far faces are entered, left, and both in part.
const WIND: Vec3 = Vec3::new(3.0, -2.0, 4.0);

fn shake(grid: &mut FlowGrid, by: f64) {
    let mut noise = Noise(7);
    for x in grid.coords.iter_mut().flatten() {
        *x += by * noise.next();
    }
}

/// A field linear in space.
struct Linear<const N: usize> {
    at: [f64; N],
    slope: [[f64; N]; 3],
}

impl<const N: usize> Linear<N> {
    fn new() -> Self {
        let mut noise = Noise(3);
        let size = [40.0, 1.5, 1.5, 1.5, 3.0];
        let slope = [0; 3].map(|_| std::array::from_fn(|v| size[v] * noise.next()));
        Self { at: std::array::from_fn(|v| [15.0, 3.0, -2.0, 2.5, 1.0][v]), slope }
    }

    fn value(&self, x: Vec3) -> [f64; N] {
        std::array::from_fn(|v| self.at[v] + (0..3).map(|d| self.slope[d][v] * x[d]).sum::<f64>())
    }

    /// Derivatives of the velocity, direction by component.
    fn velocity_slope(&self) -> Mat3 {
        Mat3::from_fn(|d, c| self.slope[d][1 + c])
    }
}

/// `mu (grad u + grad u^T - 2/3 div u) . s`.
fn force(mu: f64, g: &Mat3, s: Vec3) -> Vec3 {
    let divergence: f64 = (0..3).map(|d| g[(d, d)]).sum();
    Vec3::from_fn(|i, _| {
        mu * ((0..3).map(|j| (g[(j, i)] + g[(i, j)]) * s[j]).sum::<f64>() - 2.0 / 3.0 * divergence * s[i])
    })
}

/// Flux of the state `q` through an area that sweeps `grid_flux`.
fn convective<G: Gas<N>, const N: usize>(gas: &G, q: &[f64; N], s: Vec3, grid_flux: f64) -> [f64; N] {
    let mass = gas.density(q) * (q[1] * s[0] + q[2] * s[1] + q[3] * s[2] - grid_flux);
    let (carried, push) = (gas.carried(q), gas.pressure_flux(q[0], s, grid_flux));
    std::array::from_fn(|v| mass * carried[v] + push[v])
}

/// Residual, limited and shortened gradients, and what passes, at the solver's state.
fn evaluate<G: Gas<N>, const N: usize>(
    s: &Solver<G, N>,
    on: &Domain<'_>,
    scheme: &physics::FluxParameters,
) -> (Vec<[f64; N]>, Vec<Gradient<N>>, Vec<FaceFlux>) {
    let n = s.q.len();
    let (mut q, mut gradient) = (s.q.clone(), vec![[[0.0; N]; 3]; n]);
    let (mut residual, mut face_flux) = (vec![[0.0; N]; n], s.face_flux().to_vec());
    s.spatial.evaluate(on, scheme, &mut q, Slopes::one_pass(&mut gradient), &mut residual, &mut face_flux);
    (residual, gradient, face_flux)
}

/// Constants of a step of a hundredth of a second.
fn stepping<G, const N: usize>(s: &Solver<G, N>, frame: Vec3) -> physics::FluxParameters {
    physics::FluxParameters { rate: 150.0, rhie_chow: [150.0, -200.0, 50.0], frame, ..s.scheme }
}

/// Viscosity of a constant stress between two cells with a linear working variable, by ten thousand midpoints.
fn series([a, b]: [f64; 2], mu: f64) -> f64 {
    let n = 10_000;
    let resistance = |k: i32| {
        let x = (a + (b - a) * (f64::from(k) + 0.5) / f64::from(n)) / mu;
        1.0 / (mu * (1.0 + x * x.powi(3) / (x.powi(3) + 7.1f64.powi(3))))
    };
    f64::from(n) / (0..n).map(resistance).sum::<f64>()
}

/// Compares the residual of a linear field with the fluxes of the field itself, in every cell in which
/// the gradient is exact and whose neighbours' is; all of them on hexahedra.
#[expect(clippy::too_many_lines, reason = "the fluxes of one field on every kind of face")]
fn linear_field<G: Gas<N>, V: Viscosity, const N: usize>(shape: BoxShape, gas: G, viscosity: V) {
    let mut grid = box_grid_of(shape, [4, 3, 5], [0.0; 3], [1.0, 0.8, 1.1], PATCHES);
    shake(&mut grid, 0.015);
    let mut s = solver_of(&grid, gas, viscosity, settings(WIND, 1e-3));
    let field = Linear::<N>::new();
    for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
        *q = field.value(Vec3::from(*x));
    }
    // A grid that passes through the air and grows.
    let frame = Vec3::new(0.3, -0.4, 0.2);
    let mut noise = Noise(5);
    for f in &mut s.metrics.faces {
        f.grid_flux = f.area.dot(&frame) + 0.01 * noise.next();
    }
    let eddy: Vec<f64> = (0..s.q.len()).map(|_| 0.3 + 0.2 * noise.next()).collect();
    let fluid = viscosity.dynamic(1.0, &Mat3::zeros(), 0.0);
    let working: Vec<f64> = (0..s.q.len()).map(|_| fluid * (8.0 + noise.next())).collect();
    let borders = s.metrics.faces.len() - s.topology.cells.len();
    let wall: Vec<Vec3> = (0..borders).map(|_| Vec3::from_fn(|_, _| noise.next())).collect();
    let sheared: Vec<Vec3> = (0..borders).map(|_| Vec3::from_fn(|_, _| noise.next())).collect();
    let on = Domain { wall_velocity: &wall, sheared: &sheared, eddy: &eddy, working: &working, ..s.domain() };
    let scheme = stepping(&s, frame);
    let (found, gradient, face_flux) = evaluate(&s, &on, &scheme);

    let (t, m) = (&s.topology, &s.metrics);
    let g = field.velocity_slope();
    let of_cell = |mu: f64, c: usize| mu + if s.spatial.viscosity.transported() { eddy[c] } else { 0.0 };
    let of_face = |mu: f64, i: usize, j: usize| {
        if s.spatial.viscosity.transported() { series([working[i], working[j]], mu) } else { mu }
    };
    // Where a needle is shortened, gradients are not exact.
    let straight = |c: usize| {
        (0..N).all(|v| {
            (0..3).all(|d| (gradient[c][d][v] - field.slope[d][v]).abs() < [4e-2, 1e-3][usize::from(v > 0)])
        })
    };
    let mut exact = vec![[0.0; N]; s.q.len()];
    // What the slopes bring: the measure of an error.
    let mut size = [0.0f64; N];
    for (k, &[i, j]) in t.cells.iter().enumerate() {
        let (i, j, f) = (i as usize, j as usize, &m.faces[k]);
        let q = field.value(m.face_centre(t, k));
        let mut flux = convective(&gas, &q, f.area, f.grid_flux);
        let even = convective(&gas, &s.q[i], f.area, f.grid_flux);
        (0..N).for_each(|v| size[v] = size[v].max((flux[v] - even[v]).abs()));
        if straight(i) && straight(j) {
            let mass = gas.density(&q) * (Vec3::new(q[1], q[2], q[3]).dot(&f.area) - f.grid_flux);
            assert!((f64::from(face_flux[k].mass) - mass).abs() < 1e-5, "{} {mass}", face_flux[k].mass);
        }
        if V::ACTIVE {
            let mu = viscosity.dynamic(gas.density(&q), &g, 0.5 * (m.size[i] + m.size[j]));
            let mu = of_face(mu, i, j);
            let pull = force(mu, &g, f.area);
            (0..3).for_each(|d| flux[1 + d] -= pull[d]);
            if N > 4 {
                let gradient = Vec3::from_fn(|d, _| field.slope[d][N - 1]);
                let cp = 3.5 * 287.05;
                flux[N - 1] -=
                    mu * cp / 0.72 * gradient.dot(&f.area) + pull.dot(&Vec3::new(q[1], q[2], q[3]));
            }
        }
        for v in 0..N {
            exact[i][v] += flux[v];
            exact[j][v] -= flux[v];
        }
    }
    let mut gain = |c: usize, flux: [f64; N]| (0..N).for_each(|v| exact[c][v] += flux[v]);
    for side in t.slip.iter().chain(&t.symmetry).chain(&t.no_slip) {
        let (f, c) = (&m.faces[side.face as usize], side.cell as usize);
        let p = field.value(m.border(side.face))[0];
        gain(c, gas.pressure_flux(p, f.area * side.sign, side.sign * f.grid_flux));
    }
    if V::ACTIVE {
        for side in t.slip.iter().chain(&t.symmetry) {
            let (f, c) = (&m.faces[side.face as usize], side.cell as usize);
            let mu = of_cell(viscosity.dynamic(gas.density(&s.q[c]), &g, m.size[c]), c);
            let stress = force(mu, &g, f.area).dot(&f.area) / f.area.norm_squared();
            // Work on the wall, which sweeps the grid's flux.
            let swept = [0.0, f.area[0], f.area[1], f.area[2], f.grid_flux];
            gain(c, std::array::from_fn(|v| -side.sign * stress * swept[v]));
        }
        for side in &t.no_slip {
            let (f, c) = (&m.faces[side.face as usize], side.cell as usize);
            let w = wall[side.face as usize - t.cells.len()];
            let n = f.area * (1.0 / f.area.norm());
            let air = &s.q[c];
            let slip: Vec3 = Vec3::from_fn(|d, _| air[1 + d] - w[d] - frame[d]);
            let along: Vec3 = Vec3::from_fn(|d, _| slip[d] - slip.dot(&n) * n[d]);
            let height = side.sign * (m.border(side.face) - m.centre(c)).dot(&n);
            // No eddies at a wall: the fluid's own viscosity, or what the law of the wall makes of it.
            let mut mu = viscosity.dynamic(gas.density(air), &Mat3::zeros(), 0.0);
            if s.spatial.viscosity.wall_treatment() == WallTreatment::Automatic {
                let law = physics::WallLaw::new(along.norm(), height, mu / gas.density(air));
                mu *= law.y * mu / (gas.density(air) * along.norm() * height) * law.y;
            }
            let drag = along.map(|u| mu * u / height * f.area.norm());
            let work = (0..3).map(|d| drag[d] * (w[d] + frame[d])).sum::<f64>();
            gain(
                c,
                std::array::from_fn(|v| {
                    if v == 0 {
                        0.0
                    } else if v < 4 {
                        drag[v - 1]
                    } else {
                        work
                    }
                }),
            );
        }
    }
    for OpenSides { patch, sides } in &t.open {
        for side in sides {
            let (f, c) = (&m.faces[side.face as usize], side.cell as usize);
            let more = sheared[side.face as usize - t.cells.len()];
            let wind = WIND + more;
            let at = physics::FluxParameters { wind, ..scheme };
            let inside = field.value(m.border(side.face));
            let at = physics::BoundaryFace { scheme: &at, metric: f, sign: side.sign, pressure: 0.0 };
            let condition = physics::open_boundary::<G, N>(*patch).expect("air passes");
            let passing = condition.flux(&gas, &at, &inside, &s.q[c], [0.0; 2]);
            let kept = &face_flux[side.face as usize];
            if straight(c) {
                assert!((f64::from(kept.mass) - passing.mass).abs() < 1e-5 * passing.mass.abs().max(1.0));
                assert!(
                    (f64::from(kept.rhie_chow) - passing.rhie_chow).abs()
                        < 1e-5 * passing.rhie_chow.abs().max(1.0)
                );
            }
            gain(c, passing.flux);
        }
    }
    let a = &t.adjacency;
    let (mut worst, mut seen) = ([0.0f64; N], 0);
    for c in 0..s.q.len() {
        let row = a.start[c] as usize..a.start[c + 1] as usize;
        if !straight(c) || !a.cell[row].iter().all(|&j| straight(j as usize)) {
            assert!(shape != BoxShape::Hexahedra, "cell {c} has a wrong gradient");
            continue;
        }
        seen += 1;
        for v in 0..N {
            worst[v] = worst[v].max((found[c][v] - exact[c][v]).abs() / size[v]);
        }
    }
    println!("{shape:?}, {N} equations: {seen} of {} cells, off by {worst:?} of a slope's share", s.q.len());
    assert!(seen * 3 > s.q.len());
    // Weights and offsets of single precision.
    assert!(worst.iter().all(|w| *w < 1e-5), "{shape:?}: {worst:?}");
}

const SHAPES: [BoxShape; 4] =
    [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra];

#[test]
fn fluxes_of_linear_fields_are_exact_in_isothermal_air() {
    let air = Air::new(1.225, 288.15);
    for shape in SHAPES {
        linear_field(shape, Isothermal::new(air), Inviscid);
        linear_field(shape, Isothermal::new(air), Laminar { viscosity: 0.4 });
        linear_field(
            shape,
            Isothermal::new(air),
            Turbulent {
                viscosity: 0.2,
                eddies: EddyViscosity::TransportInput,
                wall: WallTreatment::Resolved,
            },
        );
        linear_field(
            shape,
            Isothermal::new(air),
            Turbulent {
                viscosity: 1e-3,
                eddies: EddyViscosity::TransportInput,
                wall: WallTreatment::Automatic,
            },
        );
        linear_field(
            shape,
            Isothermal::new(air),
            Turbulent { viscosity: 0.1, eddies: EddyViscosity::Smagorinsky, wall: WallTreatment::Resolved },
        );
    }
}

#[test]
fn fluxes_of_linear_fields_are_exact_in_ideal_gas() {
    let air = Air::new(1.225, 288.15);
    for shape in SHAPES {
        linear_field(shape, IdealGas::new(air), Inviscid);
        linear_field(
            shape,
            IdealGas::new(air),
            Turbulent {
                viscosity: 0.4,
                eddies: EddyViscosity::TransportInput,
                wall: WallTreatment::Automatic,
            },
        );
    }
}

/// A row of cells along `axis` with its nodes at `at`, one cell of 2 m x 3 m across.
fn row(axis: usize, at: &[f64]) -> FlowGrid {
    let mut n = [1; 3];
    n[axis] = at.len() - 1;
    let mut high = [2.0, 2.0, 2.0];
    high[(axis + 1) % 3] = 3.0;
    high[axis] = 1.0;
    let mut grid = box_grid(n, [0.0; 3], high, [Patch::Slip; 6]);
    for x in &mut grid.coords {
        x[axis] = at[(x[axis] * (at.len() - 1) as f64).round() as usize];
    }
    grid
}

/// What is left of a row's values of `v` at its faces in a stream of `speed` along it: by
/// the momentum that leaves cells, over the mass flux; of faces between inner cells only.
fn carried(axis: usize, at: &[f64], values: &[f64], speed: f64) -> Vec<f64> {
    let mut s = isothermal(&row(axis, at), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let across = (axis + 1) % 3;
    for (q, v) in s.q.iter_mut().zip(values) {
        *q = [0.0; 4];
        q[1 + axis] = speed;
        q[1 + across] = *v;
    }
    let (residual, ..) = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros()));
    let mass = s.spatial.gas.density(&s.q[0]) * speed * 6.0;
    residual.iter().map(|r| r[1 + across] / mass).collect()
}

/// The scheme is of third order on even grids: from the means of a parabola over cells it finds the
/// parabola's own values on faces, so what leaves a cell is their exact difference.
#[test]
fn reconstruction_of_parabola_means_is_exact_on_faces() {
    let h = 0.125;
    let at: Vec<f64> = (0..=8).map(|k| h * k as f64).collect();
    let f = |x: f64| 2.0 - 3.0 * x + 5.0 * x * x;
    let means: Vec<f64> = (0..8).map(|k| f(h * (k as f64 + 0.5)) + 5.0 * h * h / 12.0).collect();
    for axis in 0..3 {
        for speed in [4.0, -4.0] {
            let left = carried(axis, &at, &means, speed);
            for k in 2..6 {
                let exact = f(h * (k + 1) as f64) - f(h * k as f64);
                assert!(
                    (left[k] - exact).abs() < 1e-6,
                    "axis {axis}, {speed} m/s, cell {k}: {} {exact}",
                    left[k]
                );
            }
        }
    }
}

/// Nodes of cells that grow and shrink without a reconstruction that must be shortened, and ragged values.
const UNEVEN: [f64; 9] = [0.0, 0.1, 0.22, 0.38, 0.52, 0.64, 0.79, 0.9, 1.0];
const RAGGED: [f64; 8] = [1.0, -0.5, 2.0, 0.7, -1.2, 0.4, 1.1, -0.3];

/// Centres of a row and the least-squares slopes of `values`: the mean of the slopes to both sides.
fn slopes(at: &[f64], values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = at.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect();
    let to = |k: usize| (values[k + 1] - values[k]) / (x[k + 1] - x[k]);
    let last = x.len() - 1;
    let g = (0..=last).map(|k| match k {
        0 => to(0),
        _ if k == last => to(k - 1),
        _ => 0.5 * (to(k - 1) + to(k)),
    });
    let g = g.collect();
    (x, g)
}

/// On uneven cells the plain difference replaces a third, times the face's place between the centres, of what the
/// slope says of the way to the neighbour.
#[test]
fn central_difference_weight_depends_on_face_position() {
    let (x, g) = slopes(&UNEVEN, &RAGGED);
    for axis in 0..3 {
        for speed in [4.0, -4.0] {
            let left = carried(axis, &UNEVEN, &RAGGED, speed);
            let face = |k: usize| {
                // Between cells k and k + 1; from the side that the stream comes from.
                let (own, other) = if speed > 0.0 { (k, k + 1) } else { (k + 1, k) };
                let (to_face, to_other) = (UNEVEN[k + 1] - x[own], x[other] - x[own]);
                let missing = RAGGED[other] - RAGGED[own] - g[own] * to_other;
                RAGGED[own] + g[own] * to_face + to_face / to_other / 3.0 * missing
            };
            for k in 1..7 {
                let exact = face(k) - face(k - 1);
                assert!(
                    (left[k] - exact).abs() < 1e-5,
                    "axis {axis}, {speed} m/s, cell {k}: {} {exact}",
                    left[k]
                );
            }
        }
    }
}

/// Layers that slide over each other: the stress between two is `mu` times the difference over the distance,
/// however ragged the profile, and what heats the air is its work and the conduction of the temperature.
#[test]
fn sliding_layers_have_the_exact_shear_stress() {
    let air = Air::new(1.225, 288.15);
    let (mu, x) = (0.7, slopes(&UNEVEN, &RAGGED).0);
    for axis in 0..3 {
        let mut s = solver_of(
            &row(axis, &UNEVEN),
            IdealGas::new(air),
            Laminar { viscosity: mu },
            settings([1.0, 0.0, 0.0], 1e-3),
        );
        let across = (axis + 1) % 3;
        for (k, q) in s.q.iter_mut().enumerate() {
            *q = [0.0; 5];
            q[1 + across] = RAGGED[k];
            q[4] = 0.01 * RAGGED[7 - k];
        }
        let (residual, ..) = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros()));
        for k in 1..7 {
            let slope = |f: &dyn Fn(usize) -> f64, k: usize| (f(k + 1) - f(k)) / (x[k + 1] - x[k]);
            let v = |k: usize| RAGGED[k];
            let shear = |k: usize| 6.0 * mu * slope(&v, k);
            let exact = shear(k - 1) - shear(k);
            let found = residual[k][1 + across];
            assert!((found - exact).abs() < 1e-5 * 6.0 * mu * 10.0, "axis {axis}, cell {k}: {found} {exact}");
        }
    }
}

/// A cell of 1 m between two of 0.1 m: its reconstruction would reach to 0.5 / 0.55 of its neighbours and is shortened
/// to 0.75 of them.
#[test]
fn reconstruction_of_slender_cells_is_bounded() {
    for axis in 0..3 {
        let at = [0.0, 1.0, 1.1, 2.1, 2.2, 3.2];
        let mut s = isothermal(&row(axis, &at), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
        for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
            *q = [2.0 * x[axis], 0.0, 0.0, 5.0 * x[axis]];
        }
        let (_, gradient, _) = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros()));
        for (cell, share) in [(1, 1.0), (2, 0.75 / (0.5 / 0.55)), (3, 1.0)] {
            let g = gradient[cell][axis];
            assert!((g[0] - 2.0 * share).abs() < 1e-5 && (g[3] - 5.0 * share).abs() < 1e-5, "{cell}: {g:?}");
        }
    }
}

/// Limited slopes of a row by hand: `(y^2 + 2 y b + e) / (y^2 + y b + 2 b^2 + e)` of the change `b` to a face and the largest
/// change `y` to a neighbour on that side, where `e` grows with the cube of the cell's size over the largest and the
/// square of what is typical: a density times the square of the speed for the pressure, the speed for velocities.
#[test]
fn limiter_scales_with_cell_size_and_stream_speed() {
    let k = 0.8;
    let (x, g) = slopes(&UNEVEN, &RAGGED);
    for axis in 0..3 {
        let mut s = isothermal(&row(axis, &UNEVEN), Inviscid, settings([0.6, 0.0, 0.8], 1e-3));
        s.spatial.limiter = Some(k);
        for (q, v) in s.q.iter_mut().zip(RAGGED) {
            *q = [0.3 * v, v, -v, 2.0 * v];
        }
        let (_, gradient, _) = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros()));
        let size = |c: usize| (6.0 * (UNEVEN[c + 1] - UNEVEN[c])).cbrt();
        let longest = (0..8).map(size).fold(0.0, f64::max);
        for c in 0..8 {
            for (v, (factor, typical)) in
                [(0.3, 1.225), (1.0, 1.0), (-1.0, 1.0), (2.0, 1.0)].into_iter().enumerate()
            {
                let e = (k * size(c) / longest).powi(3) * typical * typical;
                let mut share = 1.0f64;
                for face in [c, c + 1] {
                    let b = factor * g[c] * (UNEVEN[face] - x[c]);
                    let reach = |j: usize| factor * (RAGGED[j] - RAGGED[c]);
                    let around = [(c > 0).then(|| reach(c - 1)), (c < 7).then(|| reach(c + 1))];
                    let y = around
                        .into_iter()
                        .flatten()
                        .filter(|d| d * b > 0.0)
                        .fold(0.0, |m: f64, d| if d.abs() > m.abs() { d } else { m });
                    share = share.min((y * y + 2.0 * y * b + e) / (y * y + y * b + 2.0 * b * b + e));
                }
                let exact = share * factor * g[c];
                let found = gradient[c][axis][v];
                assert!(
                    (found - exact).abs() < 1e-5 * exact.abs().max(1.0),
                    "axis {axis}, cell {c}, {v}: {found} {exact}"
                );
            }
        }
    }
}

/// The same on cells that are skewed, where the way to a face has parts in all directions.
#[test]
fn limiter_is_evaluated_along_the_vector_to_skewed_faces() {
    let mut grid = box_grid([4, 3, 4], [0.0; 3], [1.0, 0.8, 1.1], [Patch::Slip; 6]);
    shake(&mut grid, 0.04);
    let mut s = isothermal(&grid, Inviscid, settings([0.6, 0.0, 0.8], 1e-3));
    let mut noise = Noise(17);
    for q in &mut s.q {
        *q = std::array::from_fn(|_| noise.next());
    }
    let free = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros())).1;
    s.spatial.limiter = Some(0.8);
    let found = evaluate(&s, &s.domain(), &stepping(&s, Vec3::zeros())).1;
    let (t, m) = (&s.topology, &s.metrics);
    let longest = m.size.iter().fold(0.0f64, |a, b| a.max(*b));
    let mut share = vec![[1.0f64; 4]; s.q.len()];
    t.for_each_side(|face, c, _| {
        let way = m.face_centre(t, face) - m.centre(c);
        let row = &t.adjacency.cell[t.adjacency.start[c] as usize..t.adjacency.start[c + 1] as usize];
        for v in 0..4 {
            let b = Vec3::new(free[c][0][v], free[c][1][v], free[c][2][v]).dot(&way);
            let reach = row.iter().map(|&j| s.q[j as usize][v] - s.q[c][v]).filter(|d| d * b > 0.0);
            let y = reach.fold(0.0f64, |m, d| if d.abs() > m.abs() { d } else { m });
            let typical = [1.225, 1.0, 1.0, 1.0][v];
            let e = (0.8 * m.size[c] / longest).powi(3) * typical * typical;
            share[c][v] = share[c][v].min((y * y + 2.0 * y * b + e) / (y * y + y * b + 2.0 * b * b + e));
        }
    });
    let mut limited = 0;
    for c in 0..s.q.len() {
        for v in 0..4 {
            limited += usize::from(share[c][v] < 0.9);
            for d in 0..3 {
                let exact = share[c][v] * free[c][d][v];
                assert!((found[c][d][v] - exact).abs() < 1e-9 * exact.abs().max(1.0), "cell {c}, {v}");
            }
        }
    }
    assert!(limited > s.q.len());
}

/// A box cut in two by a plate along z = 0, with other linear fields on its two sides.
fn divided() -> FlowGrid {
    let mut grid = plate_grid([3, 3, 4], [-1.0; 3], [1.0; 3], [Patch::Slip; 6], 2, [0..3, 0..3]);
    // Shaken within the plate, which stays plane.
    let mut noise = Noise(7);
    for x in &mut grid.coords {
        let plane = x[2].abs() < 1e-9;
        for (d, x) in x.iter_mut().enumerate() {
            *x += if plane && d == 2 { 0.0 } else { 0.03 * noise.next() };
        }
    }
    grid
}

/// Fields inside (where the area vector of the plate comes from) and outside.
fn sides<const N: usize>() -> [Linear<N>; 2] {
    let mut outside = Linear::<N>::new();
    outside.at[0] = -80.0;
    outside.at[1] = 1.0;
    for (d, g) in outside.slope.iter_mut().enumerate() {
        for v in 0..N {
            g[v] = -0.7 * g[v] + if v == 0 { 25.0 * (d as f64 - 1.5) } else { 0.0 };
        }
    }
    [Linear::new(), outside]
}

fn fill<G: Gas<N>, const N: usize>(s: &mut Solver<G, N>, fields: &[Linear<N>; 2]) {
    // The area vector of the plate is along z: inside is below.
    for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
        *q = fields[usize::from(x[2] > 0.0)].value(Vec3::from(*x));
    }
}

/// Cloth between two linear fields: what passes solves the balance of cloth and half cells with the pressures that the
/// fields have on the two sides of each face, and carries what the side has that it leaves.
#[expect(clippy::too_many_lines, reason = "one balance, set up and compared")]
fn cloth<G: Gas<N>, const N: usize>(gas: G, turned: f64, skew: f64) {
    let (a, b) = (60.0, 9.0);
    let mut grid = divided();
    grid.coords.iter_mut().for_each(|x| x[0] += skew * x[2]);
    let mut s = solver_with_cloth(&grid, gas, Inviscid, settings(WIND, 1e-3), Some(Permeability::new(a, b)));
    let mut fields = sides::<N>();
    (fields[0].at[0], fields[1].at[0]) = (200.0 * turned, -200.0 * turned);
    if skew != 0.0 {
        // Gradients of needles are shortened: without any.
        fields.iter_mut().for_each(|f| f.slope = [[0.0; N]; 3]);
    }
    fill(&mut s, &fields);
    let mut noise = Noise(9);
    for f in &mut s.metrics.faces {
        f.grid_flux = 0.05 * noise.next();
    }
    let frame = Vec3::new(0.3, -0.4, 0.2);
    let scheme = stepping(&s, frame);
    let n = s.q.len();
    let (mut q, mut gradient, mut residual) = (s.q.clone(), vec![[[0.0; N]; 3]; n], vec![[0.0; N]; n]);
    let previous = [0.02f32, -0.05];
    let mut face_flux = vec![FaceFlux { previous, ..FaceFlux::default() }; s.metrics.faces.len()];
    s.spatial.evaluate(
        &s.domain(),
        &scheme,
        &mut q,
        Slopes::one_pass(&mut gradient),
        &mut residual,
        &mut face_flux,
    );
    // The same grid with walls: all but what passes the cloth.
    let mut tight = solver_with_cloth(&grid, gas, Inviscid, settings(WIND, 1e-3), None);
    tight.q.clone_from(&s.q);
    for (f, g) in tight.metrics.faces.iter_mut().zip(&s.metrics.faces) {
        f.grid_flux = g.grid_flux;
    }
    let mut closed = vec![[0.0; N]; n];
    let mut kept = vec![FaceFlux { previous, ..FaceFlux::default() }; s.metrics.faces.len()];
    tight.spatial.evaluate(
        &tight.domain(),
        &scheme,
        &mut q,
        Slopes::one_pass(&mut gradient),
        &mut closed,
        &mut kept,
    );
    assert_eq!(s.topology.porous_faces.len(), 9);
    for porous_face in &s.topology.porous_faces {
        let (i, o, k) =
            (porous_face.inside as usize, porous_face.outside as usize, porous_face.face as usize);
        let (f, x) = (&s.metrics.faces[k], s.metrics.border(porous_face.face));
        let (l, r) = (fields[0].value(x), fields[1].value(x));
        let unit = f.area * (1.0 / f.area.norm());
        let between = s.metrics.centre(o) - s.metrics.centre(i);
        // Skewed cells keep a fifth of their distance.
        let spacing = between.dot(&unit).max(0.2 * between.norm());
        let mean: Vec3 = Vec3::from_fn(|d, _| 0.5 * (s.q[i][1 + d] + s.q[o][1 + d]));
        let against: Vec3 = Vec3::from_fn(|d, _| mean[d] - frame[d]);
        let speed = (against.dot(&against) + scheme.floor_squared).sqrt();
        let jump = l[0] - r[0];
        let rho = gas.density(if jump > 0.0 { &l } else { &r });
        let relative = mean.dot(&unit) - f.grid_flux / f.area.norm();
        // delta (t0 e + t1 e' + t2 e'') + 2 (U + 10 floor) e = jump - a v - b |v| v, with e = rho (v - relative).
        let history =
            scheme.rhie_chow[1] * f64::from(previous[0]) + scheme.rhie_chow[2] * f64::from(previous[1]);
        let balance = |v: f64| {
            let e = rho * (v - relative);
            let fade = 2.0 * (speed + 10.0 * scheme.floor_squared.sqrt());
            spacing * (scheme.rhie_chow[0] * e + history) + fade * e - jump + a * v + b * v.abs() * v
        };
        let (mut low, mut high) = (-50.0, 50.0);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if balance(middle) > 0.0 { high = middle } else { low = middle }
        }
        let mass = rho * f.area.norm() * low;
        assert!(skew != 0.0 || mass * turned > 0.0, "{mass}");
        let found = f64::from(face_flux[k].mass);
        assert!((found - mass).abs() < 2e-5 * mass.abs(), "{found} {mass}");
        let rhie_chow = rho * (low - relative);
        assert!(
            (f64::from(face_flux[k].rhie_chow) - rhie_chow).abs() < 2e-5 * rhie_chow.abs(),
            "{} {rhie_chow}",
            face_flux[k].rhie_chow
        );
        let carried = gas.carried(if mass > 0.0 { &l } else { &r });
        for v in 0..N {
            let exact = mass * carried[v];
            let scale = 3e-5 * mass.abs() * carried[v].abs().max(1.0);
            assert!(
                (residual[i][v] - closed[i][v] - exact).abs() < scale,
                "{v}: {} {exact}",
                residual[i][v] - closed[i][v]
            );
            assert!((residual[o][v] - closed[o][v] + exact).abs() < scale);
        }
    }
}

#[test]
fn porous_flux_between_linear_fields_satisfies_its_momentum_balance() {
    let air = Air::new(1.225, 288.15);
    for turned in [1.0, -1.0] {
        cloth(Isothermal::new(air), turned, 0.0);
        cloth(IdealGas::new(air), turned, 0.0);
        cloth(Isothermal::new(air), turned, 20.0);
    }
}

/// Loads between two linear fields: the pressures on the two sides and the shear of both, force and moment.
#[test]
fn loads_of_linear_fields_are_exact() {
    let gas = Isothermal::new(Air::new(1.225, 288.15));
    let mu = 0.3;
    let mut s = solver_with_cloth(&divided(), gas, Laminar { viscosity: mu }, settings(WIND, 1e-3), None);
    let fields = sides::<4>();
    fill(&mut s, &fields);
    let (_, gradient, _) = evaluate(&s, &s.domain(), &s.scheme);
    s.gradient = gradient;
    let mut loads = Loads::new(&s);
    let total = loads.compute(&s);
    let (mut force, mut moment) = ([0.0; 3], [0.0; 3]);
    let t = &s.topology;
    for (k, &face) in t.canopy_face.iter().enumerate() {
        let (f, x) = (&s.metrics.faces[face as usize], s.metrics.border(face));
        let unit = f.area * (1.0 / f.area.norm());
        let jump = fields[0].value(x)[0] - fields[1].value(x)[0];
        let mut shear = [0.0; 3];
        for side in t.no_slip.iter().filter(|s| s.canopy == k as u32) {
            let c = side.cell as usize;
            let height = (x - s.metrics.centre(c)).dot(&unit).abs();
            let u = physics::velocity(&s.q[c]);
            for d in 0..3 {
                shear[d] += mu * (u[d] - u.dot(&unit) * unit[d]) / height;
            }
        }
        let load = loads.faces[k];
        assert!((load[0] - jump).abs() < 1e-3, "{} {jump}", load[0]);
        (0..3).for_each(|d| assert!((load[1 + d] - shear[d]).abs() < 1e-9, "{load:?} {shear:?}"));
        let push: Vec3 = Vec3::from_fn(|d, _| jump * f.area[d] + f.area.norm() * shear[d]);
        let arm = x.cross(&push);
        for d in 0..3 {
            force[d] += push[d];
            moment[d] += arm[d];
        }
    }
    for d in 0..3 {
        assert!((total.force[d] - force[d]).abs() < 1e-3, "{total:?} {force:?}");
        assert!((total.moment[d] - moment[d]).abs() < 1e-3, "{total:?} {moment:?}");
    }
}

/// Gradients in boxes with a plane of symmetry at low x that moves at `plane` m/s, of the velocity (plane + 3 x, 2 y - z, y).
fn gradients_are_exact(shape: BoxShape, cells: [usize; 3], plane: f64) {
    let mut patches = [Patch::FarField; 6];
    (patches[0], patches[2], patches[3]) = (Patch::Symmetry, Patch::FarField, Patch::Outlet);
    let grid = box_grid_of(shape, cells, [0.0; 3], [1.0, 0.8, 1.1], patches);
    let mut s = isothermal(&grid, Inviscid, settings(WIND, 1e-3));
    for f in &mut s.metrics.faces {
        f.grid_flux = f.area.x * plane;
    }
    for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
        *q = [50.0, plane + 3.0 * x[0], 2.0 * x[1] - x[2], x[1]];
    }
    let mut g = s.gradient.clone();
    let domain = s.domain();
    domain.gradients.apply(&s.topology, &s.q, &mut g);
    domain.gradients.add_images(&s.metrics, &s.q, &mut g);
    let exact = [[0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 2.0, 1.0], [0.0, 0.0, -1.0, 0.0]];
    for (c, g) in g.iter().enumerate() {
        for (found, exact) in g.iter().flatten().zip(exact.iter().flatten()) {
            assert!((found - exact).abs() < 2e-6, "{shape:?}, cell {c}: {g:?}");
        }
    }
}

/// With a single layer of cells the image alone gives the slope across it.
#[test]
fn gradients_at_planes_of_symmetry_are_exact_for_symmetric_fields() {
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms] {
        for plane in [0.0, 2.0] {
            gradients_are_exact(shape, [4, 3, 5], plane);
            gradients_are_exact(shape, [1, 3, 5], plane);
        }
    }
}
