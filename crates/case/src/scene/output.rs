//! `[output]`: snapshots, checkpoints and the folder of results.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::{Check, plain_name};

/// Snapshots and checkpoints.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Windows between ParaView snapshots of the canopy. 0: none.
    pub surface_every_windows: u32,
    /// Windows between ParaView snapshots of the flow. 0: none.
    pub volume_every_windows: u32,
    /// Windows between saved states within a stage, from which `ripstop run --resume` continues. 0: none
    /// but at the end of a stage and at Ctrl-C. Default: as often as costs 1 % of the time, at
    /// most twice a minute.
    pub checkpoint_every_windows: Option<u32>,
    /// Result folder. Default: `runs/<name>`.
    pub folder: Option<PathBuf>,
    /// Points of the canopy whose displacement is written after every window.
    #[serde(rename = "point")]
    pub points: Vec<CanopyPoint>,
}

/// A point of the canopy whose displacement is written after every window of a stage with the structure, to `points.csv` in the stage's folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CanopyPoint {
    /// Begins the names of its columns.
    pub name: String,
    /// The node of the canopy nearest to this point of the unstressed shape, m.
    pub at_m: [f64; 3],
}

/// Refuses points without a canopy, and names that are no columns.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let points = &scene.output.points;
    if !points.is_empty() && !scene.has_canopy() {
        c.refuse(
            "output.point",
            "the scene has no canopy",
            "remove it; points of the flow are [[flow.probe]]",
        );
    }
    for (k, p) in points.iter().enumerate() {
        let key = format!("output.point[{k}]");
        c.finite(&format!("{key}.at_m"), &p.at_m, "the position", "three in m");
        if !plain_name(&p.name) || points[..k].iter().any(|q| q.name == p.name) {
            c.refuse(
                &format!("{key}.name"),
                format!("\"{}\" begins the names of no columns, or of those of another point", p.name),
                "use letters, digits, `-`, `_` and `.`, and each name once",
            );
        }
    }
}

impl Default for Output {
    fn default() -> Self {
        Self {
            surface_every_windows: 4,
            volume_every_windows: 20,
            checkpoint_every_windows: None,
            folder: None,
            points: Vec::new(),
        }
    }
}
