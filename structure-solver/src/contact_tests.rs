//! Contact in motion: crossing strips.

use mesh::StructureMesh;
use mesh::geometry::Vec3;

use crate::dynamics::{Dynamics, LoadPath};
use crate::effect_tests::{BAG, of_mesh, scene};
use crate::flat::at;
use crate::loops::FaceLoad;

const DISTANCE: f64 = 0.01;
const NONE: FaceLoad<'_> = FaceLoad { pressure: &[0.0; 2], traction: &[] };
const FREE: LoadPath<'_> = LoadPath { pressure: [&[0.0; 2]; 2], traction: [&[]; 2] };

/// Two free strips of 1 m by 0.1 m, each of one quadrilateral, crossed as an X at a distance (m): no node is near a triangle.
fn strips(gap: f64) -> StructureMesh {
    let mut mesh = StructureMesh::default();
    for strip in 0..2u32 {
        let (s, c) = if strip == 0 { (0.0, 1.0) } else { 0.9f64.sin_cos() };
        for [x, y] in [[-0.5, -0.05], [0.5, -0.05], [0.5, 0.05], [-0.5, 0.05]] {
            mesh.coords.push([c * x - s * y, s * x + c * y, gap * f64::from(strip)]);
        }
        let q = [0, 1, 2, 3].map(|i| 4 * strip + i);
        mesh.faces.push(q);
        mesh.face_panel.push(strip);
        mesh.triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        mesh.triangle_face.extend([strip; 2]);
    }
    mesh.n_canopy = mesh.coords.len();
    mesh
}

/// Momentum (kg m/s), moment of momentum (kg m2/s) and energy (J).
fn invariants(d: &Dynamics) -> (Vec3, Vec3, f64) {
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let (mut p, mut l, mut energy) = (Vec3::zeros(), Vec3::zeros(), d.system.energy(&x));
    for n in 0..d.system.model.n_owned() {
        let (m, v) = (d.system.lumped_mass(n), at(&d.accepted.v, n));
        p += v * m;
        l += at(&x, n).cross(&(v * m));
        energy += 0.5 * m * v.norm_squared();
    }
    (p, l, energy)
}

/// The upper strip falls on the lower one at 2 m/s; both spin a little and slide along x at a speed (m/s) in opposite directions.
fn colliding(contact: &str, how: &str, safety: Option<f64>, slide: f64) -> Dynamics {
    let stage = format!(
        "[structure]\n{how}\n[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 0\nduration_s = 1.0\nwindow_s = 1e-3\n{contact}"
    );
    let mut d = of_mesh(&scene(BAG, "density_kg_m3 = 1000.0", &stage), strips(0.015));
    if let Some(safety) = safety {
        d.integrate_explicitly(safety).unwrap_or_else(|e| panic!("{e}"));
    }
    for n in 0..8 {
        let spin = Vec3::new(0.0, 0.0, 0.3).cross(&at(&d.system.model.reference, n));
        let side = if n < 4 { 1.0 } else { -1.0 };
        let v = spin + Vec3::new(0.1 + slide * side, 0.0, side);
        d.accepted.v[3 * n..3 * n + 3].copy_from_slice(v.as_slice());
    }
    d.balance_start(NONE, [0.0; 3]).expect("a mass");
    d
}

fn heights(d: &Dynamics) -> [f64; 2] {
    [0, 4].map(|first| {
        (first..first + 4).map(|n| d.system.model.reference[3 * n + 2] + d.accepted.u[3 * n + 2]).sum::<f64>()
            / 4.0
    })
}

/// Without contact the strips pass through each other; with it, edges against edges, they bounce, explicitly and implicitly.
#[test]
fn crossing_strips_do_not_pass_through_each_other() {
    let with = format!("[fabric.contact]\ndistance_m = {DISTANCE}");
    for (how, safety) in
        [("integration = \"explicit\"", Some(0.4)), ("spectral_radius = 0.8\nnewton_max_steps = 60", None)]
    {
        for contact in ["", with.as_str()] {
            let mut d = colliding(contact, how, safety, 0.0);
            for k in 0..40 {
                d.window(1e-3, 4, FREE, [0.0; 3], false).unwrap_or_else(|e| panic!("{how}, window {k}: {e}"));
                d.accept();
            }
            let [lower, upper] = heights(&d);
            println!("strips, {how}, contact {}: heights {lower:.4} and {upper:.4} m", !contact.is_empty());
            if contact.is_empty() {
                assert!(upper - lower < -0.05, "{how}: {lower} {upper}");
            } else {
                assert!(upper - lower > 0.02, "{how}: {lower} {upper}");
            }
        }
    }
}

/// Momentum and moment of momentum stay to rounding in explicit steps, whose forces are in balance at the positions of the nodes.
/// The energy changes with the square of the step, as that of central differences does.
#[test]
fn bouncing_strips_keep_momentum_and_energy() {
    let with = format!("[fabric.contact]\ndistance_m = {DISTANCE}");
    let lost = |safety: f64| {
        let mut d = colliding(&with, "integration = \"explicit\"", Some(safety), 0.0);
        let (p0, l0, e0) = invariants(&d);
        let (mut pressed, mut most) = (0.0f64, 0.0f64);
        for _ in 0..40 {
            d.window(1e-3, 1, FREE, [0.0; 3], false).expect("a step");
            d.accept();
            let (p, l, e) = invariants(&d);
            // 1e4 steps at most, each with some roundings of the largest terms.
            assert!((p - p0).norm() < 1e-12 * 7.5e-3, "{p} {p0}");
            assert!((l - l0).norm() < 1e-12 * 7.5e-3, "{l} {l0}");
            most = most.max((e / e0 - 1.0).abs());
            let x: Vec<f64> =
                d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
            let strain = d.system.loops().last().expect("contact").energy(&x);
            pressed = pressed.max(strain / e0);
        }
        // Both were pressed and came apart again.
        let [lower, upper] = heights(&d);
        assert!(pressed > 0.1 && upper - lower > 0.02, "{pressed} {lower} {upper}");
        most
    };
    let [large, small] = [0.4, 0.2].map(lost);
    println!("bouncing strips: energy within {large:.2e} at 0.4 of the stable step, {small:.2e} at 0.2");
    assert!(large < 0.02 && small < 0.4 * large, "{large} {small}");
}

/// Friction of crossing edges: momentum and moment of momentum stay to rounding, the strips slow each other down, and the
/// energy that is lost is what slip took, to the error of the steps.
#[test]
fn crossing_strips_with_friction_lose_what_slip_takes() {
    let law = format!("[fabric.contact]\ndistance_m = {DISTANCE}\nfriction = 0.3");
    let mut d = colliding(&law, "integration = \"explicit\"", Some(0.2), 0.5);
    let ((p0, l0, e0), mut taken) = (invariants(&d), 0.0);
    for _ in 0..40 {
        let work = d.window(1e-3, 1, FREE, [0.0; 3], false).expect("a step").damping_work;
        assert!(work >= 0.0, "{work}");
        taken += work;
        d.accept();
        let (p, l, e) = invariants(&d);
        assert!((p - p0).norm() < 1e-12 * 7.5e-3 && (l - l0).norm() < 1e-12 * 7.5e-3, "{p} {p0} {l} {l0}");
        // Contact without friction is within 1.1e-3 at this step.
        assert!((e + taken - e0).abs() < 5e-3 * e0, "{e} {taken} {e0}");
    }
    println!("strips with friction: slip took {:.2} % of the energy", 1e2 * taken / e0);
    assert!(taken > 0.02 * e0, "{taken} {e0}");
}

/// Distance of contact of a block on a plate, m.
const NEAR: f64 = 0.004;

/// A fixed plate of 8 by 8 cells in the plane z = 0, 1 m by 1 m, and a triangle over it at the distance of contact.
fn block() -> StructureMesh {
    let (mut mesh, n) = (StructureMesh::default(), 8u32);
    for j in 0..=n {
        for i in 0..=n {
            let node = j * (n + 1) + i;
            mesh.coords.push([f64::from(i) / 8.0, f64::from(j) / 8.0, 0.0]);
            mesh.fixed.push((node, [true; 3]));
            if i < n && j < n {
                let quad = [node, node + 1, node + n + 2, node + n + 1];
                let face = mesh.faces.len() as u32;
                mesh.faces.push(quad);
                mesh.face_panel.push(0);
                mesh.triangles.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
                mesh.triangle_face.extend([face; 2]);
            }
        }
    }
    let first = mesh.coords.len() as u32;
    mesh.coords.extend([[0.12, 0.31, NEAR], [0.22, 0.33, NEAR], [0.15, 0.42, NEAR]]);
    mesh.triangle_face.push(mesh.faces.len() as u32);
    mesh.faces.push([first, first + 1, first + 2, first + 2]);
    mesh.face_panel.push(1);
    mesh.triangles.push([first, first + 1, first + 2]);
    mesh.n_canopy = mesh.coords.len();
    mesh
}

/// The triangle rests on the plate under gravity and slides at `speed` (m/s): its dynamics, and its nodes.
fn on_plate(friction: f64, normal: f64, speed: f64) -> (Dynamics, std::ops::Range<usize>) {
    let stage = format!(
        "[structure]\nintegration = \"explicit\"\n[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 0\n\
         duration_s = 1.0\nwindow_s = 1e-3\n[fabric.contact]\ndistance_m = {NEAR}\nfriction = {friction}"
    );
    let mut d = of_mesh(&scene(BAG, "density_kg_m3 = 1000.0", &stage), block());
    d.integrate_explicitly(0.4).unwrap_or_else(|e| panic!("{e}"));
    let nodes = d.system.model.n_owned() - 3..d.system.model.n_owned();
    // Pairs begin at the distance of contact; then the weight rests on them.
    let reference = d.system.model.reference.clone();
    d.system.advance_history(&reference);
    d.system.keep();
    let stiffness = 0.25 * 206.8e6 * 3.048e-5;
    for n in nodes.clone() {
        d.accepted.u[3 * n + 2] = -d.system.lumped_mass(n) * normal / stiffness;
        d.accepted.v[3 * n] = speed;
    }
    (d, nodes)
}

const STILL: [f64; 65] = [0.0; 65];
const UNLOADED: LoadPath<'_> = LoadPath { pressure: [&STILL; 2], traction: [&[]; 2] };

/// A block that slides on a plate slows down by `mu g` until it rests, over many faces of the plate, and slip takes its energy.
#[test]
fn sliding_block_slows_down_by_the_coefficient_of_friction() {
    let (mu, g, v0) = (0.3, 9.81, 1.5);
    let (mut d, nodes) = on_plate(mu, g, v0);
    let (_, _, e0) = invariants(&d);
    let (mut taken, mut last) = (0.0, e0);
    for k in 1..=600 {
        taken += d.window(1e-3, 1, UNLOADED, [0.0, 0.0, -g], false).expect("a step").damping_work;
        d.accept();
        let t = 1e-3 * f64::from(k);
        let exact = (v0 - mu * g * t).max(0.0);
        let v = nodes.clone().map(|n| d.accepted.v[3 * n]).sum::<f64>() / 3.0;
        assert!((v - exact).abs() < 2e-3 * v0, "{t}: {v} {exact}");
        let (_, _, e) = invariants(&d);
        // The weight moves by nothing: no energy comes in.
        assert!(e < last + 1e-4 * e0 && (e + taken - e0).abs() < 2e-3 * e0, "{t}: {e} {last} {taken} {e0}");
        last = e;
    }
    let way = d.accepted.u[3 * nodes.start];
    println!(
        "block of friction 0.3: {way:.5} m, exact {:.5} m; slip took {:.5} of the energy",
        v0 * v0 / (2.0 * mu * g),
        taken / e0
    );
    assert!(
        (way / (v0 * v0 / (2.0 * mu * g)) - 1.0).abs() < 3e-3 && (taken / e0 - 1.0).abs() < 2e-3,
        "{way} {taken}"
    );
}

/// On a slope with the static stretch $`s = \tan\alpha`$ of its springs, in units of `N / k`, a block that is let go swings to 2 s where that is below the
/// limit $`\mu`$. Else it slips until its kinetic energy is used up: to $`\mu + (s^2 - (\mu - s)^2) / (2 (\mu - s))`$ for $`s < \mu`$. Above, it
/// slides with `g (sin - mu cos)`.
#[test]
fn block_on_a_slope_sticks_or_slides() {
    let (mu, g, stiffness) = (0.3, 9.81, 0.25 * 206.8e6 * 3.048e-5);
    for s in [0.1, 0.25, 0.28, 0.32, 0.6f64] {
        let (sine, cosine) = s.atan().sin_cos();
        let (mut d, nodes) = on_plate(mu, g * cosine, 0.0);
        let mut furthest = 0.0f64;
        for _ in 0..200 {
            d.window(1e-3, 1, UNLOADED, [g * sine, 0.0, -g * cosine], false).expect("a step");
            d.accept();
            furthest = furthest.max(d.accepted.u[3 * nodes.start]);
        }
        let stretch = d.system.lumped_mass(nodes.start) * g * cosine / stiffness;
        let swing = if 2.0 * s < mu { 2.0 * s } else { mu + (s * s - (mu - s).powi(2)) / (2.0 * (mu - s)) };
        let exact = if s < mu { stretch * swing } else { 0.5 * g * (sine - mu * cosine) * 0.2 * 0.2 };
        println!("slope of {s}: {furthest:.4e} m, closed form {exact:.4e} m");
        // Windows of 1 ms meet the swing of 1.2 ms at some of its phases; a slide begins with a swing.
        assert!((0.95..1.05).contains(&(furthest / exact)), "{s}: {furthest} {exact}");
    }
}
