//! `[canopy.risers]`: confluence points of groups of lines, and risers from there to the payload.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Canopy;
use super::canopy::LENGTH;
use crate::Scene;
use crate::check::Check;

/// Risers of a canopy of gores, of a cross or of a canopy from a pattern file. Lines in the order of the skirt form groups of equal size; each group joins in a confluence point (connector link),
/// from which a riser runs to the payload. `[risers]` gives the section of the risers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CanopyRisers {
    /// Number of risers and of confluence points. It divides the number of lines.
    pub count: u32,
    /// Unstretched length of a riser from its confluence point to the payload, m.
    pub length_m: f64,
    /// Diameter of the horizontal circle at the payload on which the risers are attached, each below the middle of its lines, m. 0: all at one point. A payload
    /// with `[descent.body]` has its own `attachments_m` instead.
    #[serde(default)]
    pub spread_m: f64,
}

impl Canopy {
    /// `[canopy.risers]`, where the canopy has it.
    pub fn risers(&self) -> Option<&CanopyRisers> {
        match self {
            Canopy::Gored(g) => g.risers.as_ref(),
            Canopy::Cross(x) => x.risers.as_ref(),
            Canopy::Pattern(p) => p.risers.as_ref(),
            _ => None,
        }
    }
}

/// Refuses risers that no group of `lines` lines of `line_length` (m) can have. `width`: of the canopy, m.
pub(super) fn check(r: &CanopyRisers, lines: u32, line_length: f64, width: f64, c: &mut Check) {
    c.count("canopy.risers.count", r.count, 1..=400, "risers");
    c.positive("canopy.risers.length_m", r.length_m, 500.0, LENGTH);
    c.range(
        "canopy.risers.spread_m",
        r.spread_m,
        0.0..=width,
        "a diameter in metres, less than the canopy's",
    );
    if r.count > 0 && !lines.is_multiple_of(r.count) {
        let divisors: Vec<_> =
            (1..=lines.min(12)).filter(|n| lines.is_multiple_of(*n)).map(|n| n.to_string()).collect();
        c.refuse(
            "canopy.risers.count",
            format!("{lines} lines cannot be shared by {} risers", r.count),
            format!("use a number that divides the lines: {}", divisors.join(", ")),
        );
    }
    if r.length_m >= line_length {
        c.refuse(
            "canopy.risers.length_m",
            format!("risers of {} m are as long as the lines ({line_length} m)", r.length_m),
            "give the length from the confluence point to the payload; `line_length_m` is that from the skirt to the confluence point",
        );
    }
    if r.count == 1 && r.spread_m > 0.0 {
        c.refuse(
            "canopy.risers.spread_m",
            format!("one riser has no attachment points {} m apart", r.spread_m),
            "remove it, or use more risers",
        );
    }
}

/// Refuses risers without a section, a section without risers, and two places of their attachments.
pub(crate) fn check_section(scene: &Scene, c: &mut Check) {
    let risers = scene.canopy.risers();
    let can_have = matches!(scene.canopy, Canopy::Gored(_) | Canopy::Cross(_) | Canopy::Pattern(_));
    if can_have && risers.is_none() && scene.risers.is_some() {
        c.refuse(
            "risers",
            "the canopy has no risers: all lines run to one point",
            "add [canopy.risers] with `count` and `length_m`, or remove [risers]",
        );
    }
    let Some(r) = risers else { return };
    if scene.risers.is_none() {
        c.refuse(
            "canopy.risers",
            format!("the scene has {} risers but no [risers]", r.count),
            "add [risers] with a material, or with `axial_stiffness_n` and `mass_kg_m`: a riser carries a group of lines",
        );
    }
    if r.spread_m > 0.0 && scene.payload_body().is_some() {
        c.refuse(
            "canopy.risers.spread_m",
            "`canopy.risers.spread_m` and `descent.body.attachments_m` both place the lower ends of the risers",
            "remove `spread_m`; list an attachment for each riser",
        );
    }
}
