//! Choices of the coupling that go beyond the sequence of the programs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How an implicit window visits structure and flow in an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CouplingOrder {
    /// The structure answers the load of the same iteration: fewer iterations.
    #[default]
    GaussSeidel,
    /// Structure and flow answer each other's last iterate; the load is one of the coupled unknowns.
    Jacobi,
}

/// What a staggered window knows in advance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Staggered {
    /// Which program is first, on extrapolated values.
    pub sequence: StaggeredSequence,
    /// Order of the extrapolation from past windows, 0 (the last value) to 2.
    pub predictor: u32,
}

/// Which program is first in a staggered window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StaggeredSequence {
    /// The structure under the extrapolated load, then the flow around its answer. With
    /// predictor 0 the paper's sequence.
    #[default]
    StructureFirst,
    /// The flow around the extrapolated canopy, then the structure under its answer, with
    /// `coupling.load` over the substeps.
    FlowFirst,
    /// The flow lives half a window off, at the middles of the structure's windows, around the
    /// canopy extrapolated there; its answer is the constant load of the structure's window
    /// (Lesoinne and Farhat 1998, improved serial staggered). Wants predictor 1 or 2.
    HalfStep,
    /// The structure under the extrapolated load with the air's added mass (potential flow around the
    /// canopy) implicit, then the flow around its answer: stands for light fabric at one call
    /// of the flow in a window. Wants predictor 1.
    AddedMass,
}

/// Highest order of extrapolation in a staggered window.
pub const MOST_PREDICTOR: u32 = 2;
