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

/// The upper strip falls on the lower one at 2 m/s; both spin a little.
fn colliding(contact: &str, how: &str, safety: Option<f64>) -> Dynamics {
    let stage = format!(
        "[structure]\n{how}\n[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 0\nduration_s = 1.0\nwindow_s = 1e-3\n{contact}"
    );
    let mut d = of_mesh(&scene(BAG, "density_kg_m3 = 1000.0", &stage), strips(0.015));
    if let Some(safety) = safety {
        d.integrate_explicitly(safety).unwrap_or_else(|e| panic!("{e}"));
    }
    for n in 0..8 {
        let spin = Vec3::new(0.0, 0.0, 0.3).cross(&at(&d.system.model.reference, n));
        let v = spin + Vec3::new(0.1, 0.0, if n < 4 { 1.0 } else { -1.0 });
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
            let mut d = colliding(contact, how, safety);
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
        let mut d = colliding(&with, "integration = \"explicit\"", Some(safety));
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
