//! Limit, order of convergence and uncertainty of a refinement sequence.
//!
//! The error of the values $`\phi_i`$ at cell sizes (or time steps, or tolerances) $`h_i`$ is modelled as
//! $`\phi_i-\phi_0=\alpha h_i^p`$, fitted by least squares. The uncertainty follows Eça and Hoekstra, J. Comput. Phys.
//! 262 (2014), who extend the grid convergence index of Roache (1994) to more than three values and to scatter:
//!
//! - A fitted order between 0.5 and the formal order (with a margin) is used with the safety factor 1.25. Above it, the
//!   formal order is used; below it, order 1 or 2, whichever fits better. Both have the safety factor 3.
//! - $`U_i=F\epsilon+\sigma+|\phi_i-\phi_\text{fit}|`$ if the scatter $`\sigma`$ is below the range parameter
//!   $`\Delta`$ of the data, else $`3\frac{\sigma}{\Delta}(\ldots)`$.
//!
//! Three values that oscillate have no order; their uncertainty is three times the range, as is that of two values.
//! For four and more values, oscillation is scatter about the fit. If a monotone sequence converges more slowly than any
//! formal order, the uncertainty is at least the range, because a fit of order one underestimates the remaining change.
//! A single value gives no estimate.
//!
//! The uncertainty of the limit is at least the change over the last halving of the size, and three times that change
//! without a reliable order. A fit through three values has three parameters and no scatter, so it looks exact for any
//! distance of the limit; the observed change bounds the uncertainty from below.

/// Minimum reliable order (Eça and Hoekstra, section 2.2).
const MIN_ORDER: f64 = 0.5;
/// Maximum excess of a reliable fitted order over the formal order.
const MARGIN: f64 = 0.1;
/// Maximum order of the fit.
const MAX_ORDER: f64 = 8.0;
/// Safety factor of a reliable fit (Roache).
pub const TRUSTED: f64 = 1.25;
/// Safety factor of an unreliable fit.
pub const DISTRUSTED: f64 = 3.0;
/// Relative difference below which values are equal.
const EQUAL: f64 = 1e-9;

/// A monotone sequence whose changes do not decrease counts as converging if its relative change over a halving of the
/// size is below this value: six more halvings at the same rate then change it by less than a tenth.
const SMALL: f64 = 0.015;

/// Behaviour of a refinement sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behaviour {
    /// The error decreases with a reliable order.
    Monotone,
    /// The fitted order exceeds the formal order: outside the asymptotic range, or by chance.
    TooFast,
    /// The fitted order is below one half, or scatter hides the order.
    Slow,
    /// The changes do not decrease with the size and are not small: a limit may not exist.
    Diverging,
    /// The values oscillate.
    Oscillating,
    /// All values are equal to round-off.
    Equal,
    /// Two values: a change without an order.
    TooFew,
}

impl Behaviour {
    /// Text for the report.
    pub fn words(self) -> &'static str {
        match self {
            Self::Monotone => "converges with a consistent order",
            Self::TooFast => {
                "converges faster than the formal order: coarse values are outside the asymptotic range"
            }
            Self::Slow => {
                "converges slowly, or scatter (tolerances, averages over few windows) hides the order"
            }
            Self::Diverging => "does not converge in the range of the values",
            Self::Oscillating => {
                "oscillates: other errors dominate, or coarse values are outside the asymptotic range"
            }
            Self::Equal => "no change in the range of the values",
            Self::TooFew => "two samples only: a change without an order",
        }
    }
}

/// Convergence of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Convergence {
    /// Extrapolated limit.
    pub limit: f64,
    /// Order of the fit that is used; `None` without a fit.
    pub order: Option<f64>,
    /// Fitted order, reliable or not.
    pub observed: Option<f64>,
    /// Behaviour.
    pub behaviour: Behaviour,
    /// Safety factor.
    pub factor: f64,
    /// Scatter about the fit.
    pub scatter: f64,
    /// Uncertainty of each value (half width), in the order given.
    pub uncertainty: Vec<f64>,
    /// Uncertainty of `limit` (half width).
    pub limit_uncertainty: f64,
    /// Factor of $`h^p`$ in the fit; 0 without a fit.
    pub slope: f64,
}

/// Convergence of `answers`: pairs of size (above zero) and value (finite), in any order; `promised` is the formal order
/// of the method. `None` for fewer than two different sizes, which give no error estimate.
pub fn converge(answers: &[(f64, f64)], promised: f64) -> Option<Convergence> {
    if sizes(answers) < 2 {
        return None;
    }
    let finest = answers.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (range, size) = extent(answers);
    if range <= EQUAL * size {
        return Some(without_order(answers, *finest, Behaviour::Equal, range));
    }
    let sizes = sizes(answers);
    if sizes < 3 {
        return Some(without_order(answers, *finest, Behaviour::TooFew, DISTRUSTED * range));
    }
    if sizes == 3 && oscillates(answers) {
        return Some(without_order(answers, *finest, Behaviour::Oscillating, DISTRUSTED * range));
    }
    let free = free_order(answers);
    let observed = free.as_ref().map(|f| f.order);
    let (fit, behaviour) = choose_fit(answers, free, promised, size);
    Some(Convergence { observed, ..with_order(answers, *finest, &fit, behaviour) })
}

/// Range of the values and the largest of their magnitudes.
fn extent(answers: &[(f64, f64)]) -> (f64, f64) {
    let values = || answers.iter().map(|a| a.1);
    let range = values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min);
    (range, values().map(f64::abs).fold(0.0, f64::max))
}

/// The result without a fit: the finest value with the uncertainty `half`.
fn without_order(answers: &[(f64, f64)], finest: (f64, f64), behaviour: Behaviour, half: f64) -> Convergence {
    Convergence {
        limit: finest.1,
        order: None,
        observed: None,
        behaviour,
        factor: if behaviour == Behaviour::Equal { TRUSTED } else { DISTRUSTED },
        scatter: 0.0,
        uncertainty: answers.iter().map(|a| half + (a.1 - finest.1).abs()).collect(),
        limit_uncertainty: half,
        slope: 0.0,
    }
}

/// The fit of free order if reliable, else a fit of fixed order; with the behaviour of the sequence.
fn choose_fit(answers: &[(f64, f64)], free: Option<Fit>, promised: f64, size: f64) -> (Fit, Behaviour) {
    let sound = |f: &Fit| (MIN_ORDER..=promised + MARGIN).contains(&f.order);
    match free {
        Some(f) if sound(&f) => (f, Behaviour::Monotone),
        Some(f) if f.order > promised + MARGIN => (fixed_order(answers, promised), Behaviour::TooFast),
        free => {
            let fits = [fixed_order(answers, 1.0), fixed_order(answers, 2.0)];
            let best = fits.into_iter().min_by(|a, b| a.scatter.total_cmp(&b.scatter));
            let diverges = monotone(answers) && free.is_none() && last_halving(answers) > SMALL * size;
            let behaviour = if diverges { Behaviour::Diverging } else { Behaviour::Slow };
            (best.unwrap_or_else(|| fixed_order(answers, 1.0)), behaviour)
        }
    }
}

/// The result of a fit, with the uncertainty of each value and of the limit.
fn with_order(answers: &[(f64, f64)], finest: (f64, f64), fit: &Fit, behaviour: Behaviour) -> Convergence {
    let (range, _) = extent(answers);
    let steady = !oscillates(answers);
    let delta = range / (answers.len() - 1) as f64;
    let quiet = fit.scatter < delta;
    let factor = if behaviour == Behaviour::Monotone && quiet { TRUSTED } else { DISTRUSTED };
    let stretch = if quiet { 1.0 } else { 3.0 * fit.scatter / delta };
    let half = |&(h, value): &(f64, f64)| {
        let error = fit.slope * h.powf(fit.order);
        let stated = stretch * (factor * error.abs() + fit.scatter + (value - fit.limit - error).abs());
        let slow = matches!(behaviour, Behaviour::Slow | Behaviour::Diverging);
        if slow && steady { stated.max(range) } else { stated }
    };
    // Uncertainty of the finest value, reduced by its distance from the limit, by half at most.
    let last = half(&finest);
    let off = (finest.1 - fit.limit).abs();
    let sound = matches!(behaviour, Behaviour::Monotone | Behaviour::TooFast);
    let seen = if sound { 1.0 } else { DISTRUSTED } * last_halving(answers);
    Convergence {
        limit: fit.limit,
        order: Some(fit.order),
        observed: None,
        behaviour,
        factor,
        scatter: fit.scatter,
        uncertainty: answers.iter().map(half).collect(),
        limit_uncertainty: (last - off).max(0.5 * last).max(seen),
        slope: fit.slope,
    }
}

/// Largest change from the finest value over sizes up to twice its size (or the next size, if that is larger). If all
/// sizes are closer together, the change is scaled by the ratio of the logarithms.
fn last_halving(answers: &[(f64, f64)]) -> f64 {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(h, finest)) = sorted.first() else { return 0.0 };
    // Slightly below two, because factors such as 0.6667 are rounded.
    let up_to = sorted.iter().position(|a| a.0 >= 1.98 * h).unwrap_or(sorted.len() - 1);
    let change = sorted[..=up_to].iter().map(|a| (a.1 - finest).abs()).fold(0.0, f64::max);
    let ratio = (sorted[up_to].0 / h).ln();
    if ratio > 0.0 { change * (2f64.ln() / ratio).max(1.0) } else { change }
}

/// Number of different sizes.
pub fn sizes(answers: &[(f64, f64)]) -> usize {
    let mut all: Vec<f64> = answers.iter().map(|a| a.0).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all.len()
}

/// Whether the values are monotone in the size.
fn monotone(answers: &[(f64, f64)]) -> bool {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut changes = sorted.windows(2).map(|w| w[1].1 - w[0].1);
    let first = changes.clone().find(|d| *d != 0.0).unwrap_or(0.0);
    changes.all(|d| d * first >= 0.0)
}

/// Whether the differences of the three finest values change sign.
fn oscillates(answers: &[(f64, f64)]) -> bool {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let d = |i: usize| sorted[i + 1].1 - sorted[i].1;
    d(0) * d(1) < 0.0
}

#[derive(Clone, Copy, Debug)]
struct Fit {
    limit: f64,
    slope: f64,
    order: f64,
    scatter: f64,
}

/// Linear least-squares fit of $`\phi_0+\alpha h^p`$ for a given order. The scatter is the standard deviation of the
/// residuals with $`n-2`$ degrees of freedom.
fn fixed_order(answers: &[(f64, f64)], order: f64) -> Fit {
    let n = answers.len() as f64;
    let x = |h: f64| h.powf(order);
    let mean_x = answers.iter().map(|a| x(a.0)).sum::<f64>() / n;
    let mean_y = answers.iter().map(|a| a.1).sum::<f64>() / n;
    let (mut xx, mut xy) = (0.0, 0.0);
    for &(h, y) in answers {
        xx += (x(h) - mean_x).powi(2);
        xy += (x(h) - mean_x) * (y - mean_y);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    let limit = mean_y - slope * mean_x;
    let left: f64 = answers.iter().map(|&(h, y)| (y - limit - slope * x(h)).powi(2)).sum();
    Fit { limit, slope, order, scatter: (left / (n - 2.0).max(1.0)).sqrt() }
}

/// The fit with the best order; `None` if that is at the lower end of the searched range.
fn free_order(answers: &[(f64, f64)]) -> Option<Fit> {
    let steps = 400;
    let least = 0.02;
    let at = |i: i32| least * (MAX_ORDER / least).powf(f64::from(i) / f64::from(steps));
    let left = |p: f64| fixed_order(answers, p).scatter;
    let best = (0..=steps).min_by(|a, b| left(at(*a)).total_cmp(&left(at(*b))))?;
    if best == 0 {
        return None;
    }
    let (mut low, mut high) = (at(best - 1), at((best + 1).min(steps)));
    for _ in 0..80 {
        let third = (high - low) / 3.0;
        if left(low + third) < left(high - third) { high -= third } else { low += third }
    }
    let fit = fixed_order(answers, 0.5 * (low + high));
    let freedom = answers.len() as f64;
    // The order is a third fitted parameter.
    let scatter = fit.scatter * ((freedom - 2.0) / (freedom - 3.0).max(1.0)).sqrt();
    Some(Fit { scatter, ..fit })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(limit: f64, slope: f64, order: f64, sizes: &[f64]) -> Vec<(f64, f64)> {
        sizes.iter().map(|&h| (h, limit + slope * h.powf(order))).collect()
    }

    #[test]
    fn exact_power_laws_give_order_limit_and_grid_convergence_index() {
        for (order, sizes) in
            [(2.0, vec![1.0, 0.5, 0.25]), (1.0, vec![1.0, 0.7, 0.4, 0.3]), (1.4, vec![4.0, 3.0, 2.0, 1.0])]
        {
            let answers = sequence(3.0, -0.2, order, &sizes);
            let c = converge(&answers, 2.0).unwrap();
            assert_eq!(c.behaviour, Behaviour::Monotone);
            assert!((c.order.unwrap() - order).abs() < 1e-4, "{c:?}");
            assert!((c.limit - 3.0).abs() < 1e-5);
            // Grid convergence index: 1.25 of the extrapolated error.
            for (u, (h, _)) in c.uncertainty.iter().zip(&answers) {
                let error = 0.2 * h.powf(order);
                assert!((u / (1.25 * error) - 1.0).abs() < 1e-2, "{u} {error}");
            }
        }
    }

    #[test]
    fn published_example_of_celik_is_reproduced() {
        // Celik et al., J. Fluids Eng. 130 (2008), table 1, first column: 18 000, 8 000 and 4 500
        // cells in two dimensions, 6.063, 5.972, 5.863: order 1.53, extrapolated 6.1685, index 2.2 %.
        let h = |cells: f64| (1.0 / cells).sqrt();
        let answers = [(h(18000.0), 6.063), (h(8000.0), 5.972), (h(4500.0), 5.863)];
        let c = converge(&answers, 2.0).unwrap();
        assert!((c.order.unwrap() - 1.53).abs() < 0.01, "{c:?}");
        assert!((c.limit - 6.1685).abs() < 1e-3, "{c:?}");
        assert!((c.uncertainty[0] / 6.063 - 0.022).abs() < 5e-4, "{c:?}");
    }

    #[test]
    fn order_above_the_formal_one_is_replaced_by_it() {
        let answers = sequence(1.0, 0.1, 4.0, &[1.0, 0.5, 0.25]);
        let c = converge(&answers, 2.0).unwrap();
        assert_eq!((c.behaviour, c.order, c.factor), (Behaviour::TooFast, Some(2.0), DISTRUSTED));
        assert!((c.observed.unwrap() - 4.0).abs() < 1e-3);
        // The true error of the finest, 4e-4, lies within.
        assert!(c.uncertainty[2] > 4e-4);
    }

    #[test]
    fn slow_oscillating_short_and_constant_sequences_are_recognised() {
        let slow = converge(&sequence(1.0, 0.1, 0.2, &[1.0, 0.5, 0.25, 0.125]), 2.0).unwrap();
        assert_eq!((slow.behaviour, slow.factor), (Behaviour::Slow, DISTRUSTED));
        // At order 0.2 a few values cannot bound the error; the uncertainty is at least their range.
        assert!(slow.uncertainty[3] >= 0.1 * (1.0 - 0.125f64.powf(0.2)) - 1e-12, "{slow:?}");
        let oscillating = converge(&[(1.0, 1.0), (0.5, 1.2), (0.25, 1.1)], 2.0).unwrap();
        assert_eq!(oscillating.behaviour, Behaviour::Oscillating);
        assert!((oscillating.limit_uncertainty - 0.6).abs() < 1e-12);
        let few = converge(&[(1.0, 1.0), (0.5, 1.1)], 2.0).unwrap();
        assert_eq!((few.behaviour, few.order), (Behaviour::TooFew, None));
        assert!((few.uncertainty[1] - 0.3).abs() < 1e-12);
        let equal = converge(&[(1.0, 2.0), (0.5, 2.0), (0.25, 2.0 + 1e-12)], 2.0).unwrap();
        assert_eq!(equal.behaviour, Behaviour::Equal);
        assert!(equal.limit_uncertainty < 1e-9);
        // The error of a single value is unknown, not zero.
        for none in [vec![], vec![(1.0, 3.0)], vec![(1.0, 3.0), (1.0, 3.5)]] {
            assert_eq!(converge(&none, 2.0), None);
        }
    }

    #[test]
    fn limit_uncertainty_is_at_least_the_last_halving() {
        assert!((last_halving(&[(1.0, 3.0), (0.5, 2.0), (0.25, 1.5)]) - 0.5).abs() < 1e-15);
        // Up to twice the finest size, and the largest change there.
        assert!((last_halving(&[(2.0, 1.0), (1.5, 1.3), (1.0, 1.1), (4.0, 9.0)]) - 0.2).abs() < 1e-12);
        // Less than a halving is scaled up; more than one counts as it is.
        let near = last_halving(&[(2f64.sqrt(), 1.2), (1.0, 1.0)]);
        assert!((near - 0.4).abs() < 1e-12, "{near}");
        assert!((last_halving(&[(10.0, 1.2), (1.0, 1.0)]) - 0.2).abs() < 1e-12);
        // Tolerances two decades apart must not reduce the uncertainty to a hundredth of the observed change.
        let c = converge(&sequence(1.0, 0.1, 1.0, &[1e-1, 1e-2, 1e-3]), 1.0).unwrap();
        assert!(c.limit_uncertainty >= 0.1 * 9e-3 - 1e-12, "{c:?}");
    }

    #[test]
    fn changes_that_grow_with_refinement_are_diverging() {
        // The mean square of an impulsive start grows with one over the step.
        let peak: Vec<_> = [2.0, 1.5, 1.0f64].iter().map(|h| (*h, 100.0 / h.sqrt())).collect();
        assert_eq!(converge(&peak, 2.0).unwrap().behaviour, Behaviour::Diverging);
        let logarithm: Vec<_> = [4.0, 2.0, 1.0f64].iter().map(|h| (*h, 10.0 - h.ln())).collect();
        assert_eq!(converge(&logarithm, 2.0).unwrap().behaviour, Behaviour::Diverging);
        // Oscillation is scatter, not divergence: windows of 10, 7.5, 6 and 5 ms, mean drag (N) of a release.
        let scattered = [(2.0, 51.03), (1.5, 51.43), (1.2, 50.49), (1.0, 50.05)];
        let c = converge(&scattered, 2.0).unwrap();
        assert!(
            c.behaviour == Behaviour::Slow && c.limit_uncertainty >= 3.0 * (51.43 - 50.05) - 1e-9,
            "{c:?}"
        );
        // Small changes: the uncertainty is three times the observed change.
        let small: Vec<_> = [4.0, 2.0, 1.0f64].iter().map(|h| (*h, 1000.0 - h.ln())).collect();
        let c = converge(&small, 2.0).unwrap();
        assert!(c.behaviour == Behaviour::Slow && c.limit_uncertainty >= 3.0 * 2f64.ln() - 1e-9, "{c:?}");
    }

    #[test]
    fn scatter_increases_the_uncertainty() {
        let mut answers = sequence(1.0, 0.1, 2.0, &[1.0, 0.8, 0.6, 0.4, 0.3]);
        let clean = converge(&answers, 2.0).unwrap();
        for (i, a) in answers.iter_mut().enumerate() {
            a.1 += 0.0015 * if i % 2 == 0 { 1.0 } else { -1.0 };
        }
        let noisy = converge(&answers, 2.0).unwrap();
        assert!(noisy.scatter > 3e-4 && noisy.uncertainty[4] > clean.uncertainty[4], "{noisy:?}");
        assert!(noisy.limit_uncertainty >= clean.limit_uncertainty, "{noisy:?}");
        assert!((noisy.limit - 1.0).abs() <= noisy.limit_uncertainty, "{noisy:?}");
    }

    #[test]
    fn uncertainty_covers_the_limit_of_two_term_sequences() {
        // Two error terms.
        let (mut covered, mut bounded, mut all) = (0, 0, 0);
        for second in [-0.5, -0.2, 0.1, 0.4, 1.0] {
            for order in [1.0, 1.5, 2.0] {
                for sizes in [vec![1.0, 0.5, 0.25], vec![1.0, 0.8, 0.6, 0.5], vec![1.0, 0.7, 0.5, 0.35, 0.25]]
                {
                    let answers: Vec<_> = sizes
                        .iter()
                        .map(|&h: &f64| (h, 1.0 + 0.1 * (h.powf(order) + second * h.powf(order + 1.0))))
                        .collect();
                    let c = converge(&answers, 2.0).unwrap();
                    let finest = answers.last().unwrap().1;
                    all += 1;
                    // Bound used in recommendations: distance from the limit plus uncertainty of the limit.
                    let bound = (finest - c.limit).abs() + c.limit_uncertainty;
                    bounded += usize::from((finest - 1.0).abs() <= bound);
                    covered += usize::from((finest - 1.0).abs() <= *c.uncertainty.last().unwrap());
                }
            }
        }
        assert!(10 * covered >= 9 * all, "{covered} of {all}");
        assert!(20 * bounded >= 19 * all, "{bounded} of {all}");
    }
}
