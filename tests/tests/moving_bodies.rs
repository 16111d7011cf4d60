//! Rigid bodies that move as prescribed: scenes from end to end.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

#[path = "../../flow-solver/tests/common/bodies.rs"]
mod bodies;

use mesh::{FlowGrid, Patch, block_grid};
use ripstop_tests::{ripstop_run, succeed};

const TILT: &str =
    "rotation = { axis = [0, 1, 0], point_m = [0.5, 0, 0], angle_rad = \"0.3*(1 - cos(2*pi*t))\" }\n";

/// A block in a box; the outer boundary is far field.
const BLOCK: &str = r#"name = "moving"
[canopy]
kind = "none"
[flow]
wind_m_s = [0.0, 0.0, 0.0]
[flow.viscosity]
dynamic_viscosity_pa_s = 0.05
[flow.grid_file]
path = "grid.msh"
[flow.grid_file.patches]
left = "far-field"
right = "far-field"
front = "far-field"
back = "far-field"
bottom = "far-field"
top = "far-field"
body = "wall"
[flow.forces]
[[flow.forces.coefficients]]
name = "block"
patches = ["body"]
drag_direction = [1.0, 0.0, 0.0]
lift_direction = [0.0, 0.0, 1.0]
reference_area_m2 = 1.0
reference_length_m = 1.0
[flow.solver]
residual_drop = 1e-6
[mesh]
tolerance = 1e-6
[ranks]
flow = 1
mesh = 1
[[stage]]
name = "swing"
kind = "prescribed"
duration_s = 0.4
window_s = 2e-2
[[stage.body_motion]]
patches = ["body"]
displacement_m = ["0.1*sin(2*pi*t)^2", "0", "0.05*t^2"]
rotation = { axis = [0, 1, 0], point_m = [0.5, 0, 0], angle_rad = "0.3*(1 - cos(2*pi*t))" }
"#;

/// A cube of edge 1 m in a box, `2 n` cells along its edge.
fn block(n: usize) -> FlowGrid {
    let [long, wide] = [6, 4].map(|k| k * n..(k + 2) * n);
    let cells = [14 * n, 10 * n, 10 * n];
    block_grid(cells, [-3.0, -2.5, -2.5], [4.0, 2.5, 2.5], [Patch::FarField; 6], [long, wide.clone(), wide])
}

fn write(folder: &Path, grid: &FlowGrid) {
    let name = |k: usize| grid.patch_name(k).expect("a name").to_owned();
    mesh::write_msh(&folder.join("grid.msh"), grid, "canopy", name, true).expect("written");
}

fn scene(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(format!("{name}.toml"));
    fs::write(&file, text).expect("written");
    file
}

/// `text` with replacements, each of which must be found.
fn changed(text: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    })
}

/// Columns of a table of a stage.
fn table(out: &Path, file: &str) -> BTreeMap<String, Vec<f64>> {
    let text = fs::read_to_string(out.join(file)).expect("a table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            columns.entry((*name).to_owned()).or_default().push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

fn run(folder: &Path, name: &str, text: &str, options: &[&str]) -> PathBuf {
    let out = folder.join(name);
    let file = scene(folder, name, text);
    let output = succeed(ripstop_run(&file, &out, &[&["--quiet"], options].concat()));
    println!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    out
}

/// The same bits on a run that stops and resumes; the same forces, to the tolerance of the solvers, on two ranks.
#[test]
fn moving_body_resumes_bitwise_and_runs_on_any_ranks() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &block(1));
    let whole = run(folder.path(), "whole", BLOCK, &[]);
    let parts = folder.path().join("parts");
    let file = scene(folder.path(), "parts", BLOCK);
    succeed(ripstop_run(&file, &parts, &["--quiet", "--stop-after-windows", "7"]));
    succeed(ripstop_run(&file, &parts, &["--quiet", "--resume"]));
    let forces = |out: &Path| fs::read_to_string(out.join("swing/forces.csv")).expect("forces");
    assert_eq!(forces(&whole).lines().count(), 21);
    assert_eq!(forces(&whole), forces(&parts));
    let bytes = |out: &Path| fs::read(out.join("swing/state/mesh.bin")).expect("a state");
    assert!(bytes(&whole) == bytes(&parts), "the grids differ");
    let two = run(folder.path(), "two", BLOCK, &["--ranks", "flow=2", "--ranks", "mesh=2"]);
    let [one, two] = [&whole, &two].map(|out| table(out, "swing/forces.csv"));
    for column in ["block_drag_n", "block_lift_n"] {
        let size = one[column].iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let off = one[column].iter().zip(&two[column]).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        println!("{column}: {off:.2e} of {size:.3} N");
        assert!(size > 0.1 && off < 1e-4 * size, "{column}: {off} {size}");
    }
}

/// A cylinder of diameter 1 m and depth 0.1 m.
const CYLINDER: &str = r#"name = "cylinder"
[canopy]
kind = "none"
[flow]
wind_m_s = [0.0, 0.0, 0.0]
[flow.viscosity]
dynamic_viscosity_pa_s = 0.01225
[flow.grid_file]
path = "grid.msh"
[flow.grid_file.patches]
cylinder = "wall"
far = "far-field"
sides = "symmetry"
[flow.forces]
[[flow.forces.coefficients]]
name = "cylinder"
patches = ["cylinder"]
drag_direction = [1.0, 0.0, 0.0]
lift_direction = [0.0, 1.0, 0.0]
reference_area_m2 = 0.1
reference_length_m = 1.0
[flow.solver]
residual_drop = 1e-4
[mesh]
outer_boundary = "sliding"
[output]
surface_every_windows = 0
volume_every_windows = 0
[ranks]
flow = 1
mesh = 1
[[stage]]
name = "swing"
kind = "prescribed"
duration_s = 3.0
window_s = 0.015625
[[stage.body_motion]]
patches = ["cylinder"]
displacement_m = ["0.01*(1 - cos(2*pi*t))", "0", "0"]
"#;

fn ring(folder: &Path, cells: [usize; 2], far: f64) {
    let grid = bodies::ring(cells[0], cells[1], far);
    let name = |k: usize| match grid.boundary[k].0 {
        Patch::Wall => "cylinder".to_owned(),
        Patch::FarField => "far".to_owned(),
        _ => "sides".to_owned(),
    };
    mesh::write_msh(&folder.join("grid.msh"), &grid, "canopy", name, true).expect("written");
}

/// Coefficients of force per amplitude and displaced mass times the squared angular frequency: in phase with the displacement
/// (added mass) and ahead of it by a quarter period (damping, negative).
fn stokes(beta: f64) -> [f64; 2] {
    let s = 1.0 / (PI * beta).sqrt();
    [1.0 + 4.0 * s + s.powi(3) - 2.0 * s.powi(4), -(4.0 * s + 4.0 * s * s - s.powi(3))]
}

/// Coefficients of `exp(i w t)` of a force over the last period, for the displacement `-cos(w t)`.
fn projected(time: &[f64], force: &[f64], windows: usize) -> [f64; 2] {
    let last = force.len() - windows..force.len();
    let (mut c, mut s) = (0.0, 0.0);
    for k in last {
        let angle = 2.0 * PI * time[k];
        c += force[k] * angle.cos() * 2.0 / windows as f64;
        s += force[k] * angle.sin() * 2.0 / windows as f64;
    }
    [-c, s]
}

/// Circular cylinder that oscillates in air at rest, amplitude 0.01 diameters, Stokes number 100: added mass and damping against
/// the solution of Stokes (1851), see Wang, J. Fluid Mech. 32 (1968). The thickness of the layer at the wall is 0.056 m, the first
/// cell 0.056 and 0.027 m.
#[test]
fn oscillating_cylinder_has_the_added_mass_and_damping_of_stokes() {
    let folder = tempfile::tempdir().expect("a folder");
    let exact = stokes(100.0);
    let off = [([32, 40], 64), ([64, 80], 128)].map(|(cells, windows)| {
        ring(folder.path(), cells, 15.0);
        let window = format!("window_s = {:?}", 1.0 / windows as f64);
        let text = changed(CYLINDER, &[("window_s = 0.015625", &window)]);
        let out = run(folder.path(), &format!("grid{windows}"), &text, &[]);
        let t = table(&out, "swing/forces.csv");
        let omega = 2.0 * PI;
        let scale = 1.225 * 0.25 * PI * 0.1 * omega * omega * 0.01;
        let found = projected(&t["time_s"], &t["cylinder_drag_n"], windows).map(|f| f / scale);
        let off = [0, 1].map(|i| (found[i] / exact[i] - 1.0).abs());
        println!(
            "{cells:?}, {windows} windows in a period: {found:.4?}, exact {exact:.4?}, off by {off:.4?}"
        );
        off
    });
    let order = [0, 1].map(|i| (off[0][i] / off[1][i]).log2());
    println!("order {order:.2?}");
    assert!(off[1][0] < 0.015 && off[1][1] < 0.06, "{off:?}");
    assert!(order[0] > 1.8 && order[1] > 1.1, "{order:?}");
}

/// Air at rest around a cylinder that starts to rotate about its axis: as a wall with a velocity on a grid at rest, with wall
/// nodes that rotate, and with the whole grid that rotates. The torque is of the friction at a wall whose velocity rotates too:
/// without this rotation it is 5 % smaller.
#[test]
fn rotation_of_the_grid_equals_a_rotating_wall() {
    let folder = tempfile::tempdir().expect("a folder");
    ring(folder.path(), [32, 40], 15.0);
    let (start, _) = CYLINDER.split_once("[[stage]]").expect("a stage");
    let start = start.replace("residual_drop = 1e-4", "residual_drop = 1e-8");
    let stage = |kind: &str, more: &str| {
        format!("[[stage]]\nname = \"swing\"\nkind = \"{kind}\"\nduration_s = 0.5\nwindow_s = 0.01\n{more}")
    };
    let axis = "axis = [0, 0, 1], point_m = [0, 0, 0]";
    let rotates = |patches: &str| {
        let angle = "angle_rad = \"0.2*t^2\"";
        stage(
            "prescribed",
            &format!("[[stage.body_motion]]\npatches = {patches}\nrotation = {{ {axis}, {angle} }}\n"),
        )
    };
    let wall = format!(
        "[[flow.moving_wall]]\npatch = \"cylinder\"\nfactor = {{ formula = \"0.4*t\" }}\n\
         rotation = {{ {axis}, angular_velocity_rad_s = 1 }}\n[flow.solver]"
    );
    let wall = start.replace("[flow.solver]", &wall) + &stage("flow-only", "");
    let torque = |name: &str, text: &str| {
        table(&run(folder.path(), name, text, &[]), "swing/forces.csv")["cylinder_moment_z_n_m"].clone()
    };
    let wall = torque("wall", &wall);
    for (name, patches) in [("body", "[\"cylinder\"]"), ("grid", "[\"cylinder\", \"far\", \"sides\"]")] {
        let found = torque(name, &format!("{start}{}", rotates(patches)));
        let off = |k: usize| (found[k] / wall[k] - 1.0).abs();
        println!(
            "{name}: torque off by {:.1e} after 10 windows, {:.1e} after 25, {:.1e} after 50",
            off(9),
            off(24),
            off(49)
        );
        // Two steps of first order at the start of an angle that grows with the square of time.
        assert!(wall[49] < -3e-3 && off(9) < 5e-3 && off(24) < 1e-3 && off(49) < 5e-4, "{found:?} {wall:?}");
    }
}

/// Velocity of a body at the ends of windows as the time differences of the flow see it: of first order in the first two.
fn discrete_velocity(x: impl Fn(f64) -> f64, dt: f64, windows: usize) -> Vec<f64> {
    let at = |k: usize, back: usize| x((k + 1 - back) as f64 * dt);
    (0..windows)
        .map(|k| match k {
            0 | 1 => (at(k, 0) - at(k, 1)) / dt,
            _ => (1.5 * at(k, 0) - 2.0 * at(k, 1) + 0.5 * at(k, 2)) / dt,
        })
        .collect()
}

/// A block that oscillates in still air, alone and with the whole grid, and air that oscillates about the block: the same
/// equations in the frame of the block, so that the forces differ by the discretisation. Also flow iterations in all windows.
fn body_and_gust(n: usize, drop: &str) -> ([f64; 2], [f64; 3]) {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &block(n));
    let (start, _) = BLOCK.split_once("[[stage]]").expect("a stage");
    let start = start.replace("residual_drop = 1e-6", &format!("residual_drop = {drop}"));
    let (dt, windows) = (0.02, 50);
    let stage = |kind: &str, more: &str| {
        format!(
            "{start}[[stage]]\nname = \"swing\"\nkind = \"{kind}\"\nduration_s = 1.0\nwindow_s = 0.02\n{more}"
        )
    };
    let moves = |patches: &str| {
        let x = "displacement_m = [\"0.1*(1 - cos(2*pi*t))\", \"0\", \"0\"]";
        stage("prescribed", &format!("[[stage.body_motion]]\npatches = {patches}\n{x}\n"))
    };
    let velocity = discrete_velocity(|t| 0.1 * (1.0 - (2.0 * PI * t).cos()), dt, windows);
    let times: Vec<f64> = (0..=windows).map(|k| k as f64 * dt).collect();
    let factor: Vec<f64> = [0.0].into_iter().chain(velocity).collect();
    let gust = format!(
        "[stage.gust]\nshape = \"table\"\nvelocity_m_s = [-1, 0, 0]\ntime_s = {times:?}\nfactor = {factor:?}\n"
    );
    let all = "[\"body\", \"left\", \"right\", \"front\", \"back\", \"bottom\", \"top\"]";
    let runs = [("gust", stage("flow-only", &gust)), ("grid", moves(all)), ("body", moves("[\"body\"]"))];
    let outs = runs.map(|(name, text)| run(folder.path(), name, &text, &[]));
    let forces = outs.each_ref().map(|out| table(out, "swing/forces.csv")["block_drag_n"].clone());
    let size = forces[0].iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let off = [1, 2].map(|k| {
        let pairs = forces[k].iter().zip(&forces[0]);
        pairs.fold(0.0f64, |most, (a, b)| most.max((a - b).abs())) / size
    });
    let iterations = outs.each_ref().map(|out| {
        let history = table(out, "swing/history.csv");
        assert_eq!(history["drag_n"].len(), windows);
        history["flow_iterations"].iter().sum::<f64>() / windows as f64
    });
    println!(
        "{n}: gust {size:.3} N, grid and body off by {off:.4?}, flow iterations in a window {iterations:.2?}"
    );
    (off, iterations)
}

#[test]
fn oscillating_body_equals_the_opposite_gust() {
    let (coarse, _) = body_and_gust(1, "1e-5");
    let (fine, _) = body_and_gust(2, "1e-5");
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        assert!(fine < 0.022 && coarse > 1.8 * fine, "{coarse} {fine}");
    }
    // At the tolerance of a scene that gives none, a moved grid is solved to a stricter one.
    let (_, [gust, grid, body]) = body_and_gust(2, "1e-2");
    assert!(grid < 2.0 * gust && body < 2.0 * gust, "{gust} {grid} {body}");
}

/// A block that moves with the air around it does not disturb it, although the grid between it and the outer boundary deforms.
#[test]
fn body_that_moves_with_the_air_leaves_it_uniform() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &block(1));
    let text = changed(
        BLOCK,
        &[
            ("wind_m_s = [0.0, 0.0, 0.0]", "wind_m_s = [1.5, 0.0, 0.5]"),
            ("[\"0.1*sin(2*pi*t)^2\", \"0\", \"0.05*t^2\"]", "[\"1.5*t\", \"0\", \"0.5*t\"]"),
            (TILT, ""),
        ],
    );
    let out = run(folder.path(), "uniform", &text, &[]);
    let (forces, history) = (table(&out, "swing/forces.csv"), table(&out, "swing/history.csv"));
    let quality = history["mesh_min_quality"].last().expect("a window");
    assert!(*quality < 0.8, "the grid has deformed: {quality}");
    for column in ["block_drag_n", "block_lift_n", "wall_pressure_force_x_n", "wall_shear_force_x_n"] {
        let most = forces[column].iter().fold(0.0f64, |most, x| most.max(x.abs()));
        println!("{column}: at most {most:.2e} N");
        assert!(most < 1e-10, "{column}: {most}");
    }
}

/// A second stage continues from where the body is; a stage with the flow alone holds it there.
#[test]
fn later_stages_start_where_the_body_is() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &block(1));
    let (start, _) = BLOCK.split_once("[[stage]]").expect("a stage");
    let stage = |name: &str, kind: &str, motion: &str| {
        format!(
            "[[stage]]\nname = \"{name}\"\nkind = \"{kind}\"\nduration_s = 0.1\nwindow_s = 0.02\n{motion}"
        )
    };
    let motion = |x: &str| {
        format!("[[stage.body_motion]]\npatches = [\"body\"]\ndisplacement_m = [\"{x}\", \"0\", \"0\"]\n")
    };
    let text = format!(
        "{}{}{}{}",
        start.replace("wind_m_s = [0.0,", "wind_m_s = [0.1,"),
        stage("first", "prescribed", &motion("2*t")),
        stage("held", "flow-only", ""),
        stage("second", "prescribed", &motion("-t"))
    );
    let file = scene(folder.path(), "stages", &text);
    let out = folder.path().join("stages");
    succeed(ripstop_run(&file, &out, &["--quiet", "--stop-after-windows", "12"]));
    succeed(ripstop_run(&file, &out, &["--quiet", "--resume"]));
    let middle = |stage: &str| {
        let state =
            mesh_mover::state::State::load(&out.join(stage).join("state/mesh.bin"), block(1).coords.len());
        let grid = block(1);
        let body: Vec<u32> = grid.faces_of(&["body".into()]).flat_map(|f| grid.boundary[f].1).collect();
        let now = state.expect("a state").now;
        body.iter()
            .map(|&n| now[3 * n as usize] - grid.coords[n as usize][0])
            .fold(0.0f64, |a, b| if a.abs() > b.abs() { a } else { b })
    };
    let found = [middle("first"), middle("second")];
    assert!((found[0] - 0.2).abs() < 1e-12 && (found[1] - 0.1).abs() < 1e-12, "{found:?}");
}

#[test]
fn invalid_motions_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &block(1));
    let refused = |from: &str, to: &str| {
        let file = scene(folder.path(), "bad", &changed(BLOCK, &[(from, to)]));
        case::load(&file).expect_err(to).to_string()
    };
    let x = "\"0.1*sin(2*pi*t)^2\"";
    for (from, to, words) in [
        (
            "patches = [\"body\"]\ndisp",
            "patches = [\"bodi\"]\ndisp",
            ["no patch \"bodi\"", "did you mean \"body\"?"],
        ),
        ("patches = [\"body\"]\ndisp", "patches = []\ndisp", ["of no patch", "back, body, bottom"]),
        ("patches = [\"body\"]\ndisp", "patches = [\"body\", \"body\"]\ndisp", ["two motions", "keep one"]),
        (x, "\"0.1*sin(2*pi*x)\"", ["unknown name `x`", "a formula of t"]),
        (x, "\"0.1*cos(t)\"", ["is 0.1 at t = 0", "would jump"]),
        (x, "\"t/(0.2 - t)\"", ["is inf at t = 0.2 s", "finite during the whole stage"]),
        ("axis = [0, 1, 0]", "axis = [0, 0, 0]", ["has no direction", "[0, 0, 1]"]),
        ("kind = \"prescribed\"", "kind = \"flow-only\"", ["moves a rigid body", "kind = \"prescribed\""]),
        (
            "[mesh]",
            "[mesh.regrid]\nquality_threshold = 0.3\n[mesh]",
            ["around the canopy alone", "remove [mesh.regrid]"],
        ),
        ("body = \"wall\"", "body = \"inlet\"", ["velocity of its own", "do not move it"]),
        ("displacement_m", "displacement", ["unknown key `displacement`", "displacement_m"]),
    ] {
        let text = refused(from, to);
        assert!(words.iter().all(|w| text.contains(w)), "{words:?}: {text}");
    }
    let (_, motion) = BLOCK.split_once("[[stage.body_motion]]").expect("a motion");
    let text = refused(&format!("[[stage.body_motion]]{motion}"), "");
    assert!(text.contains("prescribes nothing") && text.contains("[[stage.body_motion]]"), "{text}");
    let text =
        refused(&format!("[[stage.body_motion]]{motion}"), "[[stage.body_motion]]\npatches = [\"body\"]\n");
    assert!(text.contains("the body has no motion"), "{text}");
}
