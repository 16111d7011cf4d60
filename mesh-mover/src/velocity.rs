//! Velocity of the grid, consistent with the flow's time differences.
//!
//! Written as differences, so that a grid at rest has velocity zero exactly.

/// Weights of the displacements in a window and in the one before it in the second-order velocity at its end: $`c_0`$
/// and $`c_2`$ of [`channel::bdf2`] for a window `ratio` times as long as that. `None` where it is too long: first
/// order then.
pub fn weights(ratio: f64) -> Option<[f64; 2]> {
    channel::bdf2(ratio).map(|[c0, _, c2]| [c0, c2])
}

/// Velocity at the end of a window from positions (m) at its end `x`, its start `x1`,
/// and one window earlier `x2`: second-order backward difference with these [`weights`],
/// $`(3x - 4x_1 + x_2)/(2\Delta t)`$ for equal windows; `per_dt` is one over the window's length (1/s).
#[inline]
pub fn second_order(weights: [f64; 2], x: f64, x1: f64, x2: f64, per_dt: f64) -> f64 {
    (weights[0] * (x - x1) - weights[1] * (x1 - x2)) * per_dt
}

/// The same of first order, $`(x - x_1)/\Delta t`$.
#[inline]
pub fn first_order(x: f64, x1: f64, per_dt: f64) -> f64 {
    (x - x1) * per_dt
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_is_exact_for_parabolas_and_at_rest() {
        let dt = 0.25;
        let x = |t: f64| 1.0 + 2.0 * t - 3.0 * t * t;
        let equal = weights(1.0).unwrap();
        assert_eq!(equal, [1.5, 0.5]);
        for t in [0.5, 1.0, 3.75] {
            // Powers of two throughout: no rounding at all.
            let v = second_order(equal, x(t), x(t - dt), x(t - 2.0 * dt), 1.0 / dt);
            assert_eq!(v, 2.0 - 6.0 * t);
            for before in [0.5, 0.125, 1.0] {
                let v = second_order(weights(dt / before).unwrap(), x(t), x(t - dt), x(t - dt - before), 4.0);
                assert!((v - (2.0 - 6.0 * t)).abs() < 1e-12, "{dt} after {before} s: {v}");
            }
        }
        assert_eq!((weights(2.5), weights(f64::INFINITY), weights(f64::NAN)), (None, None, None));
        assert_eq!(first_order(3.0, 1.0, 1.0 / dt), 8.0);
        assert_eq!(second_order([1.5, 0.5], 0.1, 0.1, 0.1, 200.0), 0.0);
        assert_eq!(first_order(0.1, 0.1, 200.0), 0.0);
    }
}
