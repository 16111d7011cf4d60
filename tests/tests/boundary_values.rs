//! Runs of a duct whose inlet, outlet and wall have data of their own.

use std::path::Path;

use ripstop_tests::{ripstop_run, succeed};

/// A duct of 0.5 m2 around a panel that is held still.
const DUCT: &str = r#"
name = "duct"
[canopy]
kind = "panel"
size_m = [0.5, 0.5]
cells = [4, 4]
[fabric]
youngs_modulus_pa = 1e6
poisson_ratio = 0.3
thickness_m = 1e-3
density_kg_m3 = 1000.0
[flow]
[flow.viscosity]
dynamic_viscosity_pa_s = 1e-3
[flow.box]
below_m = 0.5
above_m = 0.5
layers_below = 5
layers_above = 5
ahead_m = 1.0
cells_ahead = 8
behind_m = 1.0
cells_behind = 8
[flow.box.sides]
left = "inlet"
right = "outlet"
bottom = "wall"
[[flow.inlet]]
patch = "left"
flow_rate_m3_s = 1.0
profile = "1 + 0.2*z"
factor = { time_s = [0.0, 0.4], value = [0.5, 1.0] }
[[flow.outlet]]
patch = "right"
pressure_pa = 5.0
[[flow.moving_wall]]
patch = "bottom"
velocity_m_s = [2.0, 0.0, 0.0]
[flow.solver]
residual_drop = 1e-4
[flow.forces]
[[flow.probe]]
name = "end"
position_m = [1.2, 0.05, 0.15]
[[flow.probe]]
name = "start"
position_m = [-1.2, 0.05, 0.45]
[output]
surface_every_windows = 0
volume_every_windows = 0
[ranks]
structure = 1
flow = 2
mesh = 1
[[stage]]
name = "flow"
kind = "flow-only"
duration_s = 0.8
window_s = 0.02
"#;

/// Rows of a table of the stage.
fn rows(out: &Path, table: &str, columns: &[&str]) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(out.join("flow").join(table)).expect("a table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at =
        |name: &&str| names.iter().position(|n| n == name).unwrap_or_else(|| panic!("{name}: {names:?}"));
    let places: Vec<usize> = columns.iter().map(at).collect();
    let row = |line: &str| -> Vec<f64> { line.split(',').map(|x| x.parse().expect("a number")).collect() };
    lines.map(row).map(|row| places.iter().map(|&k| row[k]).collect()).collect()
}

/// The air at the end of the duct follows the flow rate over the time, at the pressure of the outlet; a wall that slides
/// along with the air has less friction than one at rest.
#[test]
fn duct_follows_flow_rate_outlet_pressure_and_moving_wall() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, text: &str| {
        let scene = folder.path().join(format!("{name}.toml"));
        std::fs::write(&scene, text).expect("written");
        let out = folder.path().join(name);
        succeed(ripstop_run(&scene, &out, &["--quiet"]));
        out
    };
    let moving = run("moving", DUCT);
    let end = rows(&moving, "probes.csv", &["time_s", "end_u_m_s", "end_p_pa", "start_u_m_s"]);
    assert_eq!(end.len(), 40);
    for row in &end {
        // The profile is 1.03 of the mean at the height of the last probe and 1.09 at that of the first. The inlet accelerates
        // what is behind the last one.
        let (rate, push) = if row[0] < 0.4 { (0.5 + 1.25 * row[0], 1.25) } else { (1.0, 0.0) };
        let (speed, pressure) = (rate / 0.5, 5.0 + 1.225 * 2.0 * push * 0.05);
        println!("{row:.4?}: {speed:.4} m/s, {pressure:.4} Pa");
        if row[0] > 0.1 {
            assert!((0.98..1.06).contains(&(row[1] / speed)), "{row:?} {speed}");
            assert!((row[3] / (1.09 * speed) - 1.0).abs() < 0.02, "{row:?} {speed}");
            assert!((row[2] - pressure).abs() < 0.4, "{row:?} {pressure}");
        }
    }
    let friction = |out: &Path| rows(out, "forces.csv", &["wall_shear_force_x_n"]).last().expect("a row")[0];
    let (start, _) = DUCT.split_once("[[flow.moving_wall]]").expect("a wall");
    let (_, rest) = DUCT.split_once("[flow.solver]").expect("a solver");
    let still = run("still", &format!("{start}[flow.solver]{rest}"));
    let [moving, still] = [friction(&moving), friction(&still)];
    println!("friction on the wall: {moving:.3e} N where it moves, {still:.3e} N where it rests");
    assert!(still > 0.0 && moving.abs() < 0.2 * still, "{moving} {still}");
}
