//! One application of each approximate inverse against the dense system that it stands for.
//!
//! What these matrices hold changes no converged answer, so that no flow shows a wrong entry. Here each is written down once
//! more as it is defined: flux derivatives by differences, dense blocks, dense elimination. The air is so cold that sound is
//! about as fast as the stream, and so viscous that every term counts.

#![allow(clippy::needless_range_loop)]

use crate::common::{Noise, isothermal, settings, solver_with_cloth};
use flow_solver::geometry::FaceMetric;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::gradient::Field;
use flow_solver::implicit::{Correction, LuSgs, PressureCorrection, PressureSystem};
use flow_solver::permeable::Permeability;
use flow_solver::physics::{
    self, Air, BoundaryFace, EddyViscosity, FaceFlux, FarField, FluxParameters, Gas, IdealGas, Inviscid,
    Isothermal, Turbulent, Viscosity, WallTreatment, preconditioner, reference_speed, spectral_radius,
};
use flow_solver::residual::Domain;
use flow_solver::topology::Side;
use flow_solver::{Settings, Solver};
use mesh::{FlowGrid, Patch, box_grid, plate_grid};
use nalgebra::{DMatrix, DVector};

/// A box with cloth in its middle, every kind of boundary, and no cell with two far faces.
fn grid() -> FlowGrid {
    let patches =
        [Patch::FarField, Patch::FarField, Patch::Slip, Patch::Symmetry, Patch::Wall, Patch::Outlet];
    let mut grid = plate_grid([3, 2, 4], [0.0; 3], [1.2, 0.9, 1.5], patches, 2, [1..3, 0..2]);
    let mut noise = Noise(7);
    for x in grid.coords.iter_mut().flatten() {
        *x += 0.02 * noise.next();
    }
    grid
}

const CLOTH: (f64, f64) = (20.0, 6.0);
const WIND: Vec3 = Vec3::new(1.3, 3.0, 1.0);
const FRAME: Vec3 = Vec3::new(0.2, -0.4, 0.3);

fn cold() -> Air {
    Air::new(1.2, 0.3)
}

/// A solver, its constants of a step, and the eddy viscosity of its cells.
fn case<G: Gas<N>, V: Viscosity, const N: usize>(
    gas: G,
    viscosity: V,
) -> (Solver<G, N>, FluxParameters, Vec<f64>) {
    let set = Settings { air: cold(), ..settings(WIND, 1e-3) };
    let cloth = Permeability::new(CLOTH.0, CLOTH.1);
    let mut s = solver_with_cloth(&grid(), gas, viscosity, set, Some(cloth));
    let mut noise = Noise(5);
    for q in &mut s.q {
        let (at, size) = ([2.0, 1.5, 2.0, 1.0, 0.01], [3.0, 2.0, 2.0, 2.0, 0.02]);
        *q = std::array::from_fn(|v| at[v] + size[v] * noise.next());
    }
    for f in &mut s.metrics.faces {
        f.grid_flux = f.area.dot(&FRAME) + 0.03 * noise.next();
    }
    let eddy = (0..s.q.len()).map(|_| 0.4 + 0.2 * noise.next()).collect();
    let scheme = FluxParameters { rate: 15.0, rhie_chow: [18.0, -21.0, 3.0], frame: FRAME, ..s.scheme };
    (s, scheme, eddy)
}

/// Flux of `q` through a face.
fn flux<G: Gas<N>, const N: usize>(gas: &G, q: &[f64; N], face: &FaceMetric) -> [f64; N] {
    let s = face.area;
    let mass = gas.density(q) * (q[1] * s[0] + q[2] * s[1] + q[3] * s[2] - face.grid_flux);
    let (carried, push) = (gas.carried(q), gas.pressure_flux(q[0], s, face.grid_flux));
    std::array::from_fn(|v| mass * carried[v] + push[v])
}

/// Derivative of [`flux`] by the state.
fn flux_jacobian<G: Gas<N>, const N: usize>(gas: &G, q: &[f64; N], face: &FaceMetric) -> DMatrix<f64> {
    let mut a = DMatrix::zeros(N, N);
    for c in 0..N {
        let h = [1e-3, 1e-4, 1e-4, 1e-4, 1e-6][c];
        let at = |h: f64| {
            let mut q = *q;
            q[c] += h;
            flux(gas, &q, face)
        };
        let (low, high) = (at(-h), at(h));
        (0..N).for_each(|r| a[(r, c)] = (high[r] - low[r]) / (2.0 * h));
    }
    a
}

/// What turns residuals of conserved quantities into those of the unknowns.
fn to_primitive<G: Gas<N>, const N: usize>(gas: &G, q: &[f64; N]) -> DMatrix<f64> {
    let mut t = DMatrix::zeros(N, N);
    for c in 0..N {
        let mut unit = [0.0; N];
        unit[c] = 1.0;
        let column = gas.primitive_residual(q, &unit);
        (0..N).for_each(|r| t[(r, c)] = column[r]);
    }
    t
}

/// Air that passes a pore between the cells' own states without history: the share of the mean velocity that passes
/// and the derivative of the mass flux by the pressure jump.
fn porous_face<G: Gas<N>, const N: usize>(
    gas: &G,
    s: &Solver<G, N>,
    scheme: &FluxParameters,
    cells: [usize; 2],
    face: &FaceMetric,
) -> (f64, f64) {
    let [i, o] = cells;
    let area = face.area.norm();
    let unit = face.area * (1.0 / area);
    let (l, r) = (&s.q[i], &s.q[o]);
    let mean: Vec3 = Vec3::from_fn(|d, _| 0.5 * (l[1 + d] + r[1 + d]));
    let against = mean - scheme.frame;
    let speed = (against.dot(&against) + scheme.floor_squared).sqrt();
    let spacing = (s.metrics.centre(o) - s.metrics.centre(i)).dot(&unit);
    let jump = l[0] - r[0];
    let rho = gas.density(if jump > 0.0 { l } else { r });
    let resistance =
        rho * (spacing * scheme.rhie_chow[0] + 2.0 * (speed + 10.0 * scheme.floor_squared.sqrt()));
    let relative = mean.dot(&unit) - face.grid_flux / area;
    let balance = |v: f64| resistance * (v - relative) - jump + CLOTH.0 * v + CLOTH.1 * v.abs() * v;
    let (mut low, mut high) = (-100.0, 100.0);
    for _ in 0..90 {
        let middle = 0.5 * (low + high);
        if balance(middle) > 0.0 { high = middle } else { low = middle }
    }
    let stiffness = CLOTH.0 + resistance + 2.0 * CLOTH.1 * f64::abs(low);
    (resistance / stiffness, rho * area / stiffness)
}

fn porous_faces<G: Gas<N>, const N: usize>(s: &Solver<G, N>) -> Vec<([usize; 2], usize)> {
    s.topology
        .porous_faces
        .iter()
        .map(|p| ([p.inside as usize, p.outside as usize], p.face as usize))
        .collect()
}

/// Derivative of the friction on a wall by the velocity, times the height, by differences; `None` where the wall is resolved.
fn stiffness<G: Gas<N>, const N: usize>(
    s: &Solver<G, N>,
    on: &Domain<'_>,
    scheme: &FluxParameters,
    side: &Side,
) -> Option<f64> {
    let wall = s.spatial.near_wall(on, scheme, &s.q, side);
    wall.law?;
    let (speed, step) = (wall.slip.norm(), 1e-5 * wall.slip.norm());
    let nu = wall.viscosity / s.spatial.gas.density(&s.q[side.cell as usize]);
    let stress = |u: f64| wall.viscosity * u * physics::WallLaw::new(u, wall.height, nu).stress;
    Some((stress(speed + step) - stress(speed - step)) / (2.0 * step))
}

/// `(D + L) D^-1 (D + U) x = -r` of LU-SGS: `D` of pseudo time, time and half the waves, off-diagonal blocks
/// `(A - lambda Gamma) / 2`.
#[expect(clippy::too_many_lines, reason = "the method written down once more, from top to bottom")]
fn lu_sgs<G: Gas<N>, V: Viscosity, const N: usize>(gas: G, viscosity: V, own: f64) {
    let (s, scheme, eddy) = case::<G, V, N>(gas, viscosity);
    let on = Domain { eddy: &eddy, ..s.domain() };
    let (courant, extra, share) = (3.0, 1.7, 0.8);
    let mut solver = LuSgs::<N>::new(&s.topology, courant);
    let gradient = vec![[[0.0; N]; 3]; s.q.len()];
    solver.assemble(&s.spatial, &on, &scheme, Field { q: &s.q, gradient: &gradient }, s.face_flux(), extra);
    let mut noise = Noise(13);
    let r: Vec<[f64; N]> =
        s.q.iter().map(|_| std::array::from_fn(|v| [1.0, 1.0, 1.0, 1.0, 0.01][v] * noise.next())).collect();
    let mut q = s.q.clone();
    Correction::<G, N>::apply(&mut solver, &gas, &on, &scheme, &r, share, &mut q);

    let (t, m) = (&s.topology, &s.metrics);
    let n = s.q.len();
    let velocity = |c: usize| physics::velocity(&s.q[c]);
    let sound = |c: usize| gas.sound_speed_squared(&s.q[c]).sqrt();
    let nu = |c: usize| {
        if V::ACTIVE {
            (own + if s.spatial.viscosity.transported() { eddy[c] } else { 0.0 }) / gas.density(&s.q[c])
        } else {
            0.0
        }
    };
    let reference: Vec<f64> = (0..n)
        .map(|c| {
            let d = velocity(c) - FRAME;
            let speed = (d.dot(&d) + scheme.floor_squared).sqrt();
            reference_speed(speed, m.size[c], scheme.rate, nu(c), sound(c))
        })
        .collect();
    let gamma = |c: usize| {
        let g = preconditioner(&gas, &s.q[c], reference[c]);
        DMatrix::from_fn(N, N, |r, c| g[r][c])
    };
    let mut waves = vec![0.0; n];
    let mut a = DMatrix::<f64>::zeros(n * N, n * N);
    for (k, &[i, j]) in t.cells.iter().enumerate() {
        let (i, j, f) = (i as usize, j as usize, &m.faces[k]);
        let area = f.area.norm();
        let wave = |c: usize| {
            let along = (velocity(c).dot(&f.area) - f.grid_flux) / area;
            spectral_radius(along, reference[c], sound(c)) + 2.0 * nu(c) / f.spacing()
        };
        let wave = wave(i).max(wave(j)) * area;
        waves[i] += wave;
        waves[j] += wave;
        for (row, column, sign) in [(i, j, 1.0), (j, i, -1.0)] {
            let block = 0.5 * (sign * flux_jacobian(&gas, &s.q[column], f) - wave * gamma(column));
            let block = to_primitive(&gas, &s.q[row]) * block;
            a.view_mut((row * N, column * N), (N, N)).copy_from(&block);
        }
    }
    for side in t.open_sides() {
        let c = side.cell as usize;
        waves[c] += (velocity(c).norm() + sound(c)) * m.faces[side.face as usize].area.norm();
    }
    for (cells, face) in porous_faces(&s) {
        let (_, slope) = porous_face(&gas, &s, &scheme, cells, &m.faces[face]);
        cells.iter().for_each(|&c| waves[c] += 2.0 * slope * reference[c] * reference[c]);
    }
    if V::ACTIVE {
        for side in &t.no_slip {
            let c = side.cell as usize;
            let nu = stiffness(&s, &on, &scheme, side).map_or_else(|| nu(c), |mu| mu / gas.density(&s.q[c]));
            waves[c] += 2.0 * nu * m.faces[side.face as usize].area.norm() / m.height(side);
        }
    }
    for c in 0..n {
        let exact = gas.jacobian(&s.q[c]);
        let exact = DMatrix::from_fn(N, N, |r, c| exact[r][c]);
        let pseudo = waves[c] * (0.5 + extra / courant);
        let block = to_primitive(&gas, &s.q[c]) * (pseudo * gamma(c) + scheme.rate * m.volume[c] * exact);
        a.view_mut((c * N, c * N), (N, N)).copy_from(&block);
    }
    let part = |keep: &dyn Fn(usize, usize) -> bool| {
        DMatrix::from_fn(n * N, n * N, |r, c| if keep(r / N, c / N) { a[(r, c)] } else { 0.0 })
    };
    let (low, high) = (part(&|r, c| c <= r), part(&|r, c| c >= r));
    let b = DVector::from_fn(n * N, |k, _| -r[k / N][k % N]);
    let x = high.lu().solve(&(part(&|r, c| c == r) * low.lu().solve(&b).unwrap())).unwrap();
    let size: [f64; N] = std::array::from_fn(|v| (0..n).fold(0.0, |m: f64, c| m.max(x[c * N + v].abs())));
    for c in 0..n {
        for v in 0..N {
            let (found, exact) = (q[c][v] - s.q[c][v], share * x[c * N + v]);
            assert!((found - exact).abs() < 1e-5 * size[v], "cell {c}, {v}: {found} {exact}");
        }
    }
}

#[test]
fn lu_sgs_matches_its_dense_factors() {
    lu_sgs::<_, _, 4>(Isothermal::new(cold()), Inviscid, 0.0);
    lu_sgs::<_, _, 5>(
        IdealGas::new(cold()),
        Turbulent { viscosity: 0.3, eddies: EddyViscosity::TransportInput, wall: WallTreatment::Resolved },
        0.3,
    );
    let wall = WallTreatment::Automatic;
    lu_sgs::<_, _, 4>(
        Isothermal::new(cold()),
        Turbulent { viscosity: 1e-3, eddies: EddyViscosity::TransportInput, wall },
        1e-3,
    );
}

/// Share of the neighbours that follow a correction of the velocity, as the method is published with it.
const FOLLOWING: f64 = 0.8;

/// The pressure correction as it is defined: one symmetric sweep of the transport, the compact pressure equation by
/// elimination, the velocity after the gradient of the pressure.
#[expect(clippy::too_many_lines, reason = "the method written down once more, from top to bottom")]
fn pressure_correction<G: Gas<N>, V: Viscosity, const N: usize>(gas: G, viscosity: V, own: f64) {
    let (s, scheme, eddy) = case::<G, V, N>(gas, viscosity);
    let on = Domain { eddy: &eddy, ..s.domain() };
    let (extra, share) = (1.3, 0.8);
    let n = s.q.len();
    let gradient = vec![[[0.0; N]; 3]; n];
    let mut noise = Noise(11);
    let mut face_flux: Vec<FaceFlux> = s
        .metrics
        .faces
        .iter()
        .map(|_| FaceFlux { mass: noise.next() as f32, ..FaceFlux::default() })
        .collect();
    // Cloth that is passed both ways.
    for (k, (_, face)) in porous_faces(&s).into_iter().enumerate() {
        face_flux[face].mass = [0.6, -0.4][k % 2];
    }
    let r: Vec<[f64; N]> =
        s.q.iter().map(|_| std::array::from_fn(|v| [1.0, 1.0, 1.0, 1.0, 0.01][v] * noise.next())).collect();
    let mut solver = PressureCorrection::new(&s.topology);
    (solver.tolerance, solver.max_iterations) = (1e-6, 60);
    solver.assemble(&s.spatial, &on, &scheme, Field { q: &s.q, gradient: &gradient }, &face_flux, extra);
    let mut q = s.q.clone();
    let report = Correction::<G, N>::apply(&mut solver, &gas, &on, &scheme, &r, share, &mut q);
    assert!(report.drop <= 1e-6, "{report:?}");

    let (t, m) = (&s.topology, &s.metrics);
    let rate = extra * scheme.rate;
    let rho: Vec<f64> = s.q.iter().map(|q| gas.density(q)).collect();
    let c2: Vec<f64> = s.q.iter().map(|q| gas.sound_speed_squared(q)).collect();
    let mu = |c: usize| {
        if V::ACTIVE { own + if s.spatial.viscosity.transported() { eddy[c] } else { 0.0 } } else { 0.0 }
    };
    let mass = |face: usize| f64::from(face_flux[face].mass);
    let area = |face: u32| m.faces[face as usize].area.norm();
    // Transport: storage, what is carried in from upwind, half the velocity diffusion's mean, friction.
    let mut a = DMatrix::<f64>::zeros(n, n);
    for c in 0..n {
        a[(c, c)] = rate * rho[c] * m.volume[c];
    }
    for (k, &[i, j]) in t.cells.iter().enumerate() {
        let (i, j, f) = (i as usize, j as usize, &m.faces[k]);
        let both = 0.25 * scheme.velocity_diffusion * mass(k).abs()
            + 0.5 * (mu(i) + mu(j)) * f.area.norm() / f.spacing();
        for (row, column, inflow) in [(i, j, -mass(k)), (j, i, mass(k))] {
            a[(row, column)] = -(both + inflow.max(0.0));
            a[(row, row)] += both + inflow.max(0.0);
        }
    }
    let neighbours: Vec<f64> =
        (0..n).map(|i| -(0..n).filter(|j| *j != i).map(|j| a[(i, j)]).sum::<f64>()).collect();
    for side in t.open_sides() {
        let c = side.cell as usize;
        a[(c, c)] += (-mass(side.face as usize)).max(0.0);
    }
    if V::ACTIVE {
        for side in &t.no_slip {
            let c = side.cell as usize;
            let mu = stiffness(&s, &on, &scheme, side).unwrap_or_else(|| mu(c));
            a[(c, c)] += mu * area(side.face) / m.height(side);
        }
    }
    let passing: Vec<_> = porous_faces(&s)
        .into_iter()
        .map(|(cells, face)| (cells, face, porous_face(&gas, &s, &scheme, cells, &m.faces[face])))
        .collect();
    for &([i, o], face, _) in &passing {
        a[(i, i)] += (-mass(face)).max(0.0);
        a[(o, o)] += mass(face).max(0.0);
    }
    let part = |keep: &dyn Fn(usize, usize) -> bool| {
        DMatrix::from_fn(n, n, |r, c| if keep(r, c) { a[(r, c)] } else { 0.0 })
    };
    let (low, high) = (part(&|r, c| c <= r).lu(), part(&|r, c| c >= r).lu());
    let diagonal = part(&|r, c| c == r);
    // Velocity and temperature after the sweep.
    let mut x = vec![[0.0; 4]; n];
    for v in 1..N {
        let b = DVector::from_fn(n, |c, _| -r[c][v]);
        let y = high.solve(&(&diagonal * low.solve(&b).unwrap())).unwrap();
        (0..n).for_each(|c| x[c][v - 1] = y[c]);
    }
    // The velocity through a far face that is not left is held by the stiffness of sound against that of the transport.
    let leaving = |side: &flow_solver::topology::Side| {
        let metric = &m.faces[side.face as usize];
        FarField.leaving(&BoundaryFace { scheme: &scheme, metric, sign: side.sign, pressure: 0.0 })
    };
    let held: Vec<(usize, Vec3, f64)> = t
        .sides_of(Patch::FarField)
        .map(|side| {
            let c = side.cell as usize;
            let stiff = (1.0 - leaving(side)) * 0.5 * rho[c] * c2[c].sqrt() * area(side.face);
            let unit = m.faces[side.face as usize].area * (1.0 / area(side.face));
            (c, unit, stiff / (stiff + a[(c, c)]))
        })
        .collect();
    assert!(
        t.sides_of(Patch::FarField).any(|s| leaving(s) > 0.1 && leaving(s) < 0.9),
        "a face that is left in part"
    );
    for &(c, unit, part) in &held {
        let along = part * Vec3::new(x[c][0], x[c][1], x[c][2]).dot(&unit);
        (0..3).for_each(|d| x[c][d] -= along * unit[d]);
    }
    let response: Vec<f64> =
        (0..n).map(|c| rho[c] * m.volume[c] / (a[(c, c)] - FOLLOWING * neighbours[c])).collect();
    // Pressure: compression, what it drives through faces, pores and boundaries; against what the velocity leaves.
    let mut p = DMatrix::<f64>::zeros(n, n);
    let mut b = DVector::from_fn(n, |c, _| -r[c][0]);
    let flow = |c: usize, s: Vec3| Vec3::new(x[c][0], x[c][1], x[c][2]).dot(&s);
    for c in 0..n {
        p[(c, c)] = rate * m.volume[c] / c2[c];
    }
    for (k, &[i, j]) in t.cells.iter().enumerate() {
        let (i, j, f) = (i as usize, j as usize, &m.faces[k]);
        let drive = 0.5 * (response[i] + response[j]) * f.area.norm() / f.spacing();
        let moved = 0.25 * (rho[i] + rho[j]) * (flow(i, f.area) + flow(j, f.area));
        for (row, column, sign) in [(i, j, 1.0), (j, i, -1.0)] {
            p[(row, row)] += drive;
            p[(row, column)] -= drive;
            b[row] -= sign * moved;
        }
    }
    for &([i, o], face, (open, slope)) in &passing {
        let s = m.faces[face].area;
        let moved = 0.25 * (rho[i] + rho[o]) * open * (flow(i, s) + flow(o, s));
        p[(i, i)] += slope;
        p[(o, o)] += slope;
        b[i] -= moved;
        b[o] += moved;
    }
    for (patch, far) in [(Patch::Outlet, false), (Patch::FarField, true)] {
        for side in t.sides_of(patch) {
            let (c, f) = (side.cell as usize, &m.faces[side.face as usize]);
            let left = if far { leaving(side) } else { 1.0 };
            let (open, closed) = (response[c] / f.spacing(), 0.5 / c2[c].sqrt());
            p[(c, c)] += f.area.norm() * (left * open + (1.0 - left) * closed);
            b[c] -= 0.5 * (1.0 + left) * rho[c] * side.sign * flow(c, f.area);
        }
    }
    let dp = p.lu().solve(&b).unwrap();
    let change: Vec<[f64; 1]> = dp.iter().map(|p| [*p]).collect();
    let mut slopes = vec![[[0.0; 1]; 3]; n];
    on.gradients.apply(t, &change, &mut slopes);
    let mut push: Vec<Vec3> = slopes.iter().map(|g| Vec3::new(g[0][0], g[1][0], g[2][0])).collect();
    for &(c, unit, part) in &held {
        let along = part * push[c].dot(&unit);
        (0..3).for_each(|d| push[c][d] -= along * unit[d]);
    }
    let mut exact = vec![[0.0; N]; n];
    for c in 0..n {
        exact[c][0] = share * dp[c];
        for d in 0..3 {
            exact[c][1 + d] = share * (x[c][d] - response[c] / rho[c] * push[c][d]);
        }
        if N > 4 {
            // With adiabatic compression.
            exact[c][N - 1] = share * (x[c][3] + gas.compression(&s.q[c])[N - 1] * dp[c]);
        }
    }
    let size: [f64; N] = std::array::from_fn(|v| exact.iter().fold(0.0, |m: f64, x| m.max(x[v].abs())));
    for c in 0..n {
        for v in 0..N {
            let found = q[c][v] - s.q[c][v];
            assert!((found - exact[c][v]).abs() < 3e-5 * size[v], "cell {c}, {v}: {found} {}", exact[c][v]);
        }
    }
}

#[test]
fn pressure_correction_matches_its_dense_system() {
    pressure_correction::<_, _, 4>(Isothermal::new(cold()), Inviscid, 0.0);
    pressure_correction::<_, _, 5>(
        IdealGas::new(cold()),
        Turbulent { viscosity: 0.3, eddies: EddyViscosity::TransportInput, wall: WallTreatment::Resolved },
        0.3,
    );
    let wall = WallTreatment::Automatic;
    pressure_correction::<_, _, 4>(
        Isothermal::new(cold()),
        Turbulent { viscosity: 1e-3, eddies: EddyViscosity::TransportInput, wall },
        1e-3,
    );
}

/// Conjugate gradients end after as many iterations as there are unknowns, but for single precision, with the solution;
/// and they report the residual that is really left.
#[test]
fn conjugate_gradients_converge_in_n_iterations() {
    let n = 6;
    let s = isothermal(
        &box_grid([n, 1, 1], [0.0; 3], [1.0; 3], [Patch::Slip; 6]),
        Inviscid,
        settings([1.0, 0.0, 0.0], 1e-3),
    );
    let rows = &s.topology.adjacency;
    let mut system = PressureSystem::new(rows, n);
    let mut dense = DMatrix::<f64>::zeros(n, n);
    let mut noise = Noise(3);
    for i in 0..n {
        let own = 0.05 + 0.05 * noise.next().abs() as f32;
        system.matrix.own[i] = own;
        dense[(i, i)] += f64::from(own);
    }
    for (f, &[i, j]) in s.topology.cells.iter().enumerate() {
        let k = 1.0 + 0.8 * noise.next() as f32;
        let (i, j) = (i as usize, j as usize);
        rows.slot[f].iter().for_each(|&slot| system.matrix.off[slot as usize] = k);
        for (row, column) in [(i, j), (j, i)] {
            dense[(row, row)] += f64::from(k);
            dense[(row, column)] -= f64::from(k);
        }
    }
    system.prepare(&s.domain());
    let b: Vec<f32> = (0..n).map(|_| noise.next() as f32).collect();
    let exact = dense.clone().lu().solve(&DVector::from_fn(n, |i, _| f64::from(b[i]))).unwrap();
    let mut x = vec![0.0f32; n];
    let mut best = f64::INFINITY;
    for most in 1..=n {
        system.source().copy_from_slice(&b);
        let report = system.solve(rows, &s.halo, &mut x, 1e-30, most);
        assert_eq!(report.iterations, most);
        let b = DVector::from_fn(n, |i, _| f64::from(b[i]));
        let left = (&b - &dense * DVector::from_fn(n, |i, _| f64::from(x[i]))).norm() / b.norm();
        // Rounding of the matrix times its condition.
        assert!((left - report.drop).abs() < 1e-3 * report.drop + 1e-5, "{report:?}: {left}");
        // Errors fall in the norm of the matrix.
        let e = DVector::from_fn(n, |i, _| f64::from(x[i]) - exact[i]);
        let energy = (e.transpose() * &dense * &e)[0].sqrt();
        assert!(energy < best || energy < 1e-5, "{energy} after {best}");
        best = energy;
    }
    let size = (exact.transpose() * &dense * &exact)[0].sqrt();
    assert!(best < 1e-5 * size, "{best} of {size}");
}
