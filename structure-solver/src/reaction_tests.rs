//! Reactions against statics and the balance of momentum, and prescribed rotations.

use std::path::Path;
use std::rc::Rc;

use case::Scene;
use comm::Comm;
use mesh::StructureMesh;
use mesh::geometry::Vec3;

use crate::assemble;
use crate::dynamics::{Dynamics, LoadPath};
use crate::equilibrium::EquilibriumParams;
use crate::flat::at;
use crate::loops::FaceLoad;
use crate::reactions::{self, Reaction};

/// A panel of 1 m by 0.4 m with what `rest` says.
fn scene(held: &str, rest: &str) -> Scene {
    let text = format!(
        r#"
        name = "test"
        [canopy]
        kind = "panel"
        size_m = [1.0, 0.4]
        cells = [6, 4]
        held = "{held}"
        [fabric]
        youngs_modulus_pa = 1e6
        poisson_ratio = 0.3
        thickness_m = 1e-3
        density_kg_m3 = 800.0
        prestress_pa = 2e4
        [structure]
        newton_tolerance = 1e-11
        gmres_tolerance = 1e-10
        {rest}
        "#
    );
    case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

const MASS: f64 = 1.0 * 0.4 * 1e-3 * 800.0;
const AREA: f64 = 0.4;

fn structure(scene: &Scene) -> (Dynamics, StructureMesh) {
    let mesh = Rc::new(mesh::structure_mesh(scene).expect("a mesh"));
    let mut d = assemble::dynamics(&Comm::solo(), scene, 0, &mesh).expect("a structure");
    let times = case::StageTimes::planned(scene);
    assemble::nodal(&mut d, scene, 0, &times, &mesh).unwrap_or_else(|e| panic!("{e}"));
    if scene.structure.integration == case::Integration::Explicit {
        d.integrate_explicitly(0.5).unwrap_or_else(|e| panic!("{e}"));
    }
    reactions::watch(&mut d, scene, &mesh).expect("groups");
    (d, (*mesh).clone())
}

fn stage(rest: &str) -> String {
    format!(
        "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 0\nduration_s = 0.2\nwindow_s = 1e-2\nsubsteps = 2\n{rest}\n"
    )
}

const STATIC: &str =
    "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 40\nsolve = \"static\"\n";

fn rest(d: &mut Dynamics, pressure: f64, body: [f64; 3]) {
    let p = vec![pressure; d.system.model.n_faces];
    let load = FaceLoad { pressure: &p, traction: &[] };
    let params = EquilibriumParams { tolerance: 1e-11, ..EquilibriumParams::default() };
    d.equilibrium(load, body, params, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
    d.reactions_at_rest(load, body);
}

fn close(found: Vec3, expected: Vec3, tolerance: f64) {
    assert!((found - expected).norm() <= tolerance, "{found:?} beside {expected:?}");
}

/// Clamped all round under pressure and weight. The vector area of a surface is that of its boundary, so that the force is `p A - m g` however the panel
/// bulges, and its moment that of the flat panel; groups that share no node add up.
#[test]
fn reactions_at_rest_carry_pressure_and_weight() {
    let groups = "[[output.reaction]]\nname = \"all\"\nnodes = \"rim\"\nmoment_point_m = [0.3, -0.7, 0.2]
        [[output.reaction]]\nname = \"left\"\nnodes = \"left\"\n[[output.reaction]]\nname = \"right\"\nnodes = \"right\"\n
        [[output.reaction]]\nname = \"free\"\nat_m = [0, 0, 0]\n";
    let (mut d, mesh) = structure(&scene("all", &format!("[output]\n{groups}{STATIC}")));
    let (pressure, g) = (40.0, 9.81);
    rest(&mut d, pressure, [0.0, 0.0, -g]);
    let [all, left, right, free] = *d.mean_reactions() else { panic!("four groups") };
    let load = Vec3::new(0.0, 0.0, pressure * AREA - MASS * g);
    close(all.force, -load, 1e-8);
    // The weight of the bulged panel acts at its centroid, which symmetry leaves above the middle.
    close(all.moment, -Vec3::new(-0.3, 0.7, -0.2).cross(&load), 1e-8);
    assert!(left.force.x < -1.0 && (left.force.x + right.force.x).abs() < 1e-7, "{left:?} {right:?}");
    close(left.force - Vec3::x() * 2.0 * left.force.x, right.force, 1e-7);
    assert_eq!(free, Reaction::default());
    let file = tempfile::tempdir().expect("a folder");
    let mut scene = scene("all", &format!("[output]\n{groups}{STATIC}"));
    scene.output.reactions.truncate(2);
    let mut log = reactions::Log::open(file.path(), &scene, false).expect("a file");
    log.push(0.5, &d.mean_reactions()[..2]).expect("a row");
    let text = std::fs::read_to_string(file.path().join("reactions.csv")).expect("the file");
    assert!(text.starts_with("time_s,all_force_x_n,") && text.contains(",left_moment_z_n_m\n5.0"), "{text}");
    assert_eq!(text.lines().nth(1).expect("a row").split(',').count(), 13);
    assert_eq!(mesh.node_sets["left"].len(), 5);
}

/// Momentum (N s) and angular momentum (N m s) of all nodes about `about`.
fn momenta(d: &Dynamics, about: Vec3) -> [Vec3; 2] {
    let mut mv = vec![0.0; d.accepted.v.len()];
    d.system.add_mass_product(&d.accepted.v, &mut mv);
    let nodes = 0..d.system.model.n_owned();
    let place = |n: usize| at(&d.system.model.reference, n) + at(&d.accepted.u, n) - about;
    nodes.fold([Vec3::zeros(); 2], |[p, l], n| [p + at(&mv, n), l + place(n).cross(&at(&mv, n))])
}

/// A panel on its root that swings under a pressure jump and its weight. Force and moment at the root are the rates of momentum and angular momentum less
/// weight and pressure; those of the pressure are known where the balance is: of implicit steps in the middle, of which the test takes one a window.
#[test]
fn reactions_balance_the_momentum_in_motion() {
    for (kind, mass) in [("", "consistent"), ("", "lumped"), ("integration = \"explicit\"", "lumped")] {
        let kind = format!(
            "{kind}\nmass = \"{mass}\"\n[output]\n[[output.reaction]]\nname = \"all\"\nnodes = \"rim\"\nmoment_point_m = [0.1, 0.2, 0.3]"
        );
        let (mut d, mesh) = structure(&scene("root", &format!("{kind}\n{}", stage(""))));
        let (about, body) = (Vec3::new(0.1, 0.2, 0.3), [0.5, -1.0, -9.81]);
        let explicit = d.explicit().is_some();
        let faces = d.system.model.n_faces;
        let dt = 1e-3;
        let mut largest = 0.0f64;
        for k in 0..40 {
            let [p, q] =
                [0.0, 1.0].map(|s| if explicit { 0.0 } else { 30.0 * (0.1 * (f64::from(k) + s)).sin() });
            let (first, last) = (vec![p; faces], vec![q; faces]);
            let load = LoadPath { pressure: [&first, &last], traction: [&[]; 2] };
            let before = (momenta(&d, about), d.accepted.u.clone());
            d.window(dt, 1, load, body, false).expect("a window");
            let r = d.mean_reactions()[0];
            d.accept();
            let after = momenta(&d, about);
            // Pressure and weight on the shape in the middle.
            let x: Vec<f64> = (0..d.accepted.u.len())
                .map(|i| d.system.model.reference[i] + 0.5 * (before.1[i] + d.accepted.u[i]))
                .collect();
            let mean = vec![0.5 * (p + q); faces];
            let mut f = vec![0.0; x.len()];
            d.system.pressed(&x, FaceLoad { pressure: &mean, traction: &[] }, &mut f);
            let weight: Vec<f64> = (0..x.len()).map(|i| body[i % 3]).collect();
            d.system.add_mass_product(&weight, &mut f);
            let nodes = 0..d.system.model.n_owned();
            let external = nodes.fold(Reaction::default(), |sum, n| Reaction {
                force: sum.force + at(&f, n),
                moment: sum.moment + (at(&x, n) - about).cross(&at(&f, n)),
            });
            close(r.force + external.force, (after[0] - before.0[0]) / dt, 1e-7);
            let rate = (after[1] - before.0[1]) / dt;
            close(r.moment + external.moment, rate, if explicit { 1e-3 } else { 1e-7 });
            largest = largest.max(r.moment.norm());
        }
        assert!(largest > 0.5 && mesh.n_canopy == 35, "{largest}");
    }
}

const TABLE: &str = "time_s = [0.0, 1.0]\nrotation = { axis = [0, 0, 2], point_m = [0.2, 0.5, 7.0], angle_deg = [0.0, 150.0] }";
const FORMULA: &str =
    "rotation = { axis = [0, 0, 1], point_m = [0.2, 0.5, 7.0], angle_rad = \"150*pi/180*t\" }";
/// Rate of both, rad/s.
const RATE: f64 = 150.0 * std::f64::consts::PI / 180.0;
const CENTRE: Vec3 = Vec3::new(0.2, 0.5, 0.0);

fn turned(r: Vec3, angle: f64) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Vec3::new(cos * r.x - sin * r.y, sin * r.x + cos * r.y, r.z)
}

/// Largest distance of `nodes` from their places on the circle after `angle`, m.
fn off_circle(d: &Dynamics, nodes: &[u32], angle: f64) -> f64 {
    let off = |n: &u32| {
        let start = at(&d.system.model.reference, *n as usize);
        (start + at(&d.accepted.u, *n as usize) - CENTRE - turned(start - CENTRE, angle)).norm()
    };
    nodes.iter().map(off).fold(0.0, f64::max)
}

/// The whole panel turned by a table and by a formula: all nodes are on their circles, nothing is strained, and the force
/// is that of the differences of their positions, `-m (2 - 2 cos(w dt)) / dt^2` times the distance of the centroid from the axis.
#[test]
fn a_prescribed_rotation_is_rigid() {
    for how in [TABLE, FORMULA] {
        let group = "[output]\n[[output.reaction]]\nname = \"all\"\nnodes = \"canopy\"\n";
        let motion = stage(&format!("[[stage.motion]]\nnodes = \"canopy\"\n{how}"));
        let (mut d, mesh) = structure(&scene("root", &format!("{group}{motion}")));
        let faces = vec![0.0; d.system.model.n_faces];
        let load = LoadPath { pressure: [&faces, &faces], traction: [&[]; 2] };
        let rest = d.system.energy(&d.system.model.reference);
        let dt = 2e-2;
        let factor = (2.0 - 2.0 * (RATE * dt).cos()) / (dt * dt);
        for k in 1..=30 {
            d.window(dt, 1, load, [0.0; 3], false).unwrap_or_else(|e| panic!("{e}"));
            let force = d.mean_reactions()[0].force;
            d.accept();
            let angle = |k: i32| RATE * dt * f64::from(k);
            assert!(off_circle(&d, &mesh.node_sets["canopy"], angle(k)) < 1e-14);
            let x: Vec<f64> =
                d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
            assert!((d.system.energy(&x) - rest).abs() < 1e-12, "{} {rest}", d.system.energy(&x));
            if k > 1 {
                close(force, turned(CENTRE, angle(k - 1)) * (factor * MASS), 1e-8);
            }
        }
    }
}

/// Explicit steps take an edge along its circle too.
#[test]
fn explicit_steps_rotate_an_edge() {
    let motion = stage(&format!("[[stage.motion]]\nnodes = \"right\"\n{FORMULA}"));
    let (mut d, mesh) = structure(&scene("root", &format!("integration = \"explicit\"\n{motion}")));
    let faces = vec![0.0; d.system.model.n_faces];
    let load = LoadPath { pressure: [&faces, &faces], traction: [&[]; 2] };
    for k in 1..=5 {
        d.window(2e-3, 1, load, [0.0; 3], false).unwrap_or_else(|e| panic!("{e}"));
        d.accept();
        assert!(off_circle(&d, &mesh.node_sets["right"], RATE * 2e-3 * f64::from(k)) < 1e-14);
    }
}

/// One end of a strip held, the other twisted by 60 degrees about its axis: what twists it is what holds it.
#[test]
fn a_twisted_strip_is_held_by_opposite_moments() {
    let motion = "[[stage.motion]]\nnodes = \"right\"\ntime_s = [0.0, 1.0]\nrotation = { axis = [1, 0, 0], point_m = [0.5, 0, 0], angle_deg = [0, 60] }\n";
    let group = |n: &str| {
        format!("[[output.reaction]]\nname = \"{n}\"\nnodes = \"{n}\"\nmoment_point_m = [0.0, 0.1, 0.0]\n")
    };
    let (mut d, mesh) =
        structure(&scene("root", &format!("[output]\n{}{}{STATIC}{motion}", group("left"), group("right"))));
    d.system.model.fixed.fill(false);
    let held = mesh.node_sets["left"].iter().chain(&mesh.node_sets["right"]);
    let dofs: Vec<u32> = held.flat_map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
    d.system.fix(&dofs);
    rest(&mut d, 0.0, [0.0; 3]);
    let [left, right] = *d.mean_reactions() else { panic!("two groups") };
    close(left.force, -right.force, 1e-8);
    close(left.moment, -right.moment, 1e-8);
    // A strip under the tension T resists a twist as T b^2 / 12 over its length, and more as its edges stretch.
    assert!(right.moment.x > 2e4 * 1e-3 * 0.4f64.powi(3) / 12.0 * 60f64.to_radians(), "{right:?}");
    let corner = mesh.node_sets["right"][4] as usize;
    let half = 60f64.to_radians();
    close(at(&d.accepted.u, corner), Vec3::new(0.0, 0.2 * (half.cos() - 1.0), 0.2 * half.sin()), 1e-15);
}
