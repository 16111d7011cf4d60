//! `[descent]`: the falling mass, and what the air does to it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{GAS_CONSTANT, HEAT_RATIO, Role, Scene, StageKind};

/// The falling mass: one degree of freedom (paper, equation 9), or three.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Descent {
    /// Mass of the payload, kg. Fabric and lines are added.
    pub payload_mass_kg: f64,
    /// Descent speed at the start, m/s, positive downwards.
    pub initial_speed_m_s: f64,
    /// Horizontal velocity at the start, m/s, of a frame that moves in all directions: that of an aircraft, or of a steady
    /// glide.
    #[serde(default)]
    pub initial_drift_m_s: [f64; 2],
    /// Height of the payload above ground at the start of the first stage of kind `coupled` or `trajectory`, m: the run ends when it
    /// touches down. Absent: it falls for the duration of the stages.
    pub release_height_m: Option<f64>,
    /// Directions in which the frame follows the payload. Absent: `three-dimensional` with `[descent.body]`, else `vertical`.
    pub motion: Option<FrameMotion>,
    /// Acceleration of gravity, m/s2.
    #[serde(default = "standard_gravity")]
    pub gravity_m_s2: f64,
    /// Area that turns drag into a coefficient, m2.
    pub reference_area_m2: f64,
    /// Equation of the falling frame.
    #[serde(default)]
    pub equation: DescentEquation,
    /// Drag of the air on the payload. Absent: none.
    pub payload_drag: Option<PayloadDrag>,
    /// The payload as a rigid body on its lines. Absent: a point that falls with the frame.
    pub body: Option<PayloadBody>,
}

/// Acceleration of gravity, m/s2 (ISO 80000-3).
pub(crate) const STANDARD_GRAVITY: f64 = 9.80665;

fn standard_gravity() -> f64 {
    STANDARD_GRAVITY
}

/// Equation of the falling frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DescentEquation {
    /// The momentum of the whole system: the frame is fixed to the payload, which accelerates under the mean force of
    /// the lines over the window, its drag and its weight.
    #[default]
    Momentum,
    /// The paper's equation 9: the force of the air on the canopy at the end of the window acts on the frame. It is
    /// the limit in which the canopy has no acceleration of its own in the frame.
    QuasiSteady,
}

/// Directions in which the frame follows the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FrameMotion {
    /// Downwards and upwards. A payload that is a point is held sideways, as on a rail; a body moves sideways in the frame
    /// and, with its canopy, out of the grid.
    Vertical,
    /// In all directions: the payload glides and drifts with its canopy, and the grid with both.
    ThreeDimensional,
}

/// Drag of the air on the payload: `F = 1/2 rho (C A) |w| w` with the velocity `w` of the air
/// past it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PayloadDrag {
    /// Drag area: coefficient times area, m2.
    pub drag_area_m2: f64,
}

/// The payload as a rigid body with six degrees of freedom, free in coupled stages: the
/// lines pull at its attachments. In other stages it is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PayloadBody {
    /// Principal moments of inertia about its centre of mass, kg m2; its axes are those of
    /// the scene at the start.
    pub inertia_kg_m2: [f64; 3],
    /// Points where lines are attached, from its centre of mass, m. Lines that end at the payload (risers, where the
    /// canopy has them) take them in turn, in the order of the rim, and start again at the first one when the list
    /// ends. List one point for each of those lines in that order, with a point repeated for lines that share it, or a
    /// single point; more points than lines are refused.
    pub attachments_m: Vec<[f64; 3]>,
    /// Velocity of the payload in the frame when it is first free, m/s.
    #[serde(default)]
    pub initial_velocity_m_s: [f64; 3],
    /// Angular velocity of the payload when it is first free, about its axes, rad/s.
    #[serde(default)]
    pub initial_spin_rad_s: [f64; 3],
    /// Attitude of the payload when it is first free: a rotation vector about its centre of mass in the axes of the scene (axis
    /// times angle, right-handed), degrees. In the first stage of kind `pre-inflation` its attachments turn there along half a
    /// cosine in half the duration; without such a stage they are there from the start, with the lines that ends so far away have.
    #[serde(default)]
    pub initial_rotation_deg: [f64; 3],
}

impl PayloadBody {
    /// Rotation vector at the release, rad.
    pub fn initial_rotation_rad(&self) -> [f64; 3] {
        self.initial_rotation_deg.map(f64::to_radians)
    }

    /// Whether the payload is released at another attitude than that of its axes.
    pub fn is_released_turned(&self) -> bool {
        self.initial_rotation_deg != [0.0; 3]
    }
}

impl Descent {
    /// Directions in which the frame follows the payload.
    pub fn frame_motion(&self) -> FrameMotion {
        let free = if self.body.is_some() { FrameMotion::ThreeDimensional } else { FrameMotion::Vertical };
        self.motion.unwrap_or(free)
    }
}

impl Scene {
    /// The payload as a rigid body, where the scene has one.
    pub fn payload_body(&self) -> Option<&PayloadBody> {
        self.descent.as_ref()?.body.as_ref()
    }

    /// Whether a frame at this position (m, relative to its release) has reached the ground.
    pub fn has_landed(&self, position: [f64; 3]) -> bool {
        let height = self.descent.as_ref().and_then(|d| d.release_height_m);
        height.is_some_and(|height| position[2] <= -height)
    }

    /// Height of the release above ground, m: as given, or as the wind by height has it.
    pub fn release_height(&self) -> Option<f64> {
        let d = self.descent.as_ref()?;
        let by_shear = || self.shear().map(|s| s.start_height_m - fall_before_release(self, d));
        d.release_height_m.or_else(by_shear)
    }

    /// Whether the frame moves in all directions.
    pub fn frame_drifts(&self) -> bool {
        self.descent.as_ref().is_some_and(|d| d.frame_motion() == FrameMotion::ThreeDimensional)
    }

    /// Drag of the air on the payload, where the scene has it.
    pub fn payload_drag(&self) -> Option<&PayloadDrag> {
        self.descent.as_ref()?.payload_drag.as_ref()
    }
}

/// Refuses invalid masses, free streams outside the range of the flow solver, and payloads that cannot move.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    if let Some(d) = &scene.descent {
        magnitudes(d, c);
    }
    mach(scene, c);
    let Some(d) = &scene.descent else { return };
    if let (Some(height), Some(shear)) = (d.release_height_m, scene.shear()) {
        heights(height, shear.start_height_m - fall_before_release(scene, d), c);
    }
    if let Some(p) = &d.payload_drag {
        c.positive("descent.payload_drag.drag_area_m2", p.drag_area_m2, 1e4, "an area in m2");
        height_is_known(scene, "descent.payload_drag", c);
    }
    if let Some(b) = &d.body {
        shape_of_body(b, c);
        freedom_of_body(scene, b, c);
    }
}

/// Way that the frame falls in stages with flow before the first coupled one, m: the wind by height is that of its height.
fn fall_before_release(scene: &Scene, d: &Descent) -> f64 {
    let before =
        scene.stages.iter().take_while(|s| !matches!(s.kind, StageKind::Coupled | StageKind::Trajectory));
    let flows = before.filter(|s| s.kind.roles().contains(&Role::Flow) && s.in_time());
    d.initial_speed_m_s * flows.map(|s| s.duration_s).sum::<f64>()
}

/// Refuses a `height` of the release other than that `by_shear`, m, at which the wind by height is at that time.
fn heights(height: f64, by_shear: f64, c: &mut Check) {
    if (height - by_shear).abs() > 1e-3 * height {
        c.refuse(
            "descent.release_height_m",
            format!("the release is {height} m above ground, but the wind is then that of {by_shear:.3} m"),
            "flow.shear.start_height_m is the height when the first stage with flow begins; the frame falls with \
             initial_speed_m_s in the stages before the release: let both meet at the release",
        );
    }
}

/// Refuses drag by `key` in a wind by height where the frame falls with the flow alone after its release: the height counts from the release,
/// over coupled stages.
pub(super) fn height_is_known(scene: &Scene, key: &str, c: &mut Check) {
    let later = scene.stages.iter().skip_while(|s| s.kind != StageKind::Coupled);
    let alone = later
        .filter(|s| s.in_time())
        .find(|s| s.kind.roles().contains(&Role::Flow) && s.kind != StageKind::Coupled);
    if let (Some(stage), true) = (alone, scene.shear().is_some()) {
        c.refuse(
            key,
            format!(
                "the wind changes with height, and the height of lines and payload is not known after stage \"{}\", in which the frame \
                 falls without them",
                stage.name
            ),
            "remove that stage, this drag or [flow.shear]",
        );
    }
}

fn magnitudes(d: &Descent, c: &mut Check) {
    c.positive("descent.payload_mass_kg", d.payload_mass_kg, 1e6, "a mass in kg");
    let speed = "positive downwards, m/s";
    c.range("descent.initial_speed_m_s", d.initial_speed_m_s, 0.0..=1000.0, speed);
    if let Some(height) = d.release_height_m {
        c.positive("descent.release_height_m", height, 1e5, "above ground, m");
    }
    for drift in d.initial_drift_m_s {
        c.range("descent.initial_drift_m_s", drift, -1000.0..=1000.0, "horizontal, m/s");
    }
    if d.frame_motion() == FrameMotion::Vertical && d.initial_drift_m_s != [0.0; 2] {
        c.refuse(
            "descent.initial_drift_m_s",
            "the frame moves vertically, so that it cannot drift",
            "set descent.motion = \"three-dimensional\", or remove the drift; a wind is `flow.wind_m_s`",
        );
    }
    c.range("descent.gravity_m_s2", d.gravity_m_s2, 0.0..=1000.0, "in m/s2");
    c.positive("descent.reference_area_m2", d.reference_area_m2, 1e6, "an area in m2");
}

/// Speeds that the flow is not made for: of the fall, the wind and the gusts of any stage.
fn mach(scene: &Scene, c: &mut Check) {
    let Some(flow) = &scene.flow else { return };
    let length = |v: &[f64; 3]| v.iter().map(|w| w * w).sum::<f64>().sqrt();
    let sound = (HEAT_RATIO * GAS_CONSTANT * flow.temperature_k).sqrt();
    let fall = length(&scene.resolved().initial_velocity_m_s);
    let most = |stage: usize| {
        let steady = scene.stages[stage].wind.as_ref().map_or(flow.wind_m_s, |w| w.velocity_m_s);
        let gust = scene.gust(stage).map_or(0.0, |(g, _)| g.largest_speed());
        length(&steady) + gust + scene.perturbation(stage).map_or(0.0, |p| p.largest_speed())
    };
    let speed = fall + (0..scene.stages.len()).map(most).fold(0.0, f64::max);
    if speed > 0.5 * sound {
        c.refuse(
            "descent.initial_speed_m_s",
            format!("the stream is {speed} m/s, Mach {:.2}", speed / sound),
            "the flow-solver is made for Mach numbers below 0.5",
        );
    }
}

const BODY: &str = "descent.body";

fn shape_of_body(b: &PayloadBody, c: &mut Check) {
    let path = format!("{BODY}.inertia_kg_m2");
    for value in b.inertia_kg_m2 {
        c.positive(&path, value, 1e9, "a moment of inertia in kg m2");
    }
    let [x, y, z] = b.inertia_kg_m2;
    if x + y < z || y + z < x || z + x < y {
        c.refuse(
            &path,
            format!("no body has the moments of inertia {x}, {y} and {z}"),
            "each is at most the sum of the other two",
        );
    }
    let turn = b.initial_rotation_deg.iter().map(|x| x * x).sum::<f64>().sqrt();
    c.range(
        &format!("{BODY}.initial_rotation_deg"),
        turn,
        0.0..=180.0,
        "the angle of the rotation vector, degrees",
    );
    let finite = b.attachments_m.iter().all(|a| a.iter().all(|v| v.is_finite() && v.abs() < 100.0));
    if b.attachments_m.is_empty() || !finite {
        c.refuse(
            &format!("{BODY}.attachments_m"),
            format!(
                "the payload has {} attachments, or one of them is no position on it",
                b.attachments_m.len()
            ),
            "list at least one point in metres from its centre of mass",
        );
    }
}

/// A payload moves on lines, in a frame that all masses feel, in stages that let it.
fn freedom_of_body(scene: &Scene, b: &PayloadBody, c: &mut Check) {
    if !scene.may_have_cables() {
        c.refuse(BODY, "no line holds the payload", "give the canopy lines, or remove [descent.body]");
    }
    if scene.fabric_gravity.is_none() {
        c.refuse(
            BODY,
            "a payload that moves in the falling frame needs the inertia of fabric and lines in that frame too",
            "add [fabric_gravity]",
        );
    }
    if scene.frame_drifts() && b.initial_velocity_m_s != [0.0; 3] {
        c.refuse(
            &format!("{BODY}.initial_velocity_m_s"),
            "the frame follows the payload in all directions, so that the payload has no velocity in it",
            "remove it; the velocity of payload and canopy is descent.initial_drift_m_s and descent.initial_speed_m_s. For a payload \
             that moves in the frame set descent.motion = \"vertical\"",
        );
    }
    let moves = |m: &crate::Motion| m.nodes.as_deref().is_some_and(|n| ["payload", "held"].contains(&n));
    if b.is_released_turned() && scene.stages.iter().flat_map(|s| &s.motions).any(moves) {
        c.refuse(
            &format!("{BODY}.initial_rotation_deg"),
            "a [[stage.motion]] moves the attachments, which the rotation moves too",
            "remove that motion or the rotation",
        );
    }
    if !scene.stages.iter().any(|s| s.kind == StageKind::Coupled) {
        c.refuse(BODY, "the payload is free in coupled stages only, and the scene has none", "remove it");
    }
}
