//! Predictor: the first iterate of a window by extrapolation.

use super::extrapolate::TimeHistory;

/// Extrapolates accepted values. Its order, up to a given one, is the one that would have predicted the last window
/// best: quadratic for smooth motions, constant otherwise.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Predictor {
    order: usize,
    best: usize,
    history: TimeHistory,
}

impl Predictor {
    /// Extrapolation up to `order` (0 constant, 1 linear, 2 quadratic).
    pub fn new(order: usize) -> Self {
        Self { order: order.min(2), best: order.min(2), history: TimeHistory::default() }
    }

    /// The same, from the value `start`.
    pub fn from_start(order: usize, start: &[f64]) -> Self {
        let mut predictor = Self::new(order);
        predictor.accept(start, 1.0);
        predictor
    }

    /// Adds the accepted value at the end of a window of length `dt`.
    pub fn accept(&mut self, x: &[f64], dt: f64) {
        if self.history.len() > self.order {
            let errors = (0..=self.order).map(|order| (order, self.history.squared_error(order, dt, x)));
            if let Some((order, _)) = errors.min_by(|a, b| a.1.total_cmp(&b.1)) {
                self.best = order;
            }
        }
        self.history.push(x, dt);
    }

    /// Extrapolates to the end of the next window, of length `dt`.
    pub fn predict(&self, dt: f64, x: &mut [f64]) {
        self.history.extrapolate(self.best, dt, x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prediction_is_exact_for_polynomials_up_to_its_order() {
        let quadratic = |t: f64| 2.0 - 3.0 * t + 0.5 * t * t;
        for order in 0..=2 {
            let f = |t: f64| match order {
                0 => 2.0,
                1 => 2.0 - 3.0 * t,
                _ => quadratic(t),
            };
            let mut predictor = Predictor::new(order);
            for t in 0..5 {
                predictor.accept(&[f(f64::from(t))], 1.0);
            }
            let mut x = [f64::NAN];
            predictor.predict(1.0, &mut x);
            assert!((x[0] - f(5.0)).abs() < 1e-12, "order {order}");
        }
    }

    #[test]
    fn order_with_the_smallest_last_error_is_selected() {
        // For an alternating sequence the error increases with the order.
        let mut predictor = Predictor::new(2);
        for t in 0..6 {
            predictor.accept(&[if t % 2 == 0 { 1.0 } else { -1.0 }], 1.0);
        }
        let mut x = [f64::NAN];
        predictor.predict(1.0, &mut x);
        assert_eq!(x, [-1.0]);
    }

    #[test]
    fn order_is_limited_by_the_number_of_values() {
        let mut predictor = Predictor::new(2);
        let mut x = [7.0];
        predictor.predict(1.0, &mut x);
        assert_eq!(x, [7.0]);
        predictor.accept(&[1.0], 1.0);
        predictor.predict(1.0, &mut x);
        assert_eq!(x, [1.0]);
        predictor.accept(&[3.0], 1.0);
        predictor.predict(1.0, &mut x);
        assert_eq!(x, [5.0]);
    }
}
