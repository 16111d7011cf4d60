//! `[stage.trajectory]`: a descent without solver programs, by the equation of a point mass.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{ALTITUDES, FrameMotion, Role, Scene, StageKind, StandardAir};

/// The quasi-steady force of the air in a stage of kind `trajectory`: drag and lift of fixed areas in the density and the wind at the
/// height of the frame. The canopy, its lines and the flow stay as the stage before left them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Drag area: drag over dynamic pressure, m2. Absent: the drag and lift areas with which the mean velocity of the coupled stage
    /// before is in equilibrium with the weight.
    pub drag_area_m2: Option<f64>,
    /// Lift area: lift over dynamic pressure, m2; lift is normal to the velocity relative to the air. Given with `drag_area_m2` only.
    pub lift_area_m2: Option<f64>,
    /// Horizontal direction to which the lift pulls, of any length. Absent: x.
    pub lift_direction: Option<[f64; 2]>,
    /// Height of the payload above ground at which the stage ends, m. Absent: it lasts for its duration.
    pub end_height_m: Option<f64>,
}

impl Scene {
    /// Density of the air around a frame at `z` (m, relative to its release), kg/m3: with `flow.altitude_m` that of the
    /// standard atmosphere, in the ratio in which it changes with height. `None` without a flow.
    pub fn density_at(&self, z: f64) -> Option<f64> {
        let flow = self.flow.as_ref()?;
        let Some(altitude) = flow.altitude_m else { return Some(flow.density_kg_m3) };
        let at = |h: f64| StandardAir::at(h.clamp(*ALTITUDES.start(), *ALTITUDES.end())).density_kg_m3;
        Some(flow.density_kg_m3 * at(altitude + z) / at(altitude))
    }

    /// The latest coupled stage before `stage`.
    pub fn coupled_before(&self, stage: usize) -> Option<usize> {
        (0..stage).rev().find(|k| self.stages[*k].kind == StageKind::Coupled)
    }
}

/// Refuses trajectories without a mass, an air or a force, and keys that a stage without programs does not have.
pub(super) fn check(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let stage = &scene.stages[k];
    let own = stage.kind == StageKind::Trajectory;
    if !own && stage.trajectory.is_some() {
        c.refuse(
            &at("trajectory"),
            format!("stage \"{}\" has a trajectory, but its kind computes the motion otherwise", stage.name),
            "use kind = \"trajectory\", or remove [stage.trajectory]",
        );
    }
    if !own {
        return;
    }
    needs(scene, k, at, c);
    without_programs(scene, k, at, c);
    if let Some(t) = &stage.trajectory {
        forces(scene, t, at, c);
        end(scene, t, at, c);
    }
}

/// A mass, air, and areas that are given or can be measured.
fn needs(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let stage = &scene.stages[k];
    if scene.descent.is_none() {
        c.refuse(&at("kind"), "nothing falls: the scene has no descent", "add [descent]");
    }
    if scene.flow.is_none() {
        c.refuse(&at("kind"), "there is no air to fall through", "add a [flow] section");
    }
    let given = stage.trajectory.as_ref().is_some_and(|t| t.drag_area_m2.is_some());
    if !given && scene.coupled_before(k).is_none() {
        c.refuse(
            &at("trajectory"),
            format!("no coupled stage before \"{}\" gives its drag area", stage.name),
            "set drag_area_m2 in [stage.trajectory], or put the stage after a coupled one",
        );
    }
}

/// Keys of programs, which do not run in the stage, and later stages whose flow would not know the new height.
fn without_programs(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let stage = &scene.stages[k];
    for (key, given) in [
        ("motion", !stage.motions.is_empty()),
        ("body_motion", !stage.body_motions.is_empty()),
        ("force", !stage.forces.is_empty()),
        ("perturbation", stage.perturbation.is_some()),
        ("steady", stage.steady.is_some()),
        ("flow_method", stage.flow_method.is_some()),
    ] {
        if given {
            c.refuse(
                &at(key),
                format!("no program runs in stage \"{}\", whose kind is \"trajectory\"", stage.name),
                format!("remove `{key}`"),
            );
        }
    }
    let flows = |s: &crate::Stage| s.kind.roles().contains(&Role::Flow);
    if scene.shear().is_some() && scene.stages[k..].iter().any(flows) {
        c.refuse(
            &at("kind"),
            "a later stage with the flow would meet the wind of another height: the flow counts its height over its own stages",
            "put the stage last, or remove [flow.shear] and give the later stages their wind by [stage.wind]",
        );
    }
}

fn forces(scene: &Scene, t: &Trajectory, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let key = |key: &str| at(&format!("trajectory.{key}"));
    for (name, area) in [("drag_area_m2", t.drag_area_m2), ("lift_area_m2", t.lift_area_m2)] {
        if let Some(area) = area {
            c.positive(&key(name), area, 1e6, "an area in m2");
        }
    }
    if t.lift_area_m2.is_some() && t.drag_area_m2.is_none() {
        c.refuse(
            &key("lift_area_m2"),
            "a lift is given, but the drag is measured",
            "set drag_area_m2 too, or remove lift_area_m2",
        );
    }
    if let Some(d) = t.lift_direction {
        let length = d[0].hypot(d[1]);
        if !(length.is_finite() && length > 0.0) {
            c.refuse(&key("lift_direction"), "the lift has no direction", "name a vector, as [1, 0]");
        } else if t.lift_area_m2.is_none() {
            c.refuse(&key("lift_direction"), "there is no lift to direct", "set lift_area_m2, or remove it");
        }
    }
    let held = scene.descent.as_ref().is_some_and(|d| d.frame_motion() == FrameMotion::Vertical);
    if held && t.lift_area_m2.is_some() {
        c.refuse(
            &key("lift_area_m2"),
            "the frame moves vertically, so that a lift cannot move it",
            "set descent.motion = \"three-dimensional\", or remove lift_area_m2",
        );
    }
}

/// The height at which the stage ends is above ground, and below the release.
fn end(scene: &Scene, t: &Trajectory, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let Some(height) = t.end_height_m else { return };
    let path = at("trajectory.end_height_m");
    c.range(&path, height, 0.0..=1e5, "above ground, m");
    match scene.descent.as_ref().and_then(|d| d.release_height_m) {
        None => c.refuse(
            &path,
            "the height of the release above ground is not given",
            "set descent.release_height_m, or remove end_height_m",
        ),
        Some(release) if height >= release => c.refuse(
            &path,
            format!("the stage ends at {height} m above ground, but the release is at {release} m"),
            "set a height below descent.release_height_m",
        ),
        Some(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use crate::parse;
    use std::path::Path;

    /// `square-drop` that falls after its release, with `keys` in the last stage, `more` below it and `changes` elsewhere.
    fn scene(keys: &str, more: &str, changes: &[(&str, &str)]) -> Result<crate::Scene, crate::SceneError> {
        let mut text = include_str!("../../../../cases/square-drop/scene.toml").to_owned();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replacen(from, to, 1);
        }
        let stage =
            "\n[[stage]]\nname = \"fall\"\nkind = \"trajectory\"\nduration_s = 10.0\nwindow_s = 0.5\n";
        parse(Path::new("scene.toml"), &(text + stage + keys + more))
    }

    #[track_caller]
    fn refused(keys: &str, more: &str, changes: &[(&str, &str)], what: &str) {
        let error = scene(keys, more, changes).map(|_| ()).expect_err("a refusal").to_string();
        assert!(error.contains(what), "{error}");
    }

    #[test]
    fn trajectories_that_nothing_moves_are_refused() {
        assert!(scene("", "", &[]).is_ok());
        let table = "[stage.trajectory]\n";
        let given = format!("{table}drag_area_m2 = 3.0\n");
        let prescribed = ("kind = \"coupled\"", "kind = \"flow-only\"");
        refused("", "", &[prescribed], "gives its drag area");
        assert!(scene("", &given, &[prescribed]).is_ok());
        let lift = format!("{table}lift_area_m2 = 1.0\n");
        refused("", &lift, &[], "a lift is given, but the drag is measured");
        let both = format!("{given}lift_area_m2 = 1.0\n");
        refused("", &both, &[], "the frame moves vertically");
        let free = ("reference_area_m2 = 4.0", "reference_area_m2 = 4.0\nmotion = \"three-dimensional\"");
        assert!(scene("", &both, &[free]).is_ok());
        refused("", &format!("{both}lift_direction = [0, 0]\n"), &[free], "has no direction");
        refused("", &format!("{given}lift_direction = [0, 1]\n"), &[free], "no lift to direct");
        let coupled = [("substeps = 10", "substeps = 10\n[stage.trajectory]\ndrag_area_m2 = 1.0")];
        refused("", "", &coupled, "its kind computes the motion otherwise");
        refused("", "[stage.perturbation]\n", &[], "no program runs");
        refused("flow_method = \"fitted\"\n", "", &[], "no program runs");
    }

    #[test]
    fn ends_and_altitudes_need_their_heights() {
        let end = "[stage.trajectory]\nend_height_m = 50.0\n";
        refused("", end, &[], "height of the release above ground is not given");
        let release = |height: &str| format!("reference_area_m2 = 4.0\nrelease_height_m = {height}");
        let (low, high) = (release("50.0"), release("60.0"));
        refused("", end, &[("reference_area_m2 = 4.0", &low)], "but the release is at 50 m");
        let scene_of = scene("", end, &[("reference_area_m2 = 4.0", &high)]).expect("a scene");
        assert_eq!(scene_of.release_height(), Some(60.0));
        refused("altitude_m = 100.0\n", "", &[], "runs no flow");
        let coupled = ("substeps = 10", "substeps = 10\naltitude_m = 100.0");
        refused("", "", &[coupled], "not that of an altitude");
        let altitude = ("[flow.solver]", "[flow]\naltitude_m = 3000.0\n[flow.solver]");
        let scene_of = scene("", "", &[coupled, altitude]).expect("a scene");
        let density = |k: usize| scene_of.for_stage(k).flow.expect("air").density_kg_m3;
        let at = |h: f64| crate::StandardAir::at(h).density_kg_m3;
        assert!(
            (density(1) / at(3000.0) - 1.0).abs() < 1e-12 && (density(2) / at(100.0) - 1.0).abs() < 1e-12
        );
        assert!((scene_of.density_at(-1000.0).expect("air") / at(2000.0) - 1.0).abs() < 1e-12);
    }

    /// The flow counts its own height, so that it would meet the wind of another one after a fall.
    #[test]
    fn flow_after_a_fall_through_sheared_wind_is_refused() {
        let shear = "[flow]\nwind_m_s = [2, 0, 0]\n[flow.shear]\nstart_height_m = 100.0\nprofile = \"power\"\n[flow.solver]";
        let later = "[[stage]]\nname = \"after\"\nkind = \"coupled\"\nduration_s = 0.1\nwindow_s = 5e-3\n";
        refused("", later, &[("[flow.solver]", shear)], "the wind of another height");
        let last = scene("", "", &[("[flow.solver]", shear)]).expect("a scene");
        assert_eq!(last.release_height(), Some(100.0 - 4.0 * 0.2));
    }
}
