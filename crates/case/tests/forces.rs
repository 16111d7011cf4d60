//! `[[flow.forces.coefficients]]`: surfaces and axes that a scene may choose.

use std::path::Path;

const SCENE: &str = r#"
name = "forces"
[canopy]
kind = "panel"
size_m = [1.0, 1.0]
cells = [4, 4]
[fabric]
youngs_modulus_pa = 2e8
poisson_ratio = 0.3
thickness_m = 3e-5
density_kg_m3 = 1200.0
[flow]
wind_m_s = [4.0, 0.0, 0.0]
[flow.box]
below_m = 1.0
above_m = 1.0
layers_below = 4
layers_above = 4
[flow.box.sides]
left = "inlet"
right = "outlet"
bottom = "wall"
[[stage]]
name = "a"
kind = "flow-only"
duration_s = 0.1
window_s = 0.1
[[flow.forces.coefficients]]
name = "floor"
patches = ["bottom"]
drag_direction = [1.0, 0.0, 0.0]
reference_area_m2 = 1.0
reference_length_m = 1.0
"#;

fn message(from: &str, to: &str) -> String {
    assert!(SCENE.contains(from), "{from}");
    case::parse(Path::new("scene.toml"), &SCENE.replacen(from, to, 1)).unwrap_err().to_string()
}

#[test]
fn unknown_and_open_patches_are_refused_with_the_names_of_the_walls() {
    let scene = case::parse(Path::new("scene.toml"), SCENE).unwrap();
    let forces = scene.flow.unwrap().forces.unwrap();
    assert_eq!(
        forces.coefficients[0].axes(&forces).unwrap(),
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    );
    for (patches, what) in [
        ("[\"botom\"]", "no patch \"botom\""),
        ("[\"bottom\", \"left\"]", "air passes the patch \"left\""),
        ("[\"bottom\", \"bottom\"]", "occurs twice"),
        ("[]", "on no surface"),
    ] {
        let text = message("[\"bottom\"]", patches);
        assert!(text.contains(what), "{text}");
        assert!(text.contains("among: front, back, bottom, top, canopy"), "{text}");
    }
}

#[test]
fn ambiguous_names_and_axes_are_refused() {
    for name in ["canopy", "wall", "a b"] {
        let text = message("name = \"floor\"", &format!("name = \"{name}\""));
        assert!(text.contains(&format!("is \"{name}\"")) && text.contains("each name once"), "{text}");
    }
    let text = message(
        "drag_direction = [1.0, 0.0, 0.0]",
        "drag_direction = [1.0, 0.0, 0.0]\nlift_direction = [-2.0, 0.0, 0.0]",
    );
    assert!(text.contains("no two different directions") && text.contains("lift_direction"), "{text}");
    let text = message("reference_area_m2 = 1.0", "reference_area_m2 = 0.0");
    assert!(text.contains("flow.forces.coefficients[0].reference_area_m2"), "{text}");
}

#[test]
fn coefficients_have_no_scale_at_zero_speed() {
    let scene = case::parse(Path::new("scene.toml"), SCENE).unwrap();
    let mut entry = scene.flow.unwrap().forces.unwrap().coefficients.remove(0);
    assert_eq!(entry.force_scale(1.2, 2.0), Some(2.4));
    assert_eq!((entry.force_scale(1.2, 0.0), entry.force_scale(1.2, 1e-200)), (None, None));
    entry.reference_speed_m_s = Some(1.0);
    assert_eq!(entry.force_scale(1.2, 0.0), Some(0.6));
}

#[test]
fn watched_force_is_that_of_the_scene_in_flow_only_stages() {
    use case::{StageKind, WatchedForce};
    let scene = case::parse(Path::new("scene.toml"), SCENE).unwrap();
    assert_eq!(scene.watched_force(StageKind::FlowOnly), WatchedForce::Canopy);
    let watching = |name: &str| {
        let text = format!("[flow.forces]\nwatch = \"{name}\"\n[[flow.forces.coefficients]]");
        case::parse(Path::new("scene.toml"), &SCENE.replace("[[flow.forces.coefficients]]", &text))
    };
    let scene = watching("floor").unwrap();
    assert_eq!(scene.watched_force(StageKind::FlowOnly).name(), "floor");
    assert_eq!(scene.watched_direction(StageKind::FlowOnly), [1.0, 0.0, 0.0]);
    assert_eq!(scene.watched_force(StageKind::Coupled), WatchedForce::Canopy);
    assert_eq!(scene.watched_direction(StageKind::Coupled), [0.0, 0.0, 1.0]);
    assert_eq!(watching("wall").unwrap().watched_force(StageKind::FlowOnly), WatchedForce::Walls);
    let text = watching("flor").unwrap_err().to_string();
    assert!(
        text.contains("the name \"flor\"") && text.contains("name one of: floor, canopy, wall"),
        "{text}"
    );
}
