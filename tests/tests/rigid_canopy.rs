//! A canopy that a prescribed stage moves as a rigid body, in a fitted and in an immersed grid.

use std::path::{Path, PathBuf};

use coupling::interface::CanopyInterface;
use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// Stages of the scene before the descent.
const BEFORE: &str = "[[stage]]
name = \"pre-inflation\"
kind = \"pre-inflation\"
pressure_pa = 12.0
duration_s = 1.0
window_s = 5e-3
substeps = 5
mass_damping_per_s = 10.0
settled_energy_ratio = 1e-4

[[stage]]
name = \"developed-flow\"
kind = \"flow-only\"
duration_s = 0.2
window_s = 2e-2

";
const FITTED: &str = "[flow.grid]\nlayers_inside = 5\nlayers_outside = 10\nfirst_layer_m = 0.1\n";
const IMMERSED: &str = "[flow.immersed]\nspacing_m = 0.2\n";
const FORCES: &str = "
[flow.forces]
moment_point_m = [0.0, 0.0, -1.0]

[[flow.forces.coefficients]]
name = \"sheet\"
patches = [\"canopy\"]
drag_direction = [0.0, 0.0, 1.0]
lift_direction = [-1.0, 0.0, 0.0]
reference_area_m2 = 4.0
reference_length_m = 2.0
";

/// The small square canopy in a stage of kind `prescribed` with `motion`, 10 windows of 5 ms.
fn scene(folder: &Path, grid: &str, motion: &str) -> PathBuf {
    let stage = format!("kind = \"prescribed\"\nduration_s = 0.05\nwindow_s = 5e-3\n{motion}\n");
    let coupled = "kind = \"coupled\"\nduration_s = 0.1\nwindow_s = 5e-3\nsubsteps = 10\n";
    let grid = format!("{grid}{FORCES}");
    changed_scene("square-drop", folder, &[(BEFORE, ""), (FITTED, &grid), (coupled, &stage)])
}

fn run(grid: &str, motion: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let scene = scene(folder.path(), grid, motion);
    succeed(ripstop_run(&scene, &out, &[]));
    (folder, out)
}

fn table(out: &Path, name: &str) -> Vec<(String, Vec<f64>)> {
    results::history::read(&out.join(name)).expect("a table")
}

fn column(table: &[(String, Vec<f64>)], name: &str) -> Vec<f64> {
    table.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("{name}")).1.clone()
}

/// The same translation as a rigid body and by a table of its nodes gives the same flow.
#[test]
fn canopy_as_a_rigid_body_moves_as_its_nodes_do() {
    let body =
        "[[stage.body_motion]]\npatches = [\"canopy\"]\ndisplacement_m = [\"0.2*t\", \"0\", \"0.5*t\"]";
    let nodes = "[[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0.0, 0.05]\ndisplacement_m = [[0, 0, 0], [0.01, 0, 0.025]]";
    for grid in [FITTED, IMMERSED] {
        let [(_a, a), (_b, b)] = [run(grid, body), run(grid, nodes)];
        let drags = [&a, &b].map(|out| History::read(out, "descent").column("drag_n"));
        assert_eq!(drags[0].len(), 10);
        for (x, y) in drags[0].iter().zip(&drags[1]) {
            assert!((x - y).abs() < 1e-5 * y.abs(), "{x} {y}");
        }
    }
}

/// A turn about y through the payload is the pendulum angle, in both grids; the forces are those of the history.
#[test]
fn canopy_turns_about_its_axis_and_has_forces_in_both_grids() {
    let square = case::load(&ripstop_tests::scene("square-drop")).expect("a scene");
    let [x, y, z] = CanopyInterface::new(&square).expect("a canopy").payload.expect("a payload");
    let turn = format!(
        "[[stage.body_motion]]\npatches = [\"canopy\"]\n\
         rotation = {{ axis = [0, 2, 0], point_m = [{x:?}, {y:?}, {z:?}], angle_rad = \"20*t^2\" }}"
    );
    for grid in [FITTED, IMMERSED] {
        let (_folder, out) = run(grid, &turn);
        let swing = History::read(&out, "descent");
        let (along, across) = (swing.column("pendulum_x_deg"), swing.column("pendulum_y_deg"));
        for (k, (along, across)) in along.iter().zip(&across).enumerate() {
            let angle = (20.0 * (5e-3 * (k + 1) as f64).powi(2)).to_degrees();
            assert!((along - angle).abs() < 1e-7 && across.abs() < 1e-7, "{k}: {along} {across} {angle}");
        }
        let (forces, history) = (table(&out, "descent/forces.csv"), History::read(&out, "descent"));
        let sum = |of: &str, axis: &str| -> Vec<f64> {
            let part = |what: &str| column(&forces, &format!("{of}_{what}_force_{axis}_n"));
            part("pressure").iter().zip(part("shear")).map(|(a, b)| a + b).collect()
        };
        for (axis, name) in [("x", "force_x_n"), ("y", "force_y_n"), ("z", "drag_n")] {
            let scale = history.column("drag_n").iter().fold(0.0f64, |m, d| m.max(d.abs()));
            for (a, b) in sum("canopy", axis).iter().zip(history.column(name)) {
                assert!((a - b).abs() < 1e-6 * scale, "{name}: {a} {b}");
            }
            assert_eq!(sum("canopy", axis), sum("sheet", axis));
        }
        let (drag, cd) = (column(&forces, "sheet_drag_n"), column(&forces, "sheet_cd"));
        let scale = 0.5 * 1.225 * 16.0 * 4.0;
        assert!(drag.iter().zip(&cd).all(|(d, c)| (d / scale - c).abs() < 1e-6), "{drag:?} {cd:?}");
    }
}

/// Two motions of the same nodes are refused, and a name that is neither a patch nor the canopy.
#[test]
fn canopy_has_one_motion() {
    let refused = |motion: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = scene(folder.path(), IMMERSED, motion);
        case::load(&path).expect_err("refused").to_string()
    };
    let body = "[[stage.body_motion]]\npatches = [\"canopy\"]\ndisplacement_m = [\"0\", \"0\", \"0.5*t\"]\n";
    let nodes = "[[stage.motion]]\nnodes = \"rim\"\ntime_s = [0.0, 0.05]\ndisplacement_m = [[0, 0, 0], [0, 0, 0.025]]\n";
    let text = refused(&format!("{body}{nodes}"));
    assert!(text.contains("have two motions"), "{text}");
    let text = refused(&format!("{body}{body}"));
    assert!(text.contains("the patch \"canopy\" has two motions"), "{text}");
    let text = refused(&body.replace("canopy", "canpoy"));
    assert!(text.contains("did you mean \"canopy\""), "{text}");
}
