use case::{Atps, Canopy, FlatCanopy, Scene, StitchedEnd};

use super::inflate::inflate;
use crate::geometry::{Point, at, quad_area_vector};
use crate::quality;
use crate::structure::tests::scene;
use crate::{FaceTable, MeshError, StructureMesh, flow_grid, structure_mesh};

pub(crate) fn flow_scene(canopy: Canopy) -> Scene {
    let mut scene = scene(canopy);
    scene.flow = Some(case::Flow {
        altitude_m: None,
        density_kg_m3: 1.225,
        temperature_k: 288.15,
        wind_m_s: [0.0; 3],
        gust: None,
        shear: None,
        viscosity: None,
        energy: None,
        body_force_n_m3: None,
        convection: case::Convection::default(),
        limiter: None,
        grid: Default::default(),
        grid_file: None,
        box_grid: None,
        immersed: None,
        inlets: Vec::new(),
        outlets: Vec::new(),
        moving_walls: Vec::new(),
        solver: Default::default(),
        probes: Vec::new(),
        statistics: None,
        forces: None,
        slices: Vec::new(),
        surface_pressure: None,
    });
    scene
}

fn inflated(canopy: Canopy, pressure: f64) -> (Scene, StructureMesh, Vec<Point>) {
    let scene = flow_scene(canopy);
    let mesh = structure_mesh(&scene).unwrap();
    let x = inflate(&mesh, pressure, 5e-4, 2000);
    (scene, mesh, x)
}

/// What every grid must be: closed, around the canopy exactly, canopy first.
fn check(mesh: &StructureMesh, x: &[Point], grid: &crate::FlowGrid) -> FaceTable {
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
    for (inside, outside) in faces.canopy.iter().map(|c| c.both().expect("two cells")) {
        for cell in [inside, outside] {
            let cell = &grid.cells[cell as usize];
            let length = |i: usize| (at(&grid.coords, cell[i]) - at(&grid.coords, cell[i + 4])).norm();
            let mean = (0..4).map(length).sum::<f64>() / 4.0;
            assert!((0.06..0.2).contains(&mean), "first layer {mean}");
        }
    }
    // Same bits on every call.
    assert_eq!(grid, flow_grid(&scene, &mesh, &x).unwrap());
}

/// Air passes from inside to outside through the vents and the mouth only.
#[test]
fn vents_are_open() {
    let (scene, mesh, x) = inflated(Canopy::Atps(Atps::default()), 14.567);
    let grid = flow_grid(&scene, &mesh, &x).unwrap();
    let faces = check(&mesh, &x, &grid);
    let (blocks, _) = super::blocks(&scene, &Default::default(), &mesh).unwrap();
    // Faces on the surface that are not canopy: vents, skirt and cap.
    let on_surface = |f: &[u32; 4]| f.iter().all(|&n| (n as usize) < blocks.surface);
    let open: Vec<_> = faces.interior.iter().filter(|f| on_surface(&f.0)).collect();
    assert_eq!(open.len(), blocks.quads.len() - mesh.faces.len());
    let between_arms = |f: &[u32; 4]| f.iter().any(|&n| n as usize >= blocks.surface - 4 * 8);
    let vents: Vec<_> = open.iter().filter(|f| between_arms(&f.0)).collect();
    assert_eq!(vents.len(), 4 * 9 * 2);
    let area: f64 = vents.iter().map(|f| quad_area_vector(f.0.map(|n| at(&grid.coords, n))).norm()).sum();
    // Four lenses about 3 m high and 1 m wide.
    assert!((4.0..10.0).contains(&area), "{area} m2");
}

#[test]
fn closed_vents_are_rejected() {
    let scene = flow_scene(Canopy::Atps(Atps::default()));
    let mesh = structure_mesh(&scene).unwrap();
    let error = flow_grid(&scene, &mesh, &mesh.coords[..mesh.n_canopy]).unwrap_err();
    assert!(matches!(error, MeshError::VentsClosed { width_m: 0.0, .. }));
    assert!(error.to_string().contains("pre-inflation"));
}

#[test]
fn atps_at_other_resolutions() {
    for (across, vent, stitch, zip, pressure) in
        [(8, 4, 1, 1, 20.4), (12, 5, 3, 3, 8.0), (30, 15, 3, 4, 14.567)]
    {
        let atps = Atps {
            cells_across: across,
            cells_along_vent: vent,
            cells_along_stitching: stitch,
            ..Default::default()
        };
        let (mut scene, mesh, x) = inflated(Canopy::Atps(atps), pressure);
        scene.flow.as_mut().unwrap().grid.cells_across_vent = zip;
        let grid = flow_grid(&scene, &mesh, &x).unwrap();
        check(&mesh, &x, &grid);
        let summary = quality::summary(&grid);
        assert!(summary.min_scaled_jacobian > 0.25, "{across}: {summary:?}");
    }
}

#[test]
fn atps_stitched_at_the_top() {
    let atps = Atps { stitched_end: StitchedEnd::Top, ..Default::default() };
    let (scene, mesh, x) = inflated(Canopy::Atps(atps), 14.567);
    let grid = flow_grid(&scene, &mesh, &x).unwrap();
    check(&mesh, &x, &grid);
    let summary = quality::summary(&grid);
    assert!(summary.min_scaled_jacobian > 0.1, "{summary:?}");
}

/// Nodes pushed about by a third of a cell, as wrinkles do.
#[test]
fn wrinkled_canopies_are_repaired() {
    let (scene, mesh, mut x) = inflated(Canopy::Atps(Atps::default()), 14.567);
    let mut seed = 1u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    };
    for p in &mut x {
        p.iter_mut().for_each(|v| *v += 0.2 * random());
    }
    let grid = flow_grid(&scene, &mesh, &x).unwrap();
    check(&mesh, &x, &grid);
}

fn flat(cells: u32, lines: u32) -> FlatCanopy {
    FlatCanopy {
        width_m: 6.0,
        cells_across: cells,
        line_count: lines,
        line_length_m: 8.0,
        segments_per_line: 1,
    }
}

#[test]
fn flat_sheets_and_domes() {
    for (canopy, least) in [(Canopy::Square(flat(12, 0)), 0.1), (Canopy::Circular(flat(18, 0)), 0.2)] {
        let scene = flow_scene(canopy);
        let mesh = structure_mesh(&scene).unwrap();
        for angle in [0.0, 45.0f64, 90.0] {
            // Bent over a sphere along its radii: up to a hemisphere on the disc.
            let ball = 3.0 / angle.to_radians().max(1e-6);
            let bend = |p: &Point| {
                let r = p[0].hypot(p[1]);
                let s = if r > 0.0 { ball * (r / ball).sin() / r } else { 1.0 };
                [s * p[0], s * p[1], ball * ((r / ball).cos() - 1.0)]
            };
            // The square's corners would bend round to its middle.
            let angle_of_corner =
                if matches!(scene.canopy, Canopy::Square(_)) { angle * 1.42 } else { angle };
            if angle_of_corner > 91.0 {
                continue;
            }
            let x: Vec<Point> = mesh.coords[..mesh.n_canopy].iter().map(bend).collect();
            let grid = flow_grid(&scene, &mesh, &x).unwrap();
            check(&mesh, &x, &grid);
            let summary = quality::summary(&grid);
            assert!(summary.min_scaled_jacobian > least, "{angle} degrees: {summary:?}");
        }
    }
}

#[test]
fn inflated_flat_canopies() {
    for canopy in [Canopy::Square(flat(12, 8)), Canopy::Circular(flat(18, 16))] {
        let (scene, mesh, x) = inflated(canopy, 5.0);
        check(&mesh, &x, &flow_grid(&scene, &mesh, &x).unwrap());
    }
}

#[test]
fn unsupported_canopies_are_rejected() {
    let refused = |scene: &Scene| {
        let mesh = structure_mesh(scene).unwrap();
        let error = flow_grid(scene, &mesh, &mesh.coords[..mesh.n_canopy]).unwrap_err();
        let MeshError::Parameter { key, .. } = error else { panic!("{error}") };
        key
    };
    assert_eq!(refused(&flow_scene(Canopy::AirBag(Default::default()))), "canopy.kind");
    assert_eq!(refused(&scene(Canopy::Atps(Atps::default()))), "flow");
    let mut thick = flow_scene(Canopy::Square(flat(4, 0)));
    thick.flow.as_mut().unwrap().grid.first_layer_m = 5.0;
    assert_eq!(refused(&thick), "flow.grid.first_layer_m");
    let scene = flow_scene(Canopy::Square(flat(4, 0)));
    let mesh = structure_mesh(&scene).unwrap();
    assert!(matches!(flow_grid(&scene, &mesh, &[[0.0; 3]; 3]), Err(MeshError::Count { found: 3, .. })));
    let mut x = mesh.coords.clone();
    x[7][1] = f64::NAN;
    assert!(flow_grid(&scene, &mesh, &x).unwrap_err().to_string().contains("node 7"));
    // Turned inside out, no smoothing can help: an error, not a bad grid.
    let folded: Vec<Point> = mesh.coords.iter().map(|p| [p[0].abs(), p[1], p[2]]).collect();
    assert!(matches!(flow_grid(&scene, &mesh, &folded), Err(MeshError::Tangled { .. })));
}
