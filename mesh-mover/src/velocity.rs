//! Velocity of the grid, consistent with the flow's time differences.
//!
//! Written as differences, so that a grid at rest has velocity zero exactly.

/// Velocity at the end of a window from positions (m) at its end `x`, its start `x1`,
/// and one window earlier `x2`: second-order backward difference
/// $(3x - 4x_1 + x_2)/(2\Delta t)$; `per_dt` is one over the window's length (1/s).
#[inline]
pub fn second_order(x: f64, x1: f64, x2: f64, per_dt: f64) -> f64 {
    (1.5 * (x - x1) - 0.5 * (x1 - x2)) * per_dt
}

/// The same of first order, $(x - x_1)/\Delta t$.
#[inline]
pub fn first_order(x: f64, x1: f64, per_dt: f64) -> f64 {
    (x - x1) * per_dt
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
            let v = second_order(x(t), x(t - dt), x(t - 2.0 * dt), 1.0 / dt);
            assert_eq!(v, 2.0 - 6.0 * t);
        }
        assert_eq!(first_order(3.0, 1.0, 1.0 / dt), 8.0);
        assert_eq!(second_order(0.1, 0.1, 0.1, 200.0), 0.0);
        assert_eq!(first_order(0.1, 0.1, 200.0), 0.0);
    }
}
