//! `[output]`: snapshots, checkpoints and the folder of results.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::nodes::selection;
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
    /// Groups of nodes whose reactions are written after every window.
    #[serde(rename = "reaction")]
    pub reactions: Vec<Reaction>,
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

/// Force and moment that hold nodes or move them as prescribed, after every window of a stage with the structure, in `reactions.csv` in the stage's
/// folder. Only held or prescribed components count: a free node has no reaction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reaction {
    /// Begins the names of its columns.
    pub name: String,
    /// Name of a node set: `held`, `rim`, `canopy`, an edge of a panel (`left` and `right` at low and high x, `front` and `back` at low and high y), or a
    /// physical group of the mesh file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Point about which the moment is taken, in the falling frame, m. Absent: the centroid of the nodes in the unstressed shape.
    pub moment_point_m: Option<[f64; 3]>,
}

/// Refuses groups without nodes or a canopy, and names that are no columns.
fn reactions(scene: &Scene, c: &mut Check) {
    let all = &scene.output.reactions;
    if !all.is_empty() && !scene.has_canopy() {
        c.refuse("output.reaction", "the scene has no canopy, and nothing that is held", "remove it");
    }
    for (k, r) in all.iter().enumerate() {
        let key = format!("output.reaction[{k}]");
        selection(&key, &r.nodes, &r.at_m, c);
        let points = r.at_m.iter().chain(&r.moment_point_m).flatten().copied().collect::<Vec<_>>();
        c.finite(&key, &points, "a point", "three in m");
        if !plain_name(&r.name) || all[..k].iter().any(|q| q.name == r.name) {
            c.refuse(
                &format!("{key}.name"),
                format!("\"{}\" begins the names of no columns, or of those of another group", r.name),
                "use letters, digits, `-`, `_` and `.`, and each name once",
            );
        }
    }
}

/// Refuses points without a canopy, and names that are no columns.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    reactions(scene, c);
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
            reactions: Vec::new(),
        }
    }
}
