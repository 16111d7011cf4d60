//! Cloth that loses a share of the work of stretching, in time, against that share.

use std::path::Path;
use std::rc::Rc;

use case::Scene;
use comm::Comm;

use crate::assemble;
use crate::dynamics::{Dynamics, LoadPath};
use crate::loops::FaceLoad;
use crate::measures::Diagnostics;

const LOSS: f64 = 0.3;
const EXPLICIT: &str = "integration = \"explicit\"";
const IMPLICIT: &str = "spectral_radius = 1.0\nnewton_tolerance = 1e-9\ngmres_tolerance = 1e-9";
/// Membrane stiffness times width, N.
const STIFFNESS: f64 = 1e6 * 1e-3 * 0.5;
const WINDOW: f64 = 1e-3;

/// A strip of 1 m by 0.5 m that loses [`LOSS`].
fn scene(fabric: &str, structure: &str) -> Scene {
    let text = format!(
        r#"
        name = "test"
        [canopy]
        kind = "panel"
        size_m = [1.0, 0.5]
        cells = [2, 2]
        held = "root"
        [fabric]
        youngs_modulus_pa = 1e6
        poisson_ratio = 0.0
        thickness_m = 1e-3
        density_kg_m3 = 1e-3
        hysteresis = {LOSS}
        {fabric}
        [structure]
        {structure}
        [[stage]]
        name = "one"
        kind = "pre-inflation"
        pressure_pa = 0
        duration_s = 1.0
        window_s = 1e-3
        "#
    );
    case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

/// The strip with a mass of 1 kg at its end at high x, which moves along x alone, and its mesh.
fn structure(s: &Scene) -> (Dynamics, Rc<mesh::StructureMesh>) {
    let mut mesh = mesh::structure_mesh(s).expect("a mesh");
    // In proportion to the width that pulls at a node.
    let share = |x: &[f64; 3]| if x[1].abs() < 0.2 { 0.5 } else { 0.25 };
    let end = mesh.coords.iter().enumerate().filter(|(_, x)| x[0] > 0.49);
    mesh.point_masses = end.map(|(n, x)| (n as u32, share(x))).collect();
    let mesh = Rc::new(mesh);
    let mut d = assemble::dynamics(&Comm::solo(), s, 0, &mesh).expect("a structure");
    let across: Vec<u32> = (0..mesh.coords.len() as u32).flat_map(|n| [3 * n + 1, 3 * n + 2]).collect();
    d.system.fix(&across);
    if s.structure.integration == case::Integration::Explicit {
        d.integrate_explicitly(0.5).unwrap_or_else(|e| panic!("{e}"));
    }
    (d, mesh)
}

struct Measured {
    kinetic: f64,
    stored: f64,
    stretch: f64,
}

fn measured(d: &Dynamics, mesh: &mesh::StructureMesh) -> Measured {
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let end = mesh.coords.iter().position(|x| x[0] > 0.49).expect("the end");
    Measured {
        kinetic: 0.5 * d.accepted.v[3 * end].powi(2),
        stored: d.system.energy(&x),
        stretch: 1.0 + d.accepted.u[3 * end],
    }
}

/// The mass moves away from the strip's root; the strip stops it and lets it come back with the share `1 - LOSS` of its energy. At the turning point the strip has the moduli and the
/// membrane force of the scene, energy is balanced, each window is solved twice, and a structure that continues from the saved state does the same.
fn returns_its_share(fabric: &str, structure_keys: &str, substeps: u64, error: f64) {
    let s = scene(fabric, structure_keys);
    let (mut d, mesh) = structure(&s);
    let faces = vec![0.0; d.system.model.n_faces];
    let at_rest = FaceLoad { pressure: &faces, traction: &[] };
    let load = LoadPath { pressure: [&faces; 2], traction: [&[]; 2] };
    let speed = 1.5;
    // All nodes at the speed of a strip that is stretched evenly.
    for (n, x) in mesh.coords.iter().enumerate() {
        d.accepted.v[3 * n] = speed * (x[0] + 0.5);
    }
    d.balance_start(at_rest, [0.0; 3]).expect("a mass");
    let start = measured(&d, &mesh);
    let (mut taken, mut longest, mut force) = (0.0, 1.0f64, 0.0f64);
    let mut gauge = Diagnostics::new(&d.system, &mesh, &s);
    let what = format!("{fabric} {structure_keys} {substeps}");
    for step in 0..160 {
        let first = d.window(WINDOW, substeps, load, [0.0; 3], false).expect("a window").damping_work;
        let before = d.current.u.clone();
        let second = d.window(WINDOW, substeps, load, [0.0; 3], true).expect("a window").damping_work;
        let same = before.iter().zip(&d.current.u).all(|(a, b)| (a - b).abs() < 1e-10);
        assert!(same && (first - second).abs() < 1e-8, "{what}: {first} {second}");
        taken += second;
        d.accept();
        longest = longest.max(measured(&d, &mesh).stretch);
        let m = gauge.measure(&d.system, &d.accepted, at_rest);
        force = force.max(m.max_membrane_force);
        if step == 40 {
            continues_from_the_saved_state(&mut d, structure(&s).0, load, substeps);
        }
        if step > 80 && measured(&d, &mesh).stretch < 1.0 {
            break;
        }
    }
    let end = measured(&d, &mesh);
    let strain = 0.5 * (longest * longest - 1.0);
    let stored = 0.5 * STIFFNESS * strain * strain;
    println!(
        "{what}: stored {}, returned {}",
        stored / start.kinetic - 1.0,
        end.kinetic / start.kinetic - (1.0 - LOSS)
    );
    assert!((stored / start.kinetic - 1.0).abs() < error, "{what}: {stored} {}", start.kinetic);
    assert!((force * 0.5 / (STIFFNESS * strain * longest) - 1.0).abs() < error, "{what}: {force} {strain}");
    assert!((end.kinetic / start.kinetic - (1.0 - LOSS)).abs() < error, "{what}: {}", end.kinetic);
    let balance = (end.kinetic + end.stored + taken) / start.kinetic - 1.0;
    assert!(balance.abs() < 1e-3, "{what}: {balance}");
}

fn continues_from_the_saved_state(d: &mut Dynamics, mut other: Dynamics, load: LoadPath<'_>, substeps: u64) {
    other.accepted.copy_from(&d.accepted);
    let saved: Vec<_> = d.system.loops().iter().map(|l| l.save_state()).collect();
    for (l, s) in other.system.loops_mut().iter_mut().zip(&saved) {
        l.restore_state(s).expect("a state");
        assert!(s.is_empty() || l.restore_state(&s[1..]).is_err(), "a state of another mesh");
    }
    let next = [&mut other, d].map(|d| {
        d.window(WINDOW, substeps, load, [0.0; 3], false).expect("a window");
        d.current.u.clone()
    });
    assert!(next[0].iter().zip(&next[1]).all(|(a, b)| (a - b).abs() < 1e-10));
}

#[test]
fn cloth_returns_its_share_of_the_energy() {
    let quads = "membrane = \"quadrilateral\"";
    let explicit_quads = format!("{EXPLICIT}\n{quads}");
    let implicit_quads = format!("{IMPLICIT}\n{quads}");
    for (fabric, structure, substeps, error) in [
        ("", IMPLICIT, 4, 1.5e-3),
        ("", IMPLICIT, 16, 5e-4),
        ("", implicit_quads.as_str(), 4, 1.5e-3),
        ("wrinkling = true", IMPLICIT, 4, 1.5e-3),
        ("", EXPLICIT, 4, 2e-4),
        ("wrinkling = true", explicit_quads.as_str(), 4, 2e-4),
    ] {
        returns_its_share(fabric, structure, substeps, error);
    }
}
