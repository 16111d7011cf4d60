use case::{Atps, Canopy, Scene};

use super::inflate::inflate;
use crate::quality::{self, norm, sub};
use crate::structure::tests::scene;
use crate::{FaceTable, MeshError, StructureMesh, Vec3, flow_grid, structure_mesh};

pub(crate) fn flow_scene(canopy: Canopy) -> Scene {
    let mut scene = scene(canopy);
    scene.flow = Some(case::Flow {
        density_kg_m3: 1.225,
        temperature_k: 288.15,
        wind_m_s: [0.0; 3],
        viscosity: None,
        energy: None,
        limiter: None,
        grid: Default::default(),
        solver: Default::default(),
    });
    scene
}

fn inflated(canopy: Canopy, pressure: f64) -> (Scene, StructureMesh, Vec<Vec3>) {
    let scene = flow_scene(canopy);
    let mesh = structure_mesh(&scene).unwrap();
    let x = inflate(&mesh, pressure, 5e-4, 2000);
    (scene, mesh, x)
}

/// What every grid must be: closed, around the canopy exactly, canopy first.
fn check(mesh: &StructureMesh, x: &[Vec3], grid: &crate::FlowGrid) -> FaceTable {
    assert_eq!(&grid.coords[..x.len()], x);
    assert_eq!(grid.canopy_faces, mesh.faces);
    assert!(grid.canopy_nodes.iter().copied().eq(0..x.len() as u32));
    let used: std::collections::HashSet<u32> = grid.cells.iter().flatten().copied().collect();
    assert_eq!(used.len(), grid.coords.len(), "nodes without cells");
    let faces = FaceTable::new(grid).unwrap();
    assert_eq!(faces.canopy.len(), mesh.faces.len());
    faces
}

#[test]
fn atps_default() {
    let (scene, mesh, x) = inflated(Canopy::Atps(Atps::default()), 14.567);
    let grid = flow_grid(&scene, &mesh, &x).unwrap();
    assert!((40_000..=60_000).contains(&grid.cells.len()), "{} cells", grid.cells.len());
    let faces = check(&mesh, &x, &grid);
    let summary = quality::summary(&grid);
    assert!(summary.min_scaled_jacobian > 0.3, "{summary:?}");
    // The first layers have about the thickness asked for.
    for &(inside, outside) in &faces.canopy {
        for cell in [inside, outside] {
            let cell = &grid.cells[cell as usize];
            let length =
                |i: usize| norm(sub(grid.coords[cell[i] as usize], grid.coords[cell[i + 4] as usize]));
            let mean = (0..4).map(length).sum::<f64>() / 4.0;
            assert!((0.06..0.2).contains(&mean), "first layer {mean}");
        }
    }
    // Same bits on every call.
    assert_eq!(grid, flow_grid(&scene, &mesh, &x).unwrap());
}

#[test]
fn closed_vents_are_refused() {
    let scene = flow_scene(Canopy::Atps(Atps::default()));
    let mesh = structure_mesh(&scene).unwrap();
    let error = flow_grid(&scene, &mesh, &mesh.coords[..mesh.n_canopy]).unwrap_err();
    assert!(matches!(error, MeshError::VentsClosed { width_m: 0.0, .. }));
    assert!(error.to_string().contains("pre-inflation"));
}
