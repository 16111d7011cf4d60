//! Small structures for the verification tests.
#![allow(dead_code)]

use comm::Comm;
use mesh::{Cable, CableKind, StructureMesh};
use structure_solver::dynamics::{Dynamics, DynamicsParams, LoadPath};
use structure_solver::elements::cable::CableLaw;
use structure_solver::elements::mass::MassMatrix;
use structure_solver::loops::{Cables, ElementLoop, Membranes};
use structure_solver::materials::Material;
use structure_solver::model::Model;
use structure_solver::newton::NewtonParams;
use structure_solver::scheme::Scheme;
use structure_solver::system::System;

/// Thickness (m) and density (kg/m3) of test membranes.
pub const SHEET: [f64; 2] = [1e-3, 1000.0];

pub fn params(scheme: Scheme, damping: f64) -> DynamicsParams {
    DynamicsParams {
        scheme,
        damping,
        newton: NewtonParams { tolerance: 1e-9, smallest_correction: 1e-15, max_steps: 40 },
        linear_tolerance: 1e-9,
        max_cuts: 8,
    }
}

pub fn model(mesh: &StructureMesh) -> Model {
    Model::new(&Comm::solo(), mesh, &vec![0; mesh.coords.len()]).expect("a good mesh")
}

pub fn membrane(mesh: &StructureMesh, material: impl Material) -> System {
    let model = model(mesh);
    let membranes = Membranes::new(&model, material, SHEET[0], SHEET[1]);
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(membranes)];
    System::new(model, loops, MassMatrix::Consistent)
}

pub fn lines(mesh: &StructureMesh, law: impl CableLaw, area: f64, density: f64) -> System {
    let model = model(mesh);
    let cables = Cables::new(&model, law, area, density);
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(cables)];
    System::new(model, loops, MassMatrix::Consistent)
}

/// `n` cable elements along x from 0 to `span`, ends fixed, with given total rest length.
pub fn chain(n: usize, span: f64, rest_length: f64) -> StructureMesh {
    let node = |i: usize| [span * i as f64 / n as f64, 0.0, 0.0];
    StructureMesh {
        coords: (0..=n).map(node).collect(),
        cables: (0..n as u32)
            .map(|i| Cable {
                nodes: [i, i + 1],
                rest_length: rest_length / n as f64,
                kind: CableKind::SuspensionLine,
                line: 0,
            })
            .collect(),
        fixed: vec![(0, [true; 3]), (n as u32, [true; 3])],
        ..Default::default()
    }
}

/// A square sheet of side `a` with `n` x `n` cells, rim fixed.
pub fn sheet(n: usize, a: f64) -> StructureMesh {
    let node = |i: usize, j: usize| (i + (n + 1) * j) as u32;
    let mut m = StructureMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            m.coords.push([a * i as f64 / n as f64, a * j as f64 / n as f64, 0.0]);
            if i == 0 || j == 0 || i == n || j == n {
                m.fixed.push((node(i, j), [true; 3]));
            }
        }
    }
    m.n_canopy = m.coords.len();
    for j in 0..n {
        for i in 0..n {
            let q = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            let [a, b, c, d] = q;
            let cut = if (i + j) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            m.triangle_face.extend([m.faces.len() as u32; 2]);
            m.faces.push(q);
            m.face_panel.push(0);
            m.triangles.extend(cut);
        }
    }
    m
}

/// One window under a constant pressure (Pa) and body acceleration (m/s2).
pub fn window(d: &mut Dynamics, dt: f64, substeps: u64, pressure: f64, body: [f64; 3]) {
    let p = vec![pressure; d.system.model.n_faces];
    let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
    d.window(dt, substeps, load, body, false).expect("a solvable window");
    d.accept();
}

/// Kinetic and strain energy, J.
pub fn energies(d: &Dynamics) -> [f64; 2] {
    let s = &d.accepted;
    let mut mv = vec![0.0; s.v.len()];
    d.system.add_mass_product(&s.v, &mut mv);
    let x: Vec<f64> = d.system.model.reference.iter().zip(&s.u).map(|(x, u)| x + u).collect();
    let strain = d.system.loops().iter().map(|l| l.energy(&x)).sum();
    [0.5 * mv.iter().zip(&s.v).map(|(m, v)| m * v).sum::<f64>(), strain]
}

/// Lets a structure come to rest: heavy damping and long steps of a scheme that
/// removes high frequencies, until nothing moves by more than 1e-7 of `size` a step.
pub fn settle(d: &mut Dynamics, dt: f64, pressure: f64, body: [f64; 3], size: f64) {
    for _ in 0..4000 {
        let before = d.accepted.u.clone();
        window(d, dt, 1, pressure, body);
        let moved = before.iter().zip(&d.accepted.u).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        if moved < 1e-7 * size {
            return;
        }
    }
    panic!("the structure did not come to rest");
}
