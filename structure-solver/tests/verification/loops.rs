//! Identities of each kind of element: forces, energy, derivative, and what damping takes.

use comm::Comm;
use linalg::Operator;
use mesh::{CableKind, StructureMesh};
use structure_solver::elements::air::Cylinder;
use structure_solver::elements::cable::{self, TwoWay};
use structure_solver::elements::mass::MassMatrix;
use structure_solver::elements::reefing::Schedule;
use structure_solver::loops::{Configuration, ElementLoop, Elements, FaceLoad};
use structure_solver::materials::{Elastic, KelvinVoigt, StVenantKirchhoff, TensionField, Viscous};
use structure_solver::model::{Model, Surface};
use structure_solver::stream::Stream;
use structure_solver::system::System;

use crate::common::*;
use crate::shapes::*;

/// Young's modulus, Poisson's ratio and thickness of the fabric.
const FABRIC: [f64; 3] = [7.0, 0.3, 0.1];
/// Young's modulus, area and strain at rest of the lines.
const LINE: [f64; 3] = [5.0, 0.2, 0.03];
/// Damping time and step, s.
const DAMPED: [f64; 2] = [0.4, 0.2];
/// Skirt and schedule of the reefing line, which fades at 2.05 s to three quarters of its force.
const SKIRT: f64 = 4.0;
const SCHEDULE: Schedule = Schedule { length: 2.6, draw_in: 0.5, release: 2.0, ramp: 0.2 };

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Membranes,
    Field,
    Quads,
    FieldQuads,
    Cables,
    Reefing,
    Bent,
    Drag,
    SheetDamping,
    QuadDamping,
    LineDamping,
}

/// Kinds whose forces come from strains alone.
const ELASTIC: [Kind; 6] =
    [Kind::Membranes, Kind::Field, Kind::Quads, Kind::FieldQuads, Kind::Cables, Kind::Reefing];
/// Kinds whose forces come from the rates of strains, alone or beside the strains.
const DAMPING: [Kind; 3] = [Kind::SheetDamping, Kind::QuadDamping, Kind::LineDamping];

/// Two quadrilaterals and a triangle, all warped, two lines and a reinforcement.
fn patch() -> StructureMesh {
    let mut m = StructureMesh {
        coords: vec![
            [0.0; 3],
            [1.0, 0.1, 0.0],
            [1.2, 1.3, 0.1],
            [0.1, 1.2, 0.3],
            [2.1, 0.2, 0.4],
            [2.0, 1.1, -0.3],
            [1.0, 2.0, 0.2],
        ],
        n_canopy: 7,
        faces: vec![[0, 1, 2, 3], [1, 4, 5, 2], [3, 2, 6, 6]],
        face_panel: vec![0; 3],
        triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 5, 2], [3, 2, 6]],
        triangle_face: vec![0, 0, 1, 1, 2],
        ..Default::default()
    };
    add_cable(&mut m, [0, 4], 1.9);
    add_cable(&mut m, [6, 5], 1.2);
    add_cable(&mut m, [0, 1], 0.9);
    m.cables[2].kind = CableKind::Reinforcement;
    m
}

/// Elements of one kind alone, and their system with the pattern of all others, which carry nothing.
fn system_of(mesh: &StructureMesh, kind: Kind) -> System {
    let quads = matches!(kind, Kind::Quads | Kind::FieldQuads | Kind::QuadDamping);
    let surface = Surface { quadrilaterals: quads, ..Surface::default() };
    let owner = vec![0; mesh.coords.len()];
    let ties = [[0, 4], [4, 5], [5, 6]];
    let model = Model::with_ties(&Comm::solo(), mesh, &owner, surface, &ties).expect("a good mesh");
    let [y, nu, thickness] = FABRIC;
    let [youngs_modulus, area, offset] = LINE;
    let (elastic, none) = (StVenantKirchhoff::isotropic(y, nu), StVenantKirchhoff::isotropic(0.0, nu));
    let line = || cable::Elastic { law: TwoWay { youngs_modulus }, offset };
    let slack = cable::Elastic { law: TwoWay { youngs_modulus: 0.0 }, offset: 0.0 };
    let [time, _] = DAMPED;
    let of = |k: Kind| -> Box<dyn ElementLoop> {
        match k {
            Kind::Membranes => Box::new(Elements::triangles(&model, Elastic(elastic), thickness, 2.0)),
            Kind::Field => {
                Box::new(Elements::triangles(&model, Elastic(TensionField::new(y, nu)), thickness, 2.0))
            }
            Kind::Quads => Box::new(Elements::quads(&model, Elastic(elastic), thickness, 2.0)),
            Kind::FieldQuads => {
                Box::new(Elements::quads(&model, Elastic(TensionField::new(y, nu)), thickness, 2.0))
            }
            Kind::QuadDamping => {
                Box::new(Elements::quads(&model, KelvinVoigt::new(elastic, time), thickness, 2.0))
            }
            Kind::Cables => Box::new(Elements::cables(&model, line(), area, 2.0)),
            Kind::Reefing => Box::new(Elements::reefing(&model, youngs_modulus, area, SCHEDULE, SKIRT)),
            Kind::Bent => Box::new(Elements::bent_faces(&model, thickness, 2.0)),
            Kind::Drag => Box::new(Elements::line_drag(&model, Cylinder::new(1.2, 0.1, 1.1, 0.2))),
            Kind::SheetDamping => {
                Box::new(Elements::triangles(&model, Viscous::new(elastic, time), thickness, 2.0))
            }
            Kind::LineDamping => {
                Box::new(Elements::cables(&model, cable::Viscous::new(line(), time), area, 2.0))
            }
        }
    };
    let mut loops = vec![of(kind)];
    // Elements without a mass of their own lie on those that have one.
    match kind {
        Kind::SheetDamping => {
            loops.push(Box::new(Quiet(Elements::triangles(&model, Elastic(none), thickness, 2.0))));
        }
        Kind::LineDamping | Kind::Drag => loops.push(Box::new(Elements::cables(&model, slack, area, 2.0))),
        _ => {}
    }
    let mut system = System::new(model, loops, MassMatrix::Consistent);
    system.set_time(2.05);
    system.set_step(DAMPED[1]);
    system.set_air(&Stream::uniform([0.7, -0.4, 0.3].into()));
    system
}

/// The pattern of elements, without their loads.
struct Quiet<L>(L);

impl<L: ElementLoop> ElementLoop for Quiet<L> {
    fn anchor(&mut self, _x: &[f64]) {}
    fn forces(&self, _place: Configuration<'_>, _load: FaceLoad<'_>, _out: &mut [f64]) {}
    fn tangent(&self, _: Configuration<'_>, _: FaceLoad<'_>, _: f64, _: &mut [f64], _: &mut [[[f64; 3]; 3]]) {
    }
    fn external(&self, _x: &[f64], _load: FaceLoad<'_>, _out: &mut [f64]) {}
    fn energy(&self, _x: &[f64]) -> f64 {
        0.0
    }
    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        self.0.masses()
    }
    fn mass_shares(&self, element: usize, kind: MassMatrix) -> Vec<f64> {
        self.0.mass_shares(element, kind)
    }
    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.0.assign_slots(slot);
    }
}

const UNLOADED: FaceLoad<'static> = FaceLoad { pressure: &[0.0; 3], traction: &[] };
const LOADED: FaceLoad<'static> =
    FaceLoad { pressure: &[0.3, -0.2, 0.4], traction: &[0.1, -0.2, 0.3, 0.2, 0.1, -0.1, -0.3, 0.1, 0.2] };

fn waved(x: &[f64], stretch: f64, size: f64, a: f64) -> Vec<f64> {
    x.iter().enumerate().map(|(i, x)| stretch * x + size * (i as f64 * a).sin()).collect()
}

fn mix(a: &[f64], b: &[f64], s: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + s * (b - a)).collect()
}

fn forces(system: &System, configuration: Configuration<'_>, load: FaceLoad<'_>) -> Vec<f64> {
    let mut f = vec![0.0; configuration.at.len()];
    system.forces(configuration, load, &mut f);
    f
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Forces without load are the gradient of the energy, component by component.
#[test]
fn forces_are_the_gradients_of_the_energies() {
    for kind in ELASTIC {
        let system = system_of(&patch(), kind);
        let x = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let f = forces(&system, Configuration::only(&x), UNLOADED);
        let h = 1e-5;
        for i in 0..x.len() {
            let energy = |s: f64| {
                let mut x = x.clone();
                x[i] += s;
                system.energy(&x)
            };
            let slope = (energy(h) - energy(-h)) / (2.0 * h);
            assert!((f[i] - slope).abs() < 1e-8, "{kind:?} {i}: {} {slope}", f[i]);
        }
        assert!(norm(&f) > 1e-3, "{kind:?} carries something");
    }
}

/// Rotation by 1.1 rad about (1, 2, 2)/3, by Rodrigues' formula.
fn turned(x: &[f64]) -> Vec<f64> {
    let k = [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
    let (s, c) = 1.1f64.sin_cos();
    let one = |x: &[f64; 3]| -> [f64; 3] {
        let across = [k[1] * x[2] - k[2] * x[1], k[2] * x[0] - k[0] * x[2], k[0] * x[1] - k[1] * x[0]];
        std::array::from_fn(|i| c * x[i] + s * across[i] + (1.0 - c) * dot(&k, x) * k[i])
    };
    x.as_chunks::<3>().0.iter().flat_map(one).collect()
}

fn shifted(x: &[f64]) -> Vec<f64> {
    x.iter().enumerate().map(|(i, x)| x + [3.0, -7.0, 2.0][i % 3]).collect()
}

/// A rigid motion rotates the forces of a step and changes neither the energy nor the dissipation; internal
/// forces have zero sum and zero moment.
#[test]
fn forces_rotate_with_the_body_and_balance() {
    for kind in ELASTIC.into_iter().chain(DAMPING).chain([Kind::Bent]) {
        let mut system = system_of(&patch(), kind);
        let load =
            if kind == Kind::Bent { FaceLoad { pressure: LOADED.pressure, traction: &[] } } else { UNLOADED };
        let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let x1 = waved(&x0, 1.02, 0.08, 1.3);
        for weight in [0.5, 1.0] {
            let mut step = |moved: &dyn Fn(&[f64]) -> Vec<f64>| {
                let (x0, x1) = (moved(&x0), moved(&x1));
                system.anchor(&x0);
                let at = mix(&x0, &x1, weight);
                let f = forces(&system, Configuration { at: &at, end: &x1, weight }, load);
                (f, at, system.energy(&x1), system.dissipation(&x0, &x1))
            };
            let (f, at, energy, taken) = step(&|x| x.to_vec());
            let (g, _, energy_there, taken_there) = step(&|x| shifted(&turned(x)));
            assert!(largest_difference(&turned(&f), &g) < 1e-13 && norm(&f) > 1e-3, "{kind:?} {weight}");
            assert!((energy - energy_there).abs() < 1e-13, "{kind:?}: {energy} {energy_there}");
            assert!((taken - taken_there).abs() < 1e-13, "{kind:?}: {taken} {taken_there}");
            let (f, at) = (f.as_chunks::<3>().0, at.as_chunks::<3>().0);
            for c in 0..3 {
                let (a, b) = ((c + 1) % 3, (c + 2) % 3);
                let sum: f64 = f.iter().map(|f| f[c]).sum();
                let moment: f64 = f.iter().zip(at).map(|(f, x)| x[a] * f[b] - x[b] * f[a]).sum();
                assert!(sum.abs() < 1e-13 && moment.abs() < 1e-13, "{kind:?} {c}: {sum} {moment}");
            }
        }
    }
}

/// A rigid motion from the unstressed shape causes no force, no strain energy and no dissipation.
#[test]
fn rigid_motion_causes_no_force() {
    // A reefing line is drawn in: it is never unstressed at the reference.
    for kind in ELASTIC.into_iter().chain(DAMPING).filter(|k| *k != Kind::Reefing) {
        let mut m = patch();
        let offset = if kind == Kind::Cables { LINE[2] } else { 0.0 };
        for c in &mut m.cables {
            let [a, b] = c.nodes.map(|n| m.coords[n as usize]);
            let length = (0..3).map(|i| (b[i] - a[i]).powi(2)).sum::<f64>().sqrt();
            c.rest_length = length / (1.0 - 2.0 * offset).sqrt();
        }
        let mut system = system_of(&m, kind);
        let x = system.model.reference.clone();
        let there = shifted(&turned(&x));
        system.anchor(&x);
        let f = forces(&system, Configuration::only(&there), UNLOADED);
        assert!(norm(&f) < 1e-13, "{kind:?}: {f:?}");
        assert!(system.energy(&there).abs() < 1e-14 && system.dissipation(&x, &there).abs() < 1e-14);
    }
}

/// Nodes on no edge of a single triangle.
fn inner_nodes(m: &StructureMesh) -> Vec<usize> {
    let edges = || m.triangles.iter().flat_map(|t| (0..3).map(|i| [t[i], t[(i + 1) % 3]]));
    let single = |[a, b]: [u32; 2]| edges().all(|e| e != [b, a]);
    (0..m.coords.len()).filter(|&n| !edges().any(|e| e.contains(&(n as u32)) && single(e))).collect()
}

/// Patch test: an affine map of the fabric leaves no force on an inner node, whatever the shapes of its elements.
#[test]
fn affine_map_leaves_inner_nodes_in_balance() {
    let m = irregular();
    for kind in [Kind::Membranes, Kind::Field, Kind::Quads, Kind::FieldQuads] {
        let mut free = m.clone();
        free.fixed.clear();
        let system = system_of(&free, kind);
        let x: Vec<f64> = m
            .coords
            .iter()
            .flat_map(|p| [1.2 * p[0] + 0.1 * p[1], 1.1 * p[1] - 0.05 * p[0], 0.3 * p[0] - 0.2 * p[1]])
            .collect();
        let pressure = vec![0.0; m.faces.len()];
        let f = forces(&system, Configuration::only(&x), FaceLoad { pressure: &pressure, traction: &[] });
        let inner = inner_nodes(&m);
        assert!(!inner.is_empty() && norm(&f) > 1e-3, "{kind:?}");
        for n in inner {
            assert!(norm(&f[3 * n..3 * n + 3]) < 1e-14, "{kind:?} {n}: {:?}", &f[3 * n..3 * n + 3]);
        }
    }
}

/// All kinds of forces that depend on places: the blocks of the tangent, where the new places count with any weight.
#[test]
fn tangents_are_the_derivatives_of_the_forces() {
    for kind in ELASTIC.into_iter().chain(DAMPING).chain([Kind::Bent]) {
        let mut system = system_of(&patch(), kind);
        let n = system.model.reference.len();
        let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let x1 = waved(&x0, 1.02, 0.03, 1.3);
        system.anchor(&x0);
        for weight in [0.5, 0.7, 1.0] {
            for seed in [0.9, 1.7] {
                let d: Vec<f64> = (0..n).map(|i| (i as f64 * seed).sin()).collect();
                let force = |s: f64| {
                    let end: Vec<f64> = x1.iter().zip(&d).map(|(x, d)| x + s * d).collect();
                    forces(&system, Configuration { at: &mix(&x0, &end, weight), end: &end, weight }, LOADED)
                };
                let h = 1e-5;
                let (up, down) = (force(h), force(-h));
                let at = mix(&x0, &x1, weight);
                let mut kd = vec![0.0; n];
                let configuration = Configuration { at: &at, end: &x1, weight };
                let plain = forces(&system, configuration, LOADED);
                system.tangent(configuration, LOADED, weight, 0.0, &mut kd);
                assert!(largest_difference(&plain, &kd) < 1e-14, "{kind:?}: the same forces");
                system.matrix.apply(&mut d.clone(), &mut kd);
                for i in 0..n {
                    let slope = (up[i] - down[i]) / (2.0 * h);
                    assert!((slope - kd[i]).abs() < 1e-7, "{kind:?} {weight} {i}: {slope} {}", kd[i]);
                }
            }
        }
    }
}

/// What is computed near some nodes alone is in their rows what is computed for all, also when it is done twice.
#[test]
fn rows_of_some_nodes_are_those_of_all() {
    for kind in ELASTIC.into_iter().chain(DAMPING).chain([Kind::Bent, Kind::Drag]) {
        let mut system = system_of(&patch(), kind);
        let n = system.model.reference.len();
        let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let x1 = waved(&x0, 1.02, 0.03, 1.3);
        let at = mix(&x0, &x1, 0.7);
        system.anchor(&x0);
        let configuration = Configuration { at: &at, end: &x1, weight: 0.7 };
        let (full, mut out) = (forces(&system, configuration, LOADED), vec![0.0; n]);
        system.tangent(configuration, LOADED, 0.7, 3.0, &mut out);
        let blocks = system.matrix.values.clone();
        let w: Vec<f64> = (0..n).map(|i| (i as f64 * 0.3).cos()).collect();
        let mut inertia = vec![0.0; n];
        system.add_mass_product(&w, &mut inertia);
        for node in 0..n / 3 {
            let active: Vec<bool> = (0..n / 3).map(|k| k == node).collect();
            system.balance_near(&active, configuration, LOADED, &w, &mut out);
            for i in 3 * node..3 * node + 3 {
                assert!(
                    (out[i] - full[i] - inertia[i]).abs() < 1e-14,
                    "{kind:?} {i}: {} {}",
                    out[i],
                    full[i]
                );
            }
            system.matrix.values.iter_mut().flatten().flatten().for_each(|v| *v = 7.0);
            system.tangent_near(&active, configuration, LOADED, 0.7, 3.0, &mut out);
            system.tangent_near(&active, configuration, LOADED, 0.7, 3.0, &mut out);
            for i in 3 * node..3 * node + 3 {
                assert!((out[i] - full[i]).abs() < 1e-14, "{kind:?} {i}: {} {}", out[i], full[i]);
            }
            for slot in system.matrix.row(node) {
                let (a, b) = (system.matrix.values[slot].as_flattened(), blocks[slot].as_flattened());
                assert!(largest_difference(a, b) < 1e-14, "{kind:?} {node}: {a:?} {b:?}");
            }
        }
    }
}

/// The drag of lines depends on velocities, and on the turn of segments, which the tangent leaves out: a motion
/// of all nodes alike turns none.
#[test]
fn the_drag_of_lines_has_its_derivative_by_velocity() {
    let mut system = system_of(&patch(), Kind::Drag);
    let n = system.model.reference.len();
    let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
    let x1 = waved(&x0, 1.0, 0.1, 1.3);
    system.anchor(&x0);
    for weight in [0.5, 0.7, 1.0] {
        for c in 0..3 {
            let d: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i % 3 == c))).collect();
            let force = |s: f64| {
                let end: Vec<f64> = x1.iter().zip(&d).map(|(x, d)| x + s * d).collect();
                forces(&system, Configuration { at: &mix(&x0, &end, weight), end: &end, weight }, UNLOADED)
            };
            let h = 1e-6;
            let (up, down) = (force(h), force(-h));
            let (at, mut kd) = (mix(&x0, &x1, weight), vec![0.0; n]);
            system.tangent(Configuration { at: &at, end: &x1, weight }, UNLOADED, weight, 0.0, &mut kd);
            system.matrix.apply(&mut d.clone(), &mut kd);
            assert!(norm(&kd) > 0.01, "{kd:?}");
            for i in 0..n {
                let slope = (up[i] - down[i]) / (2.0 * h);
                assert!((slope - kd[i]).abs() < 1e-7, "{weight} {c} {i}: {slope} {}", kd[i]);
            }
        }
    }
}

/// Over a step, forces in the middle do the work of stresses over the change of Green strains, exactly: what
/// damping is said to take is the work of its forces. That of the air is its force at the end.
#[test]
fn damping_takes_the_work_of_its_forces() {
    for (kind, without, weight) in [
        (Kind::SheetDamping, None, 0.5),
        (Kind::QuadDamping, Some(Kind::Quads), 0.5),
        (Kind::LineDamping, None, 0.5),
        (Kind::Drag, None, 1.0),
    ] {
        let mut system = system_of(&patch(), kind);
        let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let x1 = waved(&x0, 1.1, 0.08, 1.3);
        let at = mix(&x0, &x1, weight);
        let configuration = Configuration { at: &at, end: &x1, weight };
        system.anchor(&x0);
        let mut f = forces(&system, configuration, UNLOADED);
        if let Some(kind) = without {
            let mut elastic = system_of(&patch(), kind);
            elastic.anchor(&x0);
            let all = forces(&elastic, configuration, UNLOADED);
            f.iter_mut().zip(all).for_each(|(f, e)| *f -= e);
        }
        let du: Vec<f64> = x1.iter().zip(&x0).map(|(b, a)| b - a).collect();
        let (work, taken) = (dot(&f, &du), system.dissipation(&x0, &x1));
        assert!((work - taken).abs() < 1e-13 && taken.abs() > 1e-3, "{kind:?}: {work} {taken}");
        if kind == Kind::Drag {
            // Action and reaction; the reinforcement lies on fabric and has no drag of its own.
            let air = system.air_force(&x1);
            let sum: [f64; 3] = std::array::from_fn(|c| f.iter().skip(c).step_by(3).sum());
            assert!((0..3).all(|c| (air[c] + sum[c]).abs() < 1e-14), "{air:?} {sum:?}");
        }
    }
}

/// A step of averaged strains in the middle does the work of the energy that a linear law stores, exactly, also of lines
/// that are strained at rest.
#[test]
fn steps_of_averaged_strains_store_their_work() {
    for kind in [Kind::Membranes, Kind::Quads, Kind::Cables, Kind::Reefing] {
        let mut system = system_of(&patch(), kind);
        let x0 = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let x1 = waved(&x0, 1.1, 0.05, 1.3);
        system.anchor(&x0);
        let at = mix(&x0, &x1, 0.5);
        let f = forces(&system, Configuration { at: &at, end: &x1, weight: 0.5 }, UNLOADED);
        let du: Vec<f64> = x1.iter().zip(&x0).map(|(b, a)| b - a).collect();
        let (work, stored) = (dot(&f, &du), system.energy(&x1) - system.energy(&x0));
        assert!((work - stored).abs() < 1e-13 && stored > 1e-3, "{kind:?}: {work} {stored}");
    }
}

/// From the unstressed shape elements of a linear law take `2 beta / dt` times the energy that they store: stress and
/// strain are both proportional.
#[test]
fn damping_is_in_proportion_to_the_energy() {
    let kinds = [
        (Kind::SheetDamping, Kind::Membranes),
        (Kind::QuadDamping, Kind::Quads),
        (Kind::LineDamping, Kind::Cables),
    ];
    for (damped, elastic) in kinds {
        let mut m = patch();
        // Lines are as long as they are without their strain at rest.
        for c in &mut m.cables {
            let [a, b] = c.nodes.map(|n| m.coords[n as usize]);
            let length = (0..3).map(|i| (b[i] - a[i]).powi(2)).sum::<f64>().sqrt();
            c.rest_length = length / (1.0 - 2.0 * LINE[2]).sqrt();
        }
        let [mut damped_one, elastic_one] = [damped, elastic].map(|k| system_of(&m, k));
        let x0 = elastic_one.model.reference.clone();
        let x1 = waved(&x0, 1.1, 0.05, 1.3);
        damped_one.anchor(&x0);
        let (taken, stored) = (damped_one.dissipation(&x0, &x1), elastic_one.energy(&x1));
        let exact = 2.0 * DAMPED[0] / DAMPED[1] * stored;
        assert!((taken / exact - 1.0).abs() < 1e-12, "{damped:?}: {taken} {exact}");
        // Twice the time, half the rate.
        damped_one.set_step(2.0 * DAMPED[1]);
        assert!((damped_one.dissipation(&x0, &x1) / exact - 0.5).abs() < 1e-12, "{damped:?}");
    }
}

/// Triangles with the further forces of bent faces have the external load of bilinear elements, and that is what both
/// take from the inner forces.
#[test]
fn bent_faces_have_the_load_of_bilinear_elements() {
    let m = patch();
    let pressed = FaceLoad { pressure: LOADED.pressure, traction: &[] };
    let external = |kind: Kind| {
        let system = system_of(&m, kind);
        let x = waved(&system.model.reference, 1.1, 0.05, 2.1);
        let mut out = vec![0.0; x.len()];
        system.external(&x, pressed, &mut out);
        let (full, free) = (
            forces(&system, Configuration::only(&x), pressed),
            forces(&system, Configuration::only(&x), UNLOADED),
        );
        let taken: Vec<f64> = free.iter().zip(&full).map(|(a, b)| a - b).collect();
        assert!(largest_difference(&taken, &out) < 1e-14, "{kind:?}");
        out
    };
    let [flat, bent, exact] = [Kind::Membranes, Kind::Bent, Kind::Quads].map(external);
    let sum: Vec<f64> = flat.iter().zip(&bent).map(|(a, b)| a + b).collect();
    assert!(largest_difference(&sum, &exact) < 1e-14 && norm(&bent) > 1e-3);
}

/// A plane sheet under an affine map: principal strains and stresses, energy, and the resultants of both loads.
#[test]
fn an_affine_map_has_its_closed_forms() {
    let [y, nu, thickness] = FABRIC;
    let mut m = irregular();
    m.fixed.clear();
    let faces = m.faces.len();
    for kind in [Kind::Membranes, Kind::Quads] {
        let system = system_of(&m, kind);
        let (f1, f2) = ([1.2, -0.05], [0.1, 1.1]);
        let x: Vec<f64> = m
            .coords
            .iter()
            .flat_map(|p| [f1[0] * p[0] + f2[0] * p[1], f1[1] * p[0] + f2[1] * p[1], 0.0])
            .collect();
        let e = [0.5 * (dot(&f1, &f1) - 1.0), 0.5 * (dot(&f2, &f2) - 1.0), 0.5 * dot(&f1, &f2)];
        // Principal values by trace and determinant.
        let (trace, det) = (e[0] + e[1], e[0] * e[1] - e[2] * e[2]);
        let root = (0.25 * trace * trace - det).sqrt();
        let (e1, e2) = (0.5 * trace + root, 0.5 * trace - root);
        let factor = y / (1.0 - nu * nu);
        let (s1, s2) = (factor * (e1 + nu * e2), factor * (e2 + nu * e1));
        let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|i| (a[i] - b[i]).abs() < 1e-13);
        let one = &system.loops()[0];
        assert!(one.strains(&x).iter().all(|e| near(*e, [e1, e2])), "{kind:?}: {e1} {e2}");
        assert!(one.stresses(&x).iter().all(|(s, _)| near(*s, [s1, s2])), "{kind:?}: {s1} {s2}");
        let energy = 0.5 * thickness * (s1 * e1 + s2 * e2);
        assert!((system.energy(&x) / energy - 1.0).abs() < 1e-13, "{kind:?}");
        let (p, t) = (0.7, [0.1, -0.2, 0.3]);
        let (pressure, traction) = (vec![p; faces], t.repeat(faces));
        let load = FaceLoad { pressure: &pressure, traction: &traction };
        let mut external = vec![0.0; x.len()];
        system.external(&x, load, &mut external);
        let area = f1[0] * f2[1] - f1[1] * f2[0];
        let exact = [area * t[0], area * t[1], area * (t[2] + p)];
        for (c, exact) in exact.into_iter().enumerate() {
            let sum: f64 = external.iter().skip(c).step_by(3).sum();
            assert!((sum - exact).abs() < 1e-13, "{kind:?} {c}: {sum} {exact}");
        }
        // Loads count with the other sign among the forces.
        let (loaded, free) = (forces(&system, Configuration::only(&x), load), {
            let none = vec![0.0; faces];
            forces(&system, Configuration::only(&x), FaceLoad { pressure: &none, traction: &[] })
        });
        let difference: Vec<f64> = free.iter().zip(&loaded).map(|(a, b)| a - b).collect();
        assert!(largest_difference(&difference, &external) < 1e-14, "{kind:?}");
    }
}

/// Tension of lines and of a fading reefing line: A Y (E + E0) l / L, with the share of the force that is left.
#[test]
fn tensions_have_their_closed_form() {
    let m = patch();
    let system = system_of(&m, Kind::Cables);
    let x = waved(&system.model.reference, 1.1, 0.05, 2.1);
    let length = |x: &[f64], a: usize, b: usize| {
        (0..3).map(|c| (x[3 * b + c] - x[3 * a + c]).powi(2)).sum::<f64>().sqrt()
    };
    let [y, area, offset] = LINE;
    for (c, found) in m.cables.iter().zip(system.loops()[0].tensions(&x)) {
        let [a, b] = c.nodes.map(|n| n as usize);
        let l = length(&x, a, b) / c.rest_length;
        let exact = area * y * (0.5 * (l * l - 1.0) + offset) * l;
        assert!((found - exact).abs() < 1e-14, "{found} {exact}");
    }
    let ties = [[0, 4], [4, 5], [5, 6]];
    let segments = ties.map(|t| t.map(|n| n as u32));
    let model =
        Model::with_ties(&Comm::solo(), &m, &[0; 7], Surface::default(), &segments).expect("a good mesh");
    let mut line = Elements::reefing(&model, y, area, SCHEDULE, SKIRT);
    line.set_time(2.05);
    let mut f = vec![0.0; x.len()];
    line.forces(Configuration::only(&x), UNLOADED, &mut f);
    // The first node has the first segment, the last the last; the second has that of the first with the other sign.
    let pulls = [0, 1, 2].map(|k| match k {
        0 => norm(&f[..3]),
        1 => norm(&[0, 1, 2].map(|c| f[c] + f[12 + c])),
        _ => norm(&f[18..21]),
    });
    for (found, [a, b]) in pulls.into_iter().zip(ties) {
        // Reefed from the unstressed skirt in the ratio of the lengths.
        let l = length(&x, a, b) / (length(&model.reference, a, b) * SCHEDULE.length / SKIRT);
        let exact = (0.75 * area * y * 0.5 * (l * l - 1.0) * l).max(0.0);
        assert!((found - exact).abs() < 1e-13, "{found} {exact}");
    }
}
