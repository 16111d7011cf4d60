//! `[tapes]` and `[risers]`: what is read, and what is refused with its place and remedy.

use std::path::Path;

use case::{Scene, SceneError, TapePlace};

const ATPS: &str = include_str!("../../../cases/atps-descent/scene.toml");
const SQUARE: &str = include_str!("../../../cases/square-drop/scene.toml");
const HEM: &str = "[tapes.hem]\naxial_stiffness_n = 1661.0\nmass_kg_m = 3.8e-3\n";
const GRID: &str = "[tapes.grid]\naxial_stiffness_n = 500.0\nmass_kg_m = 2e-3\nspacing_m = 0.25\n";

fn read(scene: &str, added: &str) -> Result<Scene, SceneError> {
    case::parse(Path::new("scene.toml"), &format!("{scene}\n{added}"))
}

fn refused(scene: &str, added: &str) -> String {
    read(scene, added).expect_err("this scene should be refused").to_string()
}

#[test]
fn places_have_sections_of_their_own() {
    let scene = read(ATPS, &format!("{HEM}{GRID}")).expect("a scene");
    let tapes = scene.tapes.expect("tapes");
    assert!(tapes.tension_only && tapes.seams.is_none() && tapes.vents.is_none());
    let places: Vec<_> = tapes.places().map(|(p, t)| (p, t.axial_stiffness_n, t.mass_kg_m)).collect();
    assert_eq!(places, [(TapePlace::Hem, 1661.0, 3.8e-3), (TapePlace::Grid, 500.0, 2e-3)]);
    assert_eq!(read(ATPS, "").expect("a scene").tapes, None);
}

#[test]
fn sections_and_spacings_have_ranges() {
    for (from, to, expected) in [
        ("1661.0", "0.0", "`tapes.hem.axial_stiffness_n` is 0"),
        ("1661.0", "-5.0", "strength over elongation at break"),
        ("1661.0", "nan", "`tapes.hem.axial_stiffness_n` is NaN"),
        ("3.8e-3", "380.0", "kilograms, not grams"),
        ("3.8e-3", "0.0", "`tapes.hem.mass_kg_m` is 0"),
        ("0.25", "0.0", "`tapes.grid.spacing_m` is 0"),
        ("0.25", "1e-5", "allowed: from 0.001 to 100"),
        ("0.25", "inf", "`tapes.grid.spacing_m` is inf"),
        ("spacing_m", "spacing", "did you mean `spacing_m`"),
        ("[tapes.hem]", "[tapes.hems]", "did you mean `hem`"),
    ] {
        let text = format!("{HEM}{GRID}").replacen(from, to, 1);
        let error = refused(ATPS, &text);
        assert!(error.contains(expected), "{to}: {error}");
    }
    let error = refused(ATPS, &GRID.replace("spacing_m = 0.25\n", ""));
    assert!(error.contains("spacing_m"), "{error}");
    let error = refused(ATPS, "[tapes]\ntension_only = true\n");
    assert!(error.contains("[tapes] names no place"), "{error}");
}

#[test]
fn canopies_without_a_place_refuse_its_tapes() {
    let vents = HEM.replace("hem", "vents");
    let error = refused(SQUARE, &vents);
    assert!(
        error.contains("no place `vents` for tapes") && error.contains("has tapes at: hem, grid"),
        "{error}"
    );
    let round = SQUARE.replace("kind = \"square\"", "kind = \"circular\"");
    assert!(refused(&round, GRID).contains("has tapes at: hem"));
    read(&round, HEM).expect("a hem");
    read(SQUARE, GRID).expect("a grid");
}

#[test]
fn former_reinforcements_and_tapes_exclude_each_other() {
    let both = ATPS.replace("kind = \"atps\"", "kind = \"atps\"\nreinforcements = true");
    read(&both, "").expect("the former keys are accepted");
    let error = refused(&both, HEM);
    assert!(error.contains("remove canopy.reinforcements"), "{error}");
}

#[test]
fn risers_need_lines_and_a_canopy_that_has_risers() {
    let risers = "[risers]\naxial_stiffness_n = 3e4\nmass_kg_m = 0.02\n";
    let scene = read(ATPS, risers).expect("a scene");
    assert_eq!(scene.risers.map(|r| r.mass_kg_m), Some(0.02));
    assert!(refused(SQUARE, risers).contains("has no risers"));
    let error = refused(ATPS, &risers.replace("3e4", "1e12"));
    assert!(error.contains("`risers.axial_stiffness_n` is 1000000000000"), "{error}");
}
