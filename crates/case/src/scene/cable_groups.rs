//! `[[canopy.cable]]`: kinds of cables in a mesh file, by its physical groups.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lines::retardation;
use crate::check::Check;

/// Cables of a physical group of curves of the mesh file, with a section of their own. Curves of a group that is not listed are cables where the group is named `lines`,
/// `risers` or `reinforcements`, with the section of `[lines]` or `[risers]`, at the length of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CableGroup {
    /// Name of the physical group.
    pub group: String,
    /// What the cables are: it decides where their mass and tension are reported, and whether the air of `[lines.drag]` acts on them.
    pub part: CablePart,
    /// Axial stiffness EA: force for a strain of 1, N.
    pub axial_stiffness_n: f64,
    /// Mass for each metre of unstretched length, kg/m.
    pub mass_kg_m: f64,
    /// Unstretched length over the length in the file.
    #[serde(default = "one")]
    pub rest_length_factor: f64,
    /// Tension at the unstretched length, N.
    #[serde(default)]
    pub pretension_n: f64,
    /// Cables that are shorter than their unstretched length carry nothing.
    #[serde(default = "yes")]
    pub tension_only: bool,
    /// As `lines.retardation_time_s`: retardation time (Kelvin-Voigt), s.
    #[serde(default)]
    pub retardation_time_s: f64,
}

/// Part of the canopy that the cables of a group are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CablePart {
    /// Suspension lines.
    Line,
    /// Risers.
    Riser,
    /// Tapes and bands along the fabric.
    Reinforcement,
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

/// Refuses sections that no cable has and groups that are listed twice.
pub(super) fn check(groups: &[CableGroup], c: &mut Check) {
    for (k, g) in groups.iter().enumerate() {
        let key = |name: &str| format!("canopy.cable[{k}].{name}");
        if g.group.is_empty() || groups[..k].iter().any(|other| other.group == g.group) {
            c.refuse(
                &key("group"),
                format!("the physical group \"{}\" has no name, or is listed twice", g.group),
                "name each group of curves once",
            );
        }
        c.positive(
            &key("axial_stiffness_n"),
            g.axial_stiffness_n,
            1e9,
            "an axial stiffness EA in N: modulus times cross-section",
        );
        c.positive(
            &key("mass_kg_m"),
            g.mass_kg_m,
            10.0,
            "a mass for each metre in kg/m: is the value in kilograms, not grams?",
        );
        c.range(
            &key("rest_length_factor"),
            g.rest_length_factor,
            0.01..=100.0,
            "unstretched length over length in the file",
        );
        let most = 0.5 * g.axial_stiffness_n;
        c.range(&key("pretension_n"), g.pretension_n, -most..=most, "at most half the axial stiffness");
        retardation(&format!("canopy.cable[{k}]"), g.retardation_time_s, c);
    }
}
