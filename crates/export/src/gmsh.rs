//! `ripstop export gmsh`: the canopy at the end of a stage as a surface for Gmsh, to draw a flow grid around a deformed start.

use std::path::PathBuf;

use case::{Role, StageKind};
use clap::Args;
use coupling::error::RunError;
use figures::snapshots::RunSnapshots;
use mesh::{FlowGrid, Point, StructureMesh};
use terminal::{Console, counted};

/// Arguments of `ripstop export gmsh`.
#[derive(Args)]
pub struct GmshArgs {
    /// Results folder of a run
    run: PathBuf,
    /// Stage at whose end the canopy has the exported shape [default: the last one with a saved state of the structure]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Folder of the files, which are replaced [default: RUN/export/STAGE-gmsh]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Writes `canopy.msh`, the canopy as a surface of triangles in the physical group `canopy`, and `air.geo`, a Gmsh script that fills a box around it
/// with tetrahedra.
///
/// # Errors
/// The run has no saved shape of the canopy; the canopy has faces that are no triangles; a file that cannot be written.
pub fn export(args: &GmshArgs, console: &Console) -> Result<(), RunError> {
    let run = RunSnapshots::open(&args.run)?;
    let scene = &run.scene;
    let input = |e: mesh::MeshError| RunError::Input(e.to_string());
    let stage = stage(args, &run)?;
    let mesh = mesh::structure_mesh(scene).map_err(input)?;
    triangles_alone(&mesh)?;
    let shape = case::canopy_file(&case::state_folder(&args.run, scene, stage));
    let positions = mesh::load_shape(&shape, mesh.n_canopy).map_err(input)?;
    let name = &scene.stages[stage].name;
    let folder = args.out.clone().unwrap_or_else(|| args.run.join("export").join(format!("{name}-gmsh")));
    std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
    let (surface, script) = (folder.join("canopy.msh"), folder.join("air.geo"));
    let text = air(&positions, &mesh);
    let grid = FlowGrid { coords: positions, canopy_faces: mesh.faces, ..FlowGrid::default() };
    mesh::write_msh(&surface, &grid, "canopy", |_| String::new(), false).map_err(input)?;
    std::fs::write(&script, text).map_err(RunError::file("write", &script))?;
    let faces = counted(grid.canopy_faces.len() as u64, "triangle");
    console.line(&format!("{}: canopy at the end of stage `{name}`, {faces}", surface.display()));
    console.line(&format!(
        "{}: air around it; `gmsh -3 air.geo -o air.msh` there makes the grid",
        script.display()
    ));
    Ok(())
}

/// The stage that `--stage` names, else the last with a saved state of the structure.
fn stage(args: &GmshArgs, run: &RunSnapshots) -> Result<usize, RunError> {
    let stages = &run.scene.stages;
    let saved = |k: &usize| case::canopy_file(&case::state_folder(&args.run, &run.scene, *k)).is_file();
    let has: Vec<usize> = (0..stages.len()).filter(saved).collect();
    let names = || has.iter().map(|k| stages[*k].name.as_str()).collect::<Vec<_>>().join(", ");
    match &args.stage {
        None => has.last().copied().ok_or_else(|| {
            let structure = |k: &StageKind| k.roles().contains(&Role::Structure);
            let never = !stages.iter().any(|s| structure(&s.kind));
            let why = if never {
                "the scene has no stage with the structure"
            } else {
                "no stage with the structure has ended"
            };
            RunError::Input(format!("{} has no saved shape of the canopy: {why}", args.run.display()))
        }),
        Some(name) => match stages.iter().position(|s| s.name == *name) {
            Some(k) if has.contains(&k) => Ok(k),
            _ => Err(RunError::Input(format!(
                "there is no saved shape of the canopy for stage `{name}`; stages that have one: {}",
                if has.is_empty() { "none".into() } else { names() }
            ))),
        },
    }
}

/// Refuses canopies that cannot be the wall of tetrahedra.
fn triangles_alone(mesh: &StructureMesh) -> Result<(), RunError> {
    let quadrilaterals = mesh.faces.iter().filter(|f| f[2] != f[3]).count();
    if mesh.faces.is_empty() || quadrilaterals > 0 {
        let what = match quadrilaterals {
            0 => "the canopy has no fabric".to_owned(),
            n => format!(
                "the canopy has {} among {} faces",
                counted(n as u64, "quadrilateral"),
                mesh.faces.len()
            ),
        };
        return Err(RunError::Input(format!(
            "{what}, and tetrahedra need triangles: use a pattern, or a canopy of kind \"gmsh\" with triangles; the grids that \
             Ripstop generates fit a deformed start without a file"
        )));
    }
    Ok(())
}

/// Lowest and highest coordinates, m.
fn bounds(positions: &[Point]) -> [Point; 2] {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for x in positions {
        for d in 0..3 {
            bounds[0][d] = bounds[0][d].min(x[d]);
            bounds[1][d] = bounds[1][d].max(x[d]);
        }
    }
    bounds
}

/// Mean length of the edges of all faces, m.
fn mean_edge(positions: &[Point], mesh: &StructureMesh) -> f64 {
    let length = |[a, b]: [u32; 2]| {
        let [a, b] = [a, b].map(|n| positions[n as usize]);
        (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt()
    };
    let edges = mesh.faces.iter().flat_map(|f| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]]);
    edges.map(length).sum::<f64>() / (3 * mesh.faces.len()) as f64
}

/// The Gmsh script: a box of air with the surface in it.
fn air(positions: &[Point], mesh: &StructureMesh) -> String {
    let [low, high] = bounds(positions);
    let size = (0..2).map(|d| high[d] - low[d]).fold(0.0, f64::max);
    let [x, y] = [0, 1].map(|d| 0.5 * (low[d] + high[d]));
    format!(
        "// Air around the canopy that `ripstop export gmsh` has written, for a stream along +z: gmsh -3 air.geo -o air.msh\n\
         // Change the numbers to your needs; the names of the groups are those of [flow.grid_file.patches].\n\
         Merge \"canopy.msh\";\n\
         side = {side:.6}; // m, from the middle to a side\n\
         bottom = {bottom:.6}; // m, the inflow\n\
         top = {top:.6}; // m, the outlet\n\
         far = {far:.6}; // m, size of the outer cells; those at the canopy have the size of its triangles, {edge:.4} m\n\
         x = {x:.6}; y = {y:.6};\n\
         Point(1) = {{x - side, y - side, bottom, far}};\n\
         Point(2) = {{x + side, y - side, bottom, far}};\n\
         Point(3) = {{x + side, y + side, bottom, far}};\n\
         Point(4) = {{x - side, y + side, bottom, far}};\n\
         Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};\n\
         Curve Loop(1) = {{1, 2, 3, 4}};\n\
         Plane Surface(101) = {{1}};\n\
         air[] = Extrude {{0, 0, top - bottom}} {{ Surface{{101}}; }};\n\
         Surface{{1}} In Volume{{air[1]}};\n\
         Physical Volume(\"air\") = {{air[1]}};\n\
         Physical Surface(\"canopy\") = {{1}};\n\
         Physical Surface(\"outlet\") = {{air[0]}};\n\
         Physical Surface(\"outer air\") = {{101, air[2], air[3], air[4], air[5]}};\n\
         Mesh.MshFileVersion = 4.1;\n\
         Mesh.MeshSizeExtendFromBoundary = 1;\n",
        side = 4.0 * size,
        bottom = low[2] - 4.0 * size,
        top = high[2] + 8.0 * size,
        far = 0.8 * size,
        edge = mean_edge(positions, mesh),
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A tetrahedron's worth of bent fabric.
    fn bent() -> (Vec<Point>, StructureMesh) {
        let positions = vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.5], [0.0, 2.0, 1.0 / 3.0]];
        let faces = vec![[0, 1, 2, 2], [0, 2, 3, 3]];
        (positions, StructureMesh { n_canopy: 4, faces, ..StructureMesh::default() })
    }

    /// Exports from a folder of results whose stage `shape` ended with the canopy at a place that no decimal fraction has.
    #[test]
    fn the_saved_shape_is_written_to_the_last_digit() {
        let folder = tempfile::tempdir().expect("a folder");
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/plate-gmsh");
        std::fs::copy(case.join("plate.msh"), folder.path().join("plate.msh")).expect("a copy");
        let text = std::fs::read_to_string(case.join("scene.toml")).expect("a scene");
        let shape = "[[stage]]\nname = \"shape\"\nkind = \"pre-inflation\"\npressure_pa = 1.0\nsolve = \"static\"\n\n[[stage]]";
        std::fs::write(folder.path().join("scene.toml"), text.replacen("[[stage]]", shape, 1))
            .expect("written");
        let args = |stage: Option<&str>| GmshArgs {
            run: folder.path().into(),
            stage: stage.map(String::from),
            out: None,
        };
        let quiet = Console::new(true);
        let none = export(&args(None), &quiet).expect_err("no state").to_string();
        assert!(none.contains("no stage with the structure has ended"), "{none}");

        let scene = case::load(&folder.path().join("scene.toml")).expect("a scene");
        let mesh = mesh::structure_mesh(&scene).expect("a mesh");
        let moved = |x: &Point| [x[0] / 3.0, x[1], x[2] + (x[0] * x[1]).sin()];
        let positions: Vec<Point> = mesh.coords[..mesh.n_canopy].iter().map(moved).collect();
        let state = case::state_folder(folder.path(), &scene, 0);
        std::fs::create_dir_all(&state).expect("a folder");
        mesh::save_shape(&case::canopy_file(&state), &positions).expect("saved");
        export(&args(None), &quiet).expect("exported");
        let wrong = export(&args(Some("start")), &quiet).expect_err("no state").to_string();
        assert!(wrong.contains("stages that have one: shape"), "{wrong}");

        let text =
            std::fs::read_to_string(folder.path().join("export/shape-gmsh/canopy.msh")).expect("a file");
        assert!(text.contains("$PhysicalNames\n1\n2 1 \"canopy\"\n"));
        let block = |name: &str| {
            let (_, rest) = text.split_once(&format!("${name}\n")).expect("a block");
            let numbers = |l: &str| l.split_whitespace().map(|v| v.parse().expect("a number")).collect();
            rest.lines().take_while(|l| !l.starts_with('$')).map(numbers).collect::<Vec<Vec<f64>>>()
        };
        assert_eq!(block("Entities")[0], [0.0, 0.0, 1.0, 0.0]);
        let nodes = block("Nodes");
        assert_eq!(nodes[2 + positions.len()..], positions.iter().map(|x| x.to_vec()).collect::<Vec<_>>());
        let face = |f: &[u32; 4]| f[..3].iter().map(|n| f64::from(n + 1)).collect::<Vec<_>>();
        let triangles: Vec<_> = block("Elements")[2..].iter().map(|e| e[1..].to_vec()).collect();
        assert_eq!(triangles, mesh.faces.iter().map(face).collect::<Vec<_>>());
    }

    #[test]
    fn the_box_of_air_is_around_the_canopy() {
        let (positions, mesh) = bent();
        let text = air(&positions, &mesh);
        for line in
            ["side = 8.000000;", "bottom = -8.000000;", "top = 16.500000;", "x = 1.000000; y = 1.000000;"]
        {
            assert!(text.contains(line), "{line}\n{text}");
        }
    }

    #[test]
    fn quadrilaterals_are_refused() {
        let (_, mut mesh) = bent();
        assert!(triangles_alone(&mesh).is_ok());
        mesh.faces.push([0, 1, 2, 3]);
        let error = triangles_alone(&mesh).expect_err("a quadrilateral").to_string();
        assert!(error.contains("1 quadrilateral among 3 faces"), "{error}");
        mesh.faces.clear();
        assert!(triangles_alone(&mesh).expect_err("nothing").to_string().contains("no fabric"));
    }
}
