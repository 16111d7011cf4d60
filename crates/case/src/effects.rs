//! Effects of lines, payload and skirt that a scene may ask for.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Drag of the air on suspension lines and risers, each segment a cylinder in cross flow
/// (`F/L = 1/2 rho d C |w_n| w_n` with the part `w_n` of the relative air velocity across it).
/// The air is that of the far field; the canopy's own flow around the lines is left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LineDrag {
    /// Drag coefficient of the cylinder across the flow; 1.1 is that of a long round one at
    /// Reynolds numbers from 1e3 to 1e5 (Hoerner 1965, chapter 3).
    pub coefficient: f64,
    /// Friction coefficient along the line, on its wetted surface.
    pub friction_coefficient: f64,
    /// Diameter, m. Absent: that of a round line of `lines.area_m2`.
    pub diameter_m: Option<f64>,
}

impl Default for LineDrag {
    fn default() -> Self {
        Self { coefficient: 1.1, friction_coefficient: 0.0, diameter_m: None }
    }
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
}

/// Contact of the fabric with itself: nodes keep a distance from faces that they are not part
/// of, by a penalty. The structure runs on one rank.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Distance that is kept, m: well below an edge of the mesh, and far enough that fabric does
    /// not cross it within a step.
    pub distance_m: f64,
    /// Stiffness of a node in contact in shares of the fabric's own (modulus times thickness).
    #[serde(default = "quarter")]
    pub stiffness: f64,
}

fn quarter() -> f64 {
    0.25
}

/// A reefing line: a closed line through the skirt, where the suspension lines are attached,
/// of the material of `[lines]`; it pulls only. It has no inertia.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reefing {
    /// Its whole length, m.
    pub length_m: f64,
    /// Time over which it is drawn in from the length of the unstressed skirt, s from the
    /// start of the first stage.
    #[serde(default)]
    pub draw_in_s: f64,
    /// Stage in which it is cut. Absent: it holds to the end.
    pub release_stage: Option<String>,
    /// When it is cut, s from the start of that stage.
    #[serde(default)]
    pub release_s: f64,
    /// Time over which its force fades when it is cut, s.
    #[serde(default)]
    pub release_ramp_s: f64,
}
