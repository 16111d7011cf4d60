//! Lengths, masses and places of tapes.

use std::collections::HashMap;

use case::{
    Atps, Canopy, FlatCanopy, PanelCanopy, PanelEdges, StitchedEnd, Tape, TapeGrid, TapePlace, Tapes,
};

use super::tests::scene;
use crate::{CableKind, StructureMesh, structure_mesh};

const SECTION: Tape = Tape {
    material: None,
    axial_stiffness_n: 1661.4,
    mass_kg_m: 3.8e-3,
    strength_n: None,
    safety_factor: None,
    retardation_time_s: 0.0,
};

fn grid(spacing_m: f64) -> Option<TapeGrid> {
    Some(TapeGrid { axial_stiffness_n: 1661.4, mass_kg_m: 3.8e-3, spacing_m, ..TapeGrid::default() })
}

fn all(spacing_m: f64) -> Tapes {
    let [hem, seams, vents] = [Some(SECTION); 3];
    Tapes { hem, seams, vents, grid: grid(spacing_m), tension_only: true }
}

fn taped(canopy: Canopy, tapes: Tapes) -> StructureMesh {
    let mut scene = scene(canopy);
    scene.tapes = Some(tapes);
    structure_mesh(&scene).expect("a mesh")
}

fn atps(change: impl FnOnce(&mut Atps), tapes: Tapes) -> StructureMesh {
    let mut p = Atps::default();
    change(&mut p);
    taped(Canopy::Atps(p), tapes)
}

fn length(mesh: &StructureMesh, place: TapePlace) -> f64 {
    mesh.cable_length(CableKind::Tape(place))
}

fn same(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12 * b.abs(), "{a} is not {b}");
}

/// Lengths of edges by Table 2 of the paper: the edge of an arm is (L^2 + d^2)^1/2 long with d = (W - Wb) / 2.
#[test]
fn edges_have_the_lengths_of_the_paper() {
    let (top, hem, arm, stitched) = (6.43128, 6.096, 3.93192f64, 0.73152);
    let edge = arm.hypot(0.5 * (top - hem));
    for (end, cells) in [(StitchedEnd::Hem, 18), (StitchedEnd::Top, 18), (StitchedEnd::Hem, 8)] {
        let mesh = atps(|p| (p.stitched_end, p.cells_across) = (end, cells), all(0.25));
        same(length(&mesh, TapePlace::Hem), 4.0 * hem);
        same(length(&mesh, TapePlace::Seams), 4.0 * top + 4.0 * edge * stitched / arm);
        same(length(&mesh, TapePlace::Vents), 8.0 * edge * (1.0 - stitched / arm));
    }
}

/// Each mesh has the length 2 A / d of grid, on cells below and above the spacing, and with it the same mass and stiffness.
#[test]
fn grid_has_the_same_length_on_every_mesh() {
    for (cells, vent, stitch) in [(10, 6, 2), (18, 10, 3), (18, 3, 7), (60, 31, 7)] {
        let sizes = |p: &mut Atps| {
            (p.cells_across, p.cells_along_vent, p.cells_along_stitching) = (cells, vent, stitch);
        };
        for spacing in [0.05, 0.25, 0.2563, 0.9, 20.0] {
            let mesh = atps(sizes, Tapes { grid: grid(spacing), ..Tapes::default() });
            same(length(&mesh, TapePlace::Grid), 2.0 * mesh.fabric_area(|_| true) / spacing);
            assert!(mesh.cables.iter().all(|c| c.share > 0.0));
        }
    }
}

#[test]
fn grid_has_the_symmetry_of_the_canopy() {
    for (cells, spacing) in [(18, 0.25), (40, 0.5), (40, 0.43)] {
        let mesh = atps(|p| p.cells_across = cells, all(spacing));
        let place = |x: [f64; 3]| x.map(|v| (v * 1e6).round() as i64);
        let seen = |map: &dyn Fn([f64; 3]) -> [f64; 3]| -> HashMap<[[i64; 3]; 2], i64> {
            let mut all = HashMap::new();
            for c in &mesh.cables {
                let mut ends = c.nodes.map(|n| place(map(mesh.coords[n as usize])));
                ends.sort_unstable();
                *all.entry(ends).or_insert(0) += (c.share * 1e9).round() as i64;
            }
            all
        };
        let own = seen(&|x| x);
        for other in [seen(&|[x, y, z]| [-y, x, z]), seen(&|[x, y, z]| [x, -y, z])] {
            assert_eq!(own.len(), other.len());
            assert!(
                own.iter().all(|(k, v)| other.get(k).is_some_and(|w| (v - w).abs() < 10)),
                "{cells} {spacing}"
            );
        }
    }
}

/// Spacing and cells that fit: each tape has its own column. Cells of two spacings: two tapes inside, one at each edge.
#[test]
fn tapes_lie_on_columns_where_these_coincide() {
    let strip = |cells: u32, spacing: f64| {
        let panel = PanelCanopy { size_m: [3.0, 1.0], cells: [3, cells], held: PanelEdges::Ends };
        let mesh = taped(Canopy::Panel(panel), Tapes { grid: grid(spacing), ..Tapes::default() });
        let along =
            |c: &&crate::Cable| mesh.coords[c.nodes[0] as usize][0] != mesh.coords[c.nodes[1] as usize][0];
        let mut shares: HashMap<i64, f64> = HashMap::new();
        for c in mesh.cables.iter().filter(along) {
            shares.insert((mesh.coords[c.nodes[0] as usize][1] * 1e6).round() as i64, c.share);
        }
        let mut shares: Vec<_> = shares.into_iter().collect();
        shares.sort_by_key(|s| s.0);
        shares
    };
    let at = |found: Vec<(i64, f64)>, wanted: &[(i64, f64)]| {
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        for (a, b) in found.iter().zip(wanted) {
            assert!(a.0 == b.0 && (a.1 - b.1).abs() < 1e-12, "{found:?} is not {wanted:?}");
        }
    };
    at(strip(4, 0.5), &[(-250_000, 1.0), (250_000, 1.0)]);
    at(strip(2, 0.25), &[(-500_000, 1.0), (0, 2.0), (500_000, 1.0)]);
    // A tape midway between two columns.
    at(strip(3, 1.0), &[(-166_667, 0.5), (166_667, 0.5)]);
}

/// A scene without [tapes] has the mesh of one whose tapes are removed, and edges of [tapes] are where reinforcements are.
#[test]
fn tapes_are_where_reinforcements_are() {
    let edges = Tapes { grid: None, ..all(1.0) };
    let mesh = atps(|_| {}, edges);
    let former =
        structure_mesh(&scene(Canopy::Atps(Atps { reinforcements: true, ..Atps::default() }))).unwrap();
    let pairs = |mesh: &StructureMesh| {
        let on_fabric = mesh.cables.iter().filter(|c| !c.kind.is_free());
        let mut all: Vec<_> =
            on_fabric.map(|c| [c.nodes[0].min(c.nodes[1]), c.nodes[0].max(c.nodes[1])]).collect();
        all.sort_unstable();
        all
    };
    assert_eq!(pairs(&mesh), pairs(&former));
    let mut plain = mesh.clone();
    plain.cables.retain(|c| c.kind.is_free());
    assert_eq!(plain, structure_mesh(&scene(Canopy::Atps(Atps::default()))).unwrap());
}

#[test]
fn hem_of_a_sheet_is_its_rim() {
    let flat = FlatCanopy {
        width_m: 2.0,
        cells_across: 20,
        line_count: 16,
        line_length_m: 3.0,
        segments_per_line: 1,
    };
    let hem = || Tapes { hem: Some(SECTION), ..Tapes::default() };
    same(length(&taped(Canopy::Square(flat.clone()), hem()), TapePlace::Hem), 8.0);
    let around = 56.0 * 2.0 * (std::f64::consts::PI / 56.0).sin();
    same(length(&taped(Canopy::Circular(flat.clone()), hem()), TapePlace::Hem), around);
    let panel = PanelCanopy { size_m: [3.0, 1.0], cells: [5, 4], held: PanelEdges::All };
    same(length(&taped(Canopy::Panel(panel), hem()), TapePlace::Hem), 8.0);
    let mut vents = scene(Canopy::Circular(flat));
    vents.tapes = Some(Tapes { vents: Some(SECTION), ..Tapes::default() });
    assert!(structure_mesh(&vents).expect_err("refused").to_string().contains("vents"));
}

/// The figures of the paper's parachute with the tapes that its count of elements implies (cases/atps-descent): 1170 m, 4.45 kg.
#[test]
fn tapes_of_the_paper() {
    let mesh = atps(|_| {}, all(0.2563));
    let metres: f64 = TapePlace::ALL.into_iter().map(|p| length(&mesh, p)).sum();
    assert!((metres - 1170.0).abs() < 1.0, "{metres}");
}
