//! Air that passes airtight cloth in an immersed flow: a warning where it is more than the answer tolerates.
//!
//! Cloth that cuts a Cartesian grid is airtight to a small share of the stream ([`flow_stats::MASS_DEFECT`] over the density). The walls of a
//! pocket that folded fabric encloses in few cells let air pass, because the grid does not resolve the pocket. The measure is the mean speed of that
//! air through the whole fabric, relative to the speed of stream and canopy,
//! ```math
//! \frac{\dot m}{\rho\, S_0\, W}.
//! ```
//!
//! [`flow_stats::MASS_DEFECT`]: channel::flow_stats::MASS_DEFECT

/// Share of the stream that may pass. Dynamic pressure goes with the square of the speed of the air that does not pass, so that 2 % of the drag are
/// at stake (an estimate; not measured).
const LARGEST: f64 = 1e-2;
/// Speed below which air is still, and nothing is judged, m/s.
const STILL: f64 = 1e-3;

/// Mean speed through the fabric over `speed` (m/s), that of stream and canopy; `defect`: air that passes, kg/s; `area`: of the fabric, m2.
pub fn share(defect: f64, density: f64, area: f64, speed: f64) -> f64 {
    if speed > STILL && area > 0.0 { defect.abs() / (density * area * speed) } else { 0.0 }
}

/// A warning when the largest share of a stage, `before` until the window, first exceeds what is accepted.
pub fn warning(before: f64, share: f64) -> Option<String> {
    (before <= LARGEST && share > LARGEST).then(|| {
        format!(
            "air passes airtight cloth at {:.2} % of the speed of stream and canopy, above {} % [flow.leakage]. Likely causes: folds that enclose \
             pockets of at most 64 cells, which leak, or a stream that starts at once. Remedies: a smaller flow.immersed.spacing_m, a flow-only stage \
             before this one",
            100.0 * share,
            100.0 * LARGEST
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leakage_is_relative_to_stream_and_fabric_and_warns_once() {
        // 1.2 kg/m3 through 10 m2 at 0.05 m/s, of 5 m/s.
        let share = share(0.6, 1.2, 10.0, 5.0);
        assert!((share - 0.01).abs() < 1e-15, "{share}");
        assert_eq!(super::share(0.6, 1.2, 10.0, 0.0), 0.0);
        assert_eq!(warning(0.0, 0.0099), None);
        let text = warning(0.002, 0.0123).expect("a warning");
        assert!(text.contains("1.23 %") && text.contains("above 1 % [flow.leakage]"), "{text}");
        assert_eq!(warning(0.0123, 0.05), None);
    }
}
