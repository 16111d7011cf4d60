//! Explicit time integration: its stable step, its order, what it keeps.

use mesh::StructureMesh;
use structure_solver::dynamics::{Dynamics, LoadPath};

use structure_solver::elements::cable::{self, TensionOnly, TwoWay};
use structure_solver::elements::mass::MassMatrix;
use structure_solver::explicit::ExplicitError;
use structure_solver::loops::{ElementLoop, Elements};
use structure_solver::materials::TensionField;
use structure_solver::scheme::Scheme;
use structure_solver::system::System;

use crate::common::*;
use crate::energy::{thrown_with, vibration};
use crate::shapes::*;

fn lumped_chain(mesh: &StructureMesh, density: f64) -> Dynamics {
    let model = model(mesh);
    let cables = Elements::cables(
        &model,
        cable::Elastic { law: TwoWay { youngs_modulus: 1e6 }, offset: 0.0 },
        1e-4,
        density,
    );
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(cables)];
    Dynamics::new(System::new(model, loops, MassMatrix::Lumped), params(Scheme::newmark(), 0.0))
}

/// A chain of n equal springs between fixed ends has the highest frequency
/// 2 sqrt(k/m) sin((n - 1) pi / (2 n)), with k = E A / l and m = rho A l.
#[test]
fn the_highest_frequency_of_a_chain_is_found() {
    let n = 24;
    let mut d = lumped_chain(&chain(n, 2.4, 2.4), 1000.0);
    let exact = 2.0
        * (1e6 / (1000.0 * 0.01f64)).sqrt()
        * ((n - 1) as f64 / (2 * n) as f64 * std::f64::consts::PI).sin();
    let found = d.integrate_explicitly(0.5).expect("a chain with mass").frequency;
    println!("highest frequency of a chain: {:.4} of the closed form", found / exact);
    // Power iteration comes from below; the default step has a factor of two in hand.
    assert!((0.97..1.0 + 1e-6).contains(&(found / exact)), "{found} {exact}");
}

/// Energy of a vibration over its start after 4000 steps at a share of the stable step.
fn growth(safety: f64) -> f64 {
    let mut d = thrown_with(Scheme::newmark(), 1.0 + 1e-6, 1e-3, MassMatrix::Lumped);
    let rest = energies(&d)[1];
    let stable = d.integrate_explicitly(1.0).expect("a sheet with mass").stable_step();
    let start = vibration(&d, rest);
    // One step to a substep: the limit is this test's, so nothing may divide further.
    d.integrate_explicitly(1e3).expect("a sheet with mass");
    for _ in 0..400 {
        let p = vec![0.0; d.system.model.n_faces];
        let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
        if d.window(10.0 * safety * stable, 10, load, [0.0; 3], false).is_err() {
            return f64::INFINITY;
        }
        d.accept();
    }
    vibration(&d, rest) / start
}

/// Just below the limit that was computed a vibration stays, just above it explodes: the
/// limit is that of the structure, not an estimate from its edges.
#[test]
fn the_stable_step_is_sharp() {
    let (below, above) = (growth(0.95), growth(1.05));
    println!("energy after 4000 steps at 0.95 and 1.05 of the stable step: {below:.4} and {above:.1e}");
    assert!((0.5..2.0).contains(&below), "{below}");
    assert!(above.is_nan() || above > 1e3, "{above}");
}

fn explicit_drift(safety: f64) -> f64 {
    let mut d = thrown_with(Scheme::newmark(), 1.05, 4.0, MassMatrix::Lumped);
    let rest = energies(&d)[1];
    let start = vibration(&d, rest);
    let stable = d.integrate_explicitly(1e3).expect("a sheet with mass").stable_step();
    (0..1000).fold(0.0f64, |worst, _| {
        window(&mut d, 10.0 * safety * stable, 10, 0.0, [0.0; 3]);
        worst.max((vibration(&d, rest) / start - 1.0).abs())
    })
}

/// As for the implicit schemes: amplitudes of a tenth of the side, 10 000 steps.
#[test]
fn explicit_steps_keep_the_energy_of_a_free_vibration() {
    let found = [explicit_drift(0.5), explicit_drift(0.25)];
    println!("energy drift of explicit steps at 0.5 and 0.25 of the stable one: {}", sci(&found));
    // Symplectic: the error does not grow, and falls with the square of the step.
    assert!(found[0] < 1e-2 && found[1] < found[0] / 2.5, "{found:?}");
}

/// Smooth motion with mass damping under pressure and gravity: the error after a fixed time falls with the square of
/// the step, against implicit steps (spectral radius 1, same lumped mass) so fine
/// that theirs does not count.
#[test]
fn explicit_steps_have_order_two_and_agree_with_implicit_ones() {
    let end = 0.02;
    let run = |steps: u64, explicit: bool| {
        let mut d = thrown_with(Scheme::generalized_alpha(1.0), 1.05, 2.0, MassMatrix::Lumped);
        d.accepted.a.fill(0.0);
        balance(&mut d, 3.0, [0.0, 0.0, -9.81]);
        if explicit {
            let stable = d.integrate_explicitly(1e3).expect("a sheet with mass").stable_step();
            assert!(end / (steps as f64) < 0.9 * stable, "{stable}");
        }
        window(&mut d, end, steps, 3.0, [0.0, 0.0, -9.81]);
        d.accepted.u.clone()
    };
    let exact = run(6400, true);
    let errors = [200, 400, 800].map(|n| largest_difference(&run(n, true), &exact));
    let orders = orders(&errors);
    let implicit = [400, 800].map(|n| largest_difference(&run(n, false), &exact));
    println!("explicit: errors {}, orders {orders:.2?}; implicit beside it {}", sci(&errors), sci(&implicit));
    assert!(orders.iter().all(|o| (1.9..2.15).contains(o)), "{orders:?}");
    assert!(implicit[1] < 0.3 * implicit[0] && implicit[1] < 1e-4, "{implicit:?}");
}

/// A free sheet of 1 kg/m2 under a pressure of 1 Pa/s times t: central differences give the velocity
/// t^2 / 2 exactly, and at 1 s, after N steps, the displacement (1 - 1/N^2) / 6.
#[test]
fn a_growing_load_acts_in_each_explicit_step_at_its_instant() {
    let mut m = sheet(2, 1.0);
    m.fixed.clear();
    let line = TwoWay { youngs_modulus: 1e7 };
    let system = both_of_mass(&m, TensionField::new(1e6, 0.3), line, 1e-5, MassMatrix::Lumped);
    let mut d = Dynamics::new(system, sharp(Scheme::newmark()));
    let stable = d.integrate_explicitly(0.5).expect("a sheet with mass").stable_step();
    let substeps = 8;
    let inside = (1.0 / (substeps as f64 * 0.5 * stable)).ceil();
    assert!(inside > 3.0, "each substep is divided: {inside}");
    let (none, full) = (vec![0.0; d.system.model.n_faces], vec![1.0; d.system.model.n_faces]);
    let load = LoadPath { pressure: [&none, &full], traction: [&[]; 2] };
    d.window(1.0, substeps, load, [0.0; 3], false).expect("a solvable window");
    d.accept();
    let steps = substeps as f64 * inside;
    let exact = (1.0 - 1.0 / (steps * steps)) / 6.0;
    let (u, v) = (d.accepted.u[2], d.accepted.v[2]);
    println!("growing load in {steps} explicit steps: u {u:.9} beside {exact:.9}, v {v:.9}");
    // Rounding of the strains, which are zero but for it.
    assert!((u - exact).abs() < 1e-9 && (v - 0.5).abs() < 1e-9, "{u} {exact} {v}");
}

/// The same sheet under a constant pressure with mass damping of 3/s: the acceleration at the end is what the load
/// and the damping leave.
#[test]
fn the_acceleration_after_explicit_steps_knows_the_damping() {
    let mut m = sheet(2, 1.0);
    m.fixed.clear();
    let line = TwoWay { youngs_modulus: 1e7 };
    let system = both_of_mass(&m, TensionField::new(1e6, 0.3), line, 1e-5, MassMatrix::Lumped);
    let mut d = Dynamics::new(system, params(Scheme::newmark(), 3.0));
    d.integrate_explicitly(0.5).expect("a sheet with mass");
    window(&mut d, 0.2, 4, 1.0, [0.0; 3]);
    let (v, a) = (d.accepted.v[2], d.accepted.a[2]);
    let exact = (1.0 - (-0.6f64).exp()) / 3.0;
    assert!((v - exact).abs() < 1e-4, "{v} {exact}");
    assert!((a - (1.0 - 3.0 * v)).abs() < 1e-9, "{a} {v}");
}

/// A mass on a spring whose foot moves at a constant velocity from rest: x = V t - V/w sin(w t). Central differences
/// run (w h)^2 / 24 fast, here 2e-5 of the frequency.
#[test]
fn a_foot_that_moves_drives_explicit_steps() {
    let mesh = StructureMesh {
        coords: vec![[0.0; 3], [1.0, 0.0, 0.0]],
        point_masses: vec![(0, 1.0), (1, 2.0)],
        fixed: vec![(0, [true; 3]), (1, [false, true, true])],
        cables: chain(1, 1.0, 1.0).cables,
        ..Default::default()
    };
    let model = model(&mesh);
    let cables = Elements::cables(
        &model,
        cable::Elastic { law: TwoWay { youngs_modulus: 8e4 }, offset: 0.0 },
        1e-4,
        1e-9,
    );
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(cables)];
    let mut d = Dynamics::new(System::new(model, loops, MassMatrix::Lumped), params(Scheme::newmark(), 0.0));
    // So slow that the spring stays linear: its strain is V / w.
    let (speed, w) = (1e-7, 2.0f64);
    d.prescribe(&[0], [true; 3], &[0.0, 10.0], &[[0.0; 3], [10.0 * speed, 0.0, 20.0 * speed]]);
    let step = d.integrate_explicitly(0.01).expect("a mass on a spring").stable_step();
    assert!((step - 1.0).abs() < 1e-5, "2 / w: {step}");
    for k in 1..=4 {
        window(&mut d, 0.6, 3, 0.0, [0.0; 3]);
        let t = 0.6 * f64::from(k);
        let (u, v) = (&d.accepted.u, &d.accepted.v);
        let exact = [speed * t, speed * t - speed / w * (w * t).sin(), speed * (1.0 - (w * t).cos())];
        for (found, exact) in [u[0], u[3], v[3]].iter().zip(exact) {
            assert!((found - exact).abs() < 1e-4 * speed, "{k}: {found} {exact}");
        }
        assert!((u[2] - 2.0 * speed * t).abs() < 1e-12 * speed, "{k}: {}", u[2]);
        assert!(
            (v[0] - speed).abs() < 1e-8 * speed && (v[2] - 2.0 * speed).abs() < 1e-8 * speed,
            "{k}: {v:?}"
        );
    }
}

/// A great mass held by a line that is cut at 0.5 s and fades over 2 s: in explicit steps its velocity is the impulse
/// `F (t - (t - 0.5)^2 / 4)` of the force, which trapezoids find exactly from instants that hold the kink.
#[test]
fn a_line_that_is_cut_fades_in_explicit_steps() {
    use structure_solver::elements::reefing::Schedule;
    let mesh = StructureMesh {
        coords: vec![[0.0; 3], [1.0, 0.0, 0.0]],
        point_masses: vec![(1, 1e6)],
        fixed: vec![(0, [true; 3])],
        ..Default::default()
    };
    let model = structure_solver::model::Model::with_ties(
        &comm::Comm::solo(),
        &mesh,
        &[0; 2],
        structure_solver::model::Surface::default(),
        &[[0, 1]],
    )
    .expect("a good mesh");
    let schedule = Schedule { length: 0.8, draw_in: 0.0, release: 0.5, ramp: 2.0 };
    let line = Elements::reefing(&model, 1.0, 1.0, schedule, 1.0);
    let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(line)];
    let mut d = Dynamics::new(System::new(model, loops, MassMatrix::Lumped), params(Scheme::newmark(), 0.0));
    let stable = d.integrate_explicitly(1.0).expect("a mass on a line").stable_step();
    // Each substep of 0.125 s is divided in two.
    let evaluations = |d: &Dynamics| d.explicit().expect("explicit steps").evaluations;
    d.integrate_explicitly(0.1 / stable).expect("a mass on a line");
    let force = 0.5 * (1.0 / 0.64 - 1.0) / 0.8;
    for k in 1..=3 {
        let before = evaluations(&d);
        window(&mut d, 0.5, 4, 0.0, [0.0; 3]);
        assert!(evaluations(&d) >= before + 8, "{}", evaluations(&d) - before);
        let t = 0.5 * f64::from(k);
        let since = t - 0.5;
        let impulse = force * (t - 0.25 * since * since);
        let (v, a) = (-1e6 * d.accepted.v[3], -1e6 * d.accepted.a[3]);
        assert!((v - impulse).abs() < 1e-5, "{k}: {v} {impulse}");
        assert!((a - force * (1.0 - 0.5 * since)).abs() < 1e-5, "{k}: {a}");
    }
}

/// Fabric thrown slack and taut: what snapping adds to the energy falls with the step.
#[test]
fn snapping_fabric_keeps_its_energy_better_with_smaller_steps() {
    let made = |safety: f64| {
        let m = grid([8, 8], true, |s, t| [s, t, 0.0]);
        let mut free = m.clone();
        free.fixed.clear();
        let fabric = TensionField::new(1e6, 0.3);
        let line = TensionOnly { youngs_modulus: 1e7 };
        let system = both_of_mass(&free, fabric, line, 1e-5, MassMatrix::Lumped);
        let mut d = Dynamics::new(system, sharp(Scheme::newmark()));
        for (v, x) in d.accepted.v.as_chunks_mut::<3>().0.iter_mut().zip(&free.coords) {
            let phase = 40.0 * x[0] + 23.0 * x[1];
            *v = [3.0 * phase.sin(), 3.0 * (1.7 * phase).cos(), 2.0 * (2.3 * phase).sin()];
        }
        let start: f64 = energies(&d).iter().sum();
        d.integrate_explicitly(safety).expect("a sheet with mass");
        (0..40).fold(0.0f64, |worst, _| {
            window(&mut d, 1e-2, 1, 0.0, [0.0; 3]);
            worst.max((energies(&d).iter().sum::<f64>() / start - 1.0).abs())
        })
    };
    let found = [0.9, 0.5, 0.25].map(made);
    println!("energy error of snapping fabric at 0.9, 0.5, 0.25 of the stable step: {}", sci(&found));
    assert!(found[1] < 0.05 && found[2] < 0.5 * found[1] && found[1] < 0.5 * found[0], "{found:?}");
}

#[test]
fn a_node_without_mass_is_refused_by_name() {
    let mut d = lumped_chain(&chain(4, 0.4, 0.4), 0.0);
    let error = d.integrate_explicitly(0.5).err().expect("no mass anywhere");
    assert_eq!(error, ExplicitError::Massless { node: 1 });
    assert!(error.to_string().contains("point_mass"), "{error}");
}
