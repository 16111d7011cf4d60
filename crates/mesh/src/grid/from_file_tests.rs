//! Grids written as Gmsh files and read back; files that are wrong.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use case::{Canopy, Condition, FlatCanopy, GridFile};

use super::GridFileError as Bad;
use super::from_file::from_file;
use super::tests::flow_scene;
use crate::{
    BoxShape, FaceTable, FlowGrid, MeshError, Patch, StructureMesh, box_grid_of, flow_grid, quality,
    structure_mesh, write_msh,
};

const PATCHES: [Patch; 6] =
    [Patch::Slip, Patch::Slip, Patch::Wall, Patch::Symmetry, Patch::FarField, Patch::Outlet];

fn name(patch: Patch) -> String {
    match patch {
        Patch::FarField => "far",
        Patch::Outlet => "out",
        Patch::Wall => "wall",
        Patch::Slip => "sides",
        Patch::Symmetry => "mirror",
        Patch::Inlet => "inlet",
        Patch::Periodic => "pair",
    }
    .into()
}

fn file(path: PathBuf, patches: &[(&str, Condition)]) -> GridFile {
    let patches: BTreeMap<String, Condition> = patches.iter().map(|(n, c)| ((*n).to_owned(), *c)).collect();
    GridFile { path, membrane: "canopy".into(), one_sided: None, patches, periodic: Vec::new() }
}

const ALL: [(&str, Condition); 5] = [
    ("far", Condition::FarField),
    ("out", Condition::Outlet),
    ("wall", Condition::Wall),
    ("sides", Condition::Slip),
    ("mirror", Condition::Symmetry),
];

fn write(path: &Path, grid: &FlowGrid, binary: bool) {
    write_msh(path, grid, "canopy", |k| name(grid.boundary[k].0), binary).unwrap();
}

/// The canopy that a grid says it has, as a structure.
fn canopy_of(grid: &FlowGrid) -> StructureMesh {
    StructureMesh {
        coords: grid.canopy_nodes.iter().map(|&n| grid.coords[n as usize]).collect(),
        n_canopy: grid.canopy_nodes.len(),
        faces: grid
            .canopy_faces
            .iter()
            .map(|f| f.map(|n| grid.canopy_nodes.iter().position(|c| *c == n).unwrap() as u32))
            .collect(),
        ..StructureMesh::default()
    }
}

/// A box of tetrahedra with a membrane of triangles in the middle of its height.
fn tetrahedra() -> FlowGrid {
    let n = 4;
    let mut grid = box_grid_of(BoxShape::Tetrahedra, [n; 3], [0.0; 3], [1.0; 3], PATCHES);
    let node = |i: usize, j: usize| (i + (n + 1) * (j + (n + 1) * 2)) as u32;
    for j in 1..=3 {
        for i in 1..=3 {
            grid.canopy_nodes.push(node(i, j));
        }
    }
    for j in 1..3 {
        for i in 1..3 {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            grid.canopy_faces.extend([[a, b, c, c], [a, c, d, d]]);
        }
    }
    grid
}

fn read(grid: &FlowGrid, binary: bool) -> FlowGrid {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grid.msh");
    write(&path, grid, binary);
    let canopy = canopy_of(grid);
    from_file(&file(path, &ALL), &canopy, &canopy.coords).unwrap()
}

#[test]
fn boundary_faces_have_the_names_of_their_groups() {
    for grid in [tetrahedra(), read(&tetrahedra(), false)] {
        assert_eq!(grid.boundary_patch.len(), grid.boundary.len());
    }
    let grid = read(&tetrahedra(), true);
    for (face, (condition, _)) in grid.boundary.iter().enumerate() {
        assert_eq!(grid.patch_name(face), Some(name(*condition).as_str()), "face {face}");
    }
    assert_eq!(grid.patch_name(grid.boundary.len()), None);
}

fn sorted_volumes(grid: &FlowGrid) -> Vec<f64> {
    (0..grid.cells.len()).map(|c| quality::cell_volume(grid, c)).collect()
}

#[test]
fn gmsh_round_trip_reproduces_the_generated_grid() {
    let flat =
        FlatCanopy { width_m: 2.0, cells_across: 4, line_count: 0, line_length_m: 0.0, segments_per_line: 1 };
    let mut scene = flow_scene(Canopy::Square(flat));
    let canopy = structure_mesh(&scene).unwrap();
    let x = &canopy.coords[..canopy.n_canopy];
    let grid = flow_grid(&scene, &canopy, x).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for binary in [false, true] {
        let path = folder.path().join(format!("{binary}.msh"));
        write(&path, &grid, binary);
        let patches: Vec<_> =
            ALL.into_iter().filter(|(n, _)| grid.boundary.iter().any(|b| name(b.0) == *n)).collect();
        scene.flow.as_mut().unwrap().grid_file = Some(file(path, &patches));
        let again = flow_grid(&scene, &canopy, x).unwrap();
        // Nodes and faces to the last bit (text has all digits); prisms may be turned.
        assert_eq!(again.coords, grid.coords);
        assert_eq!(again.canopy_faces, grid.canopy_faces);
        assert_eq!(again.canopy_nodes, grid.canopy_nodes);
        assert_eq!(again.boundary.len(), grid.boundary.len());
        for (a, b) in sorted_volumes(&again).iter().zip(sorted_volumes(&grid)) {
            assert!((a - b).abs() < 1e-12 * b);
        }
        let (mine, theirs) = (FaceTable::new(&again).unwrap(), FaceTable::new(&grid).unwrap());
        assert_eq!(mine.canopy, theirs.canopy);
        let pairs = |t: &FaceTable| t.interior.iter().map(|f| (f.1, f.2)).collect::<Vec<_>>();
        let (mut a, mut b) = (pairs(&mine), pairs(&theirs));
        a.sort_unstable();
        b.sort_unstable();
        assert_eq!(a, b);
    }
}

#[test]
fn gmsh_round_trip_keeps_all_cell_types() {
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids] {
        for binary in [false, true] {
            let grid = box_grid_of(shape, [3, 2, 2], [0.0; 3], [1.0; 3], PATCHES);
            let again = read(&grid, binary);
            assert_eq!((&again.coords, &again.cells), (&grid.coords, &grid.cells), "{shape:?}");
            let faces = FaceTable::new(&again).unwrap();
            assert_eq!(faces.interior, FaceTable::new(&grid).unwrap().interior);
        }
    }
    let grid = tetrahedra();
    let again = read(&grid, true);
    assert_eq!(again.canopy_faces.len(), 8);
    let faces = FaceTable::new(&again).unwrap();
    for (cells, f) in faces.canopy.iter().zip(&again.canopy_faces) {
        let (inside, outside) = cells.both().expect("two cells");
        let z = |c: u32| quality::cell_centre(&again, c as usize)[2];
        let at = again.coords[f[0] as usize][2];
        assert!(z(inside) < at && z(outside) > at, "the normal points up");
    }
    let total: f64 = sorted_volumes(&again).iter().sum();
    assert!((total - 1.0).abs() < 1e-12);
}

/// A canopy on the boundary of the volume is read where the scene says so, and only there.
#[test]
fn canopy_with_cells_on_one_side_is_read_where_the_scene_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grid.msh");
    let patches = [PATCHES[0], PATCHES[1], PATCHES[2], PATCHES[3], Patch::FarField, Patch::Outlet];
    let named: Vec<_> = ALL.into_iter().filter(|(n, _)| *n != "far").collect();
    let sides = |one_sided: bool| GridFile {
        one_sided: one_sided.then(case::OneSided::default),
        ..file(path.clone(), &named)
    };
    for up in [false, true] {
        let grid = crate::floor_grid([3, 3, 2], [0.0; 3], [1.0; 3], patches, up);
        let canopy = canopy_of(&grid);
        write(&path, &grid, true);
        let again = from_file(&sides(true), &canopy, &canopy.coords).unwrap();
        assert!(again.one_sided && again.canopy_faces.len() == 9);
        assert!(FaceTable::new(&again).unwrap().canopy.iter().all(|c| c.inside.is_some() != up));
        match from_file(&sides(false), &canopy, &canopy.coords) {
            Err(MeshError::GridFile { source, .. }) => {
                assert!(
                    source.to_string().contains("is not between two cells; if a given pressure"),
                    "{source}"
                );
            }
            other => panic!("{other:?}"),
        }
    }
    let grid = tetrahedra();
    let canopy = canopy_of(&grid);
    write(&path, &grid, true);
    let both = GridFile { one_sided: Some(case::OneSided::default()), ..file(path.clone(), &ALL) };
    match from_file(&both, &canopy, &canopy.coords) {
        Err(MeshError::GridFile { source, .. }) => {
            assert!(source.to_string().contains("does not have a cell on one side only"), "{source}");
        }
        other => panic!("{other:?}"),
    }
}

/// What is wrong with a box of tetrahedra that `change` has spoilt.
fn refused(patches: &[(&str, Condition)], change: impl Fn(&mut FlowGrid)) -> Bad {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grid.msh");
    let mut grid = tetrahedra();
    let canopy = canopy_of(&grid);
    change(&mut grid);
    write(&path, &grid, false);
    match from_file(&file(path, patches), &canopy, &canopy.coords) {
        Err(MeshError::GridFile { source, .. }) => *source,
        other => panic!("{other:?}"),
    }
}

#[test]
fn invalid_gmsh_grids_are_rejected_with_the_cause() {
    let none = |_: &mut FlowGrid| ();
    let groups =
        |e: &Bad| matches!(e, Bad::NoSuchGroup { name, groups, .. } if name == "inlet" && groups.len() == 6);
    let with_inlet = [&ALL[..], &[("inlet", Condition::FarField)]].concat();
    assert!(groups(&refused(&with_inlet, none)));
    assert_eq!(refused(&ALL[1..], none), Bad::NoCondition { name: "far".into() });
    let e = refused(&ALL, |g| {
        g.boundary.pop();
    });
    assert!(matches!(e, Bad::NoGroup { place, .. } if (place[2] - 1.0).abs() < 1e-12), "{e}");
    let e = refused(&ALL, |g| {
        let [a, b, c, _, d, ..] = g.cells[7];
        g.cells[7] = [b, a, c, c, d, d, d, d];
    });
    assert!(
        matches!(e, Bad::Inverted { shape: "tetrahedron", cell: 7, element: 8, volume, .. } if volume < 0.0),
        "{e}"
    );
    let e = refused(&ALL, |g| {
        // A second box beside the first, with its own nodes.
        let other = box_grid_of(BoxShape::Tetrahedra, [1; 3], [2.0; 3], [3.0; 3], PATCHES);
        let first = g.coords.len() as u32;
        g.coords.extend(&other.coords);
        g.cells.extend(other.cells.iter().map(|c| c.map(|n| n + first)));
        g.boundary.extend(other.boundary.iter().map(|(p, f)| (*p, f.map(|n| n + first))));
    });
    assert!(matches!(e, Bad::Unconnected { parts: 2, place, .. } if place[0] > 2.0), "{e}");
    let e = refused(&ALL, |g| {
        let n = g.canopy_nodes[4] as usize;
        g.coords[n][2] += 0.01;
    });
    assert!(matches!(e, Bad::NoNode { node: 4, distance, .. } if (distance - 0.01).abs() < 1e-9), "{e}");
    let e = refused(&ALL, |g| {
        g.canopy_faces.pop();
        let f = g.canopy_faces[0];
        g.canopy_faces.push([f[0], f[1], f[2], f[2]]);
    });
    assert!(matches!(e, Bad::OtherFaces { common: 7, expected: 8, .. }), "{e}");
    let e = refused(&ALL, |g| {
        let inner = g.canopy_faces[0];
        g.boundary.push((Patch::Wall, inner));
    });
    assert!(matches!(&e, Bad::Misplaced { name, .. } if name == "wall"), "{e}");
    let e = refused(&ALL, |g| g.cells.clear());
    assert_eq!(e, Bad::NoVolume);
}

#[test]
fn damaged_binary_files_are_rejected_with_the_location() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grid.msh");
    let grid = tetrahedra();
    let canopy = canopy_of(&grid);
    write(&path, &grid, true);
    let good = std::fs::read(&path).unwrap();
    for cut in (0..good.len() - 20).step_by(good.len() / 60) {
        std::fs::write(&path, &good[..cut]).unwrap();
        let e = from_file(&file(path.clone(), &ALL), &canopy, &canopy.coords).expect_err("a cut file");
        assert!(matches!(e, MeshError::File { .. } | MeshError::GridFile { .. }), "{e}");
    }
}

/// Tetrahedra and pyramids five times flatter than wide are read, ten times flatter ones refused; hexahedra and prisms of any flatness are read.
#[test]
fn grids_of_flat_cells_are_refused_where_their_faces_are_far_from_orthogonal() {
    let folder = tempfile::tempdir().unwrap();
    let read = |shape: BoxShape, thickness: f64| {
        let path = folder.path().join("grid.msh");
        let grid = box_grid_of(shape, [10; 3], [0.0; 3], [1.0, 1.0, thickness], PATCHES);
        write(&path, &grid, false);
        from_file(&file(path, &ALL), &StructureMesh::default(), &[])
    };
    for (shape, thickness) in [
        (BoxShape::Hexahedra, 0.01),
        (BoxShape::Prisms, 0.01),
        (BoxShape::Pyramids, 0.2),
        (BoxShape::Tetrahedra, 0.2),
    ] {
        assert!(read(shape, thickness).is_ok(), "{shape:?}, {thickness}");
    }
    for shape in [BoxShape::Pyramids, BoxShape::Tetrahedra] {
        match read(shape, 0.1) {
            Err(MeshError::GridFile { source, .. }) => {
                assert!(
                    matches!(*source, Bad::NonOrthogonal { share, worst, .. } if share > 0.1 && worst > 78.0),
                    "{source}"
                );
                assert!(source.to_string().contains("too flat"), "{source}");
            }
            other => panic!("{shape:?}: {other:?}"),
        }
    }
}
