//! Explicit substeps take no memory. One test, because it counts the allocations of the process.

use std::sync::atomic::Ordering::Relaxed;

use structure_solver::dynamics::{Dynamics, LoadPath};
use structure_solver::elements::cable::TwoWay;
use structure_solver::elements::mass::MassMatrix;
use structure_solver::materials::StVenantKirchhoff;
use structure_solver::scheme::Scheme;

#[allow(dead_code, reason = "this test uses a part of it")]
#[path = "verification/common.rs"]
mod common;
#[path = "../../tests/src/counted.rs"]
mod counted;
#[allow(dead_code, reason = "this test uses a part of it")]
#[path = "verification/shapes.rs"]
mod shapes;

use counted::COUNT;

/// Allocations of a window of `substeps` under pressure, gravity and mass damping.
fn allocations(d: &mut Dynamics, substeps: u64, pressure: &[f64]) -> usize {
    let load = LoadPath { pressure: [pressure; 2], traction: [&[]; 2] };
    let before = COUNT.load(Relaxed);
    d.window(1e-4 * substeps as f64, substeps, load, [0.0, 0.0, -9.81], false).expect("a stable step");
    let count = COUNT.load(Relaxed) - before;
    d.accept();
    count
}

/// A sheet with lines: a window of 200 substeps takes memory as often as one of ten.
#[test]
fn explicit_substeps_take_no_memory() {
    let mut mesh = shapes::sheet(8, 1.0);
    for k in 0..8 {
        shapes::add_cable(&mut mesh, [36 + k, 37 + k], 0.98 / 8.0);
    }
    let (fabric, line) = (StVenantKirchhoff::isotropic(1e6, 0.3), TwoWay { youngs_modulus: 1e7 });
    let system = common::both_of_mass(&mesh, fabric, line, 1e-5, MassMatrix::Lumped);
    let mut d = Dynamics::new(system, common::params(Scheme::newmark(), 2.0));
    let evaluations = |d: &Dynamics| d.explicit().expect("explicit steps").evaluations;
    d.integrate_explicitly(0.5).expect("a sheet with mass");
    let pressure = vec![30.0; d.system.model.n_faces];
    allocations(&mut d, 10, &pressure);
    let before = evaluations(&d);
    let [few, many] = [10, 200].map(|substeps| allocations(&mut d, substeps, &pressure));
    println!("{few} and {many} allocations in 10 and 200 substeps, {} evaluations", evaluations(&d) - before);
    assert!(evaluations(&d) - before >= 210);
    assert_eq!(few, many);
}
