//! A file read back by the library that wrote it is the snapshots.

use clap::Parser;
use mesh::vtk::read::Number;
use mesh::vtk::{Series, Values, write_surface, write_volume};
use mesh::{BoxShape, Patch as Side, Point, box_grid_of};
use rust_hdf5::{H5File, H5Type};

use super::*;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: VtkhdfArgs,
}

fn run_export(run: &Path, more: &[&str]) -> Result<(), RunError> {
    let run = run.display().to_string();
    let args = Line::parse_from(["vtkhdf", &run].iter().chain(more)).args;
    export(&args, &Console::new(true))
}

/// A run without snapshots.
fn run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
    std::fs::copy(scene, folder.path().join("scene.toml")).unwrap();
    folder
}

/// A canopy of two triangles at three times: it moves after the first, and has other cells at the third.
fn canopy(stage: &Path) {
    let mut series = Series::new(stage.join("canopy.pvd"));
    for (k, time) in [0.1, 0.2, 0.3].into_iter().enumerate() {
        let z = if k == 0 { 0.0 } else { 0.5 };
        let points: Vec<Point> = vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z + 0.1]];
        let cells: &[[u32; 3]] = if k < 2 { &[[0, 1, 2], [0, 2, 3]] } else { &[[0, 1, 2]] };
        let moved: Vec<Point> = points.iter().map(|p| [0.1 / 3.0, k as f64, p[2]]).collect();
        let jump: Vec<f64> = (0..cells.len()).map(|c| 1.0 / 3.0 + (c + 10 * k) as f64).collect();
        let state: Vec<u32> = (0..cells.len() as u32).collect();
        let file = format!("canopy_{k}.vtu");
        let point = [("displacement_m", Values::Vector(&moved))];
        let cell = [("pressure_jump_pa", Values::F64(&jump)), ("wrinkling_state", Values::U32(&state))];
        write_surface(&stage.join(&file), &points, cells, &point, &cell).unwrap();
        series.push(time, &[file]).unwrap();
    }
}

/// A grid at rest in two parts of different cells, at two times.
fn flow(stage: &Path) {
    let mut series = Series::new(stage.join("flow.pvd"));
    for (k, time) in [0.0, 0.25].into_iter().enumerate() {
        let mut files = Vec::new();
        for (rank, shape) in [BoxShape::Hexahedra, BoxShape::Tetrahedra].into_iter().enumerate() {
            let left = 2.0 * rank as f64;
            let grid = box_grid_of(shape, [2; 3], [left, 0.0, 0.0], [left + 2.0, 2.0, 2.0], [Side::Wall; 6]);
            let speed: Vec<[f32; 3]> =
                (0..grid.cells.len()).map(|c| [c as f32, rank as f32, k as f32 + 0.1]).collect();
            files.push(format!("flow/flow_{k:05}_{rank}.vtu"));
            let path = stage.join(&files[rank]);
            let fields = [("velocity_frame_m_s", Values::Vector32(&speed))];
            write_volume(&path, &grid.coords, &grid.cells, &[], &fields).unwrap();
        }
        series.push(time, &files).unwrap();
    }
}

fn read<T: H5Type>(file: &H5File, name: &str) -> Vec<T> {
    file.dataset(&format!("VTKHDF/{name}")).unwrap().read_raw::<T>().unwrap()
}

/// Compares all steps of a file with the snapshots of a series; returns how often cells and positions were written.
fn compare(run: &Path, file: &Path, series: &Path) -> [usize; 2] {
    let file = H5File::open(file).unwrap();
    let snapshots = mesh::vtk::read::snapshots(&run.join(series)).unwrap();
    let whole = |name: &str| read::<i64>(&file, name);
    let times: Vec<f64> = snapshots.iter().map(|s| s.time).collect();
    assert_eq!(read::<f64>(&file, "Steps/Values"), times);
    let (parts_of, parts) = (whole("Steps/PartOffsets"), whole("Steps/NumberOfParts"));
    let [point, cell, node] =
        ["Point", "Cell", "ConnectivityId"].map(|n| whole(&format!("Steps/{n}Offsets")));
    let [points, cells, nodes] =
        ["Points", "Cells", "ConnectivityIds"].map(|n| whole(&format!("NumberOf{n}")));
    let (x, connectivity) = (read::<f64>(&file, "Points"), whole("Connectivity"));
    let (offsets, types) = (whole("Offsets"), read::<u8>(&file, "Types"));
    for (k, snapshot) in snapshots.iter().enumerate() {
        assert_eq!(parts[k] as usize, snapshot.files.len());
        let mut at = [point[k], cell[k], node[k]].map(|n| n as usize);
        let mut data = [0, 0];
        for (i, path) in snapshot.files.iter().enumerate() {
            let piece = Piece::read(path).unwrap();
            let part = parts_of[k] as usize + i;
            let n = [points[part], cells[part], nodes[part]].map(|n| n as usize);
            assert_eq!(&x[3 * at[0]..3 * (at[0] + n[0])], piece.points.as_flattened());
            let ends = &offsets[at[1] + part..][..n[1] + 1];
            assert_eq!((ends[0], n[1]), (0, piece.n_cells()));
            for (c, end) in ends.windows(2).enumerate() {
                let found = &connectivity[at[2] + end[0] as usize..at[2] + end[1] as usize];
                assert!(found.iter().zip(piece.cell(c)).all(|(a, b)| *a == i64::from(*b)));
                assert_eq!(types[at[1] + c], piece.vtk_type(c));
            }
            for (which, kind, fields) in [(0, "Point", &piece.point_fields), (1, "Cell", &piece.cell_fields)]
            {
                for field in fields {
                    let begin =
                        whole(&format!("Steps/{kind}DataOffsets/{}", field.name))[k] as usize + data[which];
                    let name = format!("{kind}Data/{}", field.name);
                    let found: Vec<f64> = match field.number {
                        Number::F64 => read::<f64>(&file, &name),
                        Number::F32 => read::<f32>(&file, &name).into_iter().map(f64::from).collect(),
                        Number::U32 => read::<u32>(&file, &name).into_iter().map(f64::from).collect(),
                    };
                    let from = begin * field.width;
                    assert_eq!(found[from..from + field.values.len()], field.values, "{} {k}", field.name);
                }
            }
            at = [0, 1, 2].map(|c| at[c] + n[c]);
            data = [0, 1].map(|c| data[c] + n[c]);
        }
    }
    let different = |mut v: Vec<i64>| {
        v.dedup();
        v.len()
    };
    [different(cell), different(point)]
}

#[test]
fn file_holds_what_the_snapshots_hold() {
    let run = run();
    let run = run.path();
    let stage = run.join("descent");
    canopy(&stage);
    flow(&stage);
    run_export(run, &[]).unwrap();
    let written = compare(run, &run.join("export/descent-canopy.vtkhdf"), Path::new("descent/canopy.pvd"));
    assert_eq!(written, [2, 2], "cells and positions that do not change are written once");
    run_export(run, &["--what", "flow"]).unwrap();
    let file = run.join("export/descent-flow.vtkhdf");
    assert_eq!(compare(run, &file, Path::new("descent/flow.pvd")), [1, 1]);
    // The format as VTK asks for it.
    let file = H5File::open(&file).unwrap();
    let root = file.root_group().group("VTKHDF").unwrap();
    assert_eq!(root.attr_string("Type").unwrap(), "UnstructuredGrid");
    assert_eq!(root.group_names().unwrap().len(), 3);
    // The same input, the same bytes.
    let bytes = || std::fs::read(run.join("export/descent-canopy.vtkhdf")).unwrap();
    let before = bytes();
    run_export(run, &[]).unwrap();
    assert!(before == bytes());
}

#[test]
fn fields_times_and_a_box_are_chosen() {
    let run = run();
    let run = run.path();
    canopy(&run.join("descent"));
    flow(&run.join("descent"));
    let out = run.join("some/where.vtkhdf");
    let name = out.display().to_string();
    let open = |more: &[&str]| {
        run_export(run, &[&["--out", &name], more].concat()).unwrap();
        H5File::open(&out).unwrap()
    };
    let file = open(&["--from", "0.2", "--fields", "wrinkling_state"]);
    assert_eq!(read::<f64>(&file, "Steps/Values"), [0.2, 0.3]);
    let groups = file.root_group().group("VTKHDF").unwrap();
    let fields = |name: &str| groups.group(name).unwrap().dataset_names().unwrap().len();
    assert_eq!((fields("PointData"), fields("CellData")), (0, 1));
    let file = open(&["--every", "2", "--to", "0.3"]);
    assert_eq!(read::<f64>(&file, "Steps/Values"), [0.1, 0.3]);
    // One cell of the first part, and the tetrahedra of one of the second.
    let file = open(&["--what", "flow", "--box", "1,0,0,3,1,1"]);
    assert_eq!(read::<i64>(&file, "NumberOfCells"), [1, 6]);
    assert_eq!(read::<f32>(&file, "CellData/velocity_frame_m_s").len(), 3 * 2 * 7);
}

#[test]
fn what_cannot_be_exported_is_named() {
    let run = run();
    let run = run.path();
    let says = |more: &[&str], words: &[&str]| {
        let error = run_export(run, more).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{error}");
        for word in words {
            assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
        }
    };
    says(&[], &["canopy.pvd", "output.surface_every_windows"]);
    says(&["--what", "flow", "--stage", "descent"], &["stage `descent`", "output.volume_every_windows"]);
    canopy(&run.join("descent"));
    says(&["--stage", "pre-inflation"], &["`pre-inflation`", "Stages that have some: `descent`"]);
    says(&["--stage", "landing"], &["`landing`", "`developed-flow`"]);
    says(&["--from", "0.31"], &["from 0.1 s to 0.3 s"]);
    says(&["--fields", "displacement_m,mach"], &["`mach`", "pressure_jump_pa"]);
    says(&["--box", "5,5,5,6,6,6"], &["--box", "0.000,0.000,0.000,1.000"]);
    let kept = run.join("thesis.txt");
    std::fs::write(&kept, "years of work").unwrap();
    says(&["--out", &kept.display().to_string()], &["thesis.txt", "not replaced"]);
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), "years of work");
    std::fs::write(run.join("descent/canopy_2.vtu"), "<VTKFile").unwrap();
    says(&[], &["canopy_2.vtu"]);
    // Nothing unfinished is left.
    let files = std::fs::read_dir(run.join("export")).unwrap().count();
    assert_eq!(files, 0);
    // A field that a later snapshot lacks.
    let (points, cells) = ([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]]);
    write_surface(&run.join("descent/canopy_2.vtu"), &points, &cells, &[], &[]).unwrap();
    says(&[], &["t = 0.3 s", "`displacement_m`", "--fields"]);
}
