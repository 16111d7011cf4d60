//! `[canopy]` of kind `gored`: gores around a crown vent.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canopy::{LENGTH, even, line_segments, one};
use super::canopy_risers::{self, CanopyRisers};
use crate::check::Check;

/// A canopy of gores: panels from the crown vent to the skirt, sewn along radial seams, each straight across in the constructed shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GoredCanopy {
    /// Constructed shape of the gores along their middle line.
    #[serde(default)]
    pub profile: GoreProfile,
    /// Nominal diameter D0, m: that of a circle with the area S0 of all gores, the vent included.
    pub nominal_diameter_m: f64,
    /// Number of gores (even), and of lines.
    pub gores: u32,
    /// Sections of the gores from the vent to the skirt, with `profile = "sections"`.
    #[serde(default, rename = "section")]
    pub sections: Vec<GoreSection>,
    /// Diameter of the crown vent between opposite seams, m. Absent: a tenth of the nominal diameter, 1 % of the area.
    pub vent_diameter_m: Option<f64>,
    /// Angle of the gores below the horizontal in the constructed shape of a conical canopy, degrees.
    pub cone_angle_deg: Option<f64>,
    /// Quadrilaterals across a gore (even).
    #[serde(default = "two")]
    pub cells_per_gore: u32,
    /// Quadrilaterals along a gore, shared by the sections of fabric by their length.
    pub cells_along: u32,
    /// Unstretched length of a line from the skirt to its confluence point, m.
    pub line_length_m: f64,
    /// Cable elements for each line.
    #[serde(default = "one")]
    pub segments_per_line: u32,
    /// Confluence points and risers. Absent: all lines run to one point at the payload.
    pub risers: Option<CanopyRisers>,
}

/// A section of the gores along their middle line. All gores of a canopy have the same sections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GoreSection {
    /// Length along the middle line, in any unit: lengths of all sections are scaled together until the area, openings included, is that of the
    /// nominal diameter.
    pub length: f64,
    /// Angle below the horizontal in the constructed shape, degrees: 0 for a part of a flat disk, 90 for a cylindrical band, above 90 for a skirt that
    /// runs inwards.
    #[serde(default)]
    pub angle_deg: f64,
    /// An opening without fabric, which radial tapes along the seams (`[tapes.seams]`) bridge.
    #[serde(default)]
    pub gap: bool,
    /// The upper edge is sewn to the section above at the seams only: between two edges of unequal fullness a crescent slot is open, as between the sails of a
    /// ringsail canopy.
    #[serde(default)]
    pub crescent_slot: bool,
    /// Fullness of the upper edge of a sail (trailing edge), as a share: 0.05 for an edge that is 5 % longer than the gore is wide there. It varies linearly along
    /// the section. The area of `nominal_diameter_m` is that of the gores without fullness.
    #[serde(default)]
    pub upper_fullness: f64,
    /// Fullness of the lower edge of a sail (leading edge), as a share.
    #[serde(default)]
    pub lower_fullness: f64,
}

impl GoredCanopy {
    /// Diameter of the vent, m: the scene's, or the default.
    pub fn vent_diameter(&self) -> f64 {
        self.vent_diameter_m.unwrap_or(0.1 * self.nominal_diameter_m)
    }

    /// Whether sails are open against each other between the seams.
    pub fn has_crescent_slots(&self) -> bool {
        self.sections.iter().any(|s| s.crescent_slot)
    }

    /// Nominal area S0 = pi D0^2 / 4 of all gores, vent and gaps included, m2.
    pub fn nominal_area(&self) -> f64 {
        0.25 * std::f64::consts::PI * self.nominal_diameter_m.powi(2)
    }
}

/// Constructed shape of gores along their middle line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GoreProfile {
    /// In one plane: a flat circular canopy.
    #[default]
    Flat,
    /// Straight, at `cone_angle_deg` below the horizontal.
    Conical,
    /// A quarter of a circle.
    Hemispherical,
    /// A chain of straight sections, `[[canopy.section]]`, with or without fabric.
    Sections,
}

fn two() -> u32 {
    2
}

/// Refuses gores that cannot be cut, sewn or meshed. `radials`: whether the seams have tapes.
pub(super) fn check(g: &GoredCanopy, radials: bool, c: &mut Check) {
    c.positive("canopy.nominal_diameter_m", g.nominal_diameter_m, 200.0, LENGTH);
    c.positive("canopy.line_length_m", g.line_length_m, 500.0, LENGTH);
    let diameter = g.nominal_diameter_m;
    c.positive(
        "canopy.vent_diameter_m",
        g.vent_diameter(),
        0.9 * diameter,
        "less than nine tenths of the canopy",
    );
    even("canopy.gores", g.gores, 4..=400, "gores", c);
    even("canopy.cells_per_gore", g.cells_per_gore, 2..=200, "cells across a gore", c);
    c.count("canopy.cells_along", g.cells_along, 2..=2000, "cells along a gore");
    line_segments(g.segments_per_line, c);
    if let Some(r) = &g.risers {
        canopy_risers::check(r, g.gores, g.line_length_m, diameter, c);
    }
    match (g.profile, g.cone_angle_deg) {
        (GoreProfile::Conical, Some(angle)) => {
            c.range(
                "canopy.cone_angle_deg",
                angle,
                1.0..=80.0,
                "degrees below the horizontal, 20 to 30 are usual",
            );
        }
        (GoreProfile::Conical, None) => c.refuse(
            "canopy.cone_angle_deg",
            "a conical canopy has no `cone_angle_deg`",
            "add it: degrees below the horizontal, 20 to 30 are usual",
        ),
        (_, Some(_)) => c.refuse(
            "canopy.cone_angle_deg",
            "`cone_angle_deg` belongs to profile = \"conical\"",
            "remove it, or set profile = \"conical\"",
        ),
        (_, None) => {}
    }
    sections(g, radials, c);
}

/// Refuses sections that cannot be sewn.
fn sections(g: &GoredCanopy, radials: bool, c: &mut Check) {
    let chain = g.profile == GoreProfile::Sections;
    if chain == g.sections.is_empty() {
        let (message, remedy) = if chain {
            (
                "profile = \"sections\" has no [[canopy.section]]",
                "add sections from the vent to the skirt, each with `length` and `angle_deg`",
            )
        } else {
            (
                "[[canopy.section]] belongs to profile = \"sections\"",
                "set profile = \"sections\", or remove the sections",
            )
        };
        c.refuse("canopy.section", message, remedy);
        return;
    }
    for (k, s) in g.sections.iter().enumerate() {
        c.positive(
            &format!("canopy.section[{k}].length"),
            s.length,
            1e4,
            "a length along the gore, in any unit",
        );
        let range = if k == 0 { 0.0..=80.0 } else { 0.0..=170.0 };
        let what = "degrees below the horizontal: 0 flat, 90 a cylindrical band; the section at the vent has at most 80";
        c.range(&format!("canopy.section[{k}].angle_deg"), s.angle_deg, range, what);
        fullness(k, s, c);
    }
    shared_edges(g, c);
    if let (Some(first), Some(last)) = (g.sections.first(), g.sections.last())
        && (first.gap || last.gap)
    {
        c.refuse(
            "canopy.section",
            "a gap is the first or the last section: no fabric bounds it",
            "leave it out; the crown vent is `vent_diameter_m`",
        );
    }
    let fabric = g.sections.iter().filter(|s| !s.gap).count();
    if chain && (g.cells_along as usize) < fabric {
        c.refuse(
            "canopy.cells_along",
            format!("{} cells along a gore for {fabric} sections of fabric", g.cells_along),
            format!("use at least {fabric}, better two for each section"),
        );
    }
    if !radials && (fabric < g.sections.len() || g.has_crescent_slots()) {
        c.refuse(
            "tapes.seams",
            "the canopy has gaps or slots, and no radial tapes hold the parts together",
            "add [tapes.seams] with the axial stiffness and mass of the radials",
        );
    }
}

/// Refuses the fullness of a section that no cloth has.
fn fullness(k: usize, s: &GoreSection, c: &mut Check) {
    for (key, share) in [("upper_fullness", s.upper_fullness), ("lower_fullness", s.lower_fullness)] {
        let path = format!("canopy.section[{k}].{key}");
        c.range(&path, share, 0.0..=0.5, "a share: 0.05 for a fullness of 5 %");
        if s.gap && share != 0.0 {
            c.refuse(
                &path,
                format!("section {k} is a gap, and has a fullness of {share}"),
                "remove it: a gap has no cloth",
            );
        }
    }
}

/// Refuses two values of the fullness on an edge that two sections share, and a slot between edges that leave none open.
fn shared_edges(g: &GoredCanopy, c: &mut Check) {
    for (k, s) in g.sections.iter().enumerate() {
        let path = |key: &str| format!("canopy.section[{k}].{key}");
        let above = k.checked_sub(1).map(|above| g.sections[above]).filter(|above| !above.gap && !s.gap);
        let Some(above) = above else {
            if s.crescent_slot {
                c.refuse(
                    &path("crescent_slot"),
                    format!("section {k} has no cloth on both sides of its upper edge"),
                    "remove it: the vent and gaps are open without it",
                );
            }
            continue;
        };
        let [lower, upper] = [above.lower_fullness, s.upper_fullness];
        if s.crescent_slot && lower == upper {
            c.refuse(
                &path("crescent_slot"),
                format!("sections {} and {k} both have a fullness of {upper} at the slot: it has no width", k - 1),
                "give the edges another fullness: the leading edge of the lower sail is usually straight, the trailing edge of the upper one full",
            );
        }
        if !s.crescent_slot && lower != upper {
            c.refuse(
                &path("upper_fullness"),
                format!("sections {} and {k} share an edge, and have a fullness of {lower} and {upper} there", k - 1),
                "give both the same, open a slot between them with `crescent_slot = true`, or put a section with `gap = true` between them",
            );
        }
    }
}
