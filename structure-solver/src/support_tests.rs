//! The force on what holds the structure against the tension of a line.

use mesh::StructureMesh;
use mesh::geometry::Vec3;

use crate::dynamics::Dynamics;
use crate::effect_tests::{BAG, FREE, NONE, STAGE, chain, of_mesh, scene};
use crate::measures::Diagnostics;
use crate::payload::Payload;
use crate::rigid::BodyState;

const MASS: f64 = 2.0;
const DT: f64 = 1e-3;

/// A mass below the end of a line of 1 m that holds it, on a spring of 1000 N/m: w = 22.4 /s.
fn hanging(structure: &str, damping: f64) -> (Dynamics, StructureMesh) {
    let mut mesh = chain(vec![[0.0, 0.0, 1.0], [0.0; 3]], vec![0]);
    mesh.point_masses = vec![(1, MASS)];
    let stage = STAGE.replace("spectral_radius = 1.0", structure);
    let stage = format!("{stage}\nmass_damping_per_s = {damping}\n");
    let lines = "density_kg_m3 = 1e-6\ntension_only = false";
    let mut d = of_mesh(&scene(BAG, lines, &stage), mesh.clone());
    if structure.contains("explicit") {
        d.integrate_explicitly(0.05).unwrap_or_else(|e| panic!("{e}"));
    }
    (d, mesh)
}

/// The mass swings on its line under weight, or under a force of its own without it, through several periods. The mean
/// force on the holder is the mean of the line's pull: exactly where the scheme balances forces at both ends of a
/// step, to (w dt)^2 / 12 = 4e-5 and the change of the pull over a step where it does so in between.
#[test]
fn the_force_on_the_holder_is_the_pull_of_the_line() {
    for (structure, damping, most) in [
        ("spectral_radius = 1.0", 0.0, 2e-4),
        ("spectral_radius = 0.6", 1.5, 2e-2),
        ("integration = \"explicit\"", 0.0, 1e-4),
        ("integration = \"explicit\"", 1.5, 1e-4),
    ] {
        for weight in [0.0, -9.80665] {
            let (mut d, mesh) = hanging(structure, damping);
            if weight == 0.0 {
                d.system.add_force(1, [0.0, 0.0, -30.0]);
            }
            let body = [0.0, 0.0, weight];
            d.balance_start(NONE, body).expect("masses");
            let mut gauge = Diagnostics::new(&d.system, &mesh, &scene(BAG, "density_kg_m3 = 1e-6", STAGE));
            let mut pull = gauge.measure(&d.system, &d.accepted, NONE).riser_force;
            let (mut worst, mut sum) = (0.0f64, [0.0; 2]);
            for _ in 0..600 {
                let info = d.window(DT, 1, FREE, body, false).expect("a step");
                let total = d.system.total_mass();
                let found = d.mean_support_force(DT, &info)[2] + weight * total;
                let end = gauge.measure(&d.system, &d.current, NONE).riser_force;
                let mean = 0.5 * (pull + end);
                worst = worst.max((found - mean).abs());
                sum = [sum[0] + found * DT, sum[1] + mean * DT];
                pull = end;
                d.accept();
            }
            let scale = if weight == 0.0 { 30.0 } else { MASS * 9.80665 };
            println!("{structure}, damping {damping}, weight {weight}: {:.1e}, {sum:?} N s", worst / scale);
            assert!(worst < most * scale, "{structure}, {weight}: {worst} N");
            assert!((sum[0] - sum[1]).abs() < most * sum[1].abs(), "{structure}: {sum:?}");
        }
    }
}

/// A holder of 3 kg whose height is prescribed: what moves it is outside, and the force on it is the pull of the line
/// alone, also where it starts at 1 m/s within a step.
#[test]
fn a_holder_that_is_moved_adds_no_inertia_of_its_own() {
    let (_, mut mesh) = hanging("spectral_radius = 1.0", 0.0);
    mesh.point_masses = vec![(0, 3.0), (1, MASS)];
    let mut d = of_mesh(&scene(BAG, "density_kg_m3 = 1e-6\ntension_only = false", STAGE), mesh.clone());
    d.prescribe(&[0], [true; 3], &[0.0, 0.1, 0.2], &[[0.0; 3], [0.0; 3], [0.0, 0.0, 0.1]]);
    let body = [0.0, 0.0, -9.80665];
    d.balance_start(NONE, body).expect("masses");
    let mut gauge = Diagnostics::new(&d.system, &mesh, &scene(BAG, "density_kg_m3 = 1e-6", STAGE));
    let mut pull = gauge.measure(&d.system, &d.accepted, NONE).riser_force;
    let mut most = 0.0f64;
    for window in 0..200 {
        let info = d.window(DT, 1, FREE, body, false).expect("a step");
        // The holder's own weight is not in the pull.
        let found = d.mean_support_force(DT, &info)[2] + body[2] * (d.system.total_mass() - 3.0);
        let end = gauge.measure(&d.system, &d.current, NONE).riser_force;
        most = most.max((found - 0.5 * (pull + end)).abs());
        assert!(most < 0.1, "{window}: {found} of {pull} to {end} N");
        pull = end;
        d.accept();
    }
    assert!((d.accepted.u[2] - 0.1).abs() < 1e-9, "the holder has moved");
}

/// A payload that is a body on the line: the force on it is that of the line, up to the line's own mass.
#[test]
fn the_force_on_a_free_payload_is_the_pull_of_the_line() {
    let mut mesh = chain(vec![[0.0; 3], [0.0, 0.0, 1.0]], vec![0, 1]);
    mesh.node_sets.insert("payload".into(), vec![0]);
    let lines = "density_kg_m3 = 1e-6\ntension_only = false";
    let mut d = of_mesh(&scene(BAG, lines, STAGE), mesh.clone());
    let payload = Payload::on(&d, &mesh, MASS, Vec3::repeat(0.1), &[[0.0; 3]], 0.0);
    let state = BodyState::start(&payload.body, Vec3::zeros(), Vec3::zeros());
    d.carry(payload, state);
    let mut before = 0.0;
    for window in 0..600 {
        d.window(DT, 1, FREE, [0.0, 0.0, -9.80665], false).expect("a step");
        let found = d.mean_payload_force(DT, [0.0, 0.0, -9.80665].into()).expect("a payload")[2];
        let end = d.current.body.expect("a payload").force[2];
        if window > 0 {
            assert!((found - 0.5 * (before + end)).abs() < 1e-6, "{window}: {found} {before} {end}");
        }
        before = end;
        d.accept();
    }
}
