//! `[[stage.body_motion]]`: rigid bodies that move as prescribed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::error::nearest;
use crate::{CANOPY, Condition, Flow, Formula, FormulaError, Scene, StageKind};

/// Prescribed motion of a rigid body, whose surface is patches of the flow grid or the canopy, in a stage of kind `prescribed`: a
/// rotation, then a displacement. The cells around it deform, the flow sees a wall with the velocity of the body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyMotion {
    /// Sides of `[flow.box]` or groups of `[flow.grid_file]` that move together, and `canopy`: the canopy in the shape that it has at the start of
    /// the stage. With all patches of the grid the whole grid moves with the body and no cell deforms.
    pub patches: Vec<String>,
    /// Displacement along x, y and z from the position at the start of the stage, m: formulas of `t`, the time since the start of
    /// the stage, s. Zero at `t` = 0. Absent: none.
    pub displacement_m: Option<[String; 3]>,
    /// Rotation about an axis. Absent: none.
    pub rotation: Option<BodyRotation>,
}

/// Rotation of a body about an axis that is displaced with it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyRotation {
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// A point of the axis at the start of the stage, m.
    pub point_m: [f64; 3],
    /// Angle, rad, right-handed about the axis: a formula of `t`, the time since the start of the stage, s. Zero at `t` = 0.
    pub angle_rad: String,
}

/// A rigid motion as a function of time.
#[derive(Clone, Debug)]
pub struct RigidMotion {
    displacement: Option<[Formula; 3]>,
    /// Angle, unit vector of the axis, a point of it at the start, m.
    rotation: Option<(Formula, [f64; 3], [f64; 3])>,
}

/// A rigid motion at one time.
///
/// # Examples
///
/// A quarter turn about z through (1, 0, 0), then 2 m along x:
///
/// ```
/// let motion = case::BodyMotion {
///     displacement_m: Some(["2*t", "0", "0"].map(String::from)),
///     rotation: Some(case::BodyRotation {
///         axis: [0.0, 0.0, 3.0],
///         point_m: [1.0, 0.0, 0.0],
///         angle_rad: "pi/2*t".into(),
///     }),
///     ..Default::default()
/// };
/// let pose = motion.compiled()?.at(1.0);
/// let [x, y, z] = pose.apply([2.0, 0.0, 0.5]);
/// assert!((x - 3.0).abs() < 1e-15 && (y - 1.0).abs() < 1e-15 && z == 0.5);
/// # Ok::<(), case::FormulaError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Displacement, m.
    pub displacement: [f64; 3],
    /// Angle, rad.
    pub angle: f64,
    axis: [f64; 3],
    point: [f64; 3],
}

impl BodyMotion {
    /// The motion as a function of time.
    ///
    /// # Errors
    /// A text is not a formula.
    pub fn compiled(&self) -> Result<RigidMotion, FormulaError> {
        let formula = |text: &String| Formula::parse(text, &["t"]);
        let displacement = match &self.displacement_m {
            Some([x, y, z]) => Some([formula(x)?, formula(y)?, formula(z)?]),
            None => None,
        };
        let rotation = match &self.rotation {
            Some(r) => {
                let length = r.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
                Some((formula(&r.angle_rad)?, r.axis.map(|x| x / length), r.point_m))
            }
            None => None,
        };
        Ok(RigidMotion { displacement, rotation })
    }
}

impl Scene {
    /// Whether `motion` moves the canopy as a rigid body: it names `canopy`, and that is no patch of the flow grid.
    pub fn moves_canopy(&self, motion: &BodyMotion) -> bool {
        let patch = self.flow.as_ref().is_some_and(|f| f.patches().iter().any(|p| p.0 == CANOPY));
        self.has_canopy() && !patch && motion.patches.iter().any(|p| p == CANOPY)
    }

    /// Whether `motion` moves patches of the flow grid.
    pub fn moves_patches(&self, motion: &BodyMotion) -> bool {
        let canopy = self.moves_canopy(motion);
        motion.patches.iter().any(|p| !canopy || p != CANOPY)
    }
}

impl RigidMotion {
    /// Whether the body rotates.
    pub fn rotates(&self) -> bool {
        self.rotation.is_some()
    }

    /// Displacement and rotation at `t`, s since the start of the stage.
    pub fn at(&self, t: f64) -> Pose {
        let displacement = self.displacement.as_ref().map_or([0.0; 3], |d| [0, 1, 2].map(|i| d[i].at(&[t])));
        let (angle, axis, point) = match &self.rotation {
            Some((angle, axis, point)) => (angle.at(&[t]), *axis, *point),
            None => (0.0, [0.0; 3], [0.0; 3]),
        };
        Pose { displacement, angle, axis, point }
    }

    /// Distance of a point from the axis of the rotation at the start of the stage, m; 0 without rotation.
    pub fn reach(&self, x: [f64; 3]) -> f64 {
        self.rotation.as_ref().map_or(0.0, |(_, axis, point)| distance_from_axis(x, *axis, *point))
    }

    /// Largest speed, m/s, of points within `reach` (m) of the axis, as the mean over each of `windows` windows of `window_s`
    /// seconds.
    pub fn largest_speed(&self, reach: f64, windows: u64, window_s: f64) -> f64 {
        let mut before = self.at(0.0);
        let mut fastest = 0.0f64;
        for t in sample_times(windows, window_s) {
            let now = self.at(t);
            let d = difference(now.displacement, before.displacement);
            let way = length(d) + reach * (now.angle - before.angle).abs();
            fastest = fastest.max(way);
            before = now;
        }
        fastest / window_s
    }
}

impl Pose {
    /// A rotation by `angle` (rad) about the unit vector `axis` through `point` (m), then a displacement (m).
    pub(super) fn new(displacement: [f64; 3], angle: f64, axis: [f64; 3], point: [f64; 3]) -> Self {
        Self { displacement, angle, axis, point }
    }

    /// A displacement (m) alone.
    pub(super) fn displaced(displacement: [f64; 3]) -> Self {
        Self::new(displacement, 0.0, [0.0; 3], [0.0; 3])
    }

    /// Whether all of it is finite.
    pub fn is_finite(&self) -> bool {
        self.displacement.iter().all(|d| d.is_finite()) && self.angle.is_finite()
    }

    /// Where the point is that was at `x` (m) at the start of the stage: exactly there where nothing moves.
    pub fn apply(&self, x: [f64; 3]) -> [f64; 3] {
        // Rodrigues' formula as a change of place: a x r sin(angle) + a x (a x r) (1 - cos(angle)).
        let r = difference(x, self.point);
        let first = cross(self.axis, r);
        let second = cross(self.axis, first);
        let (sine, half) = (self.angle.sin(), (0.5 * self.angle).sin());
        let turned = |i: usize| sine * first[i] + 2.0 * half * half * second[i];
        [0, 1, 2].map(|i| x[i] + (self.displacement[i] + turned(i)))
    }
}

/// Distance of `x` (m) from the axis along the unit vector `axis` through `point` (m).
pub(super) fn distance_from_axis(x: [f64; 3], axis: [f64; 3], point: [f64; 3]) -> f64 {
    length(cross(axis, difference(x, point)))
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn length(a: [f64; 3]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Ends of windows at which a motion is examined: all of them up to this number.
const SAMPLES: u64 = 100_000;

/// Ends of the windows of a stage, s: all of them, or the first [`SAMPLES`].
pub(super) fn sample_times(windows: u64, window_s: f64) -> impl Iterator<Item = f64> {
    (1..=windows.min(SAMPLES)).map(move |k| k as f64 * window_s)
}

/// Displacement, m, or angle, rad, at the start of a stage that counts as zero.
const ROUND_OFF: f64 = 1e-12;

/// Refuses motions of stage `k` that its bodies cannot have.
pub(super) fn check(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let stage = &scene.stages[k];
    if stage.body_motions.is_empty() {
        return;
    }
    if stage.kind != StageKind::Prescribed {
        c.refuse(
            &at("kind"),
            format!("stage \"{}\" moves a rigid body, which its kind does not", stage.name),
            "use kind = \"prescribed\", or remove its [[stage.body_motion]]",
        );
    }
    let patches_move = stage.body_motions.iter().any(|m| scene.moves_patches(m));
    if patches_move && scene.mesh.regrid.quality_threshold.is_some_and(|t| t != 0.0) {
        c.refuse(
            "mesh.regrid.quality_threshold",
            "a new grid is built around the canopy alone, but a rigid body moves too",
            "remove [mesh.regrid] or the [[stage.body_motion]]",
        );
    }
    if !stage.motions.is_empty() && stage.body_motions.iter().any(|m| scene.moves_canopy(m)) {
        c.refuse(
            &at("motion"),
            "the nodes of the canopy have two motions: one of their own and that of the canopy as a rigid body",
            "remove the [[stage.motion]], or \"canopy\" from `patches` of [[stage.body_motion]]",
        );
    }
    let Some(flow) = &scene.flow else { return };
    for (n, motion) in stage.body_motions.iter().enumerate() {
        let at = at(&format!("body_motion[{n}]"));
        patches(flow, scene.has_canopy(), &stage.body_motions[..n], motion, &at, c);
        formulas(scene, k, motion, &at, c);
    }
}

fn patches(flow: &Flow, canopy: bool, earlier: &[BodyMotion], motion: &BodyMotion, at: &str, c: &mut Check) {
    let mut known = flow.patches();
    if canopy && !known.iter().any(|p| p.0 == CANOPY) {
        known.push((CANOPY, Condition::Wall));
    }
    let at = format!("{at}.patches");
    if known.is_empty() {
        let what = "the generated grid has a far field only, no named patches";
        return c.refuse(
            &at,
            what,
            "use [flow.box] around a panel or [flow.grid_file], which name their patches",
        );
    }
    let names = || known.iter().map(|p| p.0).collect::<Vec<_>>();
    if motion.patches.is_empty() {
        c.refuse(
            &at,
            "the motion is that of no patch",
            format!("name patches among: {}", names().join(", ")),
        );
    }
    for (i, patch) in motion.patches.iter().enumerate() {
        let at = format!("{at}[{i}]");
        let Some((_, condition)) = known.iter().find(|p| p.0 == patch) else {
            let help = match nearest(patch, names()) {
                Some(near) => format!("did you mean \"{near}\"? The patches are: {}", names().join(", ")),
                None => format!("name one of: {}", names().join(", ")),
            };
            c.refuse(&at, format!("the flow grid has no patch \"{patch}\""), help);
            continue;
        };
        if motion.patches[..i].contains(patch) || earlier.iter().any(|m| m.patches.contains(patch)) {
            c.refuse(&at, format!("the patch \"{patch}\" has two motions in this stage"), "keep one of them");
        }
        let with_data = flow.moving_walls.iter().map(|w| &w.patch);
        let with_data = with_data.chain(flow.inlets.iter().map(|i| &i.patch)).any(|p| p == patch);
        if *condition == Condition::Periodic {
            c.refuse(
                &at,
                format!("the patch \"{patch}\" is periodic: it stays at rest"),
                "name other patches",
            );
        } else if with_data || *condition == Condition::Inlet {
            c.refuse(
                &at,
                format!("the patch \"{patch}\" has a velocity of its own, which is given where the grid is at rest"),
                "remove its [[flow.inlet]] or [[flow.moving_wall]], give it another condition than \"inlet\", or do not move it",
            );
        }
    }
}

fn formulas(scene: &Scene, k: usize, motion: &BodyMotion, at: &str, c: &mut Check) {
    if motion.rotation.is_some() && scene.flow.as_ref().is_some_and(Flow::is_periodic) {
        c.refuse(
            &format!("{at}.rotation"),
            "a rotation can move the nodes of a body on two periodic patches apart",
            "use `displacement_m` alone, rotate a surface of revolution by [[flow.moving_wall]], or choose another condition than \"periodic\"",
        );
    }
    if motion.displacement_m.is_none() && motion.rotation.is_none() {
        return c.refuse(at, "the body has no motion", "add `displacement_m` or `rotation`");
    }
    if let Some(r) = &motion.rotation {
        c.finite(&format!("{at}.rotation.point_m"), &r.point_m, "the point", "three numbers in m");
        let length = r.axis.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        if !(length > 0.0 && length.is_finite() && r.axis.iter().all(|x| x.is_finite())) {
            let axis = format!("{at}.rotation.axis");
            return c.refuse(&axis, "the axis has no direction", "name a vector, as [0, 0, 1]");
        }
    }
    let mut texts: Vec<(String, &String)> = Vec::new();
    for (i, text) in motion.displacement_m.iter().flatten().enumerate() {
        texts.push((format!("{at}.displacement_m[{i}]"), text));
    }
    texts.extend(motion.rotation.iter().map(|r| (format!("{at}.rotation.angle_rad"), &r.angle_rad)));
    let stage = &scene.stages[k];
    for (at, text) in texts {
        match Formula::parse(text, &["t"]) {
            Err(error) => {
                c.refuse(&at, error.to_string(), "write a formula of t, as \"0.1*sin(2*pi*3*t)\"");
            }
            Ok(formula) => values(&formula, text, stage.windows(), stage.window_s, &at, c),
        }
    }
}

/// Refuses a motion that jumps at the start of its stage, or is not finite at the end of a window.
fn values(formula: &Formula, text: &str, windows: u64, window_s: f64, at: &str, c: &mut Check) {
    let start = formula.at(&[0.0]);
    if start.is_finite() && start.abs() > ROUND_OFF {
        c.refuse(
            at,
            format!("`{text}` is {start} at t = 0: the body would jump there from its position at the start of the stage"),
            format!("subtract the value at t = 0, as \"{text} - ({start})\", or choose a motion that starts at zero"),
        );
    }
    let mut times = [0.0].into_iter().chain(sample_times(windows, window_s));
    if let Some(t) = times.find(|t| !formula.at(&[*t]).is_finite()) {
        let value = formula.at(&[t]);
        c.refuse(
            at,
            format!("`{text}` is {value} at t = {t} s, not a finite number"),
            "write a formula that is finite during the whole stage",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about_z(angle: &str) -> BodyMotion {
        let rotation =
            BodyRotation { axis: [0.0, 0.0, 2.0], point_m: [0.3, -0.2, 7.0], angle_rad: angle.into() };
        BodyMotion { rotation: Some(rotation), ..BodyMotion::default() }
    }

    #[test]
    fn rotation_is_right_handed_keeps_distances_and_is_exact_at_rest() {
        let motion = about_z("0.7*t").compiled().expect("formulas");
        let x = [1.1, 0.4, -3.0];
        assert_eq!(motion.at(0.0).apply(x), x);
        let (sin, cos) = 1.4f64.sin_cos();
        let exact = [0.3 + 0.8 * cos - 0.6 * sin, -0.2 + 0.8 * sin + 0.6 * cos, -3.0];
        let found = motion.at(2.0).apply(x);
        assert!(length(difference(found, exact)) < 1e-15, "{found:?} {exact:?}");
    }

    #[test]
    fn largest_speed_is_that_of_the_window_means() {
        let mut motion = about_z("2*t");
        motion.displacement_m = Some(["3*t", "0", "-4*t"].map(String::from));
        let speed = motion.compiled().expect("formulas").largest_speed(0.5, 10, 0.1);
        assert!((speed - 6.0).abs() < 1e-12, "{speed}");
    }
}
