//! First iterate of a window, from the windows before.

use std::collections::VecDeque;

/// Weights of the last values, newest first, by order.
const WEIGHTS: [&[f64]; 3] = [&[1.0], &[2.0, -1.0], &[3.0, -3.0, 1.0]];

/// Extrapolates accepted values with the order, up to the one asked for, that
/// would have served the last window best: quadratic where the motion is smooth,
/// none where it is not.
#[derive(Clone, Debug)]
pub struct Predictor {
    order: usize,
    best: usize,
    past: VecDeque<Vec<f64>>,
}

impl Predictor {
    /// Extrapolation up to `order` (0 constant, 1 linear, 2 quadratic).
    pub fn new(order: usize) -> Self {
        Self { order: order.min(2), best: order.min(2), past: VecDeque::with_capacity(order + 1) }
    }

    /// Adds the accepted value of the window that just ended.
    pub fn accept(&mut self, x: &[f64]) {
        let misses = (0..=self.order.min(self.past.len().wrapping_sub(1)))
            .filter(|_| self.past.len() > self.order)
            .map(|order| (order, self.miss(order, x)));
        if let Some((order, _)) = misses.min_by(|a, b| a.1.total_cmp(&b.1)) {
            self.best = order;
        }
        let mut kept = if self.past.len() > self.order {
            self.past.pop_back().expect("not empty")
        } else {
            Vec::with_capacity(x.len())
        };
        kept.clear();
        kept.extend_from_slice(x);
        self.past.push_front(kept);
    }

    /// Squared distance of `x` from its extrapolation.
    fn miss(&self, order: usize, x: &[f64]) -> f64 {
        (0..x.len())
            .map(|i| {
                let guess: f64 = WEIGHTS[order].iter().zip(&self.past).map(|(w, p)| w * p[i]).sum();
                (x[i] - guess) * (x[i] - guess)
            })
            .sum()
    }

    /// The last accepted value.
    pub fn last(&self) -> Option<&[f64]> {
        self.past.front().map(Vec::as_slice)
    }

    /// Extrapolates to the end of the next window; all windows are equally long.
    pub fn predict(&self, x: &mut [f64]) {
        let Some(most) = self.past.len().checked_sub(1) else { return };
        let weights = WEIGHTS[self.best.min(most)];
        x.fill(0.0);
        for (weight, past) in weights.iter().zip(&self.past) {
            for (x, p) in x.iter_mut().zip(past) {
                *x += weight * p;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_exact_for_polynomials_up_to_its_order() {
        let quadratic = |t: f64| 2.0 - 3.0 * t + 0.5 * t * t;
        for order in 0..=2 {
            let f = |t: f64| match order {
                0 => 2.0,
                1 => 2.0 - 3.0 * t,
                _ => quadratic(t),
            };
            let mut predictor = Predictor::new(order);
            for t in 0..5 {
                predictor.accept(&[f(f64::from(t))]);
            }
            let mut x = [f64::NAN];
            predictor.predict(&mut x);
            assert!((x[0] - f(5.0)).abs() < 1e-12, "order {order}");
        }
    }

    #[test]
    fn starts_with_what_there_is() {
        let mut predictor = Predictor::new(2);
        let mut x = [7.0];
        predictor.predict(&mut x);
        assert_eq!(x, [7.0]);
        predictor.accept(&[1.0]);
        predictor.predict(&mut x);
        assert_eq!(x, [1.0]);
        predictor.accept(&[3.0]);
        predictor.predict(&mut x);
        assert_eq!(x, [5.0]);
    }
}
