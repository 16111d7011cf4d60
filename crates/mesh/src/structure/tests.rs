use std::collections::HashMap;

use case::*;

use crate::geometry::{Point, Vec3, at, triangle_area_vector};
use crate::{CableKind, MeshError, StructureMesh, structure_mesh};

fn cloth() -> Fabric {
    Fabric {
        material: None,
        law: case::Law::default(),
        youngs_modulus_pa: 9.5648e6,
        poisson_ratio: 0.3,
        thickness_m: 3.048e-5,
        density_kg_m3: 1223.5093,
        strength_n_m: None,
        safety_factor: None,
        retardation_time_s: 0.0,
        wrinkling: true,
        prestress_pa: 0.0,
        bending_stiffness_n_m: None,
        hysteresis: None,
        orthotropic: None,
        permeability: None,
        contact: None,
    }
}

pub(crate) fn scene(canopy: Canopy) -> Scene {
    Scene {
        name: "test".into(),
        title: String::new(),
        canopy,
        fabric: cloth(),
        lines: Some(Lines {
            material: None,
            youngs_modulus_pa: 5.342e8,
            area_m2: 3.11e-6,
            density_kg_m3: 1223.50932,
            strength_n: None,
            safety_factor: None,
            retardation_time_s: 0.0,
            hysteresis: None,
            tension_only: true,
            prestress_pa: 0.0,
            drag: None,
        }),
        risers: None,
        tapes: None,
        structure: Structure::default(),
        flow: None,
        mesh: MeshMotion::default(),
        coupling: Coupling::default(),
        descent: Some(Descent {
            equation: case::DescentEquation::default(),
            payload_mass_kg: 100.6975,
            initial_speed_m_s: 4.8768,
            initial_drift_m_s: [0.0; 2],
            motion: None,
            release_height_m: None,
            gravity_m_s2: 9.80665,
            reference_area_m2: 41.3614,
            payload_drag: None,
            body: None,
        }),
        fabric_gravity: None,
        reefing: Vec::new(),
        point_masses: Vec::new(),
        stages: Vec::new(),
        output: Output::default(),
        ranks: Ranks::default(),
        programs: Default::default(),
        accuracy: None,
    }
}

fn atps(change: impl FnOnce(&mut Atps)) -> StructureMesh {
    let mut p = Atps::default();
    change(&mut p);
    structure_mesh(&scene(Canopy::Atps(p))).unwrap()
}

/// Equal to the digits given: five.
fn close(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-5 * expected.abs(), "{value} is not {expected}");
}

/// Volume below the fabric, closed by the plane of the hem: divergence theorem
/// with the field (x/2, y/2, 0) that the two flat planes do not see.
fn enclosed(mesh: &StructureMesh) -> f64 {
    let flux = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|n| at(&mesh.coords, n));
        let area = triangle_area_vector([a, b, c]);
        (0..2).map(|i| (a[i] + b[i] + c[i]) / 3.0 * area[i] / 2.0).sum::<f64>()
    };
    mesh.triangles.iter().map(flux).sum()
}

#[test]
fn atps_totals() {
    let mesh = atps(|_| {});
    close(mesh.fabric_area(|_| true), 139.874);
    close(mesh.fabric_area(|p| p == 0), 41.361);
    close(mesh.fabric_area(|p| p > 0), 98.513);
    let scene = scene(Canopy::Atps(Atps::default()));
    let (fabric, lines) = (scene.fabric, scene.lines.unwrap());
    let fabric_kg = mesh.fabric_area(|_| true) * fabric.thickness_m * fabric.density_kg_m3;
    let cable_m = mesh.cable_length(CableKind::SuspensionLine) + mesh.cable_length(CableKind::Riser);
    let cable_kg = cable_m * lines.area_m2 * lines.density_kg_m3;
    assert!((fabric_kg - 5.216).abs() < 5e-4 && (cable_kg - 0.701).abs() < 5e-4, "{fabric_kg} {cable_kg}");
    assert!((fabric_kg + cable_kg + mesh.point_masses[0].1 - 106.614).abs() < 1e-3);
    // The cut parts coincide, so the open mesh encloses the box.
    assert!((enclosed(&mesh) - 154.2).abs() < 0.05, "{}", enclosed(&mesh));
}

#[test]
fn atps_lines() {
    for segments in [1, 4] {
        let mesh = atps(|p| p.segments_per_line = segments);
        let payload = mesh.fixed[0].0 as usize;
        let near =
            |x: Point, y: Point| assert!((Vec3::from(x) - Vec3::from(y)).norm() < 1e-5, "{x:?} is not {y:?}");
        near(mesh.coords[payload], [0.0, 0.0, -10.06028]);
        near(mesh.coords[payload + 1], [0.54268, 0.0, -8.96852]);
        near(mesh.coords[payload + 2], [0.0, 0.54268, -8.96852]);
        assert_eq!(mesh.cables.len(), 28 * segments as usize + 4);
        let mut slack = [0.0; 32];
        for c in &mesh.cables {
            let [a, b] = c.nodes.map(|n| at(&mesh.coords, n));
            slack[c.line as usize] += c.rest_length - (a - b).norm();
        }
        for (line, &s) in slack.iter().enumerate() {
            let taut = line >= 28 || line % 7 == 0 || line % 7 == 6;
            assert!(if taut { s.abs() < 1e-12 } else { s > 1e-3 }, "line {line}: {s}");
        }
        assert!((slack.iter().fold(0.0f64, |m, &s| m.max(s)) - 0.77).abs() < 0.005);
    }
}

#[test]
fn atps_edges_are_shared_where_stitched() {
    for (end, vent, stitch) in [(StitchedEnd::Hem, 9, 2), (StitchedEnd::Top, 9, 2), (StitchedEnd::Hem, 2, 1)]
    {
        let n = 18u32;
        let mesh = atps(|p| {
            (p.stitched_end, p.cells_along_vent, p.cells_along_stitching) = (end, vent, stitch);
        });
        assert_eq!(mesh.faces.len() as u32, n * n + 4 * n * (vent + stitch));
        assert_eq!(mesh.triangles.len(), 2 * mesh.faces.len());
        // Levels with the arms apart: all of the vent but its shared ends.
        let apart = if end == StitchedEnd::Hem { vent - 1 } else { vent };
        assert_eq!(mesh.n_canopy as u32, (n + 1).pow(2) + 4 * n * (vent + stitch) + 4 * apart);
        // Each directed edge once (orientation); without partner: hem and vents.
        let mut edges = HashMap::new();
        for t in &mesh.triangles {
            for i in 0..3 {
                assert!(edges.insert((t[i], t[(i + 1) % 3]), ()).is_none());
            }
        }
        let open = edges.keys().filter(|(a, b)| !edges.contains_key(&(*b, *a))).count() as u32;
        assert_eq!(open, 4 * n + 8 * vent);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|n| at(&mesh.coords, n));
            let out = (a + b + c) / 3.0 - Vec3::new(0.0, 0.0, -2.0);
            assert!(triangle_area_vector([a, b, c]).dot(&out) > 0.0);
        }
    }
}

#[test]
fn atps_mesh_has_the_symmetry_of_the_canopy() {
    let mesh = atps(|p| p.reinforcements = true);
    let bits = |x: [f64; 3]| x.map(|v| (v + 0.0).to_bits());
    let count = |map: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let mut seen = HashMap::new();
        for t in &mesh.triangles {
            let mut key = t.map(|n| bits(map(mesh.coords[n as usize])));
            key.sort_unstable();
            *seen.entry(key).or_insert(0) += 1;
        }
        seen
    };
    let own = count(&|x| x);
    assert_eq!(own, count(&|[x, y, z]| [-y, x, z]));
    assert_eq!(own, count(&|[x, y, z]| [x, -y, z]));
}

#[test]
fn reinforcements_run_along_all_edges() {
    let mesh = atps(|p| p.reinforcements = true);
    // Top edges, hems, seams with vents, and the vents' second sides.
    let expected = 4 * 18 + 4 * 18 + 4 * 11 + 4 * 9;
    assert_eq!(mesh.cables.iter().filter(|c| c.kind == CableKind::Reinforcement).count(), expected);
    assert!(mesh.cables.iter().all(|c| c.rest_length > 0.05));
}

#[test]
fn reinforcements_form_a_grid_on_all_panels() {
    let edges = atps(|p| p.reinforcements = true).cables.len();
    let mesh = atps(|p| (p.reinforcements, p.reinforcement_spacing_cells) = (true, 3));
    // Of 18 cells across, 5 lines inside, both ways on the top, down the 11 cells of
    // each arm; 3 lines across each arm.
    assert_eq!(mesh.cables.len() - edges, 2 * 5 * 18 + 4 * 5 * 11 + 4 * 3 * 18);
    let mut pairs: Vec<_> =
        mesh.cables.iter().map(|c| (c.nodes[0].min(c.nodes[1]), c.nodes[0].max(c.nodes[1]))).collect();
    pairs.sort_unstable();
    assert!(pairs.windows(2).all(|p| p[0] != p[1]), "no cable twice");
}

#[test]
fn flat_canopies() {
    let flat = FlatCanopy {
        width_m: 2.0,
        cells_across: 20,
        line_count: 16,
        line_length_m: 3.0,
        segments_per_line: 3,
    };
    let square = structure_mesh(&scene(Canopy::Square(flat.clone()))).unwrap();
    close(square.fabric_area(|_| true), 4.0);
    assert_eq!((square.n_canopy, square.faces.len(), square.cables.len()), (441, 400, 48));
    let round = structure_mesh(&scene(Canopy::Circular(flat.clone()))).unwrap();
    // 14 x 14 cells and 3 rings; the rim is a regular polygon of 56 edges.
    assert_eq!((round.n_canopy, round.faces.len()), (15 * 15 + 3 * 56, 14 * 14 + 3 * 56));
    close(round.fabric_area(|_| true), 28.0 * (std::f64::consts::TAU / 56.0).sin());
    let payload = round.coords[round.fixed[0].0 as usize];
    assert!((payload[2] + 8f64.sqrt()).abs() < 1e-12);
    for mesh in [&square, &round] {
        for t in &mesh.triangles {
            // Up, and of even size.
            let area = triangle_area_vector(t.map(|n| at(&mesh.coords, n))).z;
            assert!((0.25..2.5).contains(&(area * mesh.triangles.len() as f64 / 4.0)), "{area}");
        }
    }
    let fixed = structure_mesh(&scene(Canopy::Square(FlatCanopy { line_count: 0, ..flat }))).unwrap();
    assert_eq!((fixed.fixed.len(), fixed.cables.len(), fixed.coords.len()), (80, 0, 441));
}

#[test]
fn air_bag_octant() {
    let mesh = structure_mesh(&scene(Canopy::AirBag(AirBag { edge_m: 0.3048, cells_across: 50 }))).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.n_canopy), (5000, 51 * 51));
    close(mesh.fabric_area(|_| true), 0.1524 * 0.1524);
    let of = |node: u32| mesh.fixed.iter().find(|f| f.0 == node).map(|f| f.1);
    assert_eq!(of(0), Some([true, true, false]));
    assert_eq!(of(50), Some([false, true, true]));
    assert_eq!(of(51 * 51 - 1), Some([false, false, true]));
    assert_eq!(of(52), None);
    assert_eq!(mesh.fixed.len(), 200);
}

#[test]
fn invalid_parameters_are_reported_with_their_key() {
    let refused = |change: fn(&mut Atps)| {
        let mut p = Atps::default();
        change(&mut p);
        match structure_mesh(&scene(Canopy::Atps(p))) {
            Err(MeshError::Parameter { key, .. }) => key,
            other => panic!("not refused: {other:?}"),
        }
    };
    assert_eq!(refused(|p| p.cells_across = 7), "canopy.cells_across");
    assert_eq!(refused(|p| p.stitching_height_m = 4.0), "canopy.stitching_height_m");
    assert_eq!(refused(|p| p.suspension_line_length_m = 3.0), "canopy.suspension_line_length_m");
    assert_eq!(refused(|p| p.top_width_m = f64::NAN), "canopy.top_width_m");
    assert_eq!(refused(|p| p.lines_per_arm = 1), "canopy.lines_per_arm");
    assert_eq!(refused(|p| p.cells_along_vent = 1), "canopy.cells_along_vent");
}

proptest::proptest! {
    #![proptest_config(proptest::test_runner::Config::with_cases(64))]

    /// Any pyramid: areas and volume by formula, outer lines taut, orientation kept.
    #[test]
    fn every_atps_is_a_truncated_pyramid(
        top in 0.5..20.0f64, hem_share in 0.5..1.3f64, arm_share in 0.3..2.0f64,
        stitch_share in 0.05..0.9f64, line_share in 0.75..3.0f64,
        half_cells in 4u32..12, vent in 2u32..8, stitch in 1u32..4, lines in 2u32..9, top_end: bool,
    ) {
        let (hem, arm) = (hem_share * top, arm_share * top);
        let p = Atps {
            top_width_m: top,
            bottom_edge_width_m: hem,
            arm_length_m: arm,
            stitching_height_m: stitch_share * arm,
            stitched_end: if top_end { StitchedEnd::Top } else { StitchedEnd::Hem },
            suspension_line_length_m: line_share * hem,
            riser_length_m: 0.2 * top,
            lines_per_arm: lines,
            cells_across: 2 * half_cells,
            cells_along_vent: vent,
            cells_along_stitching: stitch,
            ..Default::default()
        };
        let mesh = structure_mesh(&scene(Canopy::Atps(p))).unwrap();
        let same = |a: f64, b: f64| assert!((a - b).abs() < 1e-10 * b.abs(), "{a} is not {b}");
        same(mesh.fabric_area(|panel| panel > 0), 2.0 * (top + hem) * arm);
        let height = (arm * arm - 0.25 * (top - hem) * (top - hem)).sqrt();
        same(enclosed(&mesh), height / 3.0 * (top * top + top * hem + hem * hem));
        let outer = mesh.cables.iter().filter(|c| c.line == 0);
        for c in outer {
            let [a, b] = c.nodes.map(|n| at(&mesh.coords, n));
            same((a - b).norm(), c.rest_length);
        }
        // No line is longer than its chord allows; risers are taut.
        for c in &mesh.cables {
            let [a, b] = c.nodes.map(|n| at(&mesh.coords, n));
            assert!((a - b).norm() <= c.rest_length * (1.0 + 1e-12));
        }
    }
}
