//! What the verification tests share: systems, loads, measures.

use comm::Comm;
use mesh::StructureMesh;
use structure_solver::dynamics::{Dynamics, DynamicsParams, LoadPath};

use structure_solver::elements::cable::{self, CableLaw};
use structure_solver::elements::mass::MassMatrix;
use structure_solver::equilibrium::EquilibriumParams;
use structure_solver::loops::{ElementLoop, Elements, FaceLoad};

use structure_solver::materials::{Elastic, Material};
use structure_solver::model::{Model, Surface, Warp};
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

/// As [`params`], solved almost to rounding.
pub fn sharp(scheme: Scheme) -> DynamicsParams {
    let mut p = params(scheme, 0.0);
    p.newton.tolerance = 1e-12;
    p.linear_tolerance = 1e-11;
    p
}

pub fn model(mesh: &StructureMesh) -> Model {
    Model::new(&Comm::solo(), mesh, &vec![0; mesh.coords.len()]).expect("a good mesh")
}

/// Which elements a membrane is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    /// Two triangles of constant strain to a face.
    Triangle,
    /// One bilinear element to a face.
    Quad,
}

pub fn membrane(mesh: &StructureMesh, material: impl Material) -> System {
    fabric(mesh, material, Element::Triangle, None)
}

/// A membrane of a choice of elements, with the direction of the warp where it counts.
pub fn fabric(mesh: &StructureMesh, material: impl Material, element: Element, warp: Option<Warp>) -> System {
    let surface = Surface { quadrilaterals: element == Element::Quad, warp, bending: false };
    let owner = vec![0; mesh.coords.len()];
    let model = Model::with(&Comm::solo(), mesh, &owner, surface).expect("a good mesh");
    let loops: Vec<Box<dyn ElementLoop>> = vec![match element {
        Element::Triangle => Box::new(Elements::triangles(&model, Elastic(material), SHEET[0], SHEET[1])),
        Element::Quad => Box::new(Elements::quads(&model, Elastic(material), SHEET[0], SHEET[1])),
    }];
    System::new(model, loops, MassMatrix::Consistent)
}

pub fn lines(mesh: &StructureMesh, law: impl CableLaw, area: f64, density: f64) -> System {
    let model = model(mesh);
    let cables = Elements::cables(&model, cable::Elastic { law, offset: 0.0 }, area, density);
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(cables)];
    System::new(model, loops, MassMatrix::Consistent)
}

/// Fabric with lines on it.
pub fn both(mesh: &StructureMesh, material: impl Material, law: impl CableLaw, area: f64) -> System {
    both_of_mass(mesh, material, law, area, MassMatrix::Consistent)
}

/// As [`both`], with a choice of the mass matrix.
pub fn both_of_mass(
    mesh: &StructureMesh,
    material: impl Material,
    law: impl CableLaw,
    area: f64,
    mass: MassMatrix,
) -> System {
    let model = model(mesh);
    let loops: Vec<Box<dyn ElementLoop>> = vec![
        Box::new(Elements::triangles(&model, Elastic(material), SHEET[0], SHEET[1])),
        Box::new(Elements::cables(&model, cable::Elastic { law, offset: 0.0 }, area, SHEET[1])),
    ];
    System::new(model, loops, mass)
}

/// One window under a constant pressure (Pa) and body acceleration (m/s2).
pub fn window(d: &mut Dynamics, dt: f64, substeps: u64, pressure: f64, body: [f64; 3]) {
    let p = vec![pressure; d.system.model.n_faces];
    let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
    d.window(dt, substeps, load, body, false).expect("a solvable window");
    d.accept();
}

/// Accelerations of the accepted state in balance under a uniform pressure.
pub fn balance(d: &mut Dynamics, pressure: f64, body: [f64; 3]) {
    let p = vec![pressure; d.system.model.n_faces];
    d.balance_start(FaceLoad { pressure: &p, traction: &[] }, body).expect("a mass matrix");
}

/// Positions of the accepted state, m.
pub fn positions(d: &Dynamics) -> Vec<f64> {
    d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect()
}

/// Kinetic and strain energy, J.
pub fn energies(d: &Dynamics) -> [f64; 2] {
    let s = &d.accepted;
    let mut mv = vec![0.0; s.v.len()];
    d.system.add_mass_product(&s.v, &mut mv);
    [0.5 * mv.iter().zip(&s.v).map(|(m, v)| m * v).sum::<f64>(), strain_energy(&d.system, &positions(d))]
}

pub fn strain_energy(system: &System, x: &[f64]) -> f64 {
    system.loops().iter().map(|l| l.energy(x)).sum()
}

/// Moves all nodes in the plane by a factor, fixed ones too: a pre-tension.
pub fn stretch(d: &mut Dynamics, factor: f64) {
    for (i, x) in d.system.model.reference.iter().enumerate() {
        if i % 3 != 2 {
            d.accepted.u[i] = (factor - 1.0) * x;
        }
    }
}

/// Moves the accepted state to its equilibrium under a load, to `tolerance` of it.
pub fn rest(d: &mut Dynamics, load: FaceLoad<'_>, body: [f64; 3], tolerance: f64) {
    let params = EquilibriumParams { tolerance, ..EquilibriumParams::default() };
    d.equilibrium(load, body, params, &mut |_| {}).expect("an equilibrium");
}

/// As [`rest`], under a uniform pressure (Pa).
pub fn rest_under(d: &mut Dynamics, pressure: f64) {
    let p = vec![pressure; d.system.model.n_faces];
    rest(d, FaceLoad { pressure: &p, traction: &[] }, [0.0; 3], 1e-8);
}

pub fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()))
}

/// Observed orders between errors on grids (or steps) that halve from one to the next.
pub fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

/// Numbers in scientific notation, for what a test prints.
pub fn sci(v: &[f64]) -> String {
    v.iter().map(|x| format!("{x:.1e}")).collect::<Vec<_>>().join(" ")
}
