//! Gradient limiting after Venkatakrishnan (1995).

use crate::geometry::Metrics;
use crate::gradient::{self, Gradient};
use crate::topology::Topology;

/// Scales the gradients of owned cells such that no face value leaves the range
/// of the cell's neighbours by more than a smooth flow would; `k` times the cell
/// size is the length below which variations pass. `scale` is a typical size of
/// each variable.
pub fn venkatakrishnan<const N: usize>(
    topology: &Topology,
    metrics: &Metrics,
    q: &[[f64; N]],
    gradient: &mut [Gradient<N>],
    k: f64,
    scale: [f64; N],
) {
    let n = topology.n_owned;
    let rows = &topology.adjacency;
    let mut range = vec![([0.0f64; N], [0.0f64; N]); n];
    for (i, (low, high)) in range.iter_mut().enumerate() {
        for &j in &rows.cell[rows.start[i] as usize..rows.start[i + 1] as usize] {
            for v in 0..N {
                let d = q[j as usize][v] - q[i][v];
                low[v] = low[v].min(d);
                high[v] = high[v].max(d);
            }
        }
    }
    let mut factor = vec![[1.0f64; N]; n];
    let length = metrics.size[..n].iter().fold(0.0f64, |m, h| m.max(*h));
    topology.for_each_side(|f, c, _| {
        if c >= n {
            return;
        }
        let d = metrics.face_centre(topology, f) - metrics.centre(c);
        let g = &gradient[c];
        let relative = k * metrics.size[c] / length;
        for v in 0..N {
            let step = gradient::along(g, v, &d);
            let bound = if step > 0.0 { range[c].1[v] } else { range[c].0[v] };
            let eps2 = relative.powi(3) * scale[v] * scale[v];
            factor[c][v] = factor[c][v].min(share(bound, step, eps2));
        }
    });
    for (g, f) in gradient.iter_mut().zip(&factor) {
        for g in g {
            for v in 0..N {
                g[v] *= f[v];
            }
        }
    }
}

/// Share of the change `b` towards a face that a cell may take whose neighbours differ by at most `a` in that
/// direction; `eps2` is the square of a change that passes.
fn share(a: f64, b: f64, eps2: f64) -> f64 {
    let top = a * a + eps2 + 2.0 * a * b;
    let bottom = a * a + 2.0 * b * b + a * b + eps2;
    if bottom > 0.0 { top / bottom } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::share;

    /// With `y = a / b`: `(y^2 + 2 y) / (y^2 + y + 2)`.
    #[test]
    fn limiter_is_the_published_rational_function() {
        for y in [0.0, 0.25, 1.0, 2.0, 7.0f64] {
            let exact = (y * y + 2.0 * y) / (y * y + y + 2.0);
            for b in [3.0, -0.2] {
                assert!((share(y * b, b, 0.0) - exact).abs() < 1e-15, "{y} {b}");
            }
        }
        // Differences much smaller than eps are not limited; at a change of eps and neighbours at rest a third does.
        assert!((share(0.0, 1e-6, 1.0) - 1.0).abs() < 1e-11);
        assert!((share(0.0, 2.0, 4.0) - 1.0 / 3.0).abs() < 1e-15);
        assert_eq!(share(0.0, 0.0, 0.0), 1.0);
    }
}
