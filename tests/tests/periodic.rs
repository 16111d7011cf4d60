//! Periodic patches in scenes: a channel of a grid file that a force drives, a box around a panel, wrong pairs.

use std::fs;
use std::path::Path;
use std::process::Command;

use mesh::{FlowGrid, Patch, block_grid, box_grid};
use ripstop_tests::{ripstop_run, succeed};

const CHANNEL: &str = r#"name = "channel"
[canopy]
kind = "none"
[flow]
body_force_n_m3 = [0.2, 0.0, 0.0]
[flow.viscosity]
dynamic_viscosity_pa_s = 0.05
[flow.grid_file]
path = "grid.msh"
periodic = [["left", "right"], ["front", "back"]]
[flow.grid_file.patches]
left = "periodic"
right = "periodic"
front = "periodic"
back = "periodic"
bottom = "wall"
top = "wall"
[flow.solver]
residual_drop = 1e-5
[flow.forces]
[[flow.forces.coefficients]]
name = "plates"
patches = ["bottom", "top"]
drag_direction = [1.0, 0.0, 0.0]
reference_area_m2 = 2.0
reference_length_m = 1.0
reference_speed_m_s = 1.0
[[flow.probe]]
name = "middle"
position_m = [0.25, 0.25, 0.041666666666666664]
[ranks]
flow = 1
[[stage]]
name = "start"
kind = "flow-only"
duration_s = 100.0
window_s = 5.0
"#;

fn write(folder: &Path, grid: &FlowGrid) {
    let name = |k: usize| grid.patch_names[usize::from(grid.boundary_patch[k])].clone();
    mesh::write_msh(&folder.join("grid.msh"), grid, "canopy", name, true).expect("written");
}

/// What a run says that is refused.
fn message(mut run: Command) -> String {
    let output = run.output().expect("it starts");
    assert!(!output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

fn channel() -> FlowGrid {
    let (p, w) = (Patch::Periodic, Patch::Wall);
    box_grid([4, 2, 12], [0.0, 0.0, -0.5], [2.0, 1.0, 0.5], [p, p, p, p, w, w])
}

fn column(out: &Path, table: &str, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(out.join("start").join(table)).expect("a table");
    let mut lines = text.lines();
    let at = lines.next().expect("a header").split(',').position(|n| n == name);
    let at = at.unwrap_or_else(|| panic!("{table} has no {name}"));
    lines.map(|l| l.split(',').nth(at).expect("a cell").parse().expect("a number")).collect()
}

/// The walls hold the force on the air, and the profile is the parabola; on one and two ranks.
#[test]
fn force_drives_a_periodic_channel_to_the_parabola() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &channel());
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, CHANNEL).expect("written");
    for ranks in [1, 2] {
        let out = folder.path().join(format!("out{ranks}"));
        succeed(ripstop_run(&scene, &out, &["--quiet", "--ranks", &format!("flow={ranks}")]));
        let friction = *column(&out, "forces.csv", "plates_drag_n").last().expect("a row");
        let speed = *column(&out, "probes.csv", "middle_u_m_s").last().expect("a row");
        println!("{ranks} ranks: friction {friction:.6} N of 0.4 N, {speed:.4} m/s in the middle");
        assert!((friction / 0.4 - 1.0).abs() < 1e-4, "{friction} N instead of the force on 2 m3");
        // In the centre of a cell at h/2 from the middle; the differences at the wall add f h^2 / (8 mu) everywhere.
        let h: f64 = 1.0 / 12.0;
        let exact = 0.2 / (2.0 * 0.05) * (0.25 - 0.25 * h * h) + 0.2 / (8.0 * 0.05) * h * h;
        assert!((speed - exact).abs() < 2e-5, "{speed} instead of {exact} m/s");
    }
}

/// A march to the steady state at a low viscosity: 25 m/s in the exact solution, far above what the force moves within the length of the channel.
#[test]
fn march_to_a_fast_steady_channel_is_not_taken_for_impossible() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &channel());
    let scene = folder.path().join("scene.toml");
    let steady = CHANNEL
        .replace("= 0.05", "= 1e-3")
        .replace("duration_s = 100.0\nwindow_s = 5.0", "[stage.steady]\nforce_change = 1e-5");
    fs::write(&scene, steady).expect("written");
    let out = folder.path().join("out");
    succeed(ripstop_run(&scene, &out, &["--quiet"]));
    let friction = *column(&out, "forces.csv", "plates_drag_n").last().expect("a row");
    assert!((friction / 0.4 - 1.0).abs() < 1e-3, "{friction} N instead of the force on 2 m3");
}

/// A stream through a box whose ends are one: an elastic panel, the grid that follows it, and the same numbers on two ranks.
#[test]
fn panel_swings_between_periodic_ends() {
    let channel = fs::read_to_string(ripstop_tests::scene("hard/channel")).expect("the scene");
    let text = channel
        .replace("left = \"outlet\"", "left = \"periodic\"")
        .replace("right = \"outlet\"", "right = \"periodic\"")
        .replace(
            "layers_above = 4",
            "layers_above = 4\nahead_m = 0.5\ncells_ahead = 4\nbehind_m = 0.5\ncells_behind = 4",
        )
        .replace("duration_s = 1.8", "duration_s = 0.15");
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, &text).expect("written");
    let load = |ranks: usize| {
        let out = folder.path().join(format!("out{ranks}"));
        succeed(ripstop_run(&scene, &out, &["--quiet", "--ranks", &format!("flow={ranks},mesh={ranks}")]));
        let table = fs::read_to_string(out.join("waves/history.csv")).expect("a history");
        let at = table.lines().next().expect("a header").split(',').position(|n| n == "interface_work_j");
        let at = at.unwrap_or_else(|| panic!("{}", table.lines().next().unwrap_or_default()));
        let last = table.lines().last().expect("a row").split(',').nth(at).expect("a cell").to_owned();
        last.parse::<f64>().expect("a number")
    };
    let (one, two) = (load(1), load(2));
    assert!(one.abs() > 0.0 && (one - two).abs() < 5e-3 * one.abs(), "{one} and {two}");
}

/// A bar through a box of one cell that heaves: its nodes on both periodic sides move along. This plane flow on a plane grid has the same forces
/// between planes of symmetry.
#[test]
fn bar_through_periodic_sides_moves_as_between_planes_of_symmetry() {
    let folder = tempfile::tempdir().expect("a folder");
    let (inlet, outlet, slip) = (Patch::Inlet, Patch::Outlet, Patch::Slip);
    let run = |name: &str, side: Patch, pairs: &str| {
        let sides = [inlet, outlet, side, side, slip, slip];
        write(
            folder.path(),
            &block_grid([16, 1, 12], [-2.0, 0.0, -2.0], [4.0, 0.5, 2.0], sides, [5..7, 0..1, 5..7]),
        );
        let (head, _) = CHANNEL.split_once("[flow.solver]").expect("a solver");
        let head = head
            .replace("body_force_n_m3 = [0.2, 0.0, 0.0]", "wind_m_s = [2.0, 0.0, 0.0]")
            .replace("periodic = [[\"left\", \"right\"], [\"front\", \"back\"]]", pairs)
            .replace("left = \"periodic\"", "left = \"inlet\"")
            .replace("right = \"periodic\"", "right = \"outlet\"")
            .replace("\"periodic\"", &format!("\"{}\"", side.name()))
            .replace(
                "bottom = \"wall\"\ntop = \"wall\"",
                "bottom = \"slip\"\ntop = \"slip\"\nbody = \"wall\"",
            );
        let scene = folder.path().join(format!("{name}.toml"));
        let rest = "[flow.solver]\nresidual_drop = 1e-6\n[flow.forces]\n[ranks]\nflow = 1\nmesh = 1\n[[stage]]\nname = \"start\"\n\
                    kind = \"prescribed\"\nduration_s = 0.5\nwindow_s = 0.025\n[[stage.body_motion]]\npatches = [\"body\"]\n\
                    displacement_m = [\"0\", \"0\", \"0.04*(1 - cos(4*pi*t))\"]\n";
        fs::write(&scene, head + rest).expect("written");
        let out = folder.path().join(name);
        succeed(ripstop_run(&scene, &out, &["--quiet"]));
        ["x", "z"].map(|axis| column(&out, "forces.csv", &format!("wall_pressure_force_{axis}_n")))
    };
    let periodic = run("periodic", Patch::Periodic, "periodic = [[\"front\", \"back\"]]");
    let symmetric = run("symmetric", Patch::Symmetry, "");
    let size = symmetric.iter().flatten().fold(0.0f64, |most, f| most.max(f.abs()));
    let apart = periodic.iter().flatten().zip(symmetric.iter().flatten());
    let apart = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("forces up to {size:.3} N are {apart:.1e} N apart");
    assert_eq!(periodic[0].len(), 20);
    assert!(size > 0.1 && apart < 1e-7 * size, "{apart} of {size} N");
}

#[test]
fn wrong_pairs_are_refused_with_place_and_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), &channel());
    let scene = folder.path().join("scene.toml");
    let refused = |from: &str, to: &str| {
        assert!(CHANNEL.contains(from), "{from}");
        fs::write(&scene, CHANNEL.replacen(from, to, 1)).expect("written");
        message(ripstop_run(&scene, &folder.path().join("out"), &["--quiet"]))
    };
    for (from, to, wanted) in [
        (", [\"front\", \"back\"]]", "]", ["the periodic patch \"back\" has no partner", "add `periodic"]),
        (
            "[\"front\", \"back\"]",
            "[\"front\", \"top\"]",
            ["\"top\" has the condition \"wall\"", "or remove the pair"],
        ),
        ("[\"front\", \"back\"]", "[\"front\", \"left\"]", ["\"left\" occurs twice", "in one pair"]),
        ("[\"front\", \"back\"]", "[\"front\", \"bach\"]", ["no patch \"bach\"", "remove the pair"]),
        (
            "[[\"left\", \"right\"], [\"front\", \"back\"]]",
            "[[\"left\", \"front\"], [\"right\", \"back\"]]",
            ["\"left\" and \"front\": they have 24 and 48 faces", "Periodic Surface"],
        ),
        (
            "kind = \"flow-only\"\nduration_s = 100.0\nwindow_s = 5.0\n",
            "kind = \"prescribed\"\nduration_s = 1.0\nwindow_s = 0.1\n[[stage.body_motion]]\npatches = [\"top\"]\n[stage.body_motion.rotation]\n\
             axis = [0.0, 1.0, 0.0]\npoint_m = [0.0, 0.0, 0.0]\nangle_rad = \"0.1*sin(t)^2\"\n",
            ["on two periodic patches apart", "use `displacement_m` alone"],
        ),
        ("[0.2, 0.0, 0.0]\n", "[0.2, 0.0, 0.0]\n[flow.energy]\n", ["no work of a force", "remove the key"]),
        ("top = \"wall\"", "top = \"far-field\"", ["undisturbed air of the far field", "set no patch"]),
    ] {
        let message = refused(from, to);
        assert!(wanted.iter().all(|w| message.contains(w)), "{to}: {message}");
    }
    // Nodes that are not where the translation puts them.
    let mut bent = channel();
    let node = bent.coords.iter().position(|x| x[0] == 2.0 && x[1] == 0.5 && x[2] == 0.0).expect("a node");
    bent.coords[node][2] += 0.02;
    write(folder.path(), &bent);
    fs::write(&scene, CHANNEL).expect("written");
    let message = message(ripstop_run(&scene, &folder.path().join("out"), &["--quiet"]));
    assert!(message.contains("has no partner at (2.0000"), "{message}");
}

#[test]
fn sides_of_a_box_are_periodic_in_pairs_away_from_the_panel() {
    let channel = fs::read_to_string(ripstop_tests::scene("hard/channel")).expect("the scene");
    let message = |left: &str, right: &str| {
        let text = channel.replace("left = \"outlet\"", left).replace("right = \"outlet\"", right);
        case::parse(Path::new("scene.toml"), &text).expect_err("refused").to_string()
    };
    let one = message("left = \"periodic\"", "right = \"outlet\"");
    assert!(
        one.contains("the opposite side is \"outlet\"") && one.contains("set right = \"periodic\" too"),
        "{one}"
    );
    let touching = message("left = \"periodic\"", "right = \"periodic\"");
    assert!(
        touching.contains("the panel touches this side") && touching.contains("`cells_ahead`"),
        "{touching}"
    );
}
