//! The Pareto front of cost and error.

use super::answer::Estimate;

/// Samples (cost and error of each, `None` where one is unknown) that are on the front, the cheapest first. A
/// dearer sample joins only if its error is less than that of the last one by more than the
/// uncertainty, the larger of the two bands: errors fall strictly along the front.
pub fn front(points: &[Option<(f64, Estimate)>]) -> Vec<usize> {
    let sound = |p: &(f64, Estimate)| p.0.is_finite() && p.1.error.is_finite() && p.1.band.is_finite();
    let mut order: Vec<(usize, f64, Estimate)> = points
        .iter()
        .enumerate()
        .filter_map(|(i, p)| p.filter(sound).map(|(cost, estimate)| (i, cost, estimate)))
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.2.error.total_cmp(&b.2.error)));
    let mut on: Vec<(usize, Estimate)> = Vec::new();
    for (i, _, e) in order {
        if on.last().is_none_or(|(_, last)| last.error - e.error > last.band.max(e.band)) {
            on.push((i, e));
        }
    }
    on.into_iter().map(|p| p.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(cost: f64, error: f64, band: f64) -> Option<(f64, Estimate)> {
        Some((cost, Estimate { error, band }))
    }

    #[test]
    fn the_front_falls_and_gains_within_the_uncertainty_do_not_count() {
        let points = [
            point(9.0, 0.02, 0.01), // as good as the next, and dearer
            point(1.0, 0.30, 0.05), // the cheapest
            point(2.0, 0.27, 0.05), // better by less than its band
            point(3.0, 0.20, 0.05), // better by more
            point(4.0, 0.10, 0.15), // better by less than its own band
            point(8.0, 0.03, 0.01),
            None,
            point(5.0, f64::NAN, 0.0),
            point(2.0, 0.40, 0.0), // dearer and worse
        ];
        assert_eq!(front(&points), [1, 3, 5]);
        assert!(front(&[]).is_empty() && front(&[None]).is_empty());
    }

    #[test]
    fn an_exact_answer_has_no_band_and_every_gain_counts() {
        let points = [point(1.0, 0.3, 0.0), point(2.0, 0.299, 0.0), point(3.0, 0.299, 0.0)];
        assert_eq!(front(&points), [0, 1]);
    }

    #[test]
    fn of_equal_costs_the_smaller_error_counts() {
        assert_eq!(front(&[point(1.0, 0.3, 0.0), point(1.0, 0.2, 0.0)]), [1]);
    }
}
