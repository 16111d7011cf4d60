//! Elements of one or several kernels in the system: matrix, dissipation, decay.

use comm::Comm;
use mesh::{Cable, CableKind, StructureMesh};

use crate::dynamics::{Dynamics, DynamicsParams, LoadPath};
use crate::elements::cable::{self, TensionOnly, TwoWay};
use crate::elements::mass::MassMatrix;
use crate::loops::{Configuration, ElementLoop, Elements, FaceLoad};
use crate::materials::{Elastic, KelvinVoigt, TensionField, Viscous};
use crate::model::{Model, Surface};
use crate::newton::NewtonParams;
use crate::scheme::Scheme;
use crate::system::System;

fn patch() -> StructureMesh {
    StructureMesh {
        coords: vec![[0.0; 3], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [1.1, 1.2, 0.3]],
        n_canopy: 4,
        faces: vec![[0, 1, 3, 2]],
        face_panel: vec![0],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
        triangle_face: vec![0, 0],
        cables: vec![Cable {
            nodes: [0, 3],
            rest_length: 1.5,
            kind: CableKind::SuspensionLine,
            line: 0,
            share: 1.0,
            group: None,
        }],
        fixed: vec![(0, [true; 3])],
        ..Default::default()
    }
}

fn system(mesh: &StructureMesh, time: f64) -> System {
    let model = Model::new(&Comm::solo(), mesh, &vec![0; mesh.coords.len()]).expect("a good mesh");
    let law = TensionField::new(7.0, 0.3);
    let line = || cable::Elastic { law: TensionOnly { youngs_modulus: 5.0 }, offset: 0.0 };
    let loops: Vec<Box<dyn ElementLoop>> = vec![
        Box::new(Elements::triangles(&model, Elastic(law), 0.1, 1.0)),
        Box::new(Elements::cables(&model, line(), 0.2, 1.0)),
        Box::new(Elements::triangles(&model, Viscous::new(law, time), 0.1, 1.0)),
        Box::new(Elements::cables(&model, cable::Viscous::new(line(), time), 0.2, 1.0)),
    ];
    System::new(model, loops, MassMatrix::Consistent)
}

fn shaken(x: &[f64], size: f64, a: f64) -> Vec<f64> {
    x.iter().enumerate().map(|(i, x)| 1.05 * x + size * (i as f64 * a).sin()).collect()
}

/// The whole matrix against central differences along a direction, at the middle
/// (as the midpoint family) and at the end (as Newmark).
#[test]
fn tangent_is_the_derivative() {
    let mesh = patch();
    let mut system = system(&mesh, 0.4);
    let x0 = shaken(&system.model.reference, 0.05, 2.1);
    let x1 = shaken(&x0, 0.08, 1.3);
    let load = FaceLoad { pressure: &[0.3], traction: &[] };
    let d: Vec<f64> = (0..12).map(|i| if i < 3 { 0.0 } else { (i as f64 * 0.9).sin() }).collect();
    for weight in [0.5, 0.6, 1.0] {
        system.set_step(0.2);
        system.anchor(&x0);
        let positions = |s: f64| -> [Vec<f64>; 2] {
            let end: Vec<f64> = x1.iter().zip(&d).map(|(x, d)| x + s * d).collect();
            [x0.iter().zip(&end).map(|(a, b)| (1.0 - weight) * a + weight * b).collect(), end]
        };
        let force = |s: f64| {
            let [at, end] = &positions(s);
            let mut f = vec![0.0; 12];
            system.forces(Configuration { at, end, weight }, load, &mut f);
            f
        };
        let h = 1e-6;
        let (up, down) = (force(h), force(-h));
        let [at, end] = &positions(0.0);
        let mut g = vec![0.0; 12];
        system.tangent(Configuration { at, end, weight }, load, weight, 0.0, &mut g);
        assert_eq!(g, {
            let mut f = vec![0.0; 12];
            system.forces(Configuration { at, end, weight }, load, &mut f);
            f
        });
        let mut kd = vec![0.0; 12];
        linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
        for i in 3..12 {
            let difference = (up[i] - down[i]) / (2.0 * h);
            assert!((difference - kd[i]).abs() < 1e-7, "{weight} {i}: {difference} {}", kd[i]);
        }
    }
}

/// A step takes energy out whatever happens in it, and a turn of the whole takes
/// none.
#[test]
fn strains_are_damped_and_rigid_motion_is_not() {
    let mesh = patch();
    let mut system = system(&mesh, 0.4);
    system.set_step(0.2);
    for k in 0..50 {
        let x0 = shaken(&system.model.reference, 0.3, 2.1 + f64::from(k));
        let x1 = shaken(&system.model.reference, 0.3, 1.3 + f64::from(k));
        system.anchor(&x0);
        assert!(system.dissipation(&x0, &x1) >= 0.0);
    }
    let x0 = shaken(&system.model.reference, 0.1, 2.1);
    let turned: Vec<f64> = x0.chunks(3).flat_map(|p| [p[2] + 1.0, p[1], -p[0]]).collect();
    system.anchor(&x0);
    assert!(system.dissipation(&x0, &turned).abs() < 1e-14);
}

/// A mass on a spring: the amplitude falls by exp(-beta w^2 t / 2). Midpoint
/// steps of w dt = 0.02 lose (w dt)^2 / 12 of the frequency and of the decay.
#[test]
fn a_spring_loses_the_amplitude_of_its_damping_time() {
    let mesh = StructureMesh {
        coords: vec![[0.0; 3], [1.0, 0.0, 0.0]],
        cables: vec![Cable {
            nodes: [0, 1],
            rest_length: 1.0,
            kind: CableKind::Riser,
            line: 0,
            share: 1.0,
            group: None,
        }],
        point_masses: vec![(1, 1.0)],
        fixed: vec![(0, [true; 3]), (1, [false, true, true])],
        ..Default::default()
    };
    let model = Model::new(&Comm::solo(), &mesh, &[0, 0]).expect("a good mesh");
    let (y, area, beta) = (4.0, 1.0, 0.05);
    let law = || cable::Elastic { law: TwoWay { youngs_modulus: y }, offset: 0.0 };
    let loops: Vec<Box<dyn ElementLoop>> = vec![
        Box::new(Elements::cables(&model, law(), area, 1e-12)),
        Box::new(Elements::cables(&model, cable::Viscous::new(law(), beta), area, 0.0)),
    ];
    let w = (y * area / 1.0f64).sqrt();
    let mut d = Dynamics::new(
        System::new(model, loops, MassMatrix::Consistent),
        DynamicsParams {
            scheme: Scheme::generalized_alpha(1.0),
            damping: 0.0,
            newton: NewtonParams { tolerance: 1e-10, smallest_correction: 1e-16, max_steps: 20 },
            linear_tolerance: 1e-12,
            max_cuts: 0,
        },
    );
    d.accepted.u[3] = 1e-4;
    d.balance_start(FaceLoad { pressure: &[], traction: &[] }, [0.0; 3]).expect("a mass");
    let dt = 0.02 / w;
    let steps = (10.0 * 2.0 * std::f64::consts::PI / 0.02) as u64;
    let load = LoadPath { pressure: [&[]; 2], traction: [&[]; 2] };
    let mut peak = 0.0f64;
    for k in 0..steps {
        d.window(dt, 1, load, [0.0; 3], false).expect("a step");
        d.accept();
        if k >= steps - (2.0 * std::f64::consts::PI / 0.02) as u64 {
            peak = peak.max(d.accepted.u[3] * (0.5 * beta * w * w * dt * (k + 1) as f64).exp());
        }
    }
    assert!((peak / 1e-4 - 1.0).abs() < 2e-3, "{peak}");
}

/// A quadrilateral and a triangle of fabric: the whole matrix, with pressure,
/// traction and damping, against central differences along a direction.
#[test]
fn the_matrix_of_quadrilaterals_is_the_derivative_of_their_forces() {
    let mesh = mesh::StructureMesh {
        coords: vec![[0.0; 3], [1.0, 0.1, 0.0], [1.2, 1.3, 0.1], [0.1, 1.2, 0.3], [2.0, 0.5, 0.2]],
        n_canopy: 5,
        faces: vec![[0, 1, 2, 3], [1, 4, 2, 2]],
        face_panel: vec![0, 0],
        triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]],
        triangle_face: vec![0, 0, 1],
        fixed: vec![(0, [true; 3])],
        ..Default::default()
    };
    let surface = Surface { quadrilaterals: true, ..Surface::default() };
    let model = Model::with(&Comm::solo(), &mesh, &[0; 5], surface).expect("a good mesh");
    let law = KelvinVoigt::new(TensionField::new(7.0, 0.3), 0.3);
    let quads = Elements::quads(&model, law, 0.1, 2.0);
    let mut system = System::new(model, vec![Box::new(quads)], MassMatrix::Consistent);
    let area = 0.1 * 2.0 * mesh.fabric_area(|_| true);
    // The warped surface is a little larger than its two flat triangles.
    assert!((system.total_mass() / area - 1.0).abs() < 0.01, "{} {area}", system.total_mass());
    let n = 15;
    let wave = |i: usize, a: f64| (i as f64 * a).sin();
    let x0: Vec<f64> = (0..n).map(|i| 1.05 * system.model.reference[i] + 0.05 * wave(i, 2.1)).collect();
    let x1: Vec<f64> = (0..n).map(|i| x0[i] + 0.08 * wave(i, 1.3)).collect();
    let d: Vec<f64> = (0..n).map(|i| if i < 3 { 0.0 } else { wave(i, 0.9) }).collect();
    let traction = [0.1, -0.2, 0.3, 0.2, 0.1, -0.1];
    let load = FaceLoad { pressure: &[0.3, 0.2], traction: &traction };
    for weight in [0.5, 1.0] {
        system.set_step(0.2);
        system.anchor(&x0);
        let force = |s: f64| {
            let end: Vec<f64> = (0..n).map(|i| x1[i] + s * d[i]).collect();
            let at: Vec<f64> = (0..n).map(|i| (1.0 - weight) * x0[i] + weight * end[i]).collect();
            let mut f = vec![0.0; n];
            system.forces(Configuration { at: &at, end: &end, weight }, load, &mut f);
            f
        };
        let h = 1e-6;
        let (up, down) = (force(h), force(-h));
        let at: Vec<f64> = (0..n).map(|i| (1.0 - weight) * x0[i] + weight * x1[i]).collect();
        let mut kd = vec![0.0; n];
        system.tangent(Configuration { at: &at, end: &x1, weight }, load, weight, 0.0, &mut kd);
        linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
        for i in 3..n {
            let difference = (up[i] - down[i]) / (2.0 * h);
            assert!((difference - kd[i]).abs() < 1e-7, "{weight} {i}: {difference} {}", kd[i]);
        }
        assert!(system.dissipation(&x0, &x1) > 0.0);
    }
}
