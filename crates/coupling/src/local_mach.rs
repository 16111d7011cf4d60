//! Largest local Mach number of the flow: a warning where the equations lose accuracy, an error where they do not hold.

use channel::{STATS, at_text, flow_stats, reported_place};

/// Local Mach number above which isothermal air is inaccurate: its density is wrong by $`(\gamma-1)M^2/2`$, 1.8 %.
const ISOTHERMAL: f64 = 0.3;
/// The same with the energy equation: beyond it, air that accelerates further passes the speed of sound, and no shock is captured.
const WITH_ENERGY: f64 = 0.7;
/// From here on characteristics at the outer boundary and preconditioner, made for subsonic flow, do not hold.
const LARGEST: f64 = 1.0;

/// A flow that passes the speed of sound.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the local Mach number reaches {mach:.2}{}; flow-solver is made for subsonic flow (local Mach number below 1). Likely causes: a stream \
     that is too fast, or a cell at a sharp edge. Remedies: lower descent.initial_speed_m_s or flow.wind_m_s, shorten window_s, enlarge \
     flow.grid.first_layer_m", at_text(*at)
)]
pub struct SupersonicFlow {
    /// Largest local Mach number.
    pub mach: f64,
    /// Centre of its cell, m; `None` where the flow program does not report it.
    pub at: Option<[f64; 3]>,
}

/// Refuses a flow whose statistics have a largest local Mach number of 1 or more.
///
/// # Errors
/// [`SupersonicFlow`].
pub fn check(statistics: &[f64; STATS]) -> Result<(), SupersonicFlow> {
    let mach = statistics[flow_stats::MAX_MACH];
    // NaN is beyond any limit.
    if mach < LARGEST {
        return Ok(());
    }
    Err(SupersonicFlow { mach, at: reported_place(statistics, flow_stats::MAX_MACH_AT) })
}

/// A warning when the largest local Mach number of a stage, `before` until the window with these statistics of the flow, first exceeds what
/// the equations, with or without that of `energy`, describe accurately.
pub fn warning(energy: bool, before: f64, statistics: &[f64; STATS]) -> Option<String> {
    let mach = statistics[flow_stats::MAX_MACH];
    let at = at_text(reported_place(statistics, flow_stats::MAX_MACH_AT));
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
    (before <= limit && mach > limit).then(|| {
        format!("the local Mach number reaches {mach:.2}{at}, above {limit} [flow.local-mach]{remedy}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statistics(mach: f64, at: [f64; 3]) -> [f64; STATS] {
        let mut values = [0.0; STATS];
        values[flow_stats::MAX_MACH] = mach;
        values[flow_stats::MAX_MACH_AT..][..3].copy_from_slice(&at);
        values
    }

    #[test]
    fn local_mach_number_warns_once_and_is_limited_to_one() {
        let warning = |energy, before, mach| warning(energy, before, &statistics(mach, [0.0; 3]));
        assert_eq!(warning(false, 0.0, 0.299), None);
        let text = warning(false, 0.2, 0.31).expect("a warning");
        assert!(text.contains("reaches 0.31, above 0.3") && text.contains("add [flow.energy]"), "{text}");
        assert_eq!(warning(false, 0.31, 0.5), None);
        assert_eq!(warning(true, 0.2, 0.69), None);
        assert!(warning(true, 0.2, 0.71).is_some_and(|t| t.contains("above 0.7")));
        let check = |mach| check(&statistics(mach, [0.0; 3]));
        assert_eq!(check(0.999), Ok(()));
        let text = check(1.2).expect_err("an error").to_string();
        assert!(text.contains("reaches 1.20; flow-solver") && text.contains("subsonic"), "{text}");
        assert!(check(f64::NAN).is_err());
    }

    #[test]
    fn messages_name_the_reported_place() {
        let at = "at (1.5000, 0.0000, -2.0300) m";
        let text = warning(false, 0.2, &statistics(0.4, [1.5, 0.0, -2.03])).expect("a warning");
        assert!(text.contains(&format!("reaches 0.40 {at}, above")), "{text}");
        let text = check(&statistics(1.2, [1.5, 0.0, -2.03])).expect_err("an error").to_string();
        assert!(text.contains(&format!("reaches 1.20 {at};")), "{text}");
    }
}
