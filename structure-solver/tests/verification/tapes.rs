//! Tapes: the stiffness of a taped strip in closed form, and the sections of risers and tapes.

use std::path::Path;
use std::rc::Rc;

use case::Scene;
use comm::Comm;
use structure_solver::assemble;
use structure_solver::dynamics::Dynamics;
use structure_solver::loops::{Configuration, FaceLoad};
use structure_solver::measures::Diagnostics;

/// A strip of 3 m x 1 m of fabric of E t = 300 N/m without Poisson contraction, with a grid of tapes.
fn strip(cells: [u32; 2], grid: &str, integration: &str) -> Scene {
    let text = format!(
        r#"
        name = "strip"
        [canopy]
        kind = "panel"
        size_m = [3.0, 1.0]
        cells = [{}, {}]
        held = "ends"
        [fabric]
        youngs_modulus_pa = 3e6
        poisson_ratio = 0.0
        thickness_m = 1e-4
        density_kg_m3 = 400.0
        {grid}
        [structure]
        {integration}
        [[stage]]
        name = "pull"
        kind = "pre-inflation"
        pressure_pa = 0.0
        duration_s = 1.0
        window_s = 0.1
        "#,
        cells[0], cells[1]
    );
    case::parse(Path::new("strip.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn assembled(scene: &Scene) -> Dynamics {
    let mesh = Rc::new(mesh::structure_mesh(scene).expect("a mesh"));
    assemble::dynamics(&Comm::solo(), scene, 0, &mesh).expect("a structure")
}

/// Internal forces (N) on the nodes of a structure with the stretches `by` along x and y.
fn forces(d: &Dynamics, by: [f64; 2]) -> Vec<f64> {
    let model = &d.system.model;
    let scale = [by[0], by[1], 1.0];
    let x: Vec<f64> = model.reference.iter().enumerate().map(|(i, x)| x * scale[i % 3]).collect();
    let pressure = vec![0.0; model.n_faces];
    let mut out = vec![0.0; x.len()];
    for l in d.system.loops() {
        let load = FaceLoad { pressure: &pressure, traction: &[] };
        l.forces(Configuration::only(&x), load, &mut out);
    }
    out
}

const GRID: &str = "[tapes.grid]\naxial_stiffness_n = 500.0\nmass_kg_m = 2e-3\nspacing_m = 0.25";

/// Patch test. A uniform stretch of a strip with tapes at a spacing d is pulled at its ends by the force
/// (E t + EA / d) W e lambda, e = (lambda^2 - 1) / 2, on each mesh, whether or not its lines coincide with the spacing; no other node
/// has a force on it.
#[test]
fn a_taped_strip_has_the_stiffness_of_fabric_and_tapes() {
    let stretch = 1.04;
    let strain = 0.5 * (stretch * stretch - 1.0);
    let exact = (300.0 + 500.0 / 0.25) * strain * stretch;
    for cells in [[6, 4], [5, 8], [7, 3], [4, 20], [3, 1]] {
        for membrane in ["triangle", "quadrilateral"] {
            let d = assembled(&strip(cells, GRID, &format!("membrane = \"{membrane}\"")));
            let out = forces(&d, [stretch, 1.0]);
            let x = &d.system.model.reference;
            let end = |i: &usize| x[3 * i] > 1.5 - 1e-9;
            let pull: f64 = (0..x.len() / 3).filter(end).map(|i| out[3 * i]).sum();
            assert!((pull / exact - 1.0).abs() < 1e-12, "{cells:?} {membrane}: {pull} is not {exact}");
            let inside = |i: &usize| x[3 * i].abs() < 1.5 - 1e-9;
            let rest = (0..x.len() / 3).filter(inside).map(|i| out[3 * i].abs()).fold(0.0, f64::max);
            assert!(rest < 1e-12 * exact, "{cells:?} {membrane}: {rest}");
        }
    }
}

/// One tape of a grid carries EA e lambda, however many an element stands for; the tapes of the hem have their own tension, and other places none.
#[test]
fn largest_tension_is_that_of_one_tape_at_each_place() {
    let hem = "[tapes.hem]\naxial_stiffness_n = 70.0\nmass_kg_m = 2e-3\n";
    let strain = |stretch: f64| 0.5 * (stretch * stretch - 1.0) * stretch;
    for cells in [[6, 4], [5, 8], [7, 3], [3, 1]] {
        let scene = strip(cells, &format!("{hem}{GRID}"), "");
        let mut d = assembled(&scene);
        let mesh = mesh::structure_mesh(&scene).expect("a mesh");
        let mut diagnostics = Diagnostics::new(&d.system, &mesh, &scene);
        for (i, (u, x)) in d.accepted.u.iter_mut().zip(&d.system.model.reference).enumerate() {
            *u = [0.04, 0.02, 0.0][i % 3] * x;
        }
        let load = FaceLoad { pressure: &vec![0.0; d.system.model.n_faces], traction: &[] };
        let found = diagnostics.measure(&d.system, &d.accepted, load).max_tape_tensions;
        let exact = [70.0 * strain(1.04), 0.0, 0.0, 500.0 * strain(1.04)];
        let error = found.iter().zip(exact).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
        assert!(error < 1e-11 * exact[3], "{cells:?}: {found:?} is not {exact:?}");
    }
}

/// A shortened tape pushes only where it is a bar: the fabric, which carries compression here, is all that is left.
#[test]
fn tapes_push_only_where_the_scene_says_so() {
    let (shrink, fabric, tapes) = (0.98, 300.0, 500.0 / 0.25);
    let strain = 0.5 * (shrink * shrink - 1.0);
    for (key, stiffness) in [("", fabric), ("[tapes]\ntension_only = false\n", fabric + tapes)] {
        let d = assembled(&strip([6, 4], &format!("{key}{GRID}"), ""));
        let out = forces(&d, [shrink, 1.0]);
        let x = &d.system.model.reference;
        let pull: f64 = (0..x.len() / 3).filter(|i| x[3 * i] > 1.5 - 1e-9).map(|i| out[3 * i]).sum();
        assert!((pull / (stiffness * strain * shrink) - 1.0).abs() < 1e-12, "{key}: {pull}");
    }
}

/// Mass of 0.04 kg/m2 of fabric and 2 g/m of tape each 0.25 m, both ways, on two meshes, lumped and consistent.
#[test]
fn masses_of_a_taped_strip_do_not_depend_on_the_mesh() {
    let exact = 3.0 * (0.04 + 2.0 * 2e-3 / 0.25);
    for cells in [[6, 4], [7, 3], [24, 8]] {
        for integration in ["integration = \"explicit\"", "mass = \"lumped\"", ""] {
            let mass = assembled(&strip(cells, GRID, integration)).system.total_mass();
            assert!((mass / exact - 1.0).abs() < 1e-13, "{cells:?} {integration}: {mass} is not {exact}");
        }
    }
}

/// The tension of each cable stands in its own row: lines, risers and tapes with sections of their own.
#[test]
fn tensions_are_in_the_order_of_the_cables() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/atps-descent/scene.toml");
    let mut scene = case::load(&file).expect("a scene");
    let plain = assembled(&scene);
    scene.risers = Some(case::Risers { axial_stiffness_n: 3e3, mass_kg_m: 5e-3, ..Default::default() });
    let tape = case::Tape { axial_stiffness_n: 700.0, mass_kg_m: 1e-3, ..case::Tape::default() };
    scene.tapes = Some(case::Tapes { hem: Some(tape), vents: Some(tape), ..case::Tapes::default() });
    let taped = assembled(&scene);
    let stretched =
        |d: &Dynamics| -> Vec<f64> { d.system.model.reference.iter().map(|x| 1.02 * x).collect() };
    let x = stretched(&taped);
    let tensions = taped.system.tensions(&x);
    for (c, tension) in taped.system.model.cables.iter().zip(&tensions) {
        let [a, b] = c.nodes.map(|n| &x[3 * n as usize..3 * n as usize + 3]);
        let length = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        let stretch = length / c.rest_length;
        let strain = (0.5 * (stretch * stretch - 1.0)).max(0.0);
        let section = c.kind.section(&scene).expect("a section");
        let exact = section.axial_stiffness_n * strain * stretch;
        assert!((tension - exact).abs() < 1e-9 * exact.max(1.0), "{c:?}: {tension} is not {exact}");
    }
    let lines = plain.system.tensions(&stretched(&plain));
    assert_eq!(lines[..28], tensions[..28], "suspension lines as without tapes");
    assert!(tensions[28..32].iter().zip(&lines[28..32]).all(|(a, b)| a > b), "stiffer risers");
}

/// The former `canopy.reinforcements` are tapes at hem, seams and vents with the section of the lines: the same mass, and the
/// same forces in a stretched shape.
#[test]
fn former_reinforcements_are_tapes_with_the_section_of_the_lines() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/atps-descent/scene.toml");
    let mut former = case::load(&file).expect("a scene");
    let mut tapes = former.clone();
    let case::Canopy::Atps(a) = &mut former.canopy else { panic!("an ATPS scene") };
    a.reinforcements = true;
    let lines = tapes.lines.as_ref().expect("lines");
    let tape = Some(case::Tape {
        axial_stiffness_n: lines.youngs_modulus_pa * lines.area_m2,
        mass_kg_m: lines.density_kg_m3 * lines.area_m2,
        ..case::Tape::default()
    });
    tapes.tapes = Some(case::Tapes { hem: tape, seams: tape, vents: tape, ..case::Tapes::default() });
    let [former, tapes] = [former, tapes].map(|s| assembled(&s));
    let [a, b] = [&former, &tapes].map(|d| d.system.total_mass());
    assert!((a / b - 1.0).abs() < 1e-14, "{a} is not {b}");
    let [a, b] = [&former, &tapes].map(|d| forces(d, [1.03, 1.05]));
    let scale = a.iter().fold(0.0f64, |m, f| m.max(f.abs()));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12 * scale), "of {scale} N");
}
