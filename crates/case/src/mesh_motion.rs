//! What a moving grid may do beside following the canopy.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the nodes of the outer boundary do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OuterBoundary {
    /// They stay.
    #[default]
    Fixed,
    /// They move within the plane of their faces, along the edge between two planes, and not
    /// at all where three planes meet or faces are no plane.
    Sliding,
}

/// When a new grid takes the place of the moved one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Regrid {
    /// A new grid is built around the canopy where the smallest scaled Jacobian is below this.
    pub below: f64,
    /// Longest way of a node to its place in the new grid in one window, in shares of the
    /// shortest cell edge around it: the flow follows the grid there as it follows any motion.
    #[serde(default = "Regrid::default_step")]
    pub step: f64,
}

impl Regrid {
    fn default_step() -> f64 {
        0.25
    }
}
