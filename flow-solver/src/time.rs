//! Backward differences over moving cells.

/// Coefficients of a backward difference: $\partial_t(W V) \approx
/// (c_0 W^{n+1}V^{n+1} + c_1 W^nV^n + c_2 W^{n-1}V^{n-1}) / \Delta t$.
///
/// The grid flux of a face follows from the same coefficients and the volumes it
/// has swept in the last two steps, $(c_0\,\delta V^{n+1} - c_2\,\delta V^n)/\Delta t$
/// (Farhat, Geuzaine and Grandmont 2001), so a uniform stream stays uniform to
/// round-off whatever the grid does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backward {
    /// $c_0, c_1, c_2$.
    pub c: [f64; 3],
}

impl Backward {
    /// First order.
    pub const FIRST: Self = Self { c: [1.0, -1.0, 0.0] };
    /// Second order, for two steps of equal length.
    pub const SECOND: Self = Self { c: [1.5, -2.0, 0.5] };

    /// Grid flux (m3/s) of a face that sweeps `now` in this step of length `dt`
    /// and swept `before` in the last one.
    #[inline(always)]
    pub fn grid_flux(&self, now: f64, before: f64, dt: f64) -> f64 {
        (self.c[0] * now - self.c[2] * before) / dt
    }
}
