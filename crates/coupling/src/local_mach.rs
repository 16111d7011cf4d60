//! Largest local Mach number of the flow: a warning where the equations lose accuracy, an error where they do not hold.

/// Local Mach number above which isothermal air is inaccurate: its density is wrong by $`(\gamma-1)M^2/2`$, 1.8 %.
const ISOTHERMAL: f64 = 0.3;
/// The same with the energy equation: beyond it, air that accelerates further passes the speed of sound, and no shock is captured.
const WITH_ENERGY: f64 = 0.7;
/// From here on characteristics at the outer boundary and preconditioner, made for subsonic flow, do not hold.
const LARGEST: f64 = 1.0;

/// A flow that passes the speed of sound.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the local Mach number reaches {mach:.2}; flow-solver is made for subsonic flow (local Mach number below 1). Likely causes: a stream \
     that is too fast, or a cell at a sharp edge. Remedies: lower descent.initial_speed_m_s or flow.wind_m_s, shorten window_s, enlarge \
     flow.grid.first_layer_m"
)]
pub struct SupersonicFlow {
    /// Largest local Mach number.
    pub mach: f64,
}

/// Refuses a flow whose largest local Mach number is `mach`.
///
/// # Errors
/// [`SupersonicFlow`].
pub fn check(mach: f64) -> Result<(), SupersonicFlow> {
    // NaN is beyond any limit.
    if mach < LARGEST { Ok(()) } else { Err(SupersonicFlow { mach }) }
}

/// A warning when the largest local Mach number of a stage, `before` until the window, first exceeds what the equations, with or without that
/// of `energy`, describe accurately.
pub fn warning(energy: bool, before: f64, mach: f64) -> Option<String> {
    let (limit, remedy) = match energy {
        false => (
            ISOTHERMAL,
            "; add [flow.energy]: isothermal air has a density error of (gamma - 1) M^2 / 2 there",
        ),
        true => (
            WITH_ENERGY,
            ": air may pass the speed of sound, and shocks are not captured; lower the speed of the stream",
        ),
    };
    (before <= limit && mach > limit)
        .then(|| format!("the local Mach number reaches {mach:.2}, above {limit} [flow.local-mach]{remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_mach_number_warns_once_and_is_limited_to_one() {
        assert_eq!(warning(false, 0.0, 0.299), None);
        let text = warning(false, 0.2, 0.31).expect("a warning");
        assert!(text.contains("reaches 0.31, above 0.3") && text.contains("add [flow.energy]"), "{text}");
        assert_eq!(warning(false, 0.31, 0.5), None);
        assert_eq!(warning(true, 0.2, 0.69), None);
        assert!(warning(true, 0.2, 0.71).is_some_and(|t| t.contains("above 0.7")));
        assert_eq!(check(0.999), Ok(()));
        let text = check(1.2).expect_err("an error").to_string();
        assert!(text.contains("reaches 1.20") && text.contains("subsonic"), "{text}");
        assert!(check(f64::NAN).is_err());
    }
}
