//! Rigid bodies as walls, without a canopy: check, run, forces and report; the drag that a scene asks for.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use mesh::{FlowGrid, Patch, block_grid};
use ripstop_tests::{program, ripstop_run, succeed};

const SCENE: &str = r#"name = "body"
[canopy]
kind = "none"
[flow]
wind_m_s = [3.0, 0.0, 0.0]
[flow.viscosity]
dynamic_viscosity_pa_s = 0.05
[flow.grid_file]
path = "grid.msh"
[flow.grid_file.patches]
left = "inlet"
right = "outlet"
front = "slip"
back = "slip"
bottom = "slip"
top = "slip"
body = "wall"
[flow.forces]
[[flow.forces.coefficients]]
name = "block"
patches = ["body"]
drag_direction = [1.0, 0.0, 0.0]
reference_area_m2 = 0.81
reference_length_m = 0.9
[ranks]
flow = 1
[[stage]]
name = "start"
kind = "flow-only"
duration_s = 0.2
window_s = 2e-2
"#;

fn grid(folder: &Path) -> FlowGrid {
    let (s, i, o) = (Patch::Slip, Patch::Inlet, Patch::Outlet);
    let grid =
        block_grid([16, 10, 10], [-2.0, -1.5, -1.5], [4.0, 1.5, 1.5], [i, o, s, s, s, s], [5..7, 4..7, 3..6]);
    let name = |k: usize| grid.patch_names[usize::from(grid.boundary_patch[k])].clone();
    mesh::write_msh(&folder.join("grid.msh"), &grid, "canopy", name, true).expect("written");
    grid
}

fn scene(folder: &Path, name: &str, text: &str) -> PathBuf {
    grid(folder);
    let file = folder.join(format!("{name}.toml"));
    fs::write(&file, text).expect("written");
    file
}

/// Cells of a table by their column, as they stand.
fn table(path: &Path) -> BTreeMap<String, Vec<String>> {
    let text = fs::read_to_string(path).expect("a table");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            columns.entry((*name).to_owned()).or_default().push(cell.to_owned());
        }
    }
    columns
}

fn last(table: &BTreeMap<String, Vec<String>>, column: &str) -> f64 {
    table[column].last().expect("a row").parse().unwrap_or_else(|_| panic!("{column}: {:?}", table[column]))
}

fn ripstop(words: &[&str], path: &Path) -> std::process::Output {
    Command::new(program("ripstop")).args(words).arg(path).output().expect("starts")
}

#[test]
fn body_without_a_canopy_is_checked_run_and_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = scene(folder.path(), "body", SCENE);
    let check = ripstop(&["check"], &file);
    let text = String::from_utf8_lossy(&check.stdout).into_owned();
    assert!(check.status.success(), "{text}{}", String::from_utf8_lossy(&check.stderr));
    println!("{text}");
    assert!(!text.contains("NaN") && !text.contains("inf "), "{text}");
    let outs = [1, 2].map(|ranks| {
        let out = folder.path().join(format!("out{ranks}"));
        let run = succeed(ripstop_run(&file, &out, &["--ranks", &format!("flow={ranks}")]));
        let text = String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr);
        println!("{text}");
        assert!(text.contains("drag of block"), "{text}");
        out
    });
    let [one, two] = outs.each_ref().map(|out| table(&out.join("start/forces.csv")));
    assert_eq!(one["block_drag_n"].len(), 10);
    assert!(!one.contains_key("canopy_drag_n"));
    for column in ["block_drag_n", "block_cd", "wall_pressure_force_x_n"] {
        let (a, b) = (last(&one, column), last(&two, column));
        assert!(a > 0.0 && (a - b).abs() < 1e-2 * a, "{column}: {a} {b}");
    }
    let force = last(&one, "wall_pressure_force_x_n") + last(&one, "wall_shear_force_x_n");
    assert!((last(&one, "block_drag_n") - force).abs() < 1e-8 * force);
    let scale = 0.5 * 1.225 * 9.0 * 0.81;
    assert!((last(&one, "block_cd") - force / scale).abs() < 1e-8 * force);
    // The history has the same drag, and its coefficient.
    let history = table(&outs[0].join("start/history.csv"));
    assert!((last(&history, "drag_n") - force).abs() < 1e-7 * force);
    assert!((last(&history, "cd") - force / scale).abs() < 1e-7 * force);
    let summary = fs::read_to_string(outs[0].join("summary.json")).expect("a summary");
    assert!(summary.contains("\"drag_of\": \"block\""), "{summary}");
    let report = ripstop(&["report"], &outs[0]);
    assert!(report.status.success(), "{}", String::from_utf8_lossy(&report.stderr));
    let picture = ripstop(&["picture"], &outs[0]);
    let text = String::from_utf8_lossy(&picture.stderr).into_owned();
    assert!(
        !picture.status.success() && text.contains("the scene has none") && text.contains("ParaView"),
        "{text}"
    );
    let page = fs::read_to_string(outs[0].join("report.html")).expect("a page");
    assert!(page.contains("Drag of block") && page.contains("Flow around the body"));
    assert!(!page.contains(">NaN") && !page.contains(">inf"), "a number is missing in the report");
}

#[test]
fn steady_march_watches_the_force_of_the_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let duration = "duration_s = 0.2\nwindow_s = 2e-2\n";
    // Without a canopy its force is zero in all steps: only the force on the body can end this march late.
    let steady = "[stage.steady]\nresidual_drop = 0.0\nforce_change = 1e-4\nmax_steps = 200\n";
    let text = SCENE.replace(duration, steady);
    let drag = |name: &str, more: &str| {
        let file =
            scene(folder.path(), name, &text.replace("[flow.forces]\n", &format!("[flow.forces]\n{more}")));
        let out = folder.path().join(name);
        succeed(ripstop_run(&file, &out, &["--quiet"]));
        table(&out.join("start/history.csv"))
    };
    let (default, all) =
        (drag("default", ""), drag("walls", "watch = \"wall\"\ndrag_direction = [1, 0, 0]\n"));
    let (a, b) = (last(&default, "drag_n"), last(&all, "drag_n"));
    println!("{a} N, {b} N");
    assert!(a > 1.0 && (a - b).abs() < 1e-3 * a, "{a} {b}");
    // All walls have no reference area.
    assert!(all["cd"].iter().all(String::is_empty), "{:?}", all["cd"]);
    assert!(last(&default, "cd") > 0.1);
}

/// Air at rest with a gust that starts later: no coefficient in the first window, no infinity in any file.
#[test]
fn history_has_no_infinity_at_zero_speed() {
    let folder = tempfile::tempdir().expect("a folder");
    let still = "wind_m_s = [0.0, 0.0, 0.0]\n[flow.gust]\nvelocity_m_s = [1.0, 0.0, 0.0]\nstart_s = 0.04\nduration_s = 10.0\n";
    let text = SCENE.replace("wind_m_s = [3.0, 0.0, 0.0]\n", still);
    let file = scene(folder.path(), "still", &text);
    let out = folder.path().join("still");
    let run = ripstop_run(&file, &out, &["--quiet"]).output().expect("starts");
    println!("{}", String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success());
    for name in ["start/history.csv", "start/forces.csv"] {
        let text = fs::read_to_string(out.join(name)).expect("a table");
        assert!(!text.contains("inf") && !text.contains("NaN"), "{text}");
    }
    let (history, forces) = (table(&out.join("start/history.csv")), table(&out.join("start/forces.csv")));
    assert_eq!((history["cd"][0].as_str(), forces["block_cd"][0].as_str()), ("", ""));
    assert!(last(&history, "cd").is_finite() && last(&forces, "block_cd").is_finite());
}

#[test]
fn scenes_that_need_a_canopy_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    grid(folder.path());
    let refused = |from: &str, to: &str| {
        assert!(SCENE.contains(from), "{from}");
        let file = folder.path().join("bad.toml");
        fs::write(&file, SCENE.replacen(from, to, 1)).expect("written");
        case::load(&file).expect_err("refused").to_string()
    };
    for (from, to, words) in [
        ("kind = \"flow-only\"", "kind = \"coupled\"", ["moves a canopy", "flow-only"]),
        ("patches = [\"body\"]", "patches = [\"sphere\"]", ["no patch \"sphere\"", "front, top"]),
        ("patches = [\"body\"]", "patches = [\"canopy\"]", ["no patch \"canopy\"", "body, bottom, front"]),
        ("[flow.forces]\n", "[flow.forces]\nwatch = \"canopy\"\n", ["the name \"canopy\"", "block, wall"]),
        ("[ranks]", "[fabric_gravity]\n[ranks]", ["belongs to a canopy", "remove it"]),
        (
            "kind = \"none\"",
            "kind = \"square\"\nwidth_m = 2.0\ncells_across = 6",
            ["no material", "add [fabric]"],
        ),
    ] {
        let text = refused(from, to);
        assert!(words.iter().all(|w| text.contains(w)), "{words:?}: {text}");
    }
}
