//! Error for speeds and pressures beyond physical bounds.

use channel::at_text;

/// A flow beyond its physical bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the flow reaches a {what} of {found:.3e} {unit}{}, {:.0} times the {possible:.3e} {unit} that {speed_m_s:.2} m/s of air \
     and canopy and {pressure_pa:.1} Pa can cause, so the flow or the coupling is unphysical. \
     Remedies: coupling.scheme = \"implicit\", a shorter window_s, a larger first_layer_m; cells of a fitted grid there as even as elsewhere (grid.txt)",
    at_text(*at), found / possible
)]
pub struct ImpossibleFlow {
    /// `speed` or `gauge pressure`.
    pub what: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Value in the flow.
    pub found: f64,
    /// Centre of the cell that has it, m; `None` where the flow program does not report it.
    pub at: Option<[f64; 3]>,
    /// Largest physical value.
    pub possible: f64,
    /// Sum of the largest speeds of air and canopy so far, m/s.
    pub speed_m_s: f64,
    /// Pressure that is applied or carries the weight, Pa.
    pub pressure_pa: f64,
}
