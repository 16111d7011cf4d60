//! Rigid bodies that move as prescribed: scenes from end to end.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

#[path = "../../flow-solver/tests/common/bodies.rs"]
mod bodies;

use mesh::{FlowGrid, Patch, block_grid};
use ripstop_tests::{ripstop_run, succeed};

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

fn block(folder: &Path) -> FlowGrid {
    let f = Patch::FarField;
    let grid = block_grid([14, 10, 10], [-3.0, -2.5, -2.5], [4.0, 2.5, 2.5], [f; 6], [6..8, 4..6, 4..6]);
    write(folder, &grid);
    grid
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
    block(folder.path());
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
    let s = 1.0 / (std::f64::consts::PI * beta).sqrt();
    [1.0 + 4.0 * s + s.powi(3) - 2.0 * s.powi(4), -(4.0 * s + 4.0 * s * s - s.powi(3))]
}

/// Coefficients of `exp(i w t)` of a force over the last period, for the displacement `-cos(w t)`.
fn projected(time: &[f64], force: &[f64], windows: usize) -> [f64; 2] {
    let last = force.len() - windows..force.len();
    let (mut c, mut s) = (0.0, 0.0);
    for k in last {
        let angle = 2.0 * std::f64::consts::PI * time[k];
        c += force[k] * angle.cos() * 2.0 / windows as f64;
        s += force[k] * angle.sin() * 2.0 / windows as f64;
    }
    [-c, s]
}

#[test]
fn oscillating_cylinder_has_the_added_mass_and_damping_of_stokes() {
    let folder = tempfile::tempdir().expect("a folder");
    for (cells, far) in [([32, 40], 15.0), ([64, 80], 15.0)] {
        ring(folder.path(), cells, far);
        let clock = std::time::Instant::now();
        let out = run(folder.path(), &format!("{}", cells[0]), CYLINDER, &[]);
        let t = table(&out, "swing/forces.csv");
        let h = table(&out, "swing/history.csv");
        let scale = 1.225 * std::f64::consts::PI / 4.0 * 0.1 * (2.0 * std::f64::consts::PI).powi(2) * 0.01;
        let found = projected(&t["time_s"], &t["cylinder_drag_n"], 64).map(|f| f / scale);
        println!("{cells:?}: {found:?}, exact {:?}, {:?}, iterations {:?}", stokes(100.0), clock.elapsed(), &h["flow_iterations"][100..110]);
    }
}
