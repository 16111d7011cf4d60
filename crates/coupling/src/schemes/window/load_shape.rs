//! Interpolation of the load over the substeps of a window.
//!
//! The flow is solved at the ends of windows only; between them the structure's substeps move without the response of
//! the air. Where the fabric is light, its displacement is determined by the mean load of a window, so the weights
//! determine the behaviour of a pressure that alternates from window to window. With
//! $`\bar p = a p^{n+1} + b p^n + c p^{n-1}`$ its amplification $`r`$ satisfies $`a r^2 + b r + c = 0`$; second order
//! about the middle of the window requires $`a = 1/2 + c`$, $`b = 1/2 - 2c`$; the double root $`c = 1/16`$ damps
//! fastest, $`r = -1/3`$.
//!
//! Linear analysis of a converged window (one mode, ten substeps, flow with added
//! mass and BDF2 velocities, fabric of 0.037 kg/m2, $`\Delta t`$ = 5 ms, tension 0 to
//! 60 N/m, wave lengths 0.7 to 13 m, structure with rho_inf 0.9) gives the largest
//! amplification per window of any mode, and of alternating modes alone, without
//! and with half of the structure's velocity along the normal averaged
//! (`coupling.velocity_average`; modes without added mass must not be averaged, see
//! `structure-solver/src/velocity_average.rs`):
//!
//! | load over the window | without | with |
//! |---|---|---|
//! | linear from start to end | 3.6 / 3.6 | 2.8 / 2.8 |
//! | end throughout | 1.06 / 1.01 | 1.07 / 0.51 |
//! | 1/2 end + 1/2 start | 1.00 / 1.00 | 1.00 / 0.99 |
//! | 9/16 end + 3/8 start + 1/16 before | 1.00 / 1.00 | 1.000 / 0.49 |

use case::LoadShape;

use super::values::InterfaceState;

/// Weights of the loads at the end and the start of the window, and one window
/// before, in [`LoadShape::Mean`] with equal windows.
pub const MEAN_WEIGHTS: [f64; 3] = [9.0 / 16.0, 3.0 / 8.0, 1.0 / 16.0];

/// The same for a window that is `ratio` times as long as the one before it: second order about its middle requires
/// $`a = 1/2 + c/r`$ and $`b = 1/2 - c(1 + 1/r)`$; $`c`$ gives the double root $`b^2 = 4ac`$, that is
/// $`c = \tfrac12 / (k + \sqrt{k^2 - (1 - 1/r)^2})`$ with $`k = 3 + 1/r`$.
pub fn mean_weights(ratio: f64) -> [f64; 3] {
    let inverse = 1.0 / ratio;
    let k = 3.0 + inverse;
    let c = 0.5 / (k + (k * k - (1.0 - inverse).powi(2)).sqrt());
    [0.5 + c * inverse, 0.5 - c - c * inverse, c]
}

/// Flow loads of a window, each `[faces][LOAD_WIDTH]`, Pa.
///
/// A canopy that was held until the window begins is released by it: the load at its start did not act on the free
/// fabric. The mean above would make the load jump to about $`-b/a`$ of it and alternate afterwards. The window
/// therefore uses the load of its end throughout, a first-order step after a jump (Rannacher 1984), and the next one
/// uses no load before its own start.
#[derive(Clone, Copy, Debug)]
pub struct FlowLoads<'a> {
    /// One window before the start; the load at the start where there was none.
    pub before: &'a [f64],
    /// At the start of the window.
    pub start: &'a [f64],
    /// At its end.
    pub end: &'a [f64],
    /// Length of the window relative to the one before it.
    pub ratio: f64,
}

impl<'a> FlowLoads<'a> {
    /// For a window with the load `end` at its end, `ratio` times as long as the one before; `released` where the
    /// canopy was held until it begins. An unknown load at the start is replaced by that at the end.
    pub fn of(state: &'a InterfaceState, end: &'a [f64], ratio: f64, released: bool) -> Self {
        let start = state.load.as_deref().filter(|_| !released).unwrap_or(end);
        let before = state.load_before.as_deref().filter(|_| !released).unwrap_or(start);
        Self { before, start, end, ratio }
    }
}

/// Loads for the structure at the start and the end of a window; it interpolates linearly between them.
pub fn shape_load(shape: LoadShape, flow: FlowLoads<'_>, start: &mut [f64], end: &mut [f64]) {
    let FlowLoads { before: l, start: m, end: n, ratio } = flow;
    match shape {
        LoadShape::Mean => {
            let [a, b, c] = mean_weights(ratio);
            for i in 0..n.len() {
                start[i] = a * n[i] + b * m[i] + c * l[i];
            }
            end.copy_from_slice(start);
        }
        LoadShape::Constant => {
            start.copy_from_slice(n);
            end.copy_from_slice(n);
        }
        LoadShape::Linear => {
            start.copy_from_slice(m);
            end.copy_from_slice(n);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_load_is_reproduced_by_every_interpolation() {
        for shape in [LoadShape::Mean, LoadShape::Constant, LoadShape::Linear] {
            let (mut start, mut end) = ([0.0; 2], [0.0; 2]);
            let steady = [3.0, -1.0];
            let flow = FlowLoads { before: &steady, start: &steady, end: &steady, ratio: 0.5 };
            shape_load(shape, flow, &mut start, &mut end);
            for (x, steady) in start.iter().chain(&end).zip(steady.iter().cycle()) {
                assert!((x - steady).abs() < 1e-14, "{shape:?}");
            }
        }
    }

    #[test]
    fn mean_is_second_order_and_damps_alternating_loads_to_a_third() {
        let [a, b, c] = MEAN_WEIGHTS;
        assert_eq!(a + b + c, 1.0);
        assert_eq!(a - c, 0.5, "centred on the middle of the window");
        let r: f64 = -1.0 / 3.0;
        assert!((a * r * r + b * r + c).abs() < 1e-15 && (b * b - 4.0 * a * c).abs() < 1e-15);
    }

    #[test]
    fn mean_is_centred_with_a_double_root_for_unequal_windows() {
        assert_eq!(mean_weights(1.0), MEAN_WEIGHTS, "to the bit");
        for ratio in [0.25, 0.5, 0.8, 1.3, 2.0, 2.4] {
            let [a, b, c] = mean_weights(ratio);
            assert!((a + b + c - 1.0).abs() < 1e-15 && a > 0.0 && b > 0.0 && c > 0.0, "{ratio}");
            // A linear load gives its value in the middle.
            assert!((a - c / ratio - 0.5).abs() < 1e-15, "{ratio}");
            assert!((b * b - 4.0 * a * c).abs() < 1e-15, "{ratio}");
        }
    }
}
