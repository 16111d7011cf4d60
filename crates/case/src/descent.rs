//! Choices of the descent equation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Equation of the falling frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DescentEquation {
    /// The momentum of the whole system: the frame is fixed to the payload, which accelerates under the mean force of
    /// the lines over the window, its drag and its weight.
    #[default]
    Momentum,
    /// The paper's equation 9: the force of the air on the canopy at the end of the window acts on the frame. It is
    /// the limit in which the canopy has no acceleration of its own in the frame.
    QuasiSteady,
}
