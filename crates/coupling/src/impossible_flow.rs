//! Speeds and pressures that no physics allows, as an error.

/// A flow that no physics allows.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the flow shows a {what} of {found:.3e} {unit}, {:.0} times what {speed_m_s:.2} m/s of air and canopy and \
     {pressure_pa:.1} Pa can cause ({possible:.3e} {unit}): the flow or the coupling has left what is physical. \
     Remedies: coupling.scheme = \"implicit\", a shorter window_s, a larger first_layer_m",
    found / possible
)]
pub struct ImpossibleFlow {
    /// `speed` or `pressure`.
    pub what: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// What was seen.
    pub found: f64,
    /// What physics allows.
    pub possible: f64,
    /// Speeds of air and canopy so far, m/s.
    pub speed_m_s: f64,
    /// Pressure that is applied or carries the weight, Pa.
    pub pressure_pa: f64,
}
