//! What a sequence of answers converges to, with which order, and how far off each may be.
//!
//! Of answers $\phi_i$ at cell sizes (or steps, or tolerances) $h_i$ the error is taken as
//! $\phi_i-\phi_0=\alpha h_i^p$, fitted by least squares, and turned into an uncertainty after Eça
//! and Hoekstra, J. Comput. Phys. 262 (2014), who extend the grid convergence index of Roache
//! (1994) to more than three answers and to scatter:
//!
//! - where the fitted order lies between 0.5 and the promised one (with a margin), it is taken,
//!   with the safety factor 1.25; above, the promised order; below, orders 1, 2 or both, whatever
//!   fits best, with the factor 3;
//! - $U_i=F\epsilon+\sigma+|\phi_i-\phi_\text{fit}|$ where the scatter $\sigma$ is below the data's
//!   range parameter $\Delta$, else $3\frac{\sigma}{\Delta}(\ldots)$.
//!
//! Three answers that oscillate have no order: the band is three times their range, as is that of
//! two answers. Of four and more, oscillation is scatter about the fit. Where a monotone sequence converges
//! more slowly than any formal order, the band is at least the range: the fit of order one would hide
//! the remaining change. One answer shows nothing: it is not assessed.
//!
//! The band about the limit is at least the change over the last halving of the size, and three times that where there is
//! no sound order. Three answers determine three numbers and leave no scatter, so a fit through them looks exact
//! however far the limit is: the change is what was seen.

/// Fitted orders below this are none (Eça and Hoekstra, section 2.2).
const LEAST_ORDER: f64 = 0.5;
/// A fitted order may exceed the promised one by this much before it is distrusted.
const MARGIN: f64 = 0.1;
/// Highest order that is looked for.
const MOST_ORDER: f64 = 8.0;
/// Safety factor of a fit that can be trusted (Roache).
pub const TRUSTED: f64 = 1.25;
/// And of one that cannot.
pub const DISTRUSTED: f64 = 3.0;
/// Answers whose differences are below this share of their size are equal.
const EQUAL: f64 = 1e-9;

/// A monotone sequence whose changes do not fall is taken to converge as long as a halving of the size changes it by
/// less than this share: six more halvings at the same rate are then within a tenth.
const SMALL: f64 = 0.015;

/// Why an order is what it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behaviour {
    /// The error falls with a sound order.
    Monotone,
    /// It falls faster than promised: not yet in the asymptotic range, or by luck.
    TooFast,
    /// It falls more slowly than with order one half, or the scatter hides the order.
    Slow,
    /// The changes do not fall with the size, and are not small: there may be no limit.
    Diverging,
    /// Answers oscillate.
    Oscillating,
    /// All answers are equal to round-off: no effect within the range of the values.
    Equal,
    /// Two answers show a change and no order.
    TooFew,
}

impl Behaviour {
    /// Text for the report.
    pub fn words(self) -> &'static str {
        match self {
            Self::Monotone => "converges with a steady order",
            Self::TooFast => {
                "converges faster than the formal order: coarse values are not yet in the asymptotic range"
            }
            Self::Slow => {
                "converges slowly, or scatter (tolerances, averages over few windows) hides the order"
            }
            Self::Diverging => "does not converge within the range of the values",
            Self::Oscillating => {
                "oscillates: below the scatter of other errors, or coarse values behave differently"
            }
            Self::Equal => "no change within the range of the values",
            Self::TooFew => "two samples show a change and no order",
        }
    }
}

/// Result for a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Convergence {
    /// The answer without this error.
    pub limit: f64,
    /// Order of the fit that was used; `None` where there is none.
    pub order: Option<f64>,
    /// The fitted order as it came out, sound or not.
    pub observed: Option<f64>,
    /// What the sequence does.
    pub behaviour: Behaviour,
    /// Safety factor.
    pub factor: f64,
    /// Scatter about the fit.
    pub scatter: f64,
    /// Half width of the band about each answer that holds the limit, in the order given.
    pub uncertainty: Vec<f64>,
    /// Half width of the band about `limit`.
    pub limit_uncertainty: f64,
    /// Factor of $h^p$ in the fit (0 where there is none).
    pub slope: f64,
}

/// Judges `answers`, pairs of size and value in any order; `promised` is the formal order of the
/// method. Sizes above zero, values finite. `None` for answers of fewer than two sizes: they say nothing of
/// an error.
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

/// The result where no order can be fitted: the finest answer with a band of this half width.
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

/// The fit of free order where that is sound, else one of a formal order, with what the sequence does.
fn choose_fit(answers: &[(f64, f64)], free: Option<Fit>, promised: f64, size: f64) -> (Fit, Behaviour) {
    let sound = |f: &Fit| (LEAST_ORDER..=promised + MARGIN).contains(&f.order);
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

/// The result of a fit, with the uncertainty of each answer and of the limit.
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
    // The finest answer's band about the limit: what the fit itself accounts for is taken off, but
    // never more than half of it.
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

/// Largest change from the finest answer over sizes up to twice its own (the next size, where that is larger);
/// where all sizes are less than that apart, their change times the ratio of the logarithms.
fn last_halving(answers: &[(f64, f64)]) -> f64 {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(h, finest)) = sorted.first() else { return 0.0 };
    // A little below two: factors such as 0.6667 are rounded.
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

/// Whether the answers only grow, or only fall, with the size.
fn monotone(answers: &[(f64, f64)]) -> bool {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut changes = sorted.windows(2).map(|w| w[1].1 - w[0].1);
    let first = changes.clone().find(|d| *d != 0.0).unwrap_or(0.0);
    changes.all(|d| d * first >= 0.0)
}

/// Whether the differences of the three finest answers change sign.
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

/// $\phi_0+\alpha h^p$ for a given order: linear least squares. The scatter is the standard
/// deviation of what is left, with the degrees of freedom that are left.
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

/// The same with the order that fits best; `None` where that is at an end of the orders
/// looked at.
fn free_order(answers: &[(f64, f64)]) -> Option<Fit> {
    let steps = 400;
    let least = 0.02;
    let at = |i: i32| least * (MOST_ORDER / least).powf(f64::from(i) / f64::from(steps));
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
    // One more number was fitted.
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
    fn exact_powers_give_order_limit_and_roaches_index() {
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
    fn the_index_of_a_published_example() {
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
    fn what_falls_too_fast_is_held_to_the_promise() {
        let answers = sequence(1.0, 0.1, 4.0, &[1.0, 0.5, 0.25]);
        let c = converge(&answers, 2.0).unwrap();
        assert_eq!((c.behaviour, c.order, c.factor), (Behaviour::TooFast, Some(2.0), DISTRUSTED));
        assert!((c.observed.unwrap() - 4.0).abs() < 1e-3);
        // The true error of the finest, 4e-4, lies within.
        assert!(c.uncertainty[2] > 4e-4);
    }

    #[test]
    fn slow_oscillating_few_and_equal() {
        let slow = converge(&sequence(1.0, 0.1, 0.2, &[1.0, 0.5, 0.25, 0.125]), 2.0).unwrap();
        assert_eq!((slow.behaviour, slow.factor), (Behaviour::Slow, DISTRUSTED));
        // At a fifth of an order no band of a few values can be sure; it says at least their range.
        assert!(slow.uncertainty[3] >= 0.1 * (1.0 - 0.125f64.powf(0.2)) - 1e-12, "{slow:?}");
        let to_and_fro = converge(&[(1.0, 1.0), (0.5, 1.2), (0.25, 1.1)], 2.0).unwrap();
        assert_eq!(to_and_fro.behaviour, Behaviour::Oscillating);
        assert!((to_and_fro.limit_uncertainty - 0.6).abs() < 1e-12);
        let few = converge(&[(1.0, 1.0), (0.5, 1.1)], 2.0).unwrap();
        assert_eq!((few.behaviour, few.order), (Behaviour::TooFew, None));
        assert!((few.uncertainty[1] - 0.3).abs() < 1e-12);
        let equal = converge(&[(1.0, 2.0), (0.5, 2.0), (0.25, 2.0 + 1e-12)], 2.0).unwrap();
        assert_eq!(equal.behaviour, Behaviour::Equal);
        assert!(equal.limit_uncertainty < 1e-9);
        // One answer has an unknown error, not one of 0 +- 0.
        for none in [vec![], vec![(1.0, 3.0)], vec![(1.0, 3.0), (1.0, 3.5)]] {
            assert_eq!(converge(&none, 2.0), None);
        }
    }

    #[test]
    fn the_last_halving_is_the_least_band_of_a_limit() {
        assert!((last_halving(&[(1.0, 3.0), (0.5, 2.0), (0.25, 1.5)]) - 0.5).abs() < 1e-15);
        // Up to twice the finest size, and the largest change there.
        assert!((last_halving(&[(2.0, 1.0), (1.5, 1.3), (1.0, 1.1), (4.0, 9.0)]) - 0.2).abs() < 1e-12);
        // Less than a halving is scaled up; more than one counts as it is.
        let near = last_halving(&[(2f64.sqrt(), 1.2), (1.0, 1.0)]);
        assert!((near - 0.4).abs() < 1e-12, "{near}");
        assert!((last_halving(&[(10.0, 1.2), (1.0, 1.0)]) - 0.2).abs() < 1e-12);
        // Tolerances: one of two sound orders of magnitude must not shrink the band to a hundredth of what was seen.
        let c = converge(&sequence(1.0, 0.1, 1.0, &[1e-1, 1e-2, 1e-3]), 1.0).unwrap();
        assert!(c.limit_uncertainty >= 0.1 * 9e-3 - 1e-12, "{c:?}");
    }

    #[test]
    fn what_grows_with_refinement_has_no_limit() {
        // The mean square of an impulsive start grows with one over the step.
        let peak: Vec<_> = [2.0, 1.5, 1.0f64].iter().map(|h| (*h, 100.0 / h.sqrt())).collect();
        assert_eq!(converge(&peak, 2.0).unwrap().behaviour, Behaviour::Diverging);
        let logarithm: Vec<_> = [4.0, 2.0, 1.0f64].iter().map(|h| (*h, 10.0 - h.ln())).collect();
        assert_eq!(converge(&logarithm, 2.0).unwrap().behaviour, Behaviour::Diverging);
        // To and fro is scatter, not growth: windows of 10, 7.5, 6 and 5 ms, mean drag (N) of a release.
        let scattered = [(2.0, 51.03), (1.5, 51.43), (1.2, 50.49), (1.0, 50.05)];
        let c = converge(&scattered, 2.0).unwrap();
        assert!(
            c.behaviour == Behaviour::Slow && c.limit_uncertainty >= 3.0 * (51.43 - 50.05) - 1e-9,
            "{c:?}"
        );
        // Too small to matter: the band has three times what was seen.
        let small: Vec<_> = [4.0, 2.0, 1.0f64].iter().map(|h| (*h, 1000.0 - h.ln())).collect();
        let c = converge(&small, 2.0).unwrap();
        assert!(c.behaviour == Behaviour::Slow && c.limit_uncertainty >= 3.0 * 2f64.ln() - 1e-9, "{c:?}");
    }

    #[test]
    fn scatter_widens_the_band() {
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
    fn the_band_holds_the_limit_of_many_sequences() {
        // Two terms of error: what a real sequence is.
        let (mut held, mut promised, mut all) = (0, 0, 0);
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
                    // What advice promises: distance from the limit and the band about the limit.
                    let bound = (finest - c.limit).abs() + c.limit_uncertainty;
                    promised += usize::from((finest - 1.0).abs() <= bound);
                    held += usize::from((finest - 1.0).abs() <= *c.uncertainty.last().unwrap());
                }
            }
        }
        assert!(10 * held >= 9 * all, "{held} of {all}");
        assert!(20 * promised >= 19 * all, "{promised} of {all}");
    }
}
