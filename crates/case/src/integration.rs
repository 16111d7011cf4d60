//! How the structure's motion is integrated in time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Time integration of the structure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Integration {
    /// Implicit steps with stresses of averaged strains, which create no energy
    /// (`spectral_radius` sets the numerical damping): a substep is one step, with equations to
    /// solve.
    #[default]
    GeneralizedAlpha,
    /// The same as `generalized-alpha`.
    Implicit,
    /// Newmark with gamma 1/2 and beta 1/4, as in the paper. It can create energy without bound
    /// where fabric and lines change between slack and taut.
    Newmark,
    /// Central differences on a lumped mass: each substep is divided into as many steps
    /// as stability asks for, with nothing to solve.
    Explicit,
}

/// Share of the largest stable step that explicit integration takes by default.
pub(crate) const EXPLICIT_SAFETY: f64 = 0.5;
/// Spectral radius of the generalized-alpha method by default: the energy-momentum method
/// (Simo and Tarnow 1992), the only member of the family of which it is proven that no step
/// creates energy, whatever the states that fabric and lines pass through.
pub(crate) const SPECTRAL_RADIUS: f64 = 1.0;
