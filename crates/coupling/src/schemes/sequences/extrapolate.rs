//! Polynomial extrapolation from the ends of past windows of any lengths.

use std::collections::VecDeque;

/// Highest order of extrapolation.
pub const MAX_ORDER: usize = 2;

/// Lagrange weights at time `t` of the polynomial through values at the times `at` (newest first; the newest is time
/// 0).
pub fn lagrange(at: &[f64], t: f64) -> [f64; MAX_ORDER + 1] {
    let mut weights = [0.0; MAX_ORDER + 1];
    for (i, weight) in weights.iter_mut().enumerate().take(at.len()) {
        let others = at.iter().enumerate().filter(|(j, _)| *j != i);
        *weight = others.map(|(_, other)| (t - other) / (at[i] - other)).product();
    }
    weights
}

/// Values at the ends of the last windows, for extrapolation in time.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct TimeHistory {
    values: VecDeque<Vec<f64>>,
    /// Lengths of the windows that ended in these values, newest first.
    lengths: VecDeque<f64>,
}

impl TimeHistory {
    /// From the value `start`.
    pub fn from_start(start: &[f64]) -> Self {
        let mut history = Self::default();
        history.push(start, 1.0);
        history
    }

    /// Adds the value at the end of a window of length `dt`, the first one with any length.
    pub fn push(&mut self, value: &[f64], dt: f64) {
        let mut kept = if self.values.len() > MAX_ORDER {
            self.lengths.pop_back();
            self.values.pop_back().unwrap_or_default()
        } else {
            Vec::with_capacity(value.len())
        };
        kept.clear();
        kept.extend_from_slice(value);
        self.values.push_front(kept);
        self.lengths.push_front(dt);
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The newest value.
    pub fn last(&self) -> Option<&[f64]> {
        self.values.front().map(Vec::as_slice)
    }

    /// Weights of an extrapolation with `order`, limited by the number of values, to `ahead` seconds after the
    /// newest.
    fn weights(&self, order: usize, ahead: f64) -> ([f64; MAX_ORDER + 1], usize) {
        let count = (order.min(MAX_ORDER) + 1).min(self.values.len());
        let mut at = [0.0; MAX_ORDER + 1];
        for i in 1..count {
            at[i] = at[i - 1] - self.lengths[i - 1];
        }
        (lagrange(&at[..count], ahead), count)
    }

    /// Extrapolates with polynomial `order` to `ahead` seconds after the newest value, into `x`, which is unchanged
    /// where there are no values.
    pub fn extrapolate(&self, order: usize, ahead: f64, x: &mut [f64]) {
        let (weights, count) = self.weights(order, ahead);
        if count == 0 {
            return;
        }
        x.fill(0.0);
        for (weight, value) in weights.iter().zip(self.values.iter().take(count)) {
            x.iter_mut().zip(value).for_each(|(x, v)| *x += weight * v);
        }
    }

    /// Squared distance of `x` from the extrapolation to `ahead` seconds.
    pub fn squared_error(&self, order: usize, ahead: f64, x: &[f64]) -> f64 {
        let (weights, count) = self.weights(order, ahead);
        let extrapolated =
            |i: usize| weights.iter().zip(self.values.iter().take(count)).map(|(w, v)| w * v[i]).sum::<f64>();
        x.iter().enumerate().map(|(i, x)| (x - extrapolated(i)).powi(2)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_for_equal_windows_are_the_binomial_ones() {
        assert_eq!(lagrange(&[0.0], 1.0)[0], 1.0);
        assert_eq!(lagrange(&[0.0, -1.0], 1.0)[..2], [2.0, -1.0]);
        assert_eq!(lagrange(&[0.0, -1.0, -2.0], 1.0), [3.0, -3.0, 1.0]);
        assert_eq!(lagrange(&[0.0, -1.0], 0.5)[..2], [1.5, -0.5]);
        assert_eq!(lagrange(&[0.0, -1.0, -2.0], 0.5), [1.875, -1.25, 0.375]);
    }

    #[test]
    fn extrapolation_is_exact_for_polynomials_over_unequal_windows() {
        let f = |t: f64| [2.0 - 3.0 * t, 1.0 + t - 0.7 * t * t];
        let mut history = TimeHistory::default();
        let mut t = 0.0;
        for dt in [0.3, 0.1, 0.25, 0.05] {
            t += dt;
            history.push(&f(t), dt);
        }
        let mut x = [0.0; 2];
        history.extrapolate(2, 0.2, &mut x);
        let exact = f(t + 0.2);
        assert!((x[0] - exact[0]).abs() < 1e-12 && (x[1] - exact[1]).abs() < 1e-12);
        assert!(
            history.squared_error(2, 0.2, &exact) < 1e-24 && history.squared_error(1, 0.2, &exact) > 1e-6
        );
    }
}
