//! First iterate of a window, from the windows before.

use std::collections::VecDeque;

/// Extrapolates accepted values: constant, then linear, then quadratic, as soon
/// as there are enough windows (and up to the order asked for).
#[derive(Clone, Debug)]
pub struct Predictor {
    order: usize,
    past: VecDeque<Vec<f64>>,
}

impl Predictor {
    /// Extrapolation up to `order` (0 constant, 1 linear, 2 quadratic).
    pub fn new(order: usize) -> Self {
        Self { order: order.min(2), past: VecDeque::with_capacity(order + 1) }
    }

    /// Adds the accepted value of the window that just ended.
    pub fn accept(&mut self, x: &[f64]) {
        let mut kept = if self.past.len() > self.order {
            self.past.pop_back().expect("not empty")
        } else {
            Vec::with_capacity(x.len())
        };
        kept.clear();
        kept.extend_from_slice(x);
        self.past.push_front(kept);
    }

    /// The last accepted value.
    pub fn last(&self) -> Option<&[f64]> {
        self.past.front().map(Vec::as_slice)
    }

    /// Extrapolates to the end of the next window; all windows are equally long.
    pub fn predict(&self, x: &mut [f64]) {
        let weights: &[f64] = match self.past.len() {
            0 => &[],
            1 => &[1.0],
            2 => &[2.0, -1.0],
            _ => &[3.0, -3.0, 1.0],
        };
        if weights.is_empty() {
            return;
        }
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
