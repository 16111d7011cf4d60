//! Effects of a scene, from its text to a solution.

use std::path::Path;
use std::rc::Rc;

use case::Scene;
use comm::Comm;
use mesh::{Cable, CableKind, StructureMesh};

use crate::alone;
use crate::assemble;
use crate::dynamics::{Dynamics, LoadPath};
use crate::equilibrium::EquilibriumParams;
use crate::flat::at;
use crate::loops::FaceLoad;
use crate::velocity_average::VelocityAverage;
use mesh::geometry::Vec3;

const LAST: &str = r#"
    [[stage]]
    name = "one"
    kind = "pre-inflation"
    pressure_pa = 23.94
    solve = "static"
"#;

fn scene(canopy: &str, fabric: &str, rest: &str) -> Scene {
    let text = format!(
        r#"
        name = "test"
        [canopy]
        {canopy}
        [lines]
        youngs_modulus_pa = 1e9
        area_m2 = 1e-6
        density_kg_m3 = 1000.0
        [fabric]
        youngs_modulus_pa = 206.8e6
        poisson_ratio = 0.3
        thickness_m = 3.048e-5
        density_kg_m3 = 1223.5093
        {fabric}
        {rest}
        "#
    );
    case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn structure(scene: &Scene, mesh: Option<StructureMesh>) -> Result<Dynamics, String> {
    let mesh = Rc::new(mesh.map_or_else(|| mesh::structure_mesh(scene), Ok).map_err(|e| e.to_string())?);
    let mut d = assemble::dynamics(&Comm::solo(), scene, 0, &mesh).map_err(|e| e.to_string())?;
    assemble::nodal(&mut d, scene, 0, &case::StageTimes::planned(scene), &mesh).map_err(|e| e.to_string())?;
    Ok(d)
}

fn rest(d: &mut Dynamics, pressure: f64) {
    let p = vec![pressure; d.system.model.n_faces];
    let load = FaceLoad { pressure: &p, traction: &[] };
    let params = EquilibriumParams { tolerance: 1e-10, ..Default::default() };
    d.equilibrium(load, [0.0; 3], params, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
}

fn volume(d: &Dynamics) -> f64 {
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let under =
        |p: [Vec3; 3]| crate::elements::load::area_vector(&p)[2] * (p[0][2] + p[1][2] + p[2][2]) / 3.0;
    d.system.model.triangles.iter().map(|t| under(t.nodes.map(|n| at(&x, n as usize)))).sum()
}

const BAG: &str = "kind = \"air-bag\"\ncells_across = 12";
const WRINKLING: &str = "wrinkling = true\n[structure]\nmembrane = \"quadrilateral\"";

/// Bilinear elements fill the bag as the triangles do: 7.167e-4 m3 with 800 of them;
/// the mesh is coarse, so to 1 %.
#[test]
fn quadrilaterals_inflate_the_air_bag() {
    let mut d = structure(&scene(BAG, WRINKLING, LAST), None).expect("a structure");
    assert_eq!((d.system.model.quads.len(), d.system.model.triangles.len()), (144, 288));
    rest(&mut d, 23.94);
    let v = volume(&d);
    assert!((v / 7.167e-4 - 1.0).abs() < 0.01, "{v}");
    assert!((d.accepted.u[2] / 0.0769 - 1.0).abs() < 0.01, "{}", d.accepted.u[2]);
}

/// Stretched before it is pressed, the bag rises less, with both kinds of elements. This fabric carries compression and buckles
/// along its rim into folds that each kind of element has of its own (2 % of the rise, not less on a finer mesh): the kinds
/// are compared where fabric wrinkles.
#[test]
fn a_prestressed_bag_rises_less() {
    let top = |prestress: &str, membrane: &str| {
        let fabric = format!("{prestress}\n[structure]\nmembrane = \"{membrane}\"");
        let mut s = scene(BAG, &fabric, LAST);
        s.fabric.youngs_modulus_pa *= 1e-2;
        let mut d = structure(&s, None).expect("a structure");
        rest(&mut d, 5.0);
        d.accepted.u[2]
    };
    let [loose, taut] = ["", "prestress_pa = 1e6"].map(|p| ["triangle", "quadrilateral"].map(|m| top(p, m)));
    assert!(taut.iter().zip(loose).all(|(t, l)| *t > 0.0 && *t < 0.8 * l), "{taut:?} {loose:?}");
}

/// The key adds the bending energy and no mass, with both kinds of elements: a flat sheet rolled to a cylinder of
/// curvature k stores D k^2 / 2 for each area between its hinges.
#[test]
fn a_bending_stiffness_adds_the_energy_of_a_curvature() {
    for membrane in ["", "[structure]\nmembrane = \"quadrilateral\""] {
        let of = |stiffness: Option<f64>, x: &dyn Fn(&[f64]) -> Vec<f64>| {
            let mut s = scene(BAG, membrane, LAST);
            s.fabric.bending_stiffness_n_m = stiffness;
            let d = structure(&s, None).expect("a structure");
            (d.system.energy(&x(&d.system.model.reference)), d.system.total_mass(), s)
        };
        let rolled = |x: &[f64]| -> Vec<f64> {
            let roll = |p: &[f64; 3]| [p[0].sin(), p[1], p[2] + 1.0 - p[0].cos()];
            x.as_chunks::<3>().0.iter().flat_map(roll).collect()
        };
        let (bent, mass, s) = of(Some(2.0), &rolled);
        let (free, plain_mass, _) = of(None, &rolled);
        assert_eq!(mass, plain_mass);
        let area = mass / (s.fabric.density_kg_m3 * s.fabric.thickness_m);
        let share = (bent - free) / (0.5 * 2.0 * area);
        assert!((0.8..1.1).contains(&share), "{share}");
        let flat = |x: &[f64]| x.iter().map(|x| 1.01 * x).collect();
        let [with, without] = [Some(2.0), None].map(|k| of(k, &flat).0);
        assert!((with / without - 1.0).abs() < 1e-9, "{with} {without}");
    }
}

/// The key chooses the law: a sheet stretched by 1.3 both ways stores `mu / 2 (2 l^2 + l^-4 - 3)` in each volume, with `mu` a third
/// of the modulus, with both kinds of elements, wrinkling or not.
#[test]
fn a_neo_hookean_sheet_has_the_energy_of_its_stretch() {
    for rest in ["", "wrinkling = true", "[structure]\nmembrane = \"quadrilateral\"", WRINKLING] {
        let mut s = scene(BAG, rest, LAST);
        s.fabric.poisson_ratio = 0.5;
        s.fabric.law = case::Law::NeoHookean;
        let d = structure(&s, None).expect("a structure");
        let l = 1.3f64;
        let x: Vec<f64> = d.system.model.reference.iter().map(|x| l * x).collect();
        let volume = d.system.total_mass() / s.fabric.density_kg_m3;
        let exact = volume * s.fabric.youngs_modulus_pa / 6.0 * (2.0 * l * l + l.powi(-4) - 3.0);
        assert!((d.system.energy(&x) / exact - 1.0).abs() < 1e-12, "{rest}: {} {exact}", d.system.energy(&x));
    }
}

/// A sheet that is stretched by 1.3 both ways has the membrane force `t l Y E / (1 - nu)` everywhere. One corner node that moves strains less
/// than 1 % of the area: the peak is that of its triangle.
#[test]
fn membrane_forces_are_those_of_a_uniform_stretch_and_of_a_peak() {
    for rest in ["", "wrinkling = true", "[structure]\nmembrane = \"quadrilateral\""] {
        let s = scene(BAG, rest, LAST);
        let mut d = structure(&s, None).expect("a structure");
        let mesh = mesh::structure_mesh(&s).expect("a mesh");
        let mut diagnostics = crate::measures::Diagnostics::new(&d.system, &mesh, &s);
        let n = d.system.model.n_faces;
        let load = FaceLoad { pressure: &vec![0.0; n], traction: &[] };
        let l = 1.3f64;
        for (u, x) in d.accepted.u.iter_mut().zip(&d.system.model.reference) {
            *u = (l - 1.0) * x;
        }
        let (f, e) = (&s.fabric, 0.5 * (l * l - 1.0));
        let exact = f.thickness_m * l * f.youngs_modulus_pa * e / (1.0 - f.poisson_ratio);
        let m = diagnostics.measure(&d.system, &d.accepted, load);
        let found = [m.max_membrane_force, m.membrane_force_99].map(|force| force / exact);
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[1] - 1.0).abs() < 1e-4, "{rest}: {found:?}");

        d.accepted.u.fill(0.0);
        let x = &d.system.model.reference;
        let far = |n: &usize| x[3 * n] + x[3 * n + 1];
        let corner = (0..x.len() / 3).max_by(|a, b| far(a).total_cmp(&far(b))).expect("nodes");
        (0..2).for_each(|c| d.accepted.u[3 * corner + c] = 1e-3 * x[3 * corner + c]);
        let m = diagnostics.measure(&d.system, &d.accepted, load);
        assert!(m.max_membrane_force > 1e-3 * exact, "{rest}: {m:?}");
        assert!(m.membrane_force_99 < 2e-3 * m.max_membrane_force, "{rest}: {m:?}");
    }
}

/// At the strain `e` of a bag its law is linear but for `5/2 e`, and the rise (with the cube root of the stress) for a
/// third of that; a softer bag departs from the linear one.
#[test]
fn a_neo_hookean_bag_rises_as_a_linear_one_while_strains_are_small() {
    let top = |law: case::Law, membrane: &str, modulus: f64| {
        let text = format!("wrinkling = true\n[structure]\nmembrane = \"{membrane}\"");
        let mut s = scene(BAG, &text, LAST);
        (s.fabric.poisson_ratio, s.fabric.law) = (0.5, law);
        s.fabric.youngs_modulus_pa *= modulus;
        let mut d = structure(&s, None).expect("a structure");
        rest(&mut d, 23.94);
        d.accepted.u[2]
    };
    for membrane in ["triangle", "quadrilateral"] {
        let deviation = |modulus: f64| {
            let [linear, film] =
                [case::Law::StVenantKirchhoff, case::Law::NeoHookean].map(|law| top(law, membrane, modulus));
            film / linear - 1.0
        };
        let [stiff, soft] = [1.0, 1e-2].map(deviation);
        assert!(stiff.abs() < 1e-3 && soft > 3e-3, "{membrane}: {stiff} {soft}");
    }
}

/// Where fabric wrinkles at no cost, triangles and quadrilaterals of a prestressed bag have one answer: they differ by 0.19 % on 12 cells
/// across and by 0.03 % on 24.
#[test]
fn both_kinds_of_elements_raise_a_wrinkling_prestressed_bag_alike() {
    let difference = |cells: u32| {
        let [t, q] = ["triangle", "quadrilateral"].map(|membrane| {
            let fabric =
                format!("wrinkling = true\nprestress_pa = 1e6\n[structure]\nmembrane = \"{membrane}\"");
            let mut s = scene(&BAG.replace("12", &cells.to_string()), &fabric, LAST);
            s.fabric.youngs_modulus_pa *= 1e-2;
            let mut d = structure(&s, None).expect("a structure");
            rest(&mut d, 5.0);
            d.accepted.u[2]
        });
        (t / q - 1.0).abs()
    };
    let [coarse, fine] = [12, 24].map(difference);
    assert!(coarse < 3e-3 && fine < 0.25 * coarse, "{coarse} {fine}");
}

/// A state that is not a number is no equilibrium.
#[test]
fn nan_is_not_at_rest() {
    let mut d = structure(&scene(BAG, WRINKLING, LAST), None).expect("a structure");
    d.accepted.u[100] = f64::NAN;
    let p = vec![0.0; d.system.model.n_faces];
    let load = FaceLoad { pressure: &p, traction: &[] };
    let found = d.equilibrium(load, [0.0; 3], EquilibriumParams::default(), &mut |_| ());
    assert!(found.is_err(), "{found:?}");
}

/// Twice as stiff along x than along y: the edges move in by different amounts, and
/// with equal moduli by the same.
#[test]
fn an_orthotropic_bag_knows_its_warp() {
    let fabric = |weft: f64, shear: f64, quads: &str| {
        format!(
            "wrinkling = true\n[fabric.orthotropic]\nyoungs_modulus_2_pa = {weft}\nshear_modulus_pa = {shear}\n{quads}"
        )
    };
    let bag = |text: &str| {
        // Soft fabric, so that stretching shows.
        let mut s = scene(BAG, text, LAST);
        s.fabric.youngs_modulus_pa *= 1e-3;
        let mut d = structure(&s, None).expect("a structure");
        rest(&mut d, 23.94);
        let n = |x: f64, y: f64| {
            let near = |p: &[f64]| (p[0] - x).abs() < 1e-9 && (p[1] - y).abs() < 1e-9;
            at(&d.accepted.u, d.system.model.reference.chunks(3).position(near).expect("a node"))
        };
        [n(0.1524, 0.0)[0], n(0.0, 0.1524)[1], n(0.0, 0.0)[2]]
    };
    let isotropic = bag("wrinkling = true");
    let same = bag(&fabric(206.8e3, 0.5 * 206.8e3 / 1.3, ""));
    (0..3).for_each(|i| assert!((same[i] / isotropic[i] - 1.0).abs() < 1e-4, "{same:?} {isotropic:?}"));
    for quads in ["", "[structure]\nmembrane = \"quadrilateral\""] {
        let [x, y, _] = bag(&fabric(0.5 * 206.8e3, 0.3 * 206.8e3, quads));
        assert!(x < y - 1e-3 || y < x - 1e-3, "{x} {y}");
    }
}

#[test]
fn warp_direction_normal_to_a_panel_is_refused() {
    let fabric =
        "[fabric.orthotropic]\nyoungs_modulus_2_pa = 1e8\nshear_modulus_pa = 1e7\ndirection = [0, 0, 1]";
    let error = structure(&scene(BAG, fabric, LAST), None).err().expect("no direction");
    assert!(error.contains("normal to face 0"), "{error}");
}

/// Cables along x, rest length 1 m each.
fn chain(n: u32, fixed: Vec<(u32, [bool; 3])>) -> StructureMesh {
    let kind = CableKind::SuspensionLine;
    StructureMesh {
        coords: (0..=n).map(|i| [f64::from(i), 0.0, 0.0]).collect(),
        cables: (0..n)
            .map(|i| Cable { nodes: [i, i + 1], rest_length: 1.0, kind, line: 0, share: 1.0, group: None })
            .collect(),
        fixed,
        node_sets: [("end".to_owned(), vec![n])].into(),
        ..Default::default()
    }
}

/// Force of a cable of rest length 1 m at length `l`: A Y E l.
fn pull(l: f64) -> f64 {
    1e-6 * 1e9 * 0.5 * (l * l - 1.0) * l
}

/// A force on the end of a chain, then the same through a prescribed end: lengths and
/// reactions are those of the closed form.
#[test]
fn forces_and_motions_of_nodes_are_static_too() {
    let held = vec![(0, [true; 3])];
    let force = format!("{LAST}[[stage.force]]\nnodes = \"end\"\nforce_n = [{}, 0.0, 0.0]\n", pull(1.1));
    let mut d = structure(&scene(BAG, "", &force), Some(chain(3, held.clone()))).expect("a structure");
    rest(&mut d, 0.0);
    assert!((d.accepted.u[9] - 0.3).abs() < 1e-9, "{}", d.accepted.u[9]);
    let r = d.reactions(FaceLoad { pressure: &[], traction: &[] }, [0.0; 3]);
    assert!((r[0] + pull(1.1)).abs() < 1e-7, "{r:?}");

    let motion = format!(
        "{LAST}[[stage.motion]]\nnodes = \"end\"\ntime_s = [0.0, 1.0]\ndisplacement_m = [[0, 0, 0], [0.3, 0, 0]]\n"
    );
    let mut d = structure(&scene(BAG, "", &motion), Some(chain(3, held))).expect("a structure");
    rest(&mut d, 0.0);
    assert!((d.accepted.u[3] - 0.1).abs() < 1e-8 && d.accepted.u[9] == 0.3, "{:?}", d.accepted.u);
    let r = d.reactions(FaceLoad { pressure: &[], traction: &[] }, [0.0; 3]);
    assert!((r[9] - pull(1.1)).abs() < 1e-5 && (r[0] + r[9]).abs() < 1e-5, "{r:?}");
}

/// A cable with the section and pretension of its group between two with those of `[lines]`: each carries the force at its own length.
#[test]
fn cables_of_a_group_have_its_section() {
    let (stiffness, pretension) = (2500.0, 60.0);
    let force = format!("{LAST}[[stage.force]]\nnodes = \"end\"\nforce_n = [{}, 0.0, 0.0]\n", pull(1.1));
    let mut s = scene(BAG, "", &force);
    let group = case::CableGroup {
        group: "kevlar".into(),
        part: case::CablePart::Line,
        axial_stiffness_n: stiffness,
        mass_kg_m: 0.25,
        rest_length_factor: 1.0,
        pretension_n: pretension,
        tension_only: true,
        retardation_time_s: 0.0,
    };
    s.canopy = case::Canopy::Gmsh(case::GmshCanopy {
        file: "any.msh".into(),
        cables: vec![group],
        fabrics: Vec::new(),
    });
    let mut mesh = chain(3, vec![(0, [true; 3])]);
    mesh.cables[1].group = Some(0);
    let mut d = structure(&s, Some(mesh)).expect("a structure");
    rest(&mut d, 0.0);
    let u = |node: usize| d.accepted.u[3 * node];
    assert!((u(1) - 0.1).abs() < 1e-8 && (u(3) - u(2) - 0.1).abs() < 1e-8, "{:?}", d.accepted.u);
    let length = 1.0 + u(2) - u(1);
    let carried = (stiffness * 0.5 * (length * length - 1.0) + pretension) * length;
    assert!((carried - pull(1.1)).abs() < 1e-6, "{length} {carried} {}", pull(1.1));
    // Half of the mass of each neighbouring cable: 1 g/m of the lines, 250 g/m of the group.
    let mut mass = vec![0.0; 3 * d.system.model.n_local()];
    d.system.add_mass_product(&vec![1.0; 3 * d.system.model.n_local()], &mut mass);
    assert!((mass.iter().sum::<f64>() - 3.0 * 0.252).abs() < 1e-9, "{mass:?}");
}

/// A mass on a pre-stressed spring whose foot starts to move at constant speed V:
/// u = V (t - sin(w t) / w). The trapezoidal rule with 200 steps a period is 8e-5 slow.
#[test]
fn a_moving_foot_shakes_a_mass() {
    let rest_of = "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 0\nduration_s = 1.0\nwindow_s = 1.0
        [[stage.motion]]\nnodes = \"end\"\ntime_s = [0.0, 20.0]\ndisplacement_m = [[0, 0, 0], [0.02, 0, 0]]\n";
    let mut s = scene(BAG, "", rest_of);
    s.lines.as_mut().expect("lines").density_kg_m3 = 1e-9;
    s.lines.as_mut().expect("lines").tension_only = false;
    s.structure.newton_tolerance = 1e-10;
    let mut mesh = chain(1, vec![(0, [false, true, true]), (1, [false, true, true])]);
    mesh.point_masses.push((0, 1000.0));
    let mut d = structure(&s, Some(mesh)).expect("a structure");
    // d(A Y E l)/dl = A Y at rest: w = 1 / s.
    let dt = 2.0 * std::f64::consts::PI / 200.0;
    let load = LoadPath { pressure: [&[]; 2], traction: [&[]; 2] };
    for step in 1..=400 {
        d.window(dt, 1, load, [0.0; 3], false).expect("a step");
        d.accept();
        let t = dt * f64::from(step);
        let exact = 1e-3 * (t - t.sin());
        assert!((d.accepted.u[0] - exact).abs() < 5e-6, "{t}: {} beside {exact}", d.accepted.u[0]);
        assert!((d.accepted.u[3] - 1e-3 * t).abs() < 1e-12 && (d.accepted.v[3] - 1e-3).abs() < 1e-12);
    }
}

#[test]
fn point_masses_and_unknown_nodes() {
    let mass = "[[point_mass]]\nat_m = [0, 0, 0]\nmass_kg = 0.5\n";
    let heavy = structure(&scene(BAG, "", &format!("{mass}{LAST}")), None).expect("a structure");
    let light = structure(&scene(BAG, "", LAST), None).expect("a structure");
    assert!((heavy.system.total_mass() - light.system.total_mass() - 0.5).abs() < 1e-12);
    let lumped = scene(BAG, "[structure]\nmass = \"lumped\"", LAST);
    let lumped = structure(&lumped, None).expect("a structure");
    assert!((lumped.system.total_mass() / light.system.total_mass() - 1.0).abs() < 1e-12);
    assert!((lumped.system.lumped_mass(0) - lumped.system.mass_of_block(0)).abs() < 1e-18);
    let force = format!("{LAST}[[stage.force]]\nnodes = \"apex\"\nforce_n = [1, 0, 0]\n");
    let error = structure(&scene(BAG, "", &force), None).err().expect("no such nodes");
    assert!(error.contains("stage[0].force[0]") && error.contains("rim"), "{error}");
}

const TIME: &str = r#"
    [[stage]]
    name = "one"
    kind = "pre-inflation"
    pressure_pa = 23.94
    duration_s = 1e-2
    window_s = 1e-3
    substeps = 2
"#;

/// A pressure that tears every limit: the step is halved as often as allowed, then
/// named with its element, as a triangle or as a quadrilateral.
#[test]
fn an_absurd_pressure_names_an_element() {
    for (quads, name) in [("", "in triangle"), ("membrane = \"quadrilateral\"", "in quadrilateral")] {
        let fabric = format!("[structure]\nmax_step_cuts = 2\nnewton_max_steps = 4\n{quads}");
        let mut d = structure(&scene(BAG, &fabric, TIME), None).expect("a structure");
        let p = vec![1e13; d.system.model.n_faces];
        let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
        let failure = d.window(1e-3, 2, load, [0.0; 3], false).expect_err("too much");
        assert_eq!(failure.cuts, 2);
        let text = failure.to_string();
        assert!(text.contains(name) && text.contains("strained") && text.contains("halvings"), "{text}");
        assert!(d.accepted.u.iter().all(|u| *u == 0.0), "the accepted state is untouched");
    }
}

/// Kinetic and strain energy of the accepted state, J.
fn energy(d: &Dynamics) -> f64 {
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let mut mv = vec![0.0; x.len()];
    d.system.add_mass_product(&d.accepted.v, &mut mv);
    let kinetic: f64 = 0.5 * mv.iter().zip(&d.accepted.v).map(|(m, v)| m * v).sum::<f64>();
    kinetic + d.system.loops().iter().map(|l| l.energy(&x)).sum::<f64>()
}

/// Free motion in the plane of a fabric, windows longer than half a period of many of its
/// modes: drawn along the normal alone, velocities keep the energy; drawn whole, modes
/// with a little over half a period in a window grow (up to 1.053 a window).
#[test]
fn averaged_velocities_do_not_pump_motion_in_the_plane() {
    let grown = |whole: bool| {
        let fabric = "wrinkling = false\n[structure]\nspectral_radius = 1.0\nnewton_tolerance = 1e-10\ngmres_tolerance = 1e-8";
        let mut d = structure(&scene(BAG, fabric, TIME), None).expect("a structure");
        let fixed = d.system.model.fixed.clone();
        for (i, v) in d.accepted.v.iter_mut().enumerate().filter(|(i, _)| i % 3 != 2 && !fixed[*i]) {
            *v = 1e-3 * (1.7 * i as f64).sin();
        }
        let before = energy(&d);
        let p = vec![0.0; d.system.model.n_faces];
        let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
        let mut average = VelocityAverage::new(0.5, p.len());
        let dt = 2.52e-4;
        for _ in 0..150 {
            d.window(dt, 10, load, [0.0; 3], false).expect("a window");
            let Dynamics { system, accepted, current, .. } = &mut d;
            if whole {
                let moved = current.u.iter().zip(&accepted.u).map(|(b, a)| (b - a) / dt);
                current.v.iter_mut().zip(moved).for_each(|(v, mean)| *v = 0.5 * (*v + mean));
            } else {
                average.apply(dt, system, accepted, current);
            }
            d.accept();
        }
        energy(&d) / before
    };
    let (along_normal, whole) = (grown(false), grown(true));
    assert!((along_normal - 1.0).abs() < 1e-3, "{along_normal}");
    assert!(whole > 5.0, "{whole}");
}

/// What damping takes is what the motion loses: a fabric released from a stretched
/// shape with both dampings, in small steps of the conserving scheme.
#[test]
fn damping_takes_what_the_motion_loses() {
    for quads in ["triangle", "quadrilateral"] {
        let fabric = format!(
            "[structure]\nspectral_radius = 1.0\nnewton_tolerance = 1e-9\ngmres_tolerance = 1e-6\nmembrane = \"{quads}\""
        );
        let stage = format!("{TIME}mass_damping_per_s = 200.0\nstiffness_damping_s = 1e-6\n");
        let mut d = structure(&scene(BAG, &fabric, &stage), None).expect("a structure");
        for (i, u) in d.accepted.u.iter_mut().enumerate() {
            let x = d.system.model.reference[i];
            *u = if i % 3 == 2 { 0.0 } else { 1e-3 * x };
        }
        let p = vec![0.0; d.system.model.n_faces];
        d.balance_start(FaceLoad { pressure: &p, traction: &[] }, [0.0; 3]).expect("a mass");
        let before = energy(&d);
        let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
        let mut taken = 0.0;
        for _ in 0..40 {
            taken += d.window(1e-6, 1, load, [0.0; 3], false).expect("a step").damping_work;
            d.accept();
        }
        let lost = before - energy(&d);
        assert!(lost > 0.01 * before, "{quads}: {lost} of {before}");
        assert!((taken / lost - 1.0).abs() < 0.01, "{quads}: {taken} beside {lost}");
    }
}

/// The history has a row for each window whose energies add up; a run that fails keeps
/// what it had.
#[test]
fn a_run_alone_keeps_its_history_and_its_last_state() {
    let fabric = "wrinkling = true\n[structure]\nspectral_radius = 1.0";
    let run = |scene: &Scene, out: &Path| {
        let options = alone::Options { profile: true, snapshot_every: 4 };
        alone::run(&Comm::solo(), scene, 0, out, options)
    };
    let mut s = scene(BAG, fabric, TIME);
    let out = tempfile::tempdir().expect("a folder");
    run(&s, out.path()).expect("a run");
    let read = |out: &Path| std::fs::read_to_string(out.join("one/history.csv")).expect("a history");
    let text = read(out.path());
    let names: Vec<&str> = text.lines().next().expect("names").split(',').collect();
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().expect("a number")).collect()).collect();
    assert_eq!(rows.len(), 10);
    let column = |name: &str| {
        let at = names.iter().position(|n| *n == name).expect("a column");
        rows.iter().map(|r| r[at]).collect::<Vec<f64>>()
    };
    let work: f64 = column("structure_load_work_j").iter().sum();
    let energy = column("structure_kinetic_energy_j")[9] + column("structure_strain_energy_j")[9];
    // Trapezoidal work beside the scheme's own: they differ by the square of the step.
    assert!((energy / work - 1.0).abs() < 0.05, "{energy} {work}");
    assert!(column("damping_work_j").iter().all(|w| *w == 0.0));
    assert!(out.path().join("one/canopy_00001.vtu").exists());

    s.stages[0].pressure_pa = Some(1e7);
    s.structure.newton_max_steps = 2;
    s.structure.max_step_cuts = 1;
    let out = tempfile::tempdir().expect("a folder");
    let fault = run(&s, out.path()).expect_err("too much").message;
    assert!(fault.contains("window 0") && fault.contains("in triangle"), "{fault}");
    assert_eq!(read(out.path()).lines().count(), 1);
    assert!(case::state_file(&out.path().join("one/state"), case::Role::Structure).exists());
}

/// Fabric released from a stretched shape in explicit steps with a retardation time, in windows of five elastic steps: energies before and after each, and the
/// energy that damping is said to take.
fn retarded_release(quads: &str, time: f64, window: f64, safety: f64) -> (f64, Vec<f64>, f64) {
    let fabric = format!(
        "retardation_time_s = {time}\n[structure]\nintegration = \"explicit\"\nmembrane = \"{quads}\""
    );
    let mut d = structure(&scene(BAG, &fabric, TIME), None).expect("a structure");
    let stable = d.integrate_explicitly(safety).expect("a mass").stable_step();
    for (i, u) in d.accepted.u.iter_mut().enumerate() {
        let x = d.system.model.reference[i];
        *u = if i % 3 == 2 { 0.0 } else { 1e-3 * x };
    }
    let p = vec![0.0; d.system.model.n_faces];
    d.balance_start(FaceLoad { pressure: &p, traction: &[] }, [0.0; 3]).expect("a mass");
    let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
    let (mut energies, mut taken) = (vec![energy(&d)], 0.0);
    for _ in 0..40 {
        let Ok(info) = d.window(window, 1, load, [0.0; 3], false) else { break };
        taken += info.damping_work;
        d.accept();
        energies.push(energy(&d));
    }
    (stable, energies, taken)
}

/// The energy falls from window to window, damping is said to take what is lost, and steps shrink as the bound says; beyond it the energy grows.
#[test]
fn explicit_steps_shrink_with_the_retardation_time() {
    for quads in ["triangle", "quadrilateral"] {
        let elastic = retarded_release(quads, 0.0, 1e-9, 0.9).0;
        for ratio in [0.1, 1.0, 10.0] {
            let (stable, energies, taken) = retarded_release(quads, ratio * elastic, 5.0 * elastic, 0.9);
            let bound = f64::hypot(ratio, 1.0) - ratio;
            assert!((stable / elastic / bound - 1.0).abs() < 0.02, "{quads}, {ratio}: {}", stable / elastic);
            assert!(
                energies.len() == 41 && energies.is_sorted_by(|a, b| a > b),
                "{quads}, {ratio}: {energies:?}"
            );
            let lost = energies[0] - energies[40];
            println!("{quads}, {ratio}: lost {:.3}, taken {:.4} of that", lost / energies[0], taken / lost);
            assert!(lost > 0.3 * energies[0], "{quads}: {lost} of {}", energies[0]);
            assert!((taken / lost - 1.0).abs() < 2e-3, "{quads}, {ratio}: {taken} beside {lost}");
        }
        let (_, energies, _) = retarded_release(quads, 10.0 * elastic, 5.0 * elastic, 1.3);
        let grown = energies.len() < 41 || energies.iter().any(|e| *e > 2.0 * energies[0]);
        assert!(grown, "{quads}: {energies:?}");
    }
}
