//! A flow grid from a file.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A volume grid from a Gmsh file (format 4.1, ASCII or binary, first-order elements,
/// metres, falling frame) in the place of the generated one. It must fit around the
/// canopy as the flow's stages start with it, node by node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridFile {
    /// The file, from the scene's folder.
    pub path: PathBuf,
    /// Physical group of the faces that are the canopy: inside the volume, between two
    /// cells that share their nodes.
    #[serde(default = "canopy")]
    pub membrane: String,
    /// Condition on each physical group of outer faces.
    pub patches: BTreeMap<String, Condition>,
}

fn canopy() -> String {
    "canopy".into()
}

/// Condition on an outer boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// Undisturbed air far away.
    FarField,
    /// Gauge pressure of zero, the rest from inside.
    Outlet,
    /// No slip, moving with the grid.
    Wall,
    /// No flow through, no friction.
    Slip,
    /// Mirror plane.
    Symmetry,
}
