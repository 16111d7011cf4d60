//! The load over the substeps of a window.
//!
//! The flow sees the canopy at the ends of windows only; between them the
//! structure's substeps move it as if there were no air to push. Linear analysis
//! of a converged window (one mode, ten substeps, flow with added mass and BDF2
//! velocities, fabric of 0.037 kg/m2, $\Delta t$ = 5 ms, tension 0 to 160 N/m,
//! wave lengths 0.5 to 12 m) gives as the largest amplification per window:
//!
//! | load over the window | Newmark | rho_inf 0.9 | rho_inf 0.6 |
//! |---|---|---|---|
//! | linear from start to end | 3.6 | 3.6 | 3.5 |
//! | end throughout | 1.19 | 1.064 | 1.063 |
//! | 0.45 start + 0.55 end throughout | 1.09 | 1.0005 | 1.02 |
//!
//! So the mean is the default. The exact mean would leave a pressure that
//! alternates from window to window undamped; the small shift to the end damps
//! it by 0.82 per window.

use case::LoadShape;

/// Weight of the pressure at the end of the window in [`LoadShape::Mean`].
pub const MEAN_WEIGHT: f64 = 0.55;

/// Loads for the structure at the start and the end of a window (it interpolates
/// linearly between them), from the flow's loads at both times.
pub fn shape_load(
    shape: LoadShape,
    flow_start: &[f64],
    flow_end: &[f64],
    start: &mut [f64],
    end: &mut [f64],
) {
    // Weights of the flow's load at the end of the window.
    let (at_start, at_end) = match shape {
        LoadShape::Mean => (MEAN_WEIGHT, MEAN_WEIGHT),
        LoadShape::Constant => (1.0, 1.0),
        LoadShape::Linear => (0.0, 1.0),
    };
    for i in 0..flow_end.len() {
        let change = flow_end[i] - flow_start[i];
        start[i] = flow_start[i] + at_start * change;
        end[i] = flow_start[i] + at_end * change;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_load_stays_itself_in_every_shape() {
        for shape in [LoadShape::Mean, LoadShape::Constant, LoadShape::Linear] {
            let (mut start, mut end) = ([0.0; 2], [0.0; 2]);
            shape_load(shape, &[3.0, -1.0], &[3.0, -1.0], &mut start, &mut end);
            assert_eq!((start, end), ([3.0, -1.0], [3.0, -1.0]), "{shape:?}");
        }
    }
}
