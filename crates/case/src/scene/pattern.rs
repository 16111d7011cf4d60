//! `[canopy]` of kind `pattern`: flat panels sewn along their edges.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canopy::{LENGTH, line_segments, one};
use super::canopy_risers::{self, CanopyRisers};
use crate::Scene;
use crate::check::Check;

/// A canopy sewn from flat panels. The pattern file has the outlines of the panels, the seams, where lines are attached and where tapes run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PatternCanopy {
    /// The pattern file, from the scene's folder.
    pub file: PathBuf,
    /// Length of the edges of the triangles, m. Edges of panels are divided equally into parts of at most this length, equally many on both sides of a seam.
    pub element_size_m: f64,
    /// Unstretched length of a line from its attachment to its confluence point, m. Absent: the pattern has no attachments.
    pub line_length_m: Option<f64>,
    /// Cable elements for each line.
    #[serde(default = "one")]
    pub segments_per_line: u32,
    /// Confluence points and risers. Absent: all lines run to one point at the payload.
    pub risers: Option<CanopyRisers>,
}

/// Refuses what no pattern can have; the file itself is judged where it is meshed.
pub(super) fn check(p: &PatternCanopy, scene: &Scene, c: &mut Check) {
    if !p.file.is_file() {
        c.refuse(
            "canopy.file",
            format!("the pattern file {} does not exist", p.file.display()),
            "name a pattern file (TOML) by its path from the scene's folder",
        );
    }
    c.positive("canopy.element_size_m", p.element_size_m, 200.0, LENGTH);
    line_segments(p.segments_per_line, c);
    if let Some(length) = p.line_length_m {
        c.positive("canopy.line_length_m", length, 500.0, LENGTH);
    }
    match (&p.risers, p.line_length_m) {
        // How many lines there are is in the file.
        (Some(r), Some(length)) => canopy_risers::check(r, r.count, length, 200.0, c),
        (Some(_), None) => c.refuse(
            "canopy.risers",
            "the canopy has risers and no lines",
            "add canopy.line_length_m, and attachments to the pattern file",
        ),
        (None, _) => {}
    }
    if scene.fabric.orthotropic.as_ref().is_some_and(|o| o.direction.is_some()) {
        c.refuse(
            "fabric.orthotropic.direction",
            "each panel of a pattern has a warp of its own",
            "remove `direction`; set `warp_deg` of the panels in the pattern file",
        );
    }
}
