//! Velocity of the grid, consistent with the flow's time differences.

/// Velocity at the end of a window of length `dt` (s) from positions (m) at its
/// end `x`, its start `x1`, and one window earlier `x2`: second-order backward
/// difference $(3x - 4x_1 + x_2)/(2\Delta t)$, or first order without `x2`.
///
/// Written as differences, so that a grid at rest has velocity zero exactly.
#[inline]
pub fn backward_difference(x: f64, x1: f64, x2: Option<f64>, dt: f64) -> f64 {
    match x2 {
        Some(x2) => (3.0 * (x - x1) - (x1 - x2)) / (2.0 * dt),
        None => (x - x1) / dt,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_parabolas_and_rest() {
        let dt = 0.25;
        let x = |t: f64| 1.0 + 2.0 * t - 3.0 * t * t;
        for t in [0.5, 1.0, 3.75] {
            // Powers of two throughout: no rounding at all.
            let v = backward_difference(x(t), x(t - dt), Some(x(t - 2.0 * dt)), dt);
            assert_eq!(v, 2.0 - 6.0 * t);
        }
        assert_eq!(backward_difference(3.0, 1.0, None, dt), 8.0);
        assert_eq!(backward_difference(0.1, 0.1, Some(0.1), 5e-3), 0.0);
        assert_eq!(backward_difference(0.1, 0.1, None, 5e-3), 0.0);
    }
}
