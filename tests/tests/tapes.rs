//! Tapes and masses across programs: what is printed and balanced is what the structure has, by the figures of the paper.

use std::path::Path;
use std::process::Command;
use std::rc::Rc;

use case::{Scene, TapePlace};
use coupling::descent::DescentModel;
use coupling::interface::CanopyInterface;
use mesh::CableKind;
use ripstop_tests::{program, root};

fn load(file: &str) -> Scene {
    case::load(&root().join(file)).unwrap_or_else(|e| panic!("{e}"))
}

/// Sum of the lumped masses of the structure, kg.
fn lumped(scene: &Scene) -> f64 {
    let mesh = Rc::new(mesh::structure_mesh(scene).expect("a mesh"));
    let d = structure_solver::assemble::dynamics(&comm::Comm::solo(), scene, 0, &mesh).expect("a structure");
    (0..d.system.model.n_owned()).map(|i| d.system.lumped_mass(i)).sum()
}

/// Figures in kg after `name` in the line "masses" of `ripstop check`.
fn printed(file: &Path) -> Vec<(String, f64)> {
    let check = Command::new(program("ripstop")).arg("check").arg(file).output().expect("starts");
    let text = String::from_utf8_lossy(&check.stdout).into_owned();
    let line =
        text.lines().find_map(|l| l.trim().strip_prefix("masses: ")).unwrap_or_else(|| panic!("{text}"));
    let figure = |part: &str| {
        let (name, value) = part.split(" kg").next()?.trim().rsplit_once(' ')?;
        Some((name.to_owned(), value.parse().ok()?))
    };
    line.split(';').flat_map(|p| p.split(", ")).filter_map(figure).collect()
}

/// With and without tapes, risers of their own and the former reinforcements: the total of the descent equation is the sum
/// of the structure's lumped masses.
#[test]
fn total_mass_is_the_sum_of_the_lumped_masses() {
    let mut scenes = vec![load("cases/atps-descent/scene.toml"), load("cases/atps-descent/tapes.toml")];
    let mut risers = load("cases/atps-descent/tapes.toml");
    risers.risers = Some(case::Risers { axial_stiffness_n: 3e4, mass_kg_m: 0.02, ..Default::default() });
    let mut former = load("cases/atps-descent/scene.toml");
    let case::Canopy::Atps(a) = &mut former.canopy else { panic!("an ATPS") };
    (a.reinforcements, a.reinforcement_spacing_cells) = (true, 3);
    scenes.extend([risers, former]);
    for scene in &scenes {
        let interface = CanopyInterface::new(scene).expect("a canopy");
        let model = DescentModel::of(scene, &interface).expect("a descent");
        let sum = lumped(scene);
        assert!((sum / model.mass_kg - 1.0).abs() < 1e-13, "{}: {sum} is not {}", scene.name, model.mass_kg);
        let parts: f64 = interface.masses.parts().iter().map(|p| p.1).sum();
        assert!((parts + model.payload_kg - sum).abs() < 1e-12 * sum, "{}: {parts}", scene.name);
    }
}

/// `ripstop check` prints each part of the mass, to its four digits.
#[test]
fn masses_are_printed_by_part() {
    let file = root().join("cases/atps-descent/tapes.toml");
    let interface = CanopyInterface::new(&load("cases/atps-descent/tapes.toml")).expect("a canopy");
    let found = printed(&file);
    for (name, mass) in interface.masses.parts() {
        let part = found.iter().find(|p| p.0 == name).unwrap_or_else(|| panic!("{name} is not in {found:?}"));
        assert!((part.1 - mass).abs() <= 5e-5, "{name}: {} is not {mass}", part.1);
    }
    let all: f64 = interface.masses.suspended();
    assert!(found.iter().any(|p| p.0 == "in all" && (p.1 - all).abs() <= 5e-5), "{found:?}");
}

/// The table of `cases/atps-descent/README.md`: its last column is what the mesh of the case has.
#[test]
fn geometry_of_the_case_is_that_of_its_table() {
    let scene = load("cases/atps-descent/tapes.toml");
    let mesh = mesh::structure_mesh(&scene).expect("a mesh");
    let interface = CanopyInterface::new(&scene).expect("a canopy");
    let masses = interface.masses;
    let tape = |place| mesh.cable_length(CableKind::Tape(place));
    let [lines, risers] = [CableKind::SuspensionLine, CableKind::Riser].map(|k| mesh.cable_length(k));
    let plain = masses.fabric + masses.lines + masses.risers;
    let total = DescentModel::of(&scene, &interface).expect("a descent").mass_kg;
    let all_tapes: f64 = TapePlace::ALL.into_iter().map(tape).sum();
    let text = std::fs::read_to_string(root().join("cases/atps-descent/README.md")).expect("the README");
    for (name, value, digits) in [
        ("area of the top, m²", mesh.fabric_area(|p| p == 0), 3),
        ("area of the arms, m²", mesh.fabric_area(|p| p > 0), 3),
        ("area of the fabric, m²", mesh.fabric_area(|_| true), 3),
        ("hem, m", tape(TapePlace::Hem), 3),
        ("edges of the top and stitched edges of the arms, m", tape(TapePlace::Seams), 3),
        ("edges of the four vents, m", tape(TapePlace::Vents), 3),
        ("28 suspension lines, m", lines, 3),
        ("4 risers, m", risers, 4),
        ("mass of the fabric, kg", masses.fabric, 3),
        ("mass of lines and risers, kg", masses.lines + masses.risers, 3),
        ("mass without tapes, with the payload, kg", plain + 100.6975, 3),
        ("tapes of `tapes.toml`, m", all_tapes, 0),
        ("mass of these tapes, kg", masses.all_tapes(), 3),
        ("mass with tapes and payload, kg", total, 3),
    ] {
        let row = text.lines().find_map(|l| l.strip_prefix(&format!("| {name} |")));
        let row = row.unwrap_or_else(|| panic!("no row for {name}"));
        let figure = row.trim_end_matches(['|', ' ']).rsplit('|').next().expect("a column").trim();
        assert_eq!(figure, format!("{value:.digits$}"), "{name}");
    }
}
