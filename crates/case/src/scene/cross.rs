//! `[canopy]` of kind `cross`: two flat panels.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canopy::{LENGTH, even_cells, line_segments, one};
use super::canopy_risers::{self, CanopyRisers};
use crate::check::Check;

/// A flat cross of two equal rectangular panels whose middles overlap in one square layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrossCanopy {
    /// Width W of a panel, m.
    pub panel_width_m: f64,
    /// Length L of a panel from one end to the other, m. The constructed area is S0 = 2 L W - W^2.
    pub panel_length_m: f64,
    /// Quadrilaterals across a panel (even).
    pub cells_across: u32,
    /// Quadrilaterals along an arm.
    pub cells_along_arm: u32,
    /// Lines from the end of each arm.
    pub lines_per_arm: u32,
    /// Unstretched length of a line from the end of an arm to its confluence point, m.
    pub line_length_m: f64,
    /// Cable elements for each line.
    #[serde(default = "one")]
    pub segments_per_line: u32,
    /// Confluence points and risers. Absent: all lines run to one point at the payload.
    pub risers: Option<CanopyRisers>,
}

/// Refuses crosses that cannot be cut, rigged or meshed.
pub(super) fn check(x: &CrossCanopy, c: &mut Check) {
    c.positive("canopy.panel_width_m", x.panel_width_m, 200.0, LENGTH);
    c.positive("canopy.panel_length_m", x.panel_length_m, 200.0, LENGTH);
    c.positive("canopy.line_length_m", x.line_length_m, 500.0, LENGTH);
    even_cells(x.cells_across, c);
    c.count("canopy.cells_along_arm", x.cells_along_arm, 1..=2000, "cells along an arm");
    c.count("canopy.lines_per_arm", x.lines_per_arm, 2..=1000, "lines from the end of an arm");
    line_segments(x.segments_per_line, c);
    if let Some(r) = &x.risers {
        canopy_risers::check(r, 4 * x.lines_per_arm, x.line_length_m, x.panel_length_m, c);
    }
    if x.panel_length_m <= x.panel_width_m {
        c.refuse(
            "canopy.panel_length_m",
            format!(
                "a panel of {} m is not longer than wide ({} m): no arms",
                x.panel_length_m, x.panel_width_m
            ),
            "give the length from one end of the panel to the other; usual are 3 to 4 widths",
        );
    }
    if x.lines_per_arm > x.cells_across + 1 {
        c.refuse(
            "canopy.lines_per_arm",
            format!(
                "{} lines do not fit on the {} nodes at the end of an arm",
                x.lines_per_arm,
                x.cells_across + 1
            ),
            "use fewer lines or more cells across",
        );
    }
    let reach = 0.5 * x.panel_length_m.hypot(x.panel_width_m);
    if x.line_length_m <= reach {
        c.refuse(
            "canopy.line_length_m",
            format!(
                "lines of {} m cannot reach from the ends of the arms to a point below the middle",
                x.line_length_m
            ),
            format!("make them longer than {reach:.3} m; usual are 1 to 1.2 panel lengths"),
        );
    }
}
