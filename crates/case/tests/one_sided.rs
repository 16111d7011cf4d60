//! What `flow.grid_file.one_sided` accepts and refuses.

use std::path::Path;

use case::Scene;

const CAVITY: &str = include_str!("../../../cases/validation/flexible-cavity/scene.toml");

fn read(text: &str) -> Result<Scene, String> {
    let grid = concat!(env!("CARGO_MANIFEST_DIR"), "/../../cases/validation/flexible-cavity/cavity-32.msh");
    let text = text.replace("\"cavity-32.msh\"", &format!("{grid:?}"));
    case::parse(Path::new("scene.toml"), &text).map_err(|e| e.to_string())
}

#[test]
fn ambient_pressure_is_read_and_zero_without_a_key() {
    let one = |to: &str| read(&CAVITY.replace("{ ambient_pressure_pa = 0.0 }", to)).expect("a scene");
    assert_eq!(one("{ ambient_pressure_pa = -3.5 }").ambient_pressure(), -3.5);
    assert_eq!(one("{}").ambient_pressure(), 0.0);
    assert!(one("{}").is_one_sided());
    let both = read(&CAVITY.replace("one_sided =", "# one_sided =")).expect("a scene");
    assert!(!both.is_one_sided() && both.ambient_pressure() == 0.0);
}

#[test]
fn what_needs_fluid_on_both_sides_is_refused() {
    let cloth = "[fabric.permeability]\ncfm_per_ft2 = 90.0\n\n[flow]\n";
    let immersed = "[flow.immersed]\nspacing_m = 0.1\n\n[flow.viscosity]\n";
    for (text, wanted) in [
        (CAVITY.replacen("[flow]\n", cloth, 1), "permeable fabric would enter a side without fluid"),
        (CAVITY.replacen("[flow.viscosity]\n", immersed, 1), "an immersed canopy has fluid on both sides"),
        (CAVITY.replacen("pressure_pa = 0.0", "pressure_pa = 1e9", 1), "ambient_pressure_pa"),
    ] {
        let message = read(&text).expect_err(wanted);
        assert!(message.contains(wanted), "{message}");
    }
}

/// The grid of a canopy that an earlier stage bends is not judged around its unstressed shape.
#[test]
fn grid_awaits_the_shape_of_an_earlier_stage() {
    assert!(!read(CAVITY).expect("a scene").grid_awaits_shape());
    let before =
        "[[stage]]\nname = \"a\"\nkind = \"pre-inflation\"\nsolve = \"static\"\npressure_pa = 1.0\n\n";
    let bent = CAVITY.replacen("[[stage]]\n", &format!("{before}[[stage]]\n"), 1);
    assert!(read(&bent).expect("a scene").grid_awaits_shape());
}
