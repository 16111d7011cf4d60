//! A real run writes the files and columns of `docs/reference/results.md`, and no others.

use std::path::{Path, PathBuf};

use results::columns::{
    Column, FORCE_COEFFICIENTS, FORCES, ITERATIONS, PAYLOAD, POINTS, PROBES, REACTIONS, first_difference,
};
use results::files::{RECORDING, RUN, ResultFile, matches};
use results::history;
use ripstop_tests::{changed_scene, ripstop_run, succeed};

/// Every monitor of the flow, and a payload that is a body.
const MONITORS: &str = "[[flow.forces.coefficients]]
name = \"sheet\"
patches = [\"canopy\"]
reference_area_m2 = 4.0
reference_length_m = 2.0
[flow.statistics]
[flow.surface_pressure]
every_windows = 1
[[flow.probe]]
name = \"centre\"
position_m = [0.0, 0.0, 1.0]
[[flow.slice]]
name = \"middle\"
point_m = [0.0, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
every_windows = 1
[descent.body]
inertia_kg_m2 = [0.1, 0.1, 0.1]
attachments_m = [[0.0, 0.0, 0.1]]
[fabric_gravity]
[output]
surface_every_windows = 1
volume_every_windows = 1
[[output.point]]
name = \"middle\"
at_m = [0.0, 0.0, 0.0]
[[output.reaction]]
name = \"payload\"
nodes = \"payload\"
[flow.grid]
";

/// End of the names of pictures of the flow around an immersed canopy.
const RECTILINEAR: &str = ".vtr";

/// Paths of the files below `folder`.
fn files(folder: &Path) -> Vec<String> {
    fn below(folder: &Path, found: &mut Vec<PathBuf>) {
        for path in std::fs::read_dir(folder).expect("a folder").flatten().map(|e| e.path()) {
            if path.is_dir() { below(&path, found) } else { found.push(path) }
        }
    }
    let mut found = Vec::new();
    below(folder, &mut found);
    found.iter().map(|p| p.strip_prefix(folder).expect("below").display().to_string()).collect()
}

fn compare(folder: &Path, tables: &[&[ResultFile]]) {
    let written = files(folder);
    let described = || tables.iter().copied().flatten();
    // The state before the last one has the files of the state.
    let current = |f: &String| f.replace("/state.old/", "/state/");
    let unknown: Vec<_> =
        written.iter().filter(|f| !described().any(|d| matches(d.path, &current(f)))).collect();
    assert!(unknown.is_empty(), "files without a description in crates/results/src/files.rs: {unknown:?}");
    // Only runs around an immersed canopy write the files of its flow.
    let of_run = tables[0].iter().filter(|d| !d.path.ends_with(RECTILINEAR));
    let missing: Vec<_> =
        of_run.filter(|d| !written.iter().any(|f| matches(d.path, f))).map(|d| d.path).collect();
    assert!(missing.is_empty(), "described files that a run with every monitor does not write: {missing:?}");
}

fn header(folder: &Path, file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join(file)).expect("a table");
    text.lines().next().expect("a header").split(',').map(str::to_owned).collect()
}

fn compare_columns(table: &[Column], folder: &Path, file: &str) {
    let names = header(folder, file);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    assert_eq!(first_difference(table, &names), None, "{file}");
}

#[test]
fn files_and_columns_of_a_run_are_those_of_the_reference() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), &[("[flow.grid]\n", MONITORS)]);
    let (out, recording) = (folder.path().join("out"), folder.path().join("recording"));
    let mut run = ripstop_run(&scene, &out, &["--stop-after-windows", "2", "--quiet", "--record"]);
    run.arg(&recording);
    succeed(run);
    compare(&out, &[RUN]);
    compare(&recording, &[RECORDING, RUN]);
    let immersed = folder.path().join("immersed");
    let scene_of_case = changed_scene("square-drop", folder.path(), &[]);
    let more = ["--set", "flow.immersed.spacing_m=0.25", "--set", "output.volume_every_windows=1"];
    succeed(ripstop_run(
        &scene_of_case,
        &immersed,
        &[&["--stop-after-windows", "1", "--quiet"], &more[..]].concat(),
    ));
    let pictures: Vec<_> = files(&immersed).into_iter().filter(|f| f.ends_with(RECTILINEAR)).collect();
    assert!(!pictures.is_empty(), "no picture of the flow around an immersed canopy");
    assert!(pictures.iter().all(|f| RUN.iter().any(|d| matches(d.path, f))), "{pictures:?}");
    let parsed = case::load(&scene).expect("a scene");
    for stage in &parsed.stages {
        assert_eq!(header(&out, &format!("{}/history.csv", stage.name)), history::names(stage.kind));
    }
    compare_columns(ITERATIONS, &out, "descent/iterations.csv");
    compare_columns(&[FORCES, FORCE_COEFFICIENTS].concat(), &out, "descent/forces.csv");
    compare_columns(PROBES, &out, "descent/probes.csv");
    compare_columns(POINTS, &out, "descent/points.csv");
    compare_columns(REACTIONS, &out, "descent/reactions.csv");
    compare_columns(PAYLOAD, &out, "descent/payload.csv");
}
