//! Canopies from pattern files: from the file to equilibrium. Reference shapes are flat, wherever the canopy starts.

use std::f64::consts::PI;
use std::path::Path;
use std::rc::Rc;

use case::Scene;
use comm::Comm;
use mesh::StructureMesh;
use mesh::geometry::Vec3;

use crate::assemble;
use crate::dynamics::Dynamics;
use crate::equilibrium::EquilibriumParams;
use crate::flat::at;
use crate::loops::FaceLoad;

/// A scene of a pattern with elements of `size` (m) in `folder`.
fn scene(
    folder: &tempfile::TempDir,
    pattern: &str,
    size: f64,
    fabric: &str,
    canopy: &str,
    rest: &str,
) -> Scene {
    std::fs::write(folder.path().join("pattern.toml"), pattern).unwrap();
    let text = format!(
        "name = \"test\"\n[canopy]\nkind = \"pattern\"\nfile = \"pattern.toml\"\nelement_size_m = {size}\n{canopy}\n{}{rest}",
        fabric_and_stage(fabric)
    );
    case::parse(&folder.path().join("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
}

fn fabric_and_stage(fabric: &str) -> String {
    format!(
        "[fabric]\nyoungs_modulus_pa = 2e8\npoisson_ratio = 0.3\nthickness_m = 1e-4\ndensity_kg_m3 = 500.0\n{fabric}\n\
         [lines]\nyoungs_modulus_pa = 2e9\narea_m2 = 3e-6\ndensity_kg_m3 = 1000.0\n\
         [[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 20.0\nsolve = \"static\"\n"
    )
}

fn dynamics(scene: &Scene, mesh: StructureMesh) -> Dynamics {
    assemble::dynamics(&Comm::solo(), scene, 0, &Rc::new(mesh)).unwrap_or_else(|e| panic!("{e}"))
}

fn rest(d: &mut Dynamics, pressure: f64, tolerance: f64) -> Vec<f64> {
    let p = vec![pressure; d.system.model.n_faces];
    let load = FaceLoad { pressure: &p, traction: &[] };
    let params = EquilibriumParams { tolerance, ..Default::default() };
    d.equilibrium(load, [0.0; 3], params, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
    d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect()
}

/// A rectangle sewn around a cylinder of radius R, whose drawing is `scale` times as large as it says.
fn cylinder(radius: f64, height: f64, scale: f64) -> String {
    let a = PI * radius * scale;
    let h = height * scale;
    format!(
        "[[panel]]\nname = \"wall\"\nstart = {{ meridian_m = [[{radius}, 0.0], [{radius}, {height}]] }}\n\
         [[panel.edge]]\nname = \"lower\"\npoints_m = [[{}, 0.0]]\n[[panel.edge]]\nname = \"right\"\npoints_m = [[{a}, 0.0]]\n\
         [[panel.edge]]\nname = \"upper\"\npoints_m = [[{a}, {h}]]\n[[panel.edge]]\nname = \"left\"\npoints_m = [[{}, {h}]]\n\
         [[seam]]\nedges = [\"wall.right\", \"wall.left\"]\n\
         [[hold]]\nedge = \"wall.lower\"\ncomponents = \"z\"\n[[hold]]\nedge = \"wall.lower\"\nat = 0.0\n\
         [[hold]]\nedge = \"wall.lower\"\nat = 0.5\ncomponents = \"y\"\n",
        -a, -a
    )
}

/// Mean distance of the nodes from the middle of their cylinder.
fn radius_of(x: &[f64]) -> f64 {
    let n = x.len() / 3;
    let mean: Vec<f64> = (0..2).map(|c| (0..n).map(|i| x[3 * i + c]).sum::<f64>() / n as f64).collect();
    (0..n).map(|i| (x[3 * i] - mean[0]).hypot(x[3 * i + 1] - mean[1])).sum::<f64>() / n as f64
}

/// A flat sheet sewn into a cylinder: no energy at the start, and under pressure the radius and the hoop stress of a free cylinder.
///
/// Large strain, axis free: the axial Cauchy stress is zero, the hoop force for each deformed length p r. In St. Venant-Kirchhoff's law without axial stress
/// S = E (l^2 - 1) / 2 along the hoop, with the axial stretch m: m^2 = 1 - nu (l^2 - 1). The force for each length along the deformed axis is
/// h S l / m = p R l, so that S = p R m / h. Of a polygon whose sides have the angle a, R is R cos(a/2) in
/// these formulas: the errors are at most a^2 / 8, and of second order.
#[test]
fn a_flat_sheet_becomes_a_cylinder_under_pressure() {
    let (radius, height, pressure, young, thick) = (0.5, 0.6, 400.0, 2e8, 1e-4);
    let folder = tempfile::tempdir().unwrap();
    let errors = [0.12, 0.06].map(|size| {
        let s = scene(&folder, &cylinder(radius, height, 1.0), size, "wrinkling = true", "", "");
        let mesh = mesh::structure_mesh(&s).unwrap();
        let mass = 2.0 * PI * radius * height * 0.05;
        let mut d = dynamics(&s, mesh);
        assert!((d.system.total_mass() / mass - 1.0).abs() < 1e-12, "{}", d.system.total_mass());
        assert_eq!(d.system.energy(&d.system.model.reference), 0.0);
        assert!(crate::energy::floor(&d.system) > 0.0);
        let x = rest(&mut d, pressure, 1e-9);
        // S by iteration of the closed form.
        let (mut l, mut stress) = (1.0_f64, 0.0);
        for _ in 0..50 {
            let m = (1.0 - 0.3 * (l * l - 1.0)).sqrt();
            stress = pressure * radius * m / thick;
            l = (1.0 + 2.0 * stress / young).sqrt();
        }
        let hoop: Vec<f64> = d.system.loops()[0].stresses(&x).iter().map(|(s, _)| s[0]).collect();
        let mean = hoop.iter().sum::<f64>() / hoop.len() as f64;
        println!(
            "sheet of {size}: radius {:.6}, stress {:.6} of exact",
            radius_of(&x) / (radius * l),
            mean / stress
        );
        [radius_of(&x) / (radius * l) - 1.0, mean / stress - 1.0]
    });
    let angle = [0.12, 0.06].map(|h: f64| h / radius);
    for (e, a) in errors.iter().zip(angle) {
        assert!(e.iter().all(|e| e.abs() < a * a / 8.0), "{errors:?}");
    }
    assert!((0..2).all(|q| errors[0][q] / errors[1][q] > 3.0), "{errors:?}");
}

/// Lengths of the drawing count, not those of the start: a sheet that is 1 % larger makes a cylinder 1 % larger, from the same start.
#[test]
fn lengths_of_the_drawing_count() {
    let folder = tempfile::tempdir().unwrap();
    let at = [1.0, 1.01].map(|scale| {
        let s = scene(&folder, &cylinder(0.5, 0.6, scale), 0.12 * scale, "wrinkling = true", "", "");
        let mut d = dynamics(&s, mesh::structure_mesh(&s).unwrap());
        radius_of(&rest(&mut d, 4.0, 1e-9))
    });
    assert!((at[1] / at[0] - 1.01).abs() < 2e-4, "{at:?}");
    // A reference of the start instead of the drawing is found: both would be equal.
    let found = [1.0, 1.01].map(|scale| {
        let s = scene(&folder, &cylinder(0.5, 0.6, scale), 0.12 * scale, "wrinkling = true", "", "");
        let mesh = StructureMesh { flat: Vec::new(), ..mesh::structure_mesh(&s).unwrap() };
        radius_of(&rest(&mut dynamics(&s, mesh), 4.0, 1e-9))
    });
    assert!((found[1] / found[0] - 1.01).abs() > 5e-3, "{found:?}");
}

/// Trapezoidal gores of a cone of 12 gores, and the same canopy of kind `gored`.
const GORES: f64 = 12.0;

fn conical_pattern(vent: f64, skirt: f64, angle: f64) -> String {
    let (sin, cos) = angle.sin_cos();
    let length = (skirt - vent) / cos;
    let half = (PI / GORES).tan();
    let [a, b] = [skirt * half, vent * half];
    format!(
        "[[panel]]\nname = \"gore\"\ncopies = 12\nstart = {{ meridian_m = [[{skirt}, 0.0], [{vent}, {}]], turn_deg = 15.0 }}\n\
         [[panel.edge]]\nname = \"skirt\"\npoints_m = [[{}, 0.0]]\n[[panel.edge]]\nname = \"right\"\npoints_m = [[{a}, 0.0]]\n\
         [[panel.edge]]\nname = \"vent\"\npoints_m = [[{b}, {length}]]\n[[panel.edge]]\nname = \"left\"\npoints_m = [[{}, {length}]]\n\
         [[seam]]\nedges = [\"gore.right\", \"gore.left\"]\nnext_copy = true\n[[attachment]]\nedge = \"gore.skirt\"\nat = 0\n",
        length * sin,
        -a,
        -b
    )
}

/// Volume below the fabric (with respect to the plane of its lowest node), height of the vent over the skirt, and the membrane force that 99 % of the area
/// do not exceed.
fn figures(d: &Dynamics, x: &[f64], mesh: &StructureMesh) -> [f64; 3] {
    let n = mesh.n_canopy;
    let low = (0..n).map(|i| x[3 * i + 2]).fold(f64::INFINITY, f64::min);
    let high = (0..n).map(|i| x[3 * i + 2]).fold(f64::NEG_INFINITY, f64::max);
    let volume = mesh.triangles.iter().map(|t| {
        let p: [Vec3; 3] = t.map(|n| at(x, n as usize));
        ((p[0].z + p[1].z + p[2].z) / 3.0 - low) * 0.5 * (p[1] - p[0]).cross(&(p[2] - p[0])).z
    });
    let (mut sum, mut area) = (0.0, 0.0);
    for (t, (s, _)) in d.system.model.triangles.iter().zip(d.system.loops()[0].stresses(x)) {
        sum += 1e-4 * s[0].max(0.0) * t.reference.area;
        area += t.reference.area;
    }
    [volume.sum(), high - low, sum / area]
}

/// A canopy of conical gores from their drawing has the area and mass of the kind `gored`, and under pressure comes to the same volume, height and mean membrane force. Both
/// meshes differ, and forces are in balance to 2e-4: canopies of slack cloth turn and fold at no force. The difference is below the mesh error.
#[test]
fn drawn_gores_are_those_of_the_gored_canopy() {
    let (angle, diameter, vent) = (20_f64.to_radians(), 6.0, 0.6);
    let middle = 0.5 * vent * (PI / GORES).cos();
    let integral = 0.25 * PI * diameter * diameter / (GORES * (PI / GORES).tan());
    let skirt = (integral * angle.cos()).sqrt();
    let folder = tempfile::tempdir().unwrap();
    let solved = [(0.5, 6, 2), (0.25, 12, 4)].map(|(size, along, across)| {
        let drawn = scene(&folder, &conical_pattern(middle, skirt, angle), size, "wrinkling = true", "line_length_m = 6.0", "");
        let text = format!(
            "name = \"test\"\n[canopy]\nkind = \"gored\"\nprofile = \"conical\"\nnominal_diameter_m = {diameter}\ngores = 12\n\
             vent_diameter_m = {vent}\ncone_angle_deg = 20.0\ncells_per_gore = {across}\ncells_along = {along}\nline_length_m = 6.0\n{}",
            fabric_and_stage("wrinkling = true")
        );
        let gored = case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
        [drawn, gored].map(|s| {
            let mesh = mesh::structure_mesh(&s).unwrap();
            let mut d = dynamics(&s, mesh.clone());
            let (area, mass) = (mesh.fabric_area(|_| true), d.system.total_mass());
            let x = rest(&mut d, 20.0, 2e-4);
            let [volume, height, force] = figures(&d, &x, &mesh);
            println!("size {size}: area {area:.6} mass {mass:.6} volume {volume:.4} height {height:.4} force {force:.4}");
            [area, mass, volume, height, force]
        })
    });
    let difference = |k: usize, q: usize| (solved[k][0][q] / solved[k][1][q] - 1.0).abs();
    for k in 0..2 {
        assert!(difference(k, 0) < 1e-12 && difference(k, 1) < 1e-9, "{solved:?}");
    }
    // On the finer meshes both differ by less than the gored canopy changes from the coarser to the finer one: its mesh error.
    for q in 2..5 {
        let refinement = (solved[0][1][q] / solved[1][1][q] - 1.0).abs();
        assert!(difference(1, q) < refinement && refinement < 0.02, "{q}: {solved:?}");
    }
}

/// Bending counts from the flat sheet, also across the seam: a cylinder of radius R has the energy D A / (2 R^2), up to the part that irregular triangles of constant curvature miss, and
/// the seam makes no difference to it.
#[test]
fn a_sewn_cylinder_is_bent() {
    let (radius, height, stiffness) = (0.5, 0.6, 1e-3);
    let folder = tempfile::tempdir().unwrap();
    let bent = [0.1, 0.05].map(|size| {
        let law = format!("wrinkling = true\nbending_stiffness_n_m = {stiffness:e}");
        let s = scene(&folder, &cylinder(radius, height, 1.0), size, &law, "", "");
        let d = dynamics(&s, mesh::structure_mesh(&s).unwrap());
        let exact = 0.5 * stiffness * 2.0 * PI * radius * height / (radius * radius);
        d.system.energy(&d.system.model.reference) / exact
    });
    println!("bending energy over that of the cylinder: {bent:?}");
    assert!(bent.iter().all(|e| (e - 1.0).abs() < 0.15), "{bent:?}");
}
