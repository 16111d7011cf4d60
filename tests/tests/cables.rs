//! A structure of cables alone, by the programs: a rope between two supports against the elastic catenary.

use std::fmt::Write;
use std::path::Path;

use ripstop_tests::{History, changed_scene, program, ripstop_run, succeed};

/// Length of the rope, m; distance of its supports, m; angle by which the case lowers one about the other, rad.
const ROPE: (f64, f64, f64) = (12.0, 10.0, 0.6);
/// Weight for each metre, N/m, and axial stiffness, N, of the case.
const WEIGHT: f64 = 0.5 * 9.80665;
const STIFFNESS: f64 = 2e5;

/// A mesh file of the case's rope in `elements` elements along a V.
fn rope(elements: usize) -> String {
    let (length, span, _) = ROPE;
    let depth = (0.25 * (length * length - span * span)).sqrt();
    let point = |i: usize| {
        let s = 2.0 * i as f64 / elements as f64;
        (0.5 * span * s, -depth * s.min(2.0 - s))
    };
    let mut text = format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n0 1 \"fixed\"\n1 2 \"rope\"\n$EndPhysicalNames\n\
         $Entities\n2 1 0 0\n1 0 0 0 1 1\n2 {span} 0 0 1 1\n1 0 0 {} {span} 0 0 1 2 2 1 -2\n$EndEntities\n\
         $Nodes\n1 {n} 1 {n}\n1 1 0 {n}\n",
        -depth,
        n = elements + 1
    );
    let mut add = |line: String| writeln!(text, "{line}").expect("text grows");
    (1..=elements + 1).for_each(|tag| add(tag.to_string()));
    (0..=elements).map(point).for_each(|(x, z)| add(format!("{x} 0 {z}")));
    add(format!(
        "$EndNodes\n$Elements\n3 {n} 1 {n}\n0 1 15 1\n1 1\n0 2 15 1\n2 {}",
        elements + 1,
        n = elements + 2
    ));
    add(format!("1 1 1 {elements}"));
    (1..=elements).for_each(|e| add(format!("{} {e} {}", e + 2, e + 1)));
    add("$EndElements".into());
    text
}

/// Reactions along x and z (N) at the left support in the last window of a stage.
fn left(out: &Path, stage: &str) -> [f64; 2] {
    let reactions = History::read_file(&out.join(stage).join("reactions.csv"));
    ["left_force_x_n", "left_force_z_n"].map(|name| *reactions.column(name).last().expect("a row"))
}

/// Horizontal and upward force (N) at the upper support of the elastic catenary whose other support is `across` (m) away and `below` (m) it:
/// Irvine, Cable Structures (1981), section 1.2, by Newton's method.
fn catenary(across: f64, below: f64) -> [f64; 2] {
    let (w, l, ea) = (WEIGHT, ROPE.0, STIFFNESS);
    let ends = |[h, v]: [f64; 2]| {
        let [a, b] = [v / h, (v - w * l) / h];
        let x = h * l / ea + h / w * (a.asinh() - b.asinh());
        let z = (v * l - 0.5 * w * l * l) / ea + h / w * (a.hypot(1.0) - b.hypot(1.0));
        [x - across, z - below]
    };
    let mut force = [20.0, 40.0];
    for _ in 0..60 {
        let r = ends(force);
        let slope = |k: usize| {
            let mut moved = force;
            moved[k] += 1e-6;
            let s = ends(moved);
            [(s[0] - r[0]) / 1e-6, (s[1] - r[1]) / 1e-6]
        };
        let [a, b] = [slope(0), slope(1)];
        let determinant = a[0] * b[1] - a[1] * b[0];
        force[0] -= (b[1] * r[0] - b[0] * r[1]) / determinant;
        force[1] -= (a[0] * r[1] - a[1] * r[0]) / determinant;
    }
    force
}

/// Reactions between level supports, and after one was lowered by a prescribed rotation, converge in second order to the elastic catenary; on
/// two ranks they are the same.
#[test]
fn a_rope_between_supports_is_an_elastic_catenary() {
    let (length, span, angle) = ROPE;
    let exact = [catenary(span, 0.0), catenary(span * angle.cos(), span * angle.sin())];
    let mut errors = Vec::new();
    for elements in [16, 32] {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("rope.msh"), rope(elements)).expect("a mesh file");
        let scene = changed_scene("hanging-rope", folder.path(), &[]);
        let out = folder.path().join("out");
        succeed(ripstop_run(&scene, &out, &["--ranks", "structure=1"]));
        let found = ["hang", "rest"].map(|stage| left(&out, stage));
        // Both supports carry the rope.
        assert!((found[0][1] - 0.5 * WEIGHT * length).abs() < 1e-6, "{found:?}");
        errors.push([0, 1].map(|k| -found[k][0] - exact[k][0]));
        let z = found[1][1] - exact[1][1];
        eprintln!("upper support: {z} of {}", exact[1][1]);
        // Measured: 3.7e-4 of the force on 16 elements.
        assert!(z.abs() < 4.5e-4 * exact[1][1] * (16.0 / elements as f64).powi(2), "{z}");
        if elements == 16 {
            let two = folder.path().join("two");
            succeed(ripstop_run(&scene, &two, &["--ranks", "structure=2", "--stop-after-windows", "1"]));
            let difference = (left(&two, "hang")[0] - found[0][0]).abs();
            assert!(difference < 1e-6, "{difference}");
            report_and_export(&out);
        }
    }
    for (k, exact) in exact.iter().enumerate() {
        eprintln!("stage {k}: {:?} of {exact:?}", [errors[0][k], errors[1][k]]);
        let [coarse, fine] = [errors[0][k], errors[1][k]];
        assert!((3.98..4.02).contains(&(coarse / fine)), "stage {k}: {coarse} {fine}");
        assert!(((4.0 * fine - coarse) / 3.0).abs() < 5e-7 * exact[0], "stage {k}: {coarse} {fine}");
    }
}

/// The commands after a run read results without fabric.
fn report_and_export(out: &Path) {
    for words in [&["report"][..], &["export", "vtkhdf"], &["watch", "--once"]] {
        let mut command = std::process::Command::new(program("ripstop"));
        let output = succeed({
            command.args(words).arg(out);
            command
        });
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(!text.contains("projected area"), "{text}");
    }
}

/// What is estimated before a run of cables alone is a number, also with a payload, and nothing is warned of that belongs to fabric.
#[test]
fn cables_alone_are_inspected() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("rope.msh"), rope(4)).expect("a mesh file");
    let falls = "[descent]\npayload_mass_kg = 5.0\ninitial_speed_m_s = 3.0\nreference_area_m2 = 1.0\n\n[fabric_gravity]";
    let scene = changed_scene("hanging-rope", folder.path(), &[("[fabric_gravity]", falls)]);
    for word in ["check", "effects"] {
        let mut command = std::process::Command::new(program("ripstop"));
        command.arg(word).arg(&scene);
        let output = succeed(command);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(!text.contains("NaN") && !text.contains("inf ") && !text.contains("warning:"), "{text}");
    }
}

/// A file with surfaces needs [fabric]; a stage with air needs fabric; a pressure acts on none.
#[test]
fn scenes_of_cables_alone_refuse_what_needs_fabric() {
    let folder = tempfile::tempdir().expect("a folder");
    let check = |case: &str, changes: &[(&str, &str)]| {
        let scene = changed_scene(case, folder.path(), changes);
        let mut command = std::process::Command::new(program("ripstop"));
        let output = command.arg("check").arg(scene).output().expect("the program starts");
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    std::fs::write(folder.path().join("rope.msh"), rope(4)).expect("a mesh file");
    let pressed = check("hanging-rope", &[("solve = \"static\"", "solve = \"static\"\npressure_pa = 3.0")]);
    assert!(pressed.contains("3 Pa act on fabric"), "{pressed}");
    let air =
        check("hanging-rope", &[("kind = \"pre-inflation\"\nduration_s", "kind = \"coupled\"\nduration_s")]);
    assert!(air.contains("stage \"lower\" has air around the fabric"), "{air}");
    let mesh = ripstop_tests::scene("plate-gmsh").with_file_name("plate.msh");
    std::fs::copy(mesh, folder.path().join("rope.msh")).expect("a copy");
    let surfaces = check("hanging-rope", &[]);
    assert!(surfaces.contains("the scene has no [fabric]"), "{surfaces}");
}
