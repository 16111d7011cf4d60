//! Closed forms and exact properties.

mod common;

use common::*;
use linalg::Operator;
use structure_solver::dynamics::Dynamics;
use structure_solver::elements::cable::{TensionOnly, TwoWay};
use structure_solver::loops::{FaceLoad, Place};
use structure_solver::materials::{StVenantKirchhoff, TensionField};
use structure_solver::scheme::Scheme;

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A sheet whose inner nodes are shifted, so that no two elements are alike.
fn irregular() -> mesh::StructureMesh {
    let mut m = sheet(4, 1.0);
    for (k, x) in m.coords.iter_mut().enumerate() {
        let inner = x[..2].iter().all(|c| *c > 0.1 && *c < 0.9);
        if inner {
            x[0] += 0.06 * ((k * 7 % 5) as f64 - 2.0) / 2.0;
            x[1] += 0.06 * ((k * 3 % 5) as f64 - 2.0) / 2.0;
        }
    }
    m
}

/// Patch test: under any affine map the inner nodes of an irregular sheet are in balance.
#[test]
fn affine_deformations_leave_inner_nodes_in_balance() {
    let m = irregular();
    let system = membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3));
    let x: Vec<f64> = m
        .coords
        .iter()
        .flat_map(|p| [1.2 * p[0] + 0.1 * p[1], -0.05 * p[0] + 1.1 * p[1], 0.3 * p[0] - 0.2 * p[1]])
        .collect();
    let mut f = vec![0.0; x.len()];
    let load = FaceLoad { pressure: &vec![0.0; m.faces.len()], traction: &[] };
    system.forces(Place::only(&x), load, &mut f);
    let largest = norm(&f);
    system.constrain(&mut f);
    assert!(norm(&f) < 1e-13 * largest, "{} of {largest}", norm(&f));
}

/// A turned and shifted sheet stores no energy (rounding squared, times the stiffness).
#[test]
fn rigid_motion_costs_no_energy() {
    let m = irregular();
    let system = membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3));
    let (c, s) = (0.8f64.cos(), 0.8f64.sin());
    let turned = m.coords.iter().flat_map(|p| [c * p[0] - 2.0, p[1] + 5.0, s * p[0] + 1.0]);
    let x: Vec<f64> = turned.collect();
    let energy: f64 = system.loops().iter().map(|l| l.energy(&x)).sum();
    assert!(energy.abs() < 1e-24, "{energy}");
}

/// The assembled matrix is the derivative of the assembled forces (pressure included).
#[test]
fn the_matrix_is_the_derivative_of_the_forces() {
    let m = irregular();
    let mut system = membrane(&m, TensionField::new(1e6, 0.3));
    let wave = |i: usize, a: f64| ((i as f64) * a).sin();
    let x: Vec<f64> = m
        .coords
        .iter()
        .enumerate()
        .flat_map(|(i, p)| [1.1 * p[0] + 0.02 * wave(i, 2.1), 0.9 * p[1], 0.1 * wave(i, 1.3)])
        .collect();
    let pressure = vec![700.0; m.faces.len()];
    let traction: Vec<f64> = (0..3 * m.faces.len()).map(|i| 300.0 * wave(i, 0.7)).collect();
    let load = FaceLoad { pressure: &pressure, traction: &traction };
    let n = x.len();
    let mut d: Vec<f64> = (0..n).map(|i| wave(i, 0.9)).collect();
    system.constrain(&mut d);
    let mut g = vec![0.0; n];
    system.tangent(Place::only(&x), load, 1.0, 0.0, &mut g);
    let mut kd = vec![0.0; n];
    system.matrix.apply(&mut d.clone(), &mut kd);
    let h = 1e-6;
    let at = |s: f64| {
        let y: Vec<f64> = x.iter().zip(&d).map(|(x, d)| x + s * d).collect();
        let mut f = vec![0.0; n];
        system.forces(Place::only(&y), load, &mut f);
        system.constrain(&mut f);
        f
    };
    let (up, down) = (at(h), at(-h));
    system.constrain(&mut kd);
    let error: Vec<f64> = (0..n).map(|i| (up[i] - down[i]) / (2.0 * h) - kd[i]).collect();
    assert!(norm(&error) < 1e-7 * norm(&kd), "{}", norm(&error) / norm(&kd));
}

/// Newton's residuals on a taut sheet fall quadratically: the exponent of the last
/// drop before rounding is near 2.
#[test]
fn newton_converges_quadratically_where_the_problem_is_smooth() {
    let m = sheet(8, 1.0);
    let system = membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3));
    let mut p = params(Scheme::newmark(), 0.0);
    p.linear_tolerance = 1e-13;
    p.newton.tolerance = 1e-11;
    let mut d = Dynamics::new(system, p);
    stretch(&mut d, 1.05);
    window(&mut d, 2e-3, 1, 2000.0, [0.0; 3]);
    let r = &d.newton.history;
    let smooth: Vec<f64> = r.iter().copied().filter(|r| *r > 1e-11).collect();
    let k = smooth.len();
    assert!(k >= 3, "{r:?}");
    let order = (smooth[k - 1] / smooth[k - 2]).ln() / (smooth[k - 2] / smooth[k - 3]).ln();
    assert!(order > 1.7, "order {order}: {r:?}");
}

/// Moves all nodes in the plane by a factor, fixed ones too: a pre-tension.
fn stretch(d: &mut Dynamics, factor: f64) {
    for (i, x) in d.system.model.reference.iter().enumerate() {
        if i % 3 != 2 {
            d.accepted.u[i] = (factor - 1.0) * x;
        }
    }
}

/// Time of `count` half periods of component `i`, by its zero crossings.
fn half_periods(d: &mut Dynamics, i: usize, dt: f64, count: usize) -> f64 {
    let mut crossings = Vec::new();
    let mut before = d.accepted.u[i];
    for step in 0..20_000 {
        window(d, dt, 1, 0.0, [0.0; 3]);
        let now = d.accepted.u[i];
        if before * now < 0.0 {
            crossings.push(dt * (step as f64 + before / (before - now)));
            if crossings.len() > count {
                return crossings[count] - crossings[0];
            }
        }
        before = now;
    }
    panic!("no vibration");
}

/// Taut string: f1 = sqrt(T/mu) / (2 L). 40 linear elements are 3e-4 too fast, 300
/// trapezoidal steps a period 4e-5 too slow, amplitude L/1000 matters as its square.
#[test]
fn taut_string_has_its_frequency() {
    let (l, rest, y, area, density) = (2.0, 1.9, 1e7, 1e-5, 1100.0);
    let m = chain(40, l, rest);
    let mut d =
        Dynamics::new(lines(&m, TwoWay { youngs_modulus: y }, area, density), params(Scheme::newmark(), 0.0));
    let e = 0.5 * ((l / rest) * (l / rest) - 1.0);
    let tension = area * y * e * l / rest;
    let mu = density * area * rest / l;
    let frequency = (tension / mu).sqrt() / (2.0 * l);
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.u[3 * i + 2] = 1e-3 * l * (std::f64::consts::PI * x[0] / l).sin();
    }
    d.balance_start(FaceLoad { pressure: &[], traction: &[] }, [0.0; 3]).expect("a mass matrix");
    let dt = 1.0 / (300.0 * frequency);
    let found = 2.0 / half_periods(&mut d, 3 * 20 + 2, dt, 4);
    assert!((found / frequency - 1.0).abs() < 6e-4, "{found} beside {frequency}");
}

/// Square drum: f11 = sqrt(2 N / (rho h)) / (2 a), N the tension per length. Energy
/// stays: the trapezoidal rule on a nearly linear vibration.
#[test]
fn square_drum_has_its_frequency_and_keeps_its_energy() {
    let (a0, n, lambda, y, nu) = (1.0, 12, 1.02, 1e6, 0.3);
    let m = sheet(n, a0);
    let mut d =
        Dynamics::new(membrane(&m, StVenantKirchhoff::isotropic(y, nu)), params(Scheme::newmark(), 0.0));
    stretch(&mut d, lambda);
    let a = lambda * a0;
    // S11 = S22 = Y E / (1 - nu); force per deformed length is S h (lambda / lambda).
    let s = y / (1.0 - nu) * 0.5 * (lambda * lambda - 1.0);
    let tension = s * SHEET[0];
    let mass = SHEET[0] * SHEET[1] / (lambda * lambda);
    let frequency = (2.0 * tension / mass).sqrt() / (2.0 * a);
    for (i, x) in m.coords.iter().enumerate() {
        let pi = std::f64::consts::PI;
        d.accepted.u[3 * i + 2] = 1e-4 * (pi * x[0]).sin() * (pi * x[1]).sin();
    }
    let p = vec![0.0; m.faces.len()];
    d.balance_start(FaceLoad { pressure: &p, traction: &[] }, [0.0; 3]).expect("a mass matrix");
    let taut = {
        let flat: Vec<f64> = m.coords.iter().flat_map(|x| [lambda * x[0], lambda * x[1], 0.0]).collect();
        d.system.loops().iter().map(|l| l.energy(&flat)).sum::<f64>()
    };
    let vibration = |d: &Dynamics| energies(d).iter().sum::<f64>() - taut;
    let start = vibration(&d);
    let dt = 1.0 / (100.0 * frequency);
    let found = 2.0 / half_periods(&mut d, 3 * (n / 2 + (n + 1) * (n / 2)) + 2, dt, 4);
    // Linear triangles of size a/12 raise the frequency by (pi/12)^2 / 24 times a
    // factor of about two; the trapezoidal rule lowers it by (2 pi / 100)^2 / 12.
    assert!((found / frequency - 1.0).abs() < 8e-3, "{found} beside {frequency}");
    for _ in 0..1500 {
        window(&mut d, dt, 1, 0.0, [0.0; 3]);
    }
    let drift = vibration(&d) / start - 1.0;
    assert!(drift.abs() < 1e-3, "energy drifts by {drift}");
}

/// A stiff cable under its weight hangs in a catenary: 2 c sinh(span / 2c) = length.
#[test]
fn cable_hangs_in_a_catenary() {
    let (span, length) = (1.0, 1.3);
    let m = chain(32, span, length);
    let law = TensionOnly { youngs_modulus: 1e9 };
    let mut d = Dynamics::new(lines(&m, law, 1e-6, 1000.0), params(Scheme::generalized_alpha(0.0), 8.0));
    // A slight bow breaks the symmetry of the straight slack start.
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.u[3 * i + 2] = -1e-3 * (std::f64::consts::PI * x[0]).sin();
    }
    settle(&mut d, 0.02, 0.0, [0.0, 0.0, -9.81], span);
    let mut c = 0.3;
    for _ in 0..60 {
        let g = 2.0 * c * (0.5f64 * span / c).sinh() - length;
        let slope = 2.0 * (0.5 * span / c).sinh() - span / c * (0.5f64 * span / c).cosh();
        c -= g / slope;
    }
    let sag = c * ((0.5 * span / c).cosh() - 1.0);
    // A polygon of 32 links on the curve: its length misses by (1/32)^2 times a curvature of order one.
    let found = -d.accepted.u[3 * 16 + 2];
    assert!((found / sag - 1.0).abs() < 2e-3, "{found} beside {sag}");
}

/// Hencky's circular membrane, nu = 0.3: w0 = 0.653 a (q a / (E h))^(1/3), with
/// strains of 2e-3 so that his small-strain theory holds to 1 %.
#[test]
fn circular_membrane_rises_as_hencky_says() {
    let scene = r#"
        name = "hencky"
        [canopy]
        kind = "circular"
        width_m = 2.0
        cells_across = 20
        [fabric]
        youngs_modulus_pa = 1e8
        poisson_ratio = 0.3
        thickness_m = 1e-3
        density_kg_m3 = 1000.0
        [[stage]]
        name = "load"
        kind = "pre-inflation"
        duration_s = 1.0
        window_s = 1e-2
        pressure_pa = 30.0
    "#;
    let scene = case::parse(std::path::Path::new("hencky.toml"), scene).expect("a good scene");
    let m = mesh::structure_mesh(&scene).expect("a good mesh");
    let system = membrane(&m, StVenantKirchhoff::isotropic(1e8, 0.3));
    let mut d = Dynamics::new(system, params(Scheme::generalized_alpha(0.0), 40.0));
    settle(&mut d, 5e-3, 30.0, [0.0; 3], 0.05);
    let found = d.accepted.u.iter().skip(2).step_by(3).fold(0.0f64, |m, u| m.max(*u));
    let exact = 0.653 * (30.0f64 / (1e8 * SHEET[0])).cbrt();
    assert!((found / exact - 1.0).abs() < 0.012, "{found} beside {exact}");
}
