//! How the structure's motion is integrated in time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Time integration of the structure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Integration {
    /// Newmark (the paper's) or generalized-alpha: a substep is one step, with equations to
    /// solve.
    #[default]
    Implicit,
    /// Central differences on a lumped mass: each substep is divided into as many steps
    /// as stability asks for, with nothing to solve.
    Explicit,
}

/// Share of the largest stable step that explicit integration takes by default.
pub(crate) const EXPLICIT_SAFETY: f64 = 0.5;
