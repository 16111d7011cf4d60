//! What the flow writes down, and grids from files.

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use comm::Comm;
use common::{at_rest, isothermal, settings};
use flow_solver::Loads;
use flow_solver::monitors::{Probes, Statistics, Surface};
use flow_solver::physics::{Inviscid, Laminar};
use mesh::vtk::read::{Piece, snapshots};
use mesh::{BoxShape, Patch, box_grid_of, plate_grid};

const SCENE: &str = r#"
name = "watched"
[canopy]
kind = "square"
width_m = 2.0
cells_across = 6
[fabric]
youngs_modulus_pa = 2e8
poisson_ratio = 0.3
thickness_m = 3e-5
density_kg_m3 = 1200.0
[flow.viscosity]
dynamic_viscosity_pa_s = 0.02
[flow.grid]
layers_inside = 3
layers_outside = 8
first_layer_m = 0.2
[flow.solver]
residual_drop = 1e-9
max_iterations = 200
[descent]
payload_mass_kg = 5.0
initial_speed_m_s = 4.0
reference_area_m2 = 4.0
[[stage]]
name = "a"
kind = "flow-only"
duration_s = 0.08
window_s = 2e-2
[[stage]]
name = "b"
kind = "flow-only"
duration_s = 0.08
window_s = 2e-2
"#;

const MONITORS: &str = r#"
[[flow.probe]]
name = "wake"
position_m = [0.11, 0.23, 0.7]
[[flow.probe]]
name = "front"
position_m = [0.0, 0.0, -0.31]
[flow.statistics]
start_s = 0.02
across_stages = true
[flow.forces]
moment_point_m = [0.5, 0.0, -1.0]
[[flow.slice]]
name = "middle"
point_m = [0.0, 0.05, 0.0]
normal = [0.0, 1.0, 0.0]
every_windows = 2
[flow.surface_pressure]
every_windows = 4
"#;

/// Runs a stage of the program alone; what it prints.
fn run_alone(scene: &Path, stage: usize, out: &Path, ranks: usize) -> Result<String, String> {
    let mut command = Command::new("mpirun");
    comm::mpirun_env(&mut command);
    let output = command
        .args(["-n", &ranks.to_string(), env!("CARGO_BIN_EXE_flow-solver"), "alone", "--save"])
        .args(["--stage", &stage.to_string(), "--scene"])
        .arg(scene)
        .arg("--out")
        .arg(out)
        .output()
        .expect("mpirun is on the PATH");
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// Columns of a CSV file by their names.
fn table(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, value) in names.iter().zip(line.split(',')) {
            columns.entry((*name).to_owned()).or_default().push(value.parse().unwrap());
        }
    }
    columns
}

/// A field over all pieces of the last snapshot of a series, in ascending order.
fn last(series: &Path, field: &str) -> Vec<f64> {
    let list = snapshots(series).unwrap();
    let mut all = Vec::new();
    for file in &list.last().unwrap().files {
        let piece = Piece::read(file).unwrap();
        let column = piece.cell_fields.iter().find(|c| c.name == field).expect(field);
        all.extend_from_slice(&column.values);
    }
    all.sort_by(f64::total_cmp);
    all
}

fn assert_close(a: &[f64], b: &[f64], tolerance: f64, what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    let size = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for (x, y) in a.iter().zip(b) {
        assert!((x - y).abs() <= tolerance * size, "{what}: {x} and {y}");
    }
}

#[test]
fn output_is_independent_of_rank_count() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, [SCENE, MONITORS].concat()).unwrap();
    let runs = [1, 3].map(|ranks| {
        let out = folder.path().join(format!("out{ranks}"));
        run_alone(&scene, 0, &out, ranks).unwrap();
        let printed = run_alone(&scene, 1, &out, ranks).unwrap();
        (out, printed)
    });
    let (one, three) = (&runs[0].0, &runs[1].0);
    for name in ["probes.csv", "forces.csv"] {
        let (a, b) = (table(&one.join("b").join(name)), table(&three.join("b").join(name)));
        assert_eq!(a["time_s"], [0.02, 0.04, 0.06, 0.08]);
        for (column, values) in a.iter().filter(|c| !c.0.contains("moment") && !c.0.contains("force_")) {
            assert_close(values, &b[column], 1e-6, column);
        }
    }
    // The drag is the force that the run itself reports, the moment the one about the point.
    let forces = table(&one.join("b/forces.csv"));
    let reported: Vec<f64> =
        runs[0].1.lines().skip(1).map(|l| l.split_whitespace().nth(2).unwrap().parse().unwrap()).collect();
    assert_close(&forces["canopy_drag_n"], &reported, 1e-5, "drag");
    let lift = &forces["canopy_pressure_force_z_n"];
    for (k, my) in forces["canopy_moment_y_n_m"].iter().enumerate() {
        // The flat plate is symmetric, so its force acts at its middle: (-0.5, 0, 1) from the point.
        let fz = lift[k] + forces["canopy_shear_force_z_n"][k];
        assert!((my - 0.5 * fz).abs() < 1e-3 * fz.abs(), "{my} and {fz}");
    }
    // Pressure before the plate above that behind it; temperature as it is everywhere.
    let probes = table(&one.join("b/probes.csv"));
    assert!(probes["front_p_pa"][3] > probes["wake_p_pa"][3] + 5.0, "{probes:?}");
    assert!(probes["front_t_k"].iter().all(|t| (t - 288.15).abs() < 1e-9));
    // Statistics of both stages, the first window of each left out.
    for field in ["pressure_mean_pa", "pressure_rms_pa"] {
        let (a, b) = (last(&one.join("b/flow.pvd"), field), last(&three.join("b/flow.pvd"), field));
        assert_close(&a, &b, 1e-5, field);
        assert!(a[a.len() - 1] > 0.1, "{field}");
    }
    for (series, field) in [("canopy_air.pvd", "pressure_jump_pa"), ("middle.pvd", "pressure_pa")] {
        let (a, b) = (last(&one.join("b").join(series), field), last(&three.join("b").join(series), field));
        assert_close(&a, &b, 1e-5, field);
    }
    assert_eq!(snapshots(&one.join("b/middle.pvd")).unwrap().len(), 2);
    let inside = last(&one.join("b/canopy_air.pvd"), "pressure_inside_pa");
    let outside = last(&one.join("b/canopy_air.pvd"), "pressure_outside_pa");
    assert!(inside[0] > *outside.last().unwrap(), "the air meets the inside");
    let quality = std::fs::read_to_string(one.join("b/grid.txt")).unwrap();
    assert!(quality.contains("hexahedra") && quality.contains("non-orthogonality"), "{quality}");
}

#[test]
fn default_output_is_minimal_and_probes_outside_the_grid_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, SCENE).unwrap();
    let out = folder.path().join("out");
    run_alone(&scene, 0, &out, 1).unwrap();
    let mut names: Vec<String> = std::fs::read_dir(out.join("a"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["flow", "flow.pvd", "grid.txt", "state"]);
    let mut states: Vec<_> = std::fs::read_dir(out.join("a/state"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    states.sort();
    assert_eq!(states, ["flow-memory-0-of-1.bin", "flow.bin"]);
    let probe = "[[flow.probe]]\nname = \"moon\"\nposition_m = [0.0, 0.0, 4e8]\n";
    std::fs::write(&scene, [SCENE, probe].concat()).unwrap();
    let message = run_alone(&scene, 0, &out, 2).unwrap_err();
    assert!(message.contains("the probe \"moon\"") && message.contains("outside"), "{message}");
}

/// Probes are exact for linear fields on any cells.
#[test]
fn probes_are_exact_for_linear_fields() {
    let air = settings([0.0; 3], 1.0).air;
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        let grid = box_grid_of(shape, [5; 3], [0.0; 3], [1.0; 3], [Patch::Slip; 6]);
        let mut s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
        let exact = |x: &[f64; 3]| [1.0 + 2.0 * x[0] - x[1], x[2], 3.0 - x[0], 0.5 * x[1] + 0.25 * x[2]];
        s.q = s.metrics.centre.iter().map(exact).collect();
        for g in &mut s.gradient {
            *g = [[2.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.25]];
        }
        let points = [[0.51, 0.43, 0.47], [0.13, 0.88, 0.34], [0.999, 0.001, 0.5]];
        let list: Vec<case::Probe> = points
            .iter()
            .enumerate()
            .map(|(k, p)| case::Probe { name: format!("p{k}"), position_m: *p })
            .collect();
        let mut probes = Probes::new(&list, &s).unwrap();
        for (row, x) in probes.sample(&s).chunks(5).zip(&points) {
            let q = exact(x);
            for (found, wanted) in row.iter().zip([q[0], q[1], q[2], q[3], air.temperature]) {
                assert!((found - wanted).abs() < 1e-9, "{shape:?} at {x:?}: {row:?}, {q:?}");
            }
        }
        let outside = [case::Probe { name: "out".into(), position_m: [1.2, 0.5, 0.5] }];
        assert!(Probes::new(&outside, &s).is_err());
    }
}

/// Statistics are those of the definition, and continue after a restart.
#[test]
fn statistics_continue_after_a_restart() {
    let grid = box_grid_of(BoxShape::Hexahedra, [3, 2, 2], [0.0; 3], [1.0; 3], [Patch::Slip; 6]);
    let mut s = isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
    let folder = tempfile::tempdir().unwrap();
    let (n, comm) = (grid.cells.len(), Comm::solo());
    // Windows of different length; the first one comes before the start.
    let windows = [(0.0, 0.5, 1e6), (0.5, 0.25, 3.0), (0.75, 0.5, -1.0), (1.25, 0.25, 7.5), (1.5, 1.0, 2.25)];
    let mut first = Statistics::new(0.5, n);
    let mut run = |statistics: &mut Statistics, part: &[(f64, f64, f64)]| {
        for &(time, dt, value) in part {
            for (c, q) in s.q.iter_mut().enumerate() {
                *q = [value, 2.0 * value, c as f64, 1e4 + value];
            }
            statistics.record(&s, time, dt);
        }
    };
    run(&mut first, &windows[..3]);
    first.save(folder.path(), &comm, &s_topology(&grid), n).unwrap();
    let mut second = Statistics::new(0.5, n);
    second.load(folder.path(), &s_topology(&grid), n).unwrap();
    run(&mut second, &windows[3..]);
    let span: f64 = windows[1..].iter().map(|w| w.1).sum();
    let mean = windows[1..].iter().map(|w| w.1 * w.2).sum::<f64>() / span;
    let square = windows[1..].iter().map(|w| w.1 * (w.2 - mean).powi(2)).sum::<f64>() / span;
    for c in 0..n {
        let (m, r) = second.of(c);
        for (found, wanted) in m.into_iter().zip([mean, 2.0 * mean, c as f64, 1e4 + mean]) {
            assert!((found - wanted).abs() < 1e-10, "{found} {wanted}");
        }
        for (found, wanted) in r.into_iter().zip([square.sqrt(), 2.0 * square.sqrt(), 0.0, square.sqrt()]) {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }
    // Damage and another grid are refused.
    assert!(second.load(folder.path(), &s_topology(&grid), n + 1).is_err());
    let file = folder.path().join("flow-statistics.bin");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    assert!(second.load(folder.path(), &s_topology(&grid), n).unwrap_err().message.contains("damaged"));
}

fn s_topology(grid: &mesh::FlowGrid) -> flow_solver::topology::Topology {
    isothermal(grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3)).topology
}

/// The two sides of the canopy differ by its load.
#[test]
fn pressure_jump_is_the_difference_of_both_sides() {
    let side = Patch::Slip;
    let patches = [side, side, side, side, Patch::FarField, Patch::Outlet];
    let grid = plate_grid([8, 8, 8], [-2.0; 3], [2.0; 3], patches, 4, [3..5, 3..5]);
    let mut s = isothermal(&grid, Laminar { viscosity: 0.02 }, settings([0.0, 0.0, 4.0], 1e-4));
    let mut loads = Loads::new(&s);
    s.advance(&at_rest(0.02)).unwrap();
    loads.compute(&s);
    let mut surface = Surface::new(1, &s);
    let sides = surface.sides(&s);
    assert_eq!(sides.len(), 4);
    for (p, l) in sides.iter().zip(&loads.faces) {
        assert!((p[0] - p[1] - l[0]).abs() < 1e-12 * l[0].abs());
        // The stream meets the plate from below: that is its inside.
        assert!(p[0] > 0.0 && p[1] < 0.0, "{p:?}");
    }
}

/// The generated grid from a file is the generated grid.
#[test]
fn drag_on_a_gmsh_grid_matches_the_generated_grid() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, SCENE).unwrap();
    let out = folder.path().join("out");
    let force = |printed: String| -> Vec<f64> {
        printed.lines().skip(1).map(|l| l.split_whitespace().nth(2).unwrap().parse().unwrap()).collect()
    };
    let generated = force(run_alone(&path, 0, &out, 1).unwrap());
    let scene = case::load(&path).unwrap();
    let structure = mesh::structure_mesh(&scene).unwrap();
    let grid = mesh::flow_grid(&scene, &structure, &structure.coords[..structure.n_canopy]).unwrap();
    let name = |k: usize| match grid.boundary[k].0 {
        Patch::FarField => "far".to_owned(),
        _ => "other".to_owned(),
    };
    for binary in [false, true] {
        mesh::write_msh(&folder.path().join("grid.msh"), &grid, "sheet", name, binary).unwrap();
        let other =
            if (0..grid.boundary.len()).any(|k| name(k) == "other") { "other = \"outlet\"\n" } else { "" };
        let keys = "[flow.grid_file]\npath = \"grid.msh\"\nmembrane = \"sheet\"\n[flow.grid_file.patches]\n";
        std::fs::write(&path, [SCENE, keys, "far = \"far-field\"\n", other].concat()).unwrap();
        let read = force(run_alone(&path, 0, &out, if binary { 2 } else { 1 }).unwrap());
        assert_close(&read, &generated, 1e-6, "drag on the grid from a file");
    }
    // A missing condition is reported by the program.
    std::fs::write(
        &path,
        [SCENE, "[flow.grid_file]\npath = \"grid.msh\"\nmembrane = \"sheet\"\n[flow.grid_file.patches]\n"]
            .concat(),
    )
    .unwrap();
    let message = run_alone(&path, 0, &out, 1).unwrap_err();
    assert!(message.contains("the patch \"far\" has no condition"), "{message}");
}

/// A box of tetrahedra with a membrane, written line by line as Gmsh would: one file
/// for the fabric and for the air.
#[expect(clippy::too_many_lines, reason = "a file as Gmsh writes it, section by section")]
fn box_with_membrane(n: usize) -> String {
    let node = |i: usize, j: usize, k: usize| 1 + i + (n + 1) * (j + (n + 1) * k);
    let at = |m: usize| 6.0 * m as f64 / n as f64 - 3.0;
    let mut nodes = String::new();
    for t in 1..=(n + 1).pow(3) {
        nodes += &format!("{t}\n");
    }
    for k in 0..=n {
        for j in 0..=n {
            for i in 0..=n {
                nodes += &format!("{} {} {}\n", at(i), at(j), at(k));
            }
        }
    }
    let (mut tets, mut outer, mut sheet) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let c = |b: usize| node(i + (b & 1), j + ((b >> 1) & 1), k + (b >> 2));
                // Six about the diagonal from corner 0 to corner 7.
                for [p, q] in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                    tets.push(vec![c(0), c(p), c(q), c(7)]);
                }
                let quad = |a: usize, b: usize, d: usize, e: usize, list: &mut Vec<Vec<usize>>| {
                    list.push(vec![c(a), c(b), c(d)]);
                    list.push(vec![c(a), c(d), c(e)]);
                };
                for (on, q) in [
                    (i == 0, [0, 4, 6, 2]),
                    (i + 1 == n, [1, 3, 7, 5]),
                    (j == 0, [0, 1, 5, 4]),
                    (j + 1 == n, [2, 6, 7, 3]),
                    (k == 0, [0, 2, 3, 1]),
                    (k + 1 == n, [4, 5, 7, 6]),
                ] {
                    if on {
                        quad(q[0], q[1], q[2], q[3], &mut outer);
                    }
                }
                let middle = |m: usize| (n / 3..2 * n / 3).contains(&m);
                if k == n / 2 && middle(i) && middle(j) {
                    quad(0, 1, 3, 2, &mut sheet);
                }
            }
        }
    }
    let held = node(n / 3, n / 3, n / 2);
    let count = 1 + tets.len() + outer.len() + sheet.len();
    let mut tag = 0;
    let mut block = |dimension: usize, entity: usize, kind: usize, list: &[Vec<usize>]| {
        let mut text = format!("{dimension} {entity} {kind} {}\n", list.len());
        for e in list {
            tag += 1;
            text += &format!("{tag}");
            e.iter().for_each(|v| text += &format!(" {v}"));
            text.push('\n');
        }
        text
    };
    let elements = [
        block(0, 1, 15, &[vec![held]]),
        block(2, 1, 2, &sheet),
        block(2, 2, 2, &outer),
        block(3, 1, 4, &tets),
    ]
    .concat();
    let total = (n + 1).pow(3);
    format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n4\n0 1 \"fixed\"\n2 1 \"canopy\"\n2 2 \"outer air\"\n3 1 \"air\"\n\
         $EndPhysicalNames\n$Entities\n1 0 2 1\n1 0 0 0 1 1\n1 -1 -1 0 1 1 0 1 1 0\n2 -3 -3 -3 3 3 3 1 2 0\n\
         1 -3 -3 -3 3 3 3 1 1 1 2\n$EndEntities\n$Nodes\n1 {total} 1 {total}\n3 1 0 {total}\n{nodes}$EndNodes\n\
         $Elements\n4 {count} 1 {count}\n{elements}$EndElements\n"
    )
}

#[test]
fn tetrahedra_around_a_membrane_run() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("box.msh"), box_with_membrane(6)).unwrap();
    let square = "kind = \"square\"\nwidth_m = 2.0\ncells_across = 6\n";
    let keys = "[flow.forces]\n[flow.grid_file]\npath = \"box.msh\"\n[flow.grid_file.patches]\n\"outer air\" = \"far-field\"\n";
    let text = [&SCENE.replace(square, "kind = \"gmsh\"\nfile = \"box.msh\"\n"), keys].concat();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, text).unwrap();
    let out = folder.path().join("out");
    run_alone(&scene, 0, &out, 2).unwrap();
    let drag = &table(&out.join("a/forces.csv"))["canopy_drag_n"];
    // The same sheet on the generated hexahedra; both grids are coarse.
    std::fs::write(&scene, [SCENE, "[flow.forces]\n"].concat()).unwrap();
    run_alone(&scene, 0, &out, 1).unwrap();
    let hexahedra = &table(&out.join("a/forces.csv"))["canopy_drag_n"];
    println!("drag in N after the start: tetrahedra {drag:.2?}, hexahedra {hexahedra:.2?}");
    assert!((drag[3] / hexahedra[3] - 1.0).abs() < 0.15, "{drag:?} {hexahedra:?}");
}

/// A panel in a wind tunnel between two walls; entries of `[[flow.forces.coefficients]]`.
fn panel_with_coefficients() -> String {
    let panel = "kind = \"panel\"\nsize_m = [2.0, 1.0]\ncells = [6, 3]\n";
    let tunnel = "[flow.box]\nbelow_m = 1.0\nabove_m = 1.0\nlayers_below = 5\nlayers_above = 5\nahead_m = 1.0\n\
                  cells_ahead = 3\nbehind_m = 1.0\ncells_behind = 3\n[flow.box.sides]\nleft = \"inlet\"\nright = \"outlet\"\n\
                  bottom = \"wall\"\ntop = \"wall\"\n[flow.forces]\nmoment_point_m = [0.5, 0.0, -1.0]\n\
                  drag_direction = [2.0, 0.0, 0.0]\n";
    let entry = |name: &str, patches: &str, rest: &str| {
        format!(
            "[[flow.forces.coefficients]]\nname = \"{name}\"\npatches = [{patches}]\nreference_area_m2 = 2.5\n\
             reference_length_m = 0.4\n{rest}"
        )
    };
    let all = "\"canopy\", \"top\", \"bottom\"";
    let entries = [
        entry("sheet", "\"canopy\"", "reference_speed_m_s = 4.0\n"),
        entry("walls", "\"top\", \"bottom\"", ""),
        entry("floor", "\"bottom\"", "moment_point_m = [1.0, 2.0, 3.0]\n"),
        entry("all", all, "drag_direction = [0, 0, 1]\nlift_direction = [-1, 0, 0]\n"),
    ]
    .concat();
    let square = "kind = \"square\"\nwidth_m = 2.0\ncells_across = 6\n";
    let generated = "[flow.grid]\nlayers_inside = 3\nlayers_outside = 8\nfirst_layer_m = 0.2\n";
    let wind = "[flow]\nwind_m_s = [3.0, 0.0, 0.5]\n[flow.viscosity]";
    let text = SCENE.replace(square, panel).replace(generated, "").replace("[flow.viscosity]", wind);
    [&text, tunnel, &entries].concat()
}

type Columns = BTreeMap<String, Vec<f64>>;

fn last_of(table: &Columns, column: &str) -> f64 {
    *table[column].last().unwrap()
}

fn last_vector(table: &Columns, on: &str, what: &str) -> [f64; 3] {
    ["x", "y", "z"].map(|d| last_of(table, &format!("{on}_{what}_force_{d}_n")))
}

/// The sum of both forces.
fn last_force(table: &Columns, on: &str) -> [f64; 3] {
    let [pressure, shear] = ["pressure", "shear"].map(|what| last_vector(table, on, what));
    std::array::from_fn(|d| pressure[d] + shear[d])
}

/// Columns of `[[flow.forces.coefficients]]` on one rank and on three, checked against each other and against the sets of
/// the canopy and of the walls. A table has ten digits.
#[test]
fn force_coefficients_are_independent_of_rank_count() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, panel_with_coefficients()).unwrap();
    let [one, three] = [1, 3].map(|ranks| {
        let out = folder.path().join(format!("out{ranks}"));
        run_alone(&scene, 0, &out, ranks).unwrap();
        table(&out.join("a/forces.csv"))
    });
    let size = last_force(&one, "all").iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for (name, values) in &one {
        for (a, b) in values.iter().zip(&three[name]) {
            assert!((a - b).abs() < 1e-6 * size.max(a.abs()), "{name}: {a} {b}");
        }
    }
    for (own, set) in [("sheet", "canopy"), ("walls", "wall")] {
        for what in ["pressure", "shear"] {
            assert_close(&last_vector(&one, own, what), &last_vector(&one, set, what), 1e-8, own);
        }
        for column in ["moment_x_n_m", "moment_y_n_m", "moment_z_n_m", "drag_n"] {
            let [a, b] = [own, set].map(|on| last_of(&one, &format!("{on}_{column}")));
            assert!((a - b).abs() < 1e-8 * size, "{own}_{column}: {a} {b}");
        }
    }
    // Axes turned by 90 degrees: drag along z, lift against x.
    let (canopy, walls) = (last_force(&one, "canopy"), last_force(&one, "wall"));
    let [x, y, z] = std::array::from_fn(|d| canopy[d] + walls[d]);
    let turned = ["drag", "lift", "side"].map(|f| last_of(&one, &format!("all_{f}_n")));
    assert_close(&turned, &[z, -x, y], 1e-7, "turned axes");
    let drag = |name: &str| last_of(&one, &format!("{name}_drag_n"));
    assert!(drag("sheet") > 0.0 && drag("walls") > drag("floor") && drag("floor") > 0.0);
}

/// By hand: with the speed of the scene, and with that of the undisturbed air relative to the falling frame.
#[test]
fn force_coefficients_are_those_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, panel_with_coefficients()).unwrap();
    run_alone(&scene, 0, folder.path(), 1).unwrap();
    let forces = table(&folder.path().join("a/forces.csv"));
    let last = |column: &str| last_of(&forces, column);
    let air = 3.0f64.powi(2) + 4.5f64.powi(2);
    for (name, speed_squared) in [("sheet", 16.0), ("walls", air), ("all", air)] {
        let scale = 0.5 * 1.225 * 2.5 * speed_squared;
        for (force, coefficient) in [("drag", "cd"), ("side", "cs"), ("lift", "cl")] {
            let expected = last(&format!("{name}_{force}_n")) / scale;
            assert_close(&[last(&format!("{name}_{coefficient}"))], &[expected], 1e-8, name);
        }
    }
    let scale = 0.5 * 1.225 * 2.5 * air * 0.4;
    assert_close(&[last("walls_cm_pitch")], &[last("walls_moment_y_n_m") / scale], 1e-8, "pitch");
    assert_close(&[last("all_cm_yaw")], &[-last("all_moment_x_n_m") / scale], 1e-8, "yaw about -x");
}

/// The case that users copy: its drag coefficient is near that of 250 880 hexahedra in a larger
/// box, 1.52.
#[test]
fn gmsh_grid_case_runs() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/plate-gmsh/scene.toml");
    let folder = tempfile::tempdir().unwrap();
    run_alone(&scene, 0, folder.path(), 2).unwrap();
    let drag = &table(&folder.path().join("start/forces.csv"))["canopy_drag_n"];
    let coefficient = drag.last().unwrap() / (0.5 * 1.225 * 4.88 * 4.88);
    println!("plate on a grid from Gmsh: drag coefficient {coefficient:.4}");
    assert!((1.5..1.75).contains(&coefficient), "{coefficient}");
}
