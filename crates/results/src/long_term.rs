//! Long-term mean of an oscillating signal, with its confidence interval and main period.

/// Long-term statistics of a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LongTerm {
    /// End of the initial transient, which is removed, s.
    pub from: f64,
    /// Mean after the transient.
    pub mean: f64,
    /// Half width of the 95 % confidence interval of the mean, and the number of batches; `None` if the batches are
    /// too few or serially correlated.
    pub margin: Option<(f64, usize)>,
    /// Main period, s, and its share of the variance; `None` without a dominant period.
    pub period: Option<(f64, f64)>,
}

/// Minimum number of points.
const MIN_POINTS: usize = 40;
/// Minimum number of batches of a confidence interval.
pub const MIN_BATCHES: usize = 4;
/// Maximum number of batches.
const MAX_BATCHES: usize = 10;
/// Minimum von Neumann ratio of the batch means: squared differences of successive means over squared deviations
/// from their mean. It is 2 for independent batches; smaller values show serial correlation.
const MIN_VON_NEUMANN_RATIO: f64 = 1.0;
/// Minimum share of the variance of a main period.
const MIN_VARIANCE_SHARE: f64 = 0.25;
/// Oversampling of the periodogram: steps per cycle over the whole signal.
const STEPS: usize = 4;
/// Maximum number of cycles over the whole signal that is searched.
const MAX_CYCLES: usize = 200;

/// Quantile 0.975 of Student's t for 3 to 9 degrees of freedom.
const STUDENT: [f64; 7] = [3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// Long-term statistics of points (time, value) with increasing times; `None` for fewer than [`MIN_POINTS`] finite
/// values or a constant signal.
///
/// The initial transient ends where the marginal standard error of the rest is minimal, at the latest in the middle
/// of the signal (MSER: White, Simulation 69, 1997). The main period is the peak of the periodogram of the rest,
/// detrended, with a Hann window. The confidence interval comes from the means of batches of equal length (Student's
/// t). Each batch contains whole main periods, which makes the batch means nearly independent.
pub fn long_term(points: &[(f64, f64)]) -> Option<LongTerm> {
    let (time, values) = even(points)?;
    let step = (time.1 - time.0) / (values.len() - 1) as f64;
    let cut = transient(&values);
    let rest = &values[cut..];
    let period = main_period(rest, step);
    let steps = period.map_or(1.0, |(p, _)| p / step);
    // Whole periods per batch: the smallest number that gives at most `MAX_BATCHES` batches.
    let periods = (rest.len() as f64 / steps / MAX_BATCHES as f64).ceil().max(1.0);
    let length = periods * steps;
    let batches = (rest.len() as f64 / length) as usize;
    let used = &rest[rest.len() - (batches.max(1) as f64 * length).min(rest.len() as f64) as usize..];
    let mean = average(used);
    let edge = |b: usize| (b as f64 * length) as usize;
    let means: Vec<f64> =
        (0..batches).map(|b| average(&used[edge(b)..edge(b + 1).min(used.len())])).collect();
    let spread = means.iter().map(|m| (m - average(&means)).powi(2)).sum::<f64>();
    let steps_between = means.windows(2).map(|m| (m[1] - m[0]).powi(2)).sum::<f64>();
    let margin = (batches >= MIN_BATCHES && steps_between >= MIN_VON_NEUMANN_RATIO * spread).then(|| {
        let error = (spread / ((batches - 1) * batches) as f64).sqrt();
        (STUDENT[(batches - MIN_BATCHES).min(STUDENT.len() - 1)] * error, batches)
    });
    let from = time.0 + step * (values.len() - used.len()) as f64;
    Some(LongTerm { from, mean, margin, period })
}

fn average(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

/// First and last time, and the values at evenly spaced times between them, by linear interpolation.
fn even(points: &[(f64, f64)]) -> Option<((f64, f64), Vec<f64>)> {
    let points: Vec<(f64, f64)> = points.iter().copied().filter(|p| p.1.is_finite()).collect();
    if points.len() < MIN_POINTS {
        return None;
    }
    let (first, last) = (points[0].0, points[points.len() - 1].0);
    let mut at = 0;
    let values: Vec<f64> = (0..points.len())
        .map(|k| {
            let t = first + (last - first) * k as f64 / (points.len() - 1) as f64;
            while at + 2 < points.len() && points[at + 1].0 < t {
                at += 1;
            }
            let [(t0, y0), (t1, y1)] = [points[at], points[at + 1]];
            y0 + (y1 - y0) * ((t - t0) / (t1 - t0)).clamp(0.0, 1.0)
        })
        .collect();
    let constant = values.iter().all(|v| *v == values[0]);
    (last > first && !constant).then_some(((first, last), values))
}

/// Number of values of the initial transient (MSER).
fn transient(values: &[f64]) -> usize {
    let mut best = (f64::INFINITY, 0);
    // Mean and sum of squared deviations of the rest, updated from the end (Welford).
    let (mut count, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for (k, v) in values.iter().enumerate().rev() {
        count += 1.0;
        let d = v - mean;
        mean += d / count;
        squares += d * (v - mean);
        let error = squares / (count * count);
        if k <= values.len() / 2 && error < best.0 {
            best = (error, k);
        }
    }
    best.1
}

/// The period at the peak of the periodogram, s, and its share of the variance.
fn main_period(values: &[f64], step: f64) -> Option<(f64, f64)> {
    let n = values.len();
    let (mean, middle) = (average(values), 0.5 * (n - 1) as f64);
    let along: Vec<f64> = (0..n).map(|k| k as f64 - middle).collect();
    let slope = along.iter().zip(values).map(|(s, v)| s * (v - mean)).sum::<f64>()
        / along.iter().map(|s| s * s).sum::<f64>();
    let flat: Vec<f64> = along.iter().zip(values).map(|(s, v)| v - mean - slope * s).collect();
    let variance = flat.iter().map(|v| v * v).sum::<f64>() / n as f64;
    let turn = std::f64::consts::TAU / n as f64;
    let hann: Vec<f64> =
        flat.iter().enumerate().map(|(k, v)| v * (1.0 - (turn * (k as f64 + 0.5)).cos())).collect();
    // Amplitude of the oscillation with `cycles` cycles over the values.
    let amplitude = |cycles: f64| {
        let (s, c) = (turn * cycles).sin_cos();
        let (mut re, mut im, mut cos, mut sin) = (0.0, 0.0, 1.0, 0.0);
        for v in &hann {
            re += v * cos;
            im += v * sin;
            // Recurrence for the rotation: accurate to twelve digits over thousands of steps.
            (cos, sin) = (cos * c - sin * s, sin * c + cos * s);
        }
        2.0 * f64::hypot(re, im) / n as f64
    };
    let most = MAX_CYCLES.min(n / 4);
    let at = |j: usize| j as f64 / STEPS as f64;
    let all: Vec<f64> = (0..=most * STEPS).map(|j| amplitude(at(j))).collect();
    // At least two cycles.
    let peak = (2 * STEPS..all.len() - 1).max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
    let share = 0.5 * all[peak] * all[peak] / variance;
    let [a, b, c] = [all[peak - 1], all[peak], all[peak + 1]];
    // A maximum at the edge of the search range is not a peak.
    if share < MIN_VARIANCE_SHARE || a > b || c > b {
        return None;
    }
    let bend = a - 2.0 * b + c;
    let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
    let cycles = at(peak) + shift / STEPS as f64;
    Some((n as f64 * step / cycles, share.min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers, uniform between -1 and 1 (xorshift).
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    fn signal(rows: usize, f: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        (1..=rows).map(|k| 0.005 * k as f64).map(|t| (t, f(t))).collect()
    }

    #[test]
    fn oscillation_after_transient_has_correct_mean_and_period() {
        let f = |t: f64| 4.4 + 3.0 * (-t / 0.3).exp() + 0.6 * (std::f64::consts::TAU * t / 2.17 + 0.4).sin();
        let found = long_term(&signal(4000, f)).expect("enough rows");
        let (period, share) = found.period.expect("a period");
        assert!((period / 2.17 - 1.0).abs() < 0.005 && share > 0.9, "{period} {share}");
        let (margin, batches) = found.margin.expect("nine periods");
        assert!(found.from > 0.3 && found.from < 3.5 && batches >= 7, "{found:?}");
        assert!((found.mean - 4.4).abs() < 2e-3 && margin < 0.02, "{found:?}");
    }

    #[test]
    fn uneven_times_have_little_effect() {
        let f = |t: f64| 1.0 + (5.0 * t).sin();
        let mut points = signal(3000, f);
        points.retain(|p| p.0 > 6.0 || ((p.0 / 0.005).round() as u64).is_multiple_of(2));
        let found = long_term(&points).expect("enough rows");
        let (period, _) = found.period.expect("a period");
        assert!((period * 5.0 / std::f64::consts::TAU - 1.0).abs() < 0.005, "{period}");
        assert!((found.mean - 1.0).abs() < 5e-3, "{found:?}");
    }

    #[test]
    fn confidence_interval_has_its_nominal_coverage() {
        let (mut given, mut covered, mut period) = (0, 0, 0);
        for seed in 1..=100 {
            let mut noise = Noise(seed * 0x9e37_79b9);
            let mut slow = 0.0;
            let phase = 3.0 * noise.next();
            let points: Vec<(f64, f64)> = (0..4000)
                .map(|k| {
                    // Correlation time of half a second, plus an oscillation with a period of two.
                    slow = 0.99 * slow + 0.1 * noise.next();
                    let t = 0.005 * f64::from(k);
                    (t, 2.0 + slow + 0.6 * (std::f64::consts::PI * t + phase).sin())
                })
                .collect();
            let found = long_term(&points).expect("enough rows");
            let Some((margin, _)) = found.margin else { continue };
            given += 1;
            covered += i32::from((found.mean - 2.0).abs() < margin);
            period += i32::from(found.period.is_some_and(|(p, _)| (p - 2.0).abs() < 0.1));
        }
        // 95 %, less the scatter of 100 samples and the effect of few batches.
        assert!(
            given >= 85 && covered * 100 >= given * 88 && period >= given * 97 / 100,
            "{given} {covered} {period}"
        );
    }

    #[test]
    fn short_constant_and_noisy_signals_have_no_period() {
        assert_eq!(long_term(&signal(MIN_POINTS - 1, f64::sin)), None);
        assert_eq!(long_term(&signal(500, |_| 3.0)), None);
        let one_cycle = long_term(&signal(400, |t| (std::f64::consts::PI * t).sin())).expect("enough rows");
        assert_eq!((one_cycle.period, one_cycle.margin), (None, None), "one cycle only");
        let mut noise = Noise(77);
        let points: Vec<(f64, f64)> = (0..2000).map(|k| (f64::from(k), noise.next())).collect();
        assert_eq!(long_term(&points).expect("enough rows").period, None);
    }
}
