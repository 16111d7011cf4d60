//! The Pareto front of cost and error.

use super::answer::Estimate;

/// Indices of the samples on the Pareto front, by increasing cost, from the cost and error of each sample (`None` if
/// unknown). A costlier sample is on the front if its error is smaller than that of the last one by more than the larger
/// of the two uncertainties, so errors decrease strictly along the front.
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
    fn front_decreases_by_more_than_the_uncertainty() {
        let points = [
            point(9.0, 0.02, 0.01), // as accurate as the next, and costlier
            point(1.0, 0.30, 0.05), // the cheapest
            point(2.0, 0.27, 0.05), // smaller error, within the uncertainty
            point(3.0, 0.20, 0.05), // smaller by more than the uncertainty
            point(4.0, 0.10, 0.15), // smaller error, within its own uncertainty
            point(8.0, 0.03, 0.01),
            None,
            point(5.0, f64::NAN, 0.0),
            point(2.0, 0.40, 0.0), // costlier and less accurate
        ];
        assert_eq!(front(&points), [1, 3, 5]);
        assert!(front(&[]).is_empty() && front(&[None]).is_empty());
    }

    #[test]
    fn without_uncertainty_every_decrease_counts() {
        let points = [point(1.0, 0.3, 0.0), point(2.0, 0.299, 0.0), point(3.0, 0.299, 0.0)];
        assert_eq!(front(&points), [0, 1]);
    }

    #[test]
    fn smallest_error_wins_at_equal_cost() {
        assert_eq!(front(&[point(1.0, 0.3, 0.0), point(1.0, 0.2, 0.0)]), [1]);
    }
}
