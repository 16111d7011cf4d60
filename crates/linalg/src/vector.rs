//! Vector kernels. Sums use eight fixed lanes, so they vectorise and their order
//! (and so the answer to the last bit) never changes.

use crate::block::Real;

const LANES: usize = 8;

/// Rank-local dot product.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (xs, xr) = x.as_chunks::<LANES>();
    let (ys, yr) = y.as_chunks::<LANES>();
    let mut acc = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..LANES {
            acc[l] = x[l].fused(y[l], acc[l]);
        }
    }
    let tail: f64 = xr.iter().zip(yr).map(|(x, y)| x * y).sum();
    let q = [acc[0] + acc[4], acc[1] + acc[5], acc[2] + acc[6], acc[3] + acc[7]];
    (q[0] + q[2]) + (q[1] + q[3]) + tail
}

/// `y += a x`.
pub(crate) fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// `y = x + b y`.
pub(crate) fn xpby(x: &[f64], b: f64, y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y = x + b * *y;
    }
}

/// `r = b - r`.
pub(crate) fn residual(b: &[f64], r: &mut [f64]) {
    for (r, b) in r.iter_mut().zip(b) {
        *r = b - *r;
    }
}
