//! What holds for any state of any mesh: patch test, rigid motion, objectivity,
//! tangents of the whole system, nothing from nothing.

use linalg::Operator;
use mesh::StructureMesh;
use proptest::prelude::*;
use structure_solver::elements::cable::TensionOnly;
use structure_solver::loops::{Configuration, FaceLoad};
use structure_solver::materials::{Material, StVenantKirchhoff, TensionField};
use structure_solver::model::Warp;
use structure_solver::system::System;

use crate::common::*;
use crate::shapes::*;

/// Patch test: under any affine map the inner nodes of an irregular sheet are in balance.
#[test]
fn affine_deformations_leave_inner_nodes_in_balance() {
    let m = irregular();
    for element in [Element::Triangle, Element::Quad] {
        let system = fabric(&m, StVenantKirchhoff::isotropic(1e6, 0.3), element, None);
        let map =
            |p: &[f64; 3]| [1.2 * p[0] + 0.1 * p[1], -0.05 * p[0] + 1.1 * p[1], 0.3 * p[0] - 0.2 * p[1]];
        let x: Vec<f64> = m.coords.iter().flat_map(map).collect();
        let mut f = vec![0.0; x.len()];
        let load = FaceLoad { pressure: &vec![0.0; m.faces.len()], traction: &[] };
        system.forces(Configuration::only(&x), load, &mut f);
        let largest = norm(&f);
        system.constrain(&mut f);
        assert!(norm(&f) < 1e-13 * largest, "{} of {largest}", norm(&f));
    }
}

/// Patch test in each state of the tension field: an affine map gives each element the
/// same stress, that of the law: both principal stresses in the taut state, one in
/// the wrinkled (Y e1), none in the slack.
#[test]
fn affine_deformations_have_the_stress_of_the_law() {
    let (y, nu) = (1e6, 0.3);
    let m = irregular();
    let system = membrane(&m, TensionField::new(y, nu));
    for [along, across] in [[1.1, 1.05], [1.1, 0.9], [0.95, 0.9]] {
        // Stretches along axes at 0.6 to x, in the sheet's plane turned about y by 0.8.
        let (c, s) = (0.6f64.cos(), 0.6f64.sin());
        let map = |p: &[f64; 3]| {
            let (u, v) = (along * (c * p[0] + s * p[1]), across * (c * p[1] - s * p[0]));
            let (a, b) = (c * u - s * v, s * u + c * v);
            [0.8f64.cos() * a, b, 0.8f64.sin() * a]
        };
        let x: Vec<f64> = m.coords.iter().flat_map(map).collect();
        let [e1, e2] = [along, across].map(|l: f64| 0.5 * (l * l - 1.0));
        let exact = if e1 <= 0.0 {
            [0.0, 0.0]
        } else if e2 + nu * e1 < 0.0 {
            [y * e1, 0.0]
        } else {
            [y * (e1 + nu * e2) / (1.0 - nu * nu), y * (e2 + nu * e1) / (1.0 - nu * nu)]
        };
        for (s, _) in system.loops()[0].stresses(&x) {
            assert!((0..2).all(|i| (s[i] - exact[i]).abs() < 1e-12 * y), "{s:?} beside {exact:?}");
        }
    }
}

/// Patch test of orthotropic fabric with its warp at 35 degrees to the axes: strains turned to the warp, its law,
/// and the principal stresses of the result, which do not depend on axes.
#[test]
fn orthotropic_fabric_follows_its_warp() {
    let (y1, y2, nu, g) = (1e6, 3e5, 0.25, 1.5e5);
    let m = irregular();
    let angle = 35.0f64.to_radians();
    let warp = Some(Warp::Vector([angle.cos(), angle.sin(), 0.0]));
    let [[f11, f12], [f21, f22]] = [[1.1, 0.04], [-0.02, 1.05f64]];
    let x: Vec<f64> =
        m.coords.iter().flat_map(|p| [f11 * p[0] + f12 * p[1], f21 * p[0] + f22 * p[1], 0.0]).collect();
    let e = [
        0.5 * (f11 * f11 + f21 * f21 - 1.0),
        0.5 * (f12 * f12 + f22 * f22 - 1.0),
        0.5 * (f11 * f12 + f21 * f22),
    ];
    let (c, s) = (angle.cos(), angle.sin());
    let along = c * c * e[0] + s * s * e[1] + 2.0 * s * c * e[2];
    let across = s * s * e[0] + c * c * e[1] - 2.0 * s * c * e[2];
    let shear = s * c * (e[1] - e[0]) + (c * c - s * s) * e[2];
    let d = 1.0 - nu * nu * y2 / y1;
    let stress = [(y1 * along + nu * y2 * across) / d, y2 * (across + nu * along) / d, 2.0 * g * shear];
    let (mean, radius) = (0.5 * (stress[0] + stress[1]), (0.5 * (stress[0] - stress[1])).hypot(stress[2]));
    for element in [Element::Triangle, Element::Quad] {
        let system = fabric(&m, StVenantKirchhoff::orthotropic(y1, y2, nu, g), element, warp);
        for (s, _) in system.loops()[0].stresses(&x) {
            let error = (s[0] - mean - radius).abs().max((s[1] - mean + radius).abs());
            assert!(error < 1e-12 * y1, "{element:?}: {s:?} beside {mean} and {radius}");
        }
    }
}

/// A turned and shifted sheet stores no energy (rounding squared, times the stiffness).
#[test]
fn rigid_motion_costs_no_energy() {
    let m = irregular();
    for element in [Element::Triangle, Element::Quad] {
        let system = fabric(&m, StVenantKirchhoff::isotropic(1e6, 0.3), element, None);
        let (c, s) = (0.8f64.cos(), 0.8f64.sin());
        let turned = m.coords.iter().flat_map(|p| [c * p[0] - 2.0, p[1] + 5.0, s * p[0] + 1.0]);
        let x: Vec<f64> = turned.collect();
        let energy = strain_energy(&system, &x);
        assert!(energy.abs() < 1e-24, "{energy}");
    }
}

/// Fabric in its irregular sheet with lines along one diagonal.
fn fabric_with_lines(material: impl Material) -> (StructureMesh, System) {
    let mut m = irregular();
    for k in 0..4u32 {
        let ends = [6 * k, 6 * (k + 1)];
        add_cable(&mut m, ends, 0.3);
    }
    let system = both(&m, material, TensionOnly { youngs_modulus: 1e7 }, 1e-5);
    (m, system)
}

/// A state without any symmetry, from a few numbers.
fn wild(m: &StructureMesh, by: [f64; 3]) -> Vec<f64> {
    let wave = |i: usize, a: f64| ((i as f64 + 1.0) * a).sin();
    m.coords
        .iter()
        .enumerate()
        .flat_map(|(i, p)| {
            [
                (1.0 + by[0]) * p[0] + 0.03 * wave(i, 2.1 + by[2]),
                (1.0 + by[1]) * p[1] + 0.03 * wave(i, 3.7 + by[0]),
                0.2 * p[0] * p[1] + 0.1 * wave(i, 1.3 + by[1]),
            ]
        })
        .collect()
}

fn derivative_error(m: &StructureMesh, system: &mut System, x: &[f64]) -> f64 {
    let wave = |i: usize, a: f64| ((i as f64) * a).sin();
    let pressure = vec![700.0; m.faces.len()];
    let traction: Vec<f64> = (0..3 * m.faces.len()).map(|i| 300.0 * wave(i, 0.7)).collect();
    let load = FaceLoad { pressure: &pressure, traction: &traction };
    let n = x.len();
    let mut d: Vec<f64> = (0..n).map(|i| wave(i, 0.9)).collect();
    system.constrain(&mut d);
    let mut g = vec![0.0; n];
    system.tangent(Configuration::only(x), load, 1.0, 0.0, &mut g);
    let mut kd = vec![0.0; n];
    system.matrix.apply(&mut d.clone(), &mut kd);
    let h = 1e-6;
    let at = |s: f64| {
        let y: Vec<f64> = x.iter().zip(&d).map(|(x, d)| x + s * d).collect();
        let mut f = vec![0.0; n];
        system.forces(Configuration::only(&y), load, &mut f);
        system.constrain(&mut f);
        f
    };
    let (up, down) = (at(h), at(-h));
    system.constrain(&mut kd);
    let error: Vec<f64> = (0..n).map(|i| (up[i] - down[i]) / (2.0 * h) - kd[i]).collect();
    norm(&error) / norm(&kd)
}

/// The assembled matrix is the derivative of the assembled forces: fabric, lines,
/// pressure and traction together. Central differences with h = 1e-6: truncation
/// h^2 times third derivatives of order 1/l^2, cancellation eps / h, both near 1e-10.
#[test]
fn the_matrix_is_the_derivative_of_the_forces() {
    let (m, mut system) = fabric_with_lines(StVenantKirchhoff::isotropic(1e6, 0.3));
    let x = wild(&m, [0.1, -0.1, 0.2]);
    let e = derivative_error(&m, &mut system, &x);
    assert!(e < 1e-8, "{e}");
    let (m, mut system) = fabric_with_lines(TensionField::new(1e6, 0.3));
    let e = derivative_error(&m, &mut system, &x);
    assert!(e < 1e-7, "{e}");
    let mut system = fabric(&m, TensionField::new(1e6, 0.3), Element::Quad, None);
    let e = derivative_error(&m, &mut system, &x);
    assert!(e < 1e-7, "{e}");
}

/// The rotation by `angle` about `axis` (Rodrigues).
fn rotate(axis: [f64; 3], angle: f64, p: [f64; 3]) -> [f64; 3] {
    let size = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
    let k = axis.map(|a| a / size);
    let (c, s) = (angle.cos(), angle.sin());
    let along = (0..3).map(|i| k[i] * p[i]).sum::<f64>();
    let cross = [k[1] * p[2] - k[2] * p[1], k[2] * p[0] - k[0] * p[2], k[0] * p[1] - k[1] * p[0]];
    [0, 1, 2].map(|i| c * p[i] + s * cross[i] + (1.0 - c) * along * k[i])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Objectivity: whoever turns and shifts the whole state sees the same forces,
    /// turned. Both laws, lines, pressure and (turned) traction; to rounding.
    #[test]
    fn a_turned_state_has_turned_forces(
        axis in prop::array::uniform3(-1.0..1.0f64), angle in -3.0..3.0f64,
        shift in prop::array::uniform3(-10.0..10.0f64), by in prop::array::uniform3(-0.3..0.3f64),
        wrinkling in any::<bool>(),
    ) {
        prop_assume!(norm(&axis) > 0.1);
        let (m, system) = if wrinkling {
            fabric_with_lines(TensionField::new(1e6, 0.3))
        } else {
            fabric_with_lines(StVenantKirchhoff::isotropic(1e6, 0.3))
        };
        let x = wild(&m, by);
        let turn = |v: &[f64], shift: [f64; 3]| -> Vec<f64> {
            v.as_chunks::<3>().0.iter().flat_map(|p| {
                let q = rotate(axis, angle, *p);
                [0, 1, 2].map(|i| q[i] + shift[i])
            }).collect()
        };
        let pressure: Vec<f64> = (0..m.faces.len()).map(|f| 500.0 * (f as f64).cos()).collect();
        let traction: Vec<f64> = (0..3 * m.faces.len()).map(|i| 400.0 * (i as f64).sin()).collect();
        let forces = |x: &[f64], traction: &[f64]| {
            let mut f = vec![0.0; x.len()];
            system.forces(Configuration::only(x), FaceLoad { pressure: &pressure, traction }, &mut f);
            f
        };
        let here = turn(&forces(&x, &traction), [0.0; 3]);
        let there = forces(&turn(&x, shift), &turn(&traction, [0.0; 3]));
        // Positions of size 10 carry 2e-15, over edges of 0.2: strains 1e-14, times
        // the stiffness 1e3 N/m; forces here are of 1e2 N.
        prop_assert!(largest_difference(&here, &there) < 1e-10 * norm(&here), "{:?}", largest_difference(&here, &there));
    }

    /// Internal forces alone sum to nothing and turn nothing, whatever the state.
    #[test]
    fn internal_forces_have_no_resultant(by in prop::array::uniform3(-0.3..0.3f64)) {
        let (m, system) = fabric_with_lines(TensionField::new(1e6, 0.3));
        let x = wild(&m, by);
        let mut f = vec![0.0; x.len()];
        system.forces(Configuration::only(&x), FaceLoad { pressure: &vec![0.0; m.faces.len()], traction: &[] }, &mut f);
        let (mut sum, mut moment) = ([0.0; 3], [0.0; 3]);
        for (x, f) in x.as_chunks::<3>().0.iter().zip(f.as_chunks::<3>().0) {
            let cross = [x[1] * f[2] - x[2] * f[1], x[2] * f[0] - x[0] * f[2], x[0] * f[1] - x[1] * f[0]];
            (0..3).for_each(|i| { sum[i] += f[i]; moment[i] += cross[i]; });
        }
        prop_assert!(norm(&sum) + norm(&moment) < 1e-13 * norm(&f), "{:?} {:?}", sum, moment);
    }
}
