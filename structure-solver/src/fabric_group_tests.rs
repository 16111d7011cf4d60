//! Cloths of their own by groups, against closed forms.

use std::path::Path;
use std::rc::Rc;

use case::{FabricGroup, GmshCanopy, Scene};
use comm::Comm;

use crate::assemble;
use crate::dynamics::Dynamics;
use crate::equilibrium::EquilibriumParams;
use crate::loops::FaceLoad;
use crate::measures::Diagnostics;
use crate::reactions;

/// A strip of 2 m by 0.5 m without lateral contraction, held at low x and pulled at high x by 0.3 m; its half at high x is another cloth.
fn scene(structure: &str) -> Scene {
    let text = format!(
        r#"
        name = "test"
        [canopy]
        kind = "panel"
        size_m = [2.0, 0.5]
        cells = [8, 2]
        held = "root"
        [fabric]
        youngs_modulus_pa = 1e6
        poisson_ratio = 0.0
        thickness_m = 1e-3
        density_kg_m3 = 800.0
        {structure}
        [output]
        [[output.reaction]]
        name = "left"
        nodes = "left"
        [[stage]]
        name = "one"
        kind = "pre-inflation"
        pressure_pa = 0
        solve = "static"
        [[stage.motion]]
        nodes = "right"
        time_s = [0.0]
        displacement_m = [[0.3, 0.0, 0.0]]
        "#
    );
    case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

const STIFFNESS: [f64; 2] = [1e6 * 1e-3, 3e6 * 4e-4];
const MASS: [f64; 2] = [800.0 * 1e-3, 1200.0 * 4e-4];
const WIDTH: f64 = 0.5;
/// Of the second cloth, N/m; the first has none.
const STRENGTH: f64 = 900.0;

/// Force of a strip of a stiffness E t (N/m) at the stretch `l`, N: of the second Piola-Kirchhoff stress E (l^2 - 1)/2.
fn pull(stiffness: f64, l: f64) -> f64 {
    WIDTH * stiffness * 0.5 * (l * l - 1.0) * l
}

/// Stretch of the first half where both carry the same force: they are 2.3 m long together.
fn stretch() -> f64 {
    let (mut low, mut high) = (1.0, 1.3);
    for _ in 0..60 {
        let l = 0.5 * (low + high);
        if pull(STIFFNESS[0], l) < pull(STIFFNESS[1], 2.3 - l) {
            low = l;
        } else {
            high = l;
        }
    }
    low
}

/// Both halves carry one force at their own stretch, as triangles, as bilinear elements and where damping adds a second loop; each has its own mass, stress and
/// membrane force.
#[test]
fn two_cloths_in_a_row_carry_one_force() {
    for structure in ["", "retardation_time_s = 1e-3", "[structure]\nmembrane = \"quadrilateral\""] {
        let mut s = scene(structure);
        let mut mesh = mesh::structure_mesh(&s).expect("a mesh");
        let file = "any.msh".into();
        let group = FabricGroup {
            group: "stiff".into(),
            thickness_m: Some(4e-4),
            density_kg_m3: Some(1200.0),
            youngs_modulus_pa: Some(3e6),
            strength_n_m: Some(STRENGTH),
            ..FabricGroup::default()
        };
        s.canopy = case::Canopy::Gmsh(GmshCanopy { file, cables: Vec::new(), fabrics: vec![group] });
        let far = |f: &[u32; 4]| f.iter().map(|n| mesh.coords[*n as usize][0]).sum::<f64>() > 0.0;
        mesh.face_fabric = mesh.faces.iter().map(|f| far(f).then_some(0)).collect();
        let mass: f64 = MASS.iter().map(|m| m * WIDTH).sum();
        assert!(
            (mesh.fabric_mass(&s) - mass).abs() < 1e-14 && (mesh.mean_areal_mass(&s) - mass).abs() < 1e-14
        );
        let mesh = Rc::new(mesh);
        let mut d = assemble::dynamics(&Comm::solo(), &s, 0, &mesh).expect("a structure");
        assemble::nodal(&mut d, &s, 0, &case::StageTimes::planned(&s), &mesh).expect("motions");
        reactions::watch(&mut d, &s, &mesh).expect("groups");
        assert!((d.system.total_mass() - mass).abs() < 1e-14, "{}", d.system.total_mass());
        // Of a flat strip nothing holds the height.
        let heights: Vec<u32> = (0..mesh.coords.len() as u32).map(|n| 3 * n + 2).collect();
        d.system.fix(&heights);
        compare(&mut d, &s, &mesh);
    }
}

fn compare(d: &mut Dynamics, s: &Scene, mesh: &mesh::StructureMesh) {
    let faces = vec![0.0; d.system.model.n_faces];
    let load = FaceLoad { pressure: &faces, traction: &[] };
    let params = EquilibriumParams { tolerance: 1e-11, ..EquilibriumParams::default() };
    d.equilibrium(load, [0.0; 3], params, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
    d.reactions_at_rest(load, [0.0; 3]);
    let l = stretch();
    let force = pull(STIFFNESS[0], l);
    for (n, x) in mesh.coords.iter().enumerate() {
        let exact = if x[0] <= 0.0 { (x[0] + 1.0) * (l - 1.0) } else { l - 1.0 + x[0] * (1.3 - l) };
        assert!((d.accepted.u[3 * n] - exact).abs() < 1e-9, "{x:?}: {} {exact}", d.accepted.u[3 * n]);
    }
    assert!((d.mean_reactions()[0].force.x + force).abs() < 1e-6, "{:?} {force}", d.mean_reactions());
    let mut gauge = Diagnostics::new(&d.system, mesh, s);
    let m = gauge.measure(&d.system, &d.accepted, load);
    assert!((m.max_membrane_force * WIDTH / force - 1.0).abs() < 1e-8, "{m:?}");
    let share = force / (WIDTH * STRENGTH);
    assert!((m.max_force_over_strength / share - 1.0).abs() < 1e-8, "{m:?}");
    assert!((m.force_over_strength_99 / share - 1.0).abs() < 1e-3, "{m:?}");
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let stresses = d.system.by_triangle(f64::NAN, |l| l.nominal_stresses(&x));
    for (t, stress) in d.system.model.triangles.iter().zip(stresses) {
        let thickness = if t.fabric.is_some() { 4e-4 } else { 1e-3 };
        assert!((stress * thickness * WIDTH / force - 1.0).abs() < 1e-8, "{stress} {:?}", t.fabric);
    }
}

/// One of 200 faces has a strength: the quantile is over its area alone.
#[test]
fn quantile_is_that_of_cloth_with_a_strength() {
    let mut s = scene("");
    let case::Canopy::Panel(panel) = &mut s.canopy else { panic!("a panel") };
    panel.cells = [200, 1];
    let mut mesh = mesh::structure_mesh(&s).expect("a mesh");
    let group = FabricGroup { strength_n_m: Some(STRENGTH), ..FabricGroup::default() };
    let file = "any.msh".into();
    s.canopy = case::Canopy::Gmsh(GmshCanopy { file, cables: Vec::new(), fabrics: vec![group] });
    mesh.face_fabric = (0..200).map(|face| (face == 57).then_some(0)).collect();
    let mesh = Rc::new(mesh);
    let mut d = assemble::dynamics(&Comm::solo(), &s, 0, &mesh).expect("a structure");
    for (i, (u, x)) in d.accepted.u.iter_mut().zip(&d.system.model.reference).enumerate() {
        *u = if i % 3 == 0 { 0.1 * x } else { 0.0 };
    }
    let load = FaceLoad { pressure: &vec![0.0; d.system.model.n_faces], traction: &[] };
    let m = Diagnostics::new(&d.system, &mesh, &s).measure(&d.system, &d.accepted, load);
    let share = pull(STIFFNESS[0], 1.1) / (WIDTH * STRENGTH);
    assert!((m.max_force_over_strength / share - 1.0).abs() < 1e-8, "{m:?}");
    assert!((m.force_over_strength_99 / share - 1.0).abs() < 1e-3, "{m:?}");
}
