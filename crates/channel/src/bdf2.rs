//! The backward difference in time of the grid's velocity and of the flow.

/// Largest ratio of a step to the step before it for which the second-order difference is used. With steps that grow
/// by more than a factor $`1 + \sqrt 2`$ every time the difference is not zero-stable (Grigorieff 1983).
pub const LONGEST_RATIO: f64 = 2.4;

/// Coefficients of the second-order backward difference (BDF2) for a step of length $`\Delta t`$ that is `ratio` times
/// as long as the one before it:
///
/// ```math
/// \partial_t y \approx (c_0 y^{n+1} + c_1 y^n + c_2 y^{n-1}) / \Delta t, \quad
/// c_0 = \frac{1 + 2r}{1 + r}, \quad c_1 = -(1 + r), \quad c_2 = \frac{r^2}{1 + r}
/// ```
///
/// `None` where the step is longer than [`LONGEST_RATIO`], or `ratio` is not a positive number: first order then,
/// $`c = (1, -1, 0)`$. The sum of the coefficients is exactly zero, so a constant has no rate.
///
/// Grid velocities of the contract are $`(c_0 (x^{n+1} - x^n) - c_2 (x^n - x^{n-1})) / \Delta t`$ with these
/// coefficients, so that they satisfy the flow's geometric conservation law.
pub fn bdf2(ratio: f64) -> Option<[f64; 3]> {
    let share = ratio / (1.0 + ratio);
    let (c0, c2) = (1.0 + share, ratio * share);
    (ratio > 0.0 && ratio <= LONGEST_RATIO).then_some([c0, -(c0 + c2), c2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_steps_have_exact_bdf2_coefficients() {
        assert_eq!(bdf2(1.0), Some([1.5, -2.0, 0.5]));
        assert_eq!([2.5, f64::INFINITY, f64::NAN, 0.0, -1.0].map(bdf2), [None; 5]);
    }

    #[test]
    fn difference_is_exact_for_parabolas_at_any_ratio() {
        let f = |t: f64| 2.0 - 3.0 * t + 0.7 * t * t;
        for (dt, before) in [(0.1, 0.1), (0.2, 0.1), (0.05, 0.1), (0.01, 0.3), (0.24, 0.1)] {
            let c = bdf2(dt / before).expect("not too long");
            let rate = (c[0] * f(dt) + c[1] * f(0.0) + c[2] * f(-before)) / dt;
            assert!((rate - (-3.0 + 1.4 * dt)).abs() < 1e-12, "{dt} after {before}: {rate}");
            assert_eq!(c[0] + c[2] + c[1], 0.0);
        }
    }
}
