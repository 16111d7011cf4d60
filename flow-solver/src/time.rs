//! Backward differences over moving cells.

/// Coefficients of a backward difference:
/// $`\partial_t(W V) \approx (c_0 W^{n+1}V^{n+1} + c_1 W^nV^n + c_2 W^{n-1}V^{n-1}) / \Delta t`$.
///
/// The grid flux of a face follows from the same coefficients and the volumes it
/// has swept in the last two steps, $`(c_0\,\delta V^{n+1} - c_2\,\delta V^n)/\Delta t`$
/// (Farhat, Geuzaine and Grandmont 2001), so a uniform stream stays uniform to
/// round-off whatever the grid does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backward {
    /// $`c_0, c_1, c_2`$.
    pub c: [f64; 3],
}

impl Backward {
    /// First order.
    pub const FIRST: Self = Self { c: [1.0, -1.0, 0.0] };
    /// Second order, for two steps of equal length.
    pub const SECOND: Self = Self { c: [1.5, -2.0, 0.5] };

    /// Second order for a step that is `ratio` times as long as the one before it, by [`channel::bdf2`]. First order
    /// where the step is longer than [`channel::LONGEST_RATIO`].
    pub fn second(ratio: f64) -> Self {
        channel::bdf2(ratio).map_or(Self::FIRST, |c| Self { c })
    }

    /// Grid flux (m3/s) of a face that sweeps `now` in this step of length `dt`
    /// and swept `before` in the last one.
    #[inline(always)]
    pub fn grid_flux(&self, now: f64, before: f64, dt: f64) -> f64 {
        (self.c[0] * now - self.c[2] * before) / dt
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_steps_have_exact_bdf2_coefficients() {
        assert_eq!(Backward::second(1.0), Backward::SECOND);
        assert_eq!(Backward::second(2.5), Backward::FIRST);
        assert_eq!(Backward::second(f64::INFINITY), Backward::FIRST);
        assert_eq!(Backward::second(f64::NAN), Backward::FIRST);
    }

    #[test]
    fn bdf2_is_exact_for_parabolas_at_any_step_ratio() {
        let f = |t: f64| 2.0 - 3.0 * t + 0.7 * t * t;
        for (dt, before) in [(0.1, 0.1), (0.2, 0.1), (0.05, 0.1), (0.01, 0.3), (0.24, 0.1)] {
            let Backward { c } = Backward::second(dt / before);
            let rate = (c[0] * f(dt) + c[1] * f(0.0) + c[2] * f(-before)) / dt;
            assert!((rate - (-3.0 + 1.4 * dt)).abs() < 1e-12, "{dt} after {before}: {rate}");
            assert!((c[0] + c[1] + c[2]).abs() < 1e-15);
            // What a face sweeps has the rate of the volume behind it.
            let (now, earlier) = (f(dt) - f(0.0), f(0.0) - f(-before));
            let swept = Backward { c }.grid_flux(now, earlier, dt);
            assert!((swept - (-3.0 + 1.4 * dt)).abs() < 1e-12, "{dt} after {before}: {swept}");
        }
    }

    /// Order on x' = -x with steps that alternate between one and two parts.
    #[test]
    fn second_order_on_alternating_steps() {
        let end = |pairs: usize| {
            let part = 1.0 / (3 * pairs) as f64;
            let (mut x, mut old, mut t, mut before) = (1.0, (part).exp(), 0.0f64, part);
            for k in 0..2 * pairs {
                let dt = if k % 2 == 0 { part } else { 2.0 * part };
                let Backward { c } = Backward::second(dt / before);
                let new = -(c[1] * x + c[2] * old) / (c[0] + dt);
                (old, x, before) = (x, new, dt);
                t += dt;
            }
            (x - (-t).exp()).abs()
        };
        let order = (end(20) / end(40)).log2();
        assert!((order - 2.0).abs() < 0.1, "order {order}");
    }
}
