//! `[lines]`: material and drag of suspension lines and risers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fabric::safety_factor;
use crate::check::Check;
use crate::materials::required_without_material;
use crate::{LineMaterial, Scene};

/// Material of lines and risers.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = required_without_material)]
pub struct Lines {
    /// Line of the library: it gives the keys of this table that the scene leaves out. Absent: the scene gives them all.
    pub material: Option<LineMaterial>,
    /// Young's modulus ("cable stiffness"), Pa.
    pub youngs_modulus_pa: f64,
    /// Cross-sectional area, m2.
    pub area_m2: f64,
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Breaking force of a line, N. Absent: no safety factor.
    pub strength_n: Option<f64>,
    /// Safety factor that lines should have: strength over largest tension. Absent: 1.
    pub safety_factor: Option<f64>,
    /// Share of the work of stretching that a slow cycle from zero to a load and back does not return, at most 0.4. Absent: 0, elastic. Each stage
    /// starts as after a first loading; stages with `solve = "static"` have none.
    pub hysteresis: Option<f64>,
    /// Retardation time (Kelvin-Voigt), s: a stress of this time times the rate of the elastic stress is added to it, so that an oscillation of circular frequency
    /// w loses as with a loss factor of w times this time. It adds to `stage.stiffness_damping_s`. Explicit steps shrink with it.
    #[serde(default)]
    pub retardation_time_s: f64,
    /// A line that is shorter than its rest length carries nothing.
    #[serde(default = "yes")]
    pub tension_only: bool,
    /// Stress at rest length, Pa: a pulled line has a positive one.
    #[serde(default)]
    pub prestress_pa: f64,
    /// Drag of the air. Absent: none.
    pub drag: Option<LineDrag>,
}

fn yes() -> bool {
    true
}

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

impl Scene {
    /// Drag of the air on lines, where the scene has it.
    pub fn line_drag(&self) -> Option<&LineDrag> {
        self.lines.as_ref()?.drag.as_ref()
    }

    /// Whether the fabric returns less work than it took to stretch it.
    pub fn has_fabric_hysteresis(&self) -> bool {
        self.fabric.hysteresis.is_some_and(|share| share > 0.0)
    }

    /// Whether lines or risers return less work than it took to stretch them.
    pub fn has_hysteresis(&self) -> bool {
        let lines = self.lines.as_ref().and_then(|l| l.hysteresis);
        let risers = self.risers.and_then(|r| r.hysteresis);
        [lines, risers].into_iter().flatten().any(|share| share > 0.0)
    }
}

impl Scene {
    /// Largest retardation time of fabric, lines, risers and tapes, s.
    pub fn retardation_time_s(&self) -> f64 {
        let lines = self.lines.as_ref().map(|l| l.retardation_time_s);
        let risers = self.risers.map(|r| r.retardation_time_s);
        let tapes = self.tapes.iter().flat_map(|t| t.places()).map(|(_, tape)| tape.retardation_time_s);
        let groups = self.cable_groups().iter().map(|g| g.retardation_time_s);
        lines
            .into_iter()
            .chain(risers)
            .chain(tapes)
            .chain(groups)
            .fold(self.fabric.retardation_time_s, f64::max)
    }
}

/// Largest share of the work of stretching that lines or fabric may take.
pub const MOST_HYSTERESIS: f64 = 0.4;

/// Refuses a share of the work of stretching that no material takes.
pub(super) fn hysteresis(section: &str, share: Option<f64>, c: &mut Check) {
    if let Some(share) = share {
        let why = "a share of the work of stretching; the friction of the law reaches 0.4";
        c.range(&format!("{section}.hysteresis"), share, 0.0..=MOST_HYSTERESIS, why);
    }
}

/// Refuses a retardation time that no material has.
pub(super) fn retardation(section: &str, time: f64, c: &mut Check) {
    c.range(&format!("{section}.retardation_time_s"), time, 0.0..=10.0, "in seconds");
}

/// What the strength of a line is.
pub(super) const STRENGTH: &str = "a breaking force in N: 1 lb is 4.45 N";

/// Refuses invalid materials, and drag without air.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let Some(l) = &scene.lines else { return };
    c.positive("lines.youngs_modulus_pa", l.youngs_modulus_pa, 1e13, "a modulus in Pa");
    c.positive("lines.area_m2", l.area_m2, 0.1, "a cross-section in m2: is the value in square metres?");
    c.positive("lines.density_kg_m3", l.density_kg_m3, 30_000.0, "a density in kg/m3");
    if let Some(strength) = l.strength_n {
        c.positive("lines.strength_n", strength, 1e8, STRENGTH);
    }
    safety_factor("lines", l.safety_factor, l.strength_n.is_some(), "strength_n", c);
    hysteresis("lines", l.hysteresis, c);
    retardation("lines", l.retardation_time_s, c);
    let most = 0.5 * l.youngs_modulus_pa;
    c.range("lines.prestress_pa", l.prestress_pa, -most..=most, "at most half the modulus");
    if let Some(d) = &l.drag {
        drag(d, scene, c);
    }
}

fn drag(d: &LineDrag, scene: &Scene, c: &mut Check) {
    c.range("lines.drag.coefficient", d.coefficient, 0.0..=10.0, "1.1 for a cylinder");
    c.range("lines.drag.friction_coefficient", d.friction_coefficient, 0.0..=1.0, "of a wetted surface");
    if let Some(w) = d.diameter_m {
        c.positive("lines.drag.diameter_m", w, 1.0, "a diameter in metres");
    }
    match &scene.flow {
        Some(_) => super::descent::height_is_known(scene, "lines.drag", c),
        None => c.refuse(
            "lines.drag",
            "lines have drag in air, but the scene has none",
            "remove it, or add a [flow] section with the air",
        ),
    }
}
