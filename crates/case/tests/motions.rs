//! Prescribed motions with rotations, groups of reactions, and cloths of groups: what they mean and what is refused.

use std::path::Path;

use case::{Scene, StageTimes, jumps};

const PANEL: &str = "name = \"panel\"\n[canopy]\nkind = \"panel\"\nsize_m = [1.0, 0.4]\ncells = [4, 2]\n\
    [fabric]\nyoungs_modulus_pa = 1e6\npoisson_ratio = 0.3\nthickness_m = 1e-3\ndensity_kg_m3 = 800.0\n";
const STAGE: &str = "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 10\nduration_s = 1.0\nwindow_s = 0.1\n";
const STATIC: &str =
    "[[stage]]\nname = \"one\"\nkind = \"pre-inflation\"\npressure_pa = 10\nsolve = \"static\"\n";
const MOTION: &str = "[[stage.motion]]\nnodes = \"right\"\n";

fn try_read(parts: &[&str]) -> Result<Scene, String> {
    case::parse(Path::new("scene.toml"), &format!("{PANEL}{}", parts.concat())).map_err(|e| e.to_string())
}

fn read(parts: &[&str]) -> Scene {
    try_read(parts).unwrap_or_else(|e| panic!("{e}"))
}

fn rotation(rest: &str) -> String {
    format!("{MOTION}rotation = {{ axis = [0, 0, 3], point_m = [1, 0, 0], {rest} }}\n")
}

/// A quarter turn about z through (1, 0, 0), then the displacement of the table: by a table, by a formula, and of two stages on one clock.
#[test]
fn a_motion_rotates_and_then_displaces() {
    let at = |scene: &Scene, k: usize, t: f64| {
        let motion =
            scene.stages[k].motions[0].in_stage(scene, k, &StageTimes::planned(scene)).expect("a motion");
        motion.at(t).apply([2.0, 0.0, 0.5])
    };
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-14);
    let table = "time_s = [0.0, 1.0]\ndisplacement_m = [[0, 0, 0], [2, 0, 0]]\n";
    for angle in ["angle_deg = [0, 90]", "angle_rad = \"pi/2*t\""] {
        let scene = read(&[STAGE, &rotation(angle), table]);
        assert!(near(at(&scene, 0, 1.0), [3.0, 1.0, 0.5]), "{angle}: {:?}", at(&scene, 0, 1.0));
        assert_eq!(at(&scene, 0, 0.0), [2.0, 0.0, 0.5]);
    }
    let two = STAGE.replace("\"one\"", "\"two\"");
    for angle in ["angle_deg = [0, 180]", "angle_rad = \"pi/2*t\""] {
        let times = if angle.starts_with("angle_deg") { "time_s = [0.0, 2.0]\n" } else { "" };
        let motion = format!("{}clock = \"run\"\n{times}", rotation(angle));
        let scene = read(&[STAGE, &motion, &two, &motion]);
        assert!(near(at(&scene, 0, 1.0), [1.0, 1.0, 0.5]), "{angle}: {:?}", at(&scene, 0, 1.0));
        // What was turned before counts as the start.
        assert_eq!(at(&scene, 1, 0.0), [2.0, 0.0, 0.5]);
        assert!(near(at(&scene, 1, 1.0), [1.0, 1.0, 0.5]), "{angle}: {:?}", at(&scene, 1, 1.0));
    }
}

/// A rotation that starts at speed or turned is a jump; one that starts at rest is none, nor is the boundary within one motion.
#[test]
fn rotations_that_jump_are_named() {
    let two = STAGE.replace("\"one\"", "\"two\"");
    let found = |a: &str, b: &str| {
        let scene = read(&[STAGE, a, &two, b]);
        jumps(&scene, &StageTimes::planned(&scene)).iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let still = rotation("angle_rad = \"0\"");
    assert!(found(&still, &rotation("angle_rad = \"0.1*(1 - cos(3*t))\"")).is_empty());
    let speed = found(&still, &rotation("angle_rad = \"0.3*t\""));
    assert!(
        speed.len() == 1 && speed[0].contains("angular velocity of nodes `right` changes from 0.000"),
        "{speed:?}"
    );
    assert!(speed[0].contains("a jump of 0.300 rad/s"), "{speed:?}");
    let turned = found(&still, &rotation("angle_rad = \"0.2 + t^2\""));
    assert!(turned.len() == 1 && turned[0].contains("turned at the start"), "{turned:?}");
    let running = format!("{}clock = \"run\"\n", rotation("angle_rad = \"0.3*(t - sin(t))\""));
    assert!(found(&running, &running).is_empty(), "{:?}", found(&running, &running));
}

#[test]
fn rotations_without_meaning_are_refused() {
    let formula = rotation("angle_rad = \"t\"");
    for (stage, motion, words) in [
        (STAGE, rotation("angle_deg = [0, 90]"), ["0 times, but 2 angles", "one angle for each"]),
        (STAGE, rotation("angle_deg = [0, 90], angle_rad = \"t\""), ["two kinds of angle", "give either"]),
        (STAGE, formula.replace(", angle_rad = \"t\"", ""), ["no angle", "give either"]),
        (STAGE, formula.replace("[0, 0, 3]", "[0, 0, 0]"), ["no direction", "name a vector"]),
        (STAGE, formula.replace("\"t\"", "\"1/(t - 0.5)\""), ["not a number", "finite"]),
        (STAGE, formula.replace("\"t\"", "\"x\""), ["not a formula", "formula of t"]),
        (STATIC, formula.clone(), ["static", "angle_deg"]),
        (STAGE, MOTION.to_owned(), ["0 times, but 0 displacements", "at least one"]),
    ] {
        let error = try_read(&[stage, &motion]).expect_err(&motion);
        assert!(words.iter().all(|w| error.contains(w)), "{motion}: {error}");
    }
}

#[test]
fn groups_of_reactions_without_meaning_are_refused() {
    let group = |text: &str| try_read(&[STAGE, "[output]\n", text]).map(|s| s.output.reactions.len());
    let one = "[[output.reaction]]\nname = \"clamp\"\nnodes = \"held\"\n";
    assert_eq!(group(one), Ok(1));
    let error = |text: &str| group(text).expect_err(text);
    assert!(error(&format!("{one}{one}")).contains("of those of another group"));
    assert!(error(&one.replace("clamp", "a b")).contains("use letters"));
    assert!(error(&format!("{one}at_m = [0, 0, 0]\n")).contains("two kinds of nodes"));
    assert!(error(&one.replace("nodes = \"held\"", "")).contains("names no nodes"));
}

/// The cloth of a group has its own keys and the others of `[fabric]`; what is no cloth is refused.
#[test]
fn cloths_of_groups_complete_the_fabric() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("canopy.msh");
    std::fs::write(&file, "").expect("a file");
    let gmsh = format!("kind = \"gmsh\"\nfile = \"{}\"\n", file.display());
    let read = |group: &str, fabric: &str| {
        let text = PANEL
            .replace("kind = \"panel\"\nsize_m = [1.0, 0.4]\ncells = [4, 2]\n", &format!("{gmsh}{group}"))
            .replace("density_kg_m3 = 800.0\n", &format!("density_kg_m3 = 800.0\n{fabric}"));
        case::parse(Path::new("scene.toml"), &format!("{text}{STAGE}")).map_err(|e| e.to_string())
    };
    let crown = "[[canopy.fabric]]\ngroup = \"crown\"\n";
    let scene = read(&format!("{crown}thickness_m = 2e-3\nyoungs_modulus_pa = 4e6\n"), "").expect("a scene");
    let own = scene.fabric_of(Some(0));
    assert_eq!((own.thickness_m, own.youngs_modulus_pa, own.density_kg_m3), (2e-3, 4e6, 800.0));
    assert_eq!(scene.fabric_of(None).thickness_m, 1e-3);
    for (group, fabric, words) in [
        (format!("{crown}{crown}"), "", "listed twice"),
        (format!("{crown}thickness_m = -1e-3\n"), "", "canopy.fabric[0].thickness_m"),
        (format!("{crown}poisson_ratio = 0.7\n"), "", "canopy.fabric[0].poisson_ratio"),
        (format!("{crown}shear_modulus_pa = 1e6\n"), "", "no warp and weft"),
        (format!("{crown}youngs_modulus_pa = 1e4\n"), "prestress_pa = 1e4\n", "more than half the modulus"),
        (
            format!("{crown}youngs_modulus_2_pa = 1e9\n"),
            "[fabric.orthotropic]\nyoungs_modulus_2_pa = 1e6\nshear_modulus_pa = 1e5\n",
            "would give energy",
        ),
    ] {
        let error = read(&group, fabric).expect_err(&group);
        assert!(error.contains(words), "{group}: {error}");
    }
}
