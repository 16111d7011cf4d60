//! Settled mean of an oscillating signal, with its confidence interval, a test of stationarity, and the main oscillation.

/// The method of [`long_term`] in words, for tables and files.
pub const METHOD: &str = "start of the settled part by the marginal standard error rule (MSER), at most half of the stage; batch means over \
                          whole main periods; stationary by Student's t test of the trend of the batch means (5 %) and their von Neumann ratio \
                          (at least 1); 95 % interval by Student's t of the batch means";

/// Long-term statistics of a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LongTerm {
    /// Start of the settled part, s: end of the initial transient, which is removed, at a whole number of batches before the end.
    pub from: f64,
    /// Mean of the settled part.
    pub mean: f64,
    /// Number of batches.
    pub batches: usize,
    /// Whether the mean has settled.
    pub state: State,
    /// Half width of the 95 % confidence interval of the mean; `None` unless `state` is [`State::Stationary`].
    pub half_width: Option<f64>,
    /// Change of the mean over the settled part, from the line of least squares through the batch means; `None` with fewer than
    /// [`MIN_BATCHES`].
    pub drift: Option<f64>,
    /// Main oscillation; `None` without a dominant period.
    pub swing: Option<Swing>,
}

/// Main oscillation of a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Period, s.
    pub period: f64,
    /// Share of this period in the variance.
    pub share: f64,
    /// Half of the difference of largest and smallest value in a period, averaged over whole periods, in units of the signal.
    pub amplitude: f64,
}

/// Whether a mean has settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The batch means have no trend and no serial correlation.
    Stationary,
    /// Fewer than [`MIN_BATCHES`] batches: not known.
    TooShort,
    /// The mean still changes.
    Drift,
    /// The batch means have no significant trend, but are serially correlated: the signal has variations longer than a batch.
    Correlated,
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
/// Change of the mean over the settled part, relative to the standard deviation of the signal, that counts as none however
/// significant it is: a signal without noise has a significant trend until its transient is round-off.
const NEGLIGIBLE_DRIFT: f64 = 0.01;
/// Start of the settled part, as a share of the signal, from which the transient counts as not ended: MSER finds it near its limit, a half,
/// where the mean drifts through the whole signal.
const LATE_START: f64 = 0.45;
/// Minimum share of the variance of a main period.
const MIN_VARIANCE_SHARE: f64 = 0.25;
/// Oversampling of the periodogram: steps per cycle over the whole signal.
const STEPS: usize = 4;
/// Maximum number of cycles over the whole signal that is searched.
const MAX_CYCLES: usize = 200;

/// Quantile 0.975 of Student's t for 2 to 9 degrees of freedom.
const STUDENT: [f64; 8] = [4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// Quantile 0.975 of Student's t.
pub(crate) fn student(degrees_of_freedom: usize) -> f64 {
    STUDENT[degrees_of_freedom.saturating_sub(2).min(STUDENT.len() - 1)]
}

/// Long-term statistics of points (time, value) with increasing times; `None` for fewer than 40 finite
/// values or a constant signal.
///
/// The initial transient ends where the marginal standard error of the rest is minimal, at the latest in the middle
/// of the signal (MSER: White, Simulation 69, 1997); a minimum in the last tenth of this range is drift. The main period is the peak of the
/// periodogram of the rest, detrended, with a Hann window. The confidence interval comes from the means of batches of equal
/// length (Student's t). Each batch contains whole main periods, which makes the batch means nearly independent. A mean has
/// no interval unless its batch means are stationary: no significant trend (Student's t of the slope of the line of least
/// squares, 5 %), and no serial correlation (von Neumann ratio).
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
    let edge = |b: usize| (b as f64 * length) as usize;
    let means: Vec<f64> =
        (0..batches).map(|b| average(&used[edge(b)..edge(b + 1).min(used.len())])).collect();
    let trend = trend(&means);
    let state = state(&means, trend, cut as f64 > LATE_START * values.len() as f64, deviation(used));
    let half_width = (state == State::Stationary)
        .then(|| student(batches - 1) * (squares(&means) / ((batches - 1) * batches) as f64).sqrt());
    let swing =
        period.map(|(period, share)| Swing { period, share, amplitude: amplitude(used, period / step) });
    let from = time.0 + step * (values.len() - used.len()) as f64;
    let drift = trend.map(|(change, _)| change);
    Some(LongTerm { from, mean: average(used), batches, state, half_width, drift, swing })
}

/// Whether the means of batches have settled. `at_limit`: the transient ends near its latest possible place; `deviation`: standard deviation of
/// the signal.
fn state(means: &[f64], trend: Option<(f64, bool)>, at_limit: bool, deviation: f64) -> State {
    let Some((change, significant)) = trend else { return State::TooShort };
    if (significant || at_limit) && change.abs() > NEGLIGIBLE_DRIFT * deviation {
        return State::Drift;
    }
    let differences = means.windows(2).map(|m| (m[1] - m[0]).powi(2)).sum::<f64>();
    let negligible = squares(means) < means.len() as f64 * (NEGLIGIBLE_DRIFT * deviation).powi(2);
    if differences < MIN_VON_NEUMANN_RATIO * squares(means) && !negligible {
        return State::Correlated;
    }
    State::Stationary
}

/// Change of the mean over the batches, by the line of least squares through their means, and whether it is significant
/// (Student's t, 5 %); `None` for fewer than [`MIN_BATCHES`].
fn trend(means: &[f64]) -> Option<(f64, bool)> {
    let n = means.len();
    if n < MIN_BATCHES {
        return None;
    }
    let (mean, middle) = (average(means), 0.5 * (n - 1) as f64);
    let at = |b: usize| b as f64 - middle;
    let moment = (0..n).map(|b| at(b).powi(2)).sum::<f64>();
    let slope = means.iter().enumerate().map(|(b, m)| at(b) * (m - mean)).sum::<f64>() / moment;
    let left = means.iter().enumerate().map(|(b, m)| (m - mean - slope * at(b)).powi(2)).sum::<f64>();
    let error = (left / ((n - 2) as f64 * moment)).sqrt();
    Some((slope * n as f64, slope.abs() > student(n - 2) * error))
}

/// Half of the difference of largest and smallest value, averaged over whole periods of `steps` values.
fn amplitude(values: &[f64], steps: f64) -> f64 {
    let count = ((values.len() as f64 / steps) as usize).max(1);
    let range = |k: usize| {
        let (from, to) = ((k as f64 * steps) as usize, ((k + 1) as f64 * steps) as usize);
        let within = &values[from..to.min(values.len())];
        let (low, high) = within.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        0.5 * (high - low)
    };
    (0..count).map(range).sum::<f64>() / count as f64
}

fn average(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

/// Sum of squared deviations from the mean.
fn squares(x: &[f64]) -> f64 {
    let mean = average(x);
    x.iter().map(|v| (v - mean).powi(2)).sum()
}

fn deviation(x: &[f64]) -> f64 {
    (squares(x) / x.len().max(1) as f64).sqrt()
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
        let swing = found.swing.expect("a period");
        assert!((swing.period / 2.17 - 1.0).abs() < 0.005 && swing.share > 0.9, "{swing:?}");
        assert!((swing.amplitude / 0.6 - 1.0).abs() < 0.01, "{swing:?}");
        assert!(found.from > 0.3 && found.from < 3.5 && found.batches >= 7, "{found:?}");
        let half_width = found.half_width.expect("nine periods");
        assert!((found.mean - 4.4).abs() < 2e-3 && half_width < 0.02, "{found:?}");
        assert_eq!(found.state, State::Stationary);
    }

    #[test]
    fn uneven_times_have_little_effect() {
        let f = |t: f64| 1.0 + (5.0 * t).sin();
        let mut points = signal(3000, f);
        points.retain(|p| p.0 > 6.0 || ((p.0 / 0.005).round() as u64).is_multiple_of(2));
        let found = long_term(&points).expect("enough rows");
        let period = found.swing.expect("a period").period;
        assert!((period * 5.0 / std::f64::consts::TAU - 1.0).abs() < 0.005, "{period}");
        assert!((found.mean - 1.0).abs() < 5e-3, "{found:?}");
    }

    /// A mean of 2 (at the end, with drift), noise of a first-order autoregressive process with a correlation time of half a second (standard deviation 0.41), an
    /// oscillation with a period of two seconds, a transient of one second, and a drift by `drift` over the 40 s.
    fn wake_like(seed: u64, drift: f64) -> Vec<(f64, f64)> {
        let mut noise = Noise(seed * 0x9e37_79b9);
        let mut slow = 0.0;
        let phase = 3.0 * noise.next();
        (0..2000)
            .map(|k| {
                slow = 0.96 * slow + 0.2 * noise.next();
                let t = 0.02 * f64::from(k);
                let swing = 0.6 * (std::f64::consts::PI * t + phase).sin();
                (t, 2.0 + slow + swing - 1.5 * (-t).exp() + drift * (t / 40.0 - 1.0))
            })
            .collect()
    }

    /// Shares of 400 series that have an interval, and of these, for each factor on its half width, of those whose interval contains the mean.
    fn coverage(factors: [f64; 3]) -> (f64, [f64; 3]) {
        let found: Vec<LongTerm> =
            (1..=400).map(|seed| long_term(&wake_like(seed, 0.0)).expect("enough rows")).collect();
        let given: Vec<(f64, f64)> =
            found.iter().filter_map(|f| Some((f.half_width?, (f.mean - 2.0).abs()))).collect();
        let share = |factor: f64| {
            given.iter().filter(|(half_width, error)| *error < factor * half_width).count() as f64
                / given.len() as f64
        };
        (given.len() as f64 / 400.0, factors.map(share))
    }

    /// The band of the coverage is narrow enough to reject an interval that is wrong by a third or by two.
    #[test]
    fn confidence_interval_has_its_nominal_coverage() {
        let (given, [narrow, nominal, wide]) = coverage([0.67, 1.0, 2.0]);
        println!("intervals {given:.3}, coverage {narrow:.3} {nominal:.3} {wide:.3}");
        assert!(given > 0.8, "{given}");
        assert!((0.90..=0.99).contains(&nominal), "{nominal}");
        assert!(narrow < 0.90 && wide > 0.99, "{narrow} {wide}");
    }

    /// Drift by twice to ten times the standard deviation of the noise.
    #[test]
    fn drifting_mean_has_no_interval() {
        for (drift, most) in [(0.8, 0.3), (1.5, 0.1), (-4.0, 0.0)] {
            let found: Vec<LongTerm> =
                (1..=100).map(|seed| long_term(&wake_like(seed, drift)).expect("enough rows")).collect();
            let given = found.iter().filter(|f| f.half_width.is_some()).count() as f64 / 100.0;
            println!("drift {drift}: {given} have an interval");
            assert!(given <= most, "{drift}: {given}");
            assert!(found.iter().all(|f| f.half_width.is_some() == (f.state == State::Stationary)));
        }
        let drift = long_term(&wake_like(1, -4.0)).expect("enough rows");
        assert_eq!(drift.state, State::Drift);
        assert!(drift.drift.is_some_and(|change| change < -1.0), "{drift:?}");
    }

    /// Slow noise on a fast oscillation: batches of few periods are correlated.
    #[test]
    fn correlated_batches_have_no_interval() {
        let tau = std::f64::consts::TAU;
        let slow = |t: f64| (tau * t / 36.0).cos() + 3.0 * (tau * t / 0.9).sin();
        let found = long_term(&signal(7200, slow)).expect("enough rows");
        assert_eq!((found.state, found.half_width), (State::Correlated, None), "{found:?}");
    }

    #[test]
    fn short_constant_and_noisy_signals_have_no_period() {
        assert_eq!(long_term(&signal(MIN_POINTS - 1, f64::sin)), None);
        assert_eq!(long_term(&signal(500, |_| 3.0)), None);
        let one_cycle = long_term(&signal(400, |t| (std::f64::consts::PI * t).sin())).expect("enough rows");
        assert_eq!((one_cycle.swing, one_cycle.half_width), (None, None), "one cycle only");
        let mut noise = Noise(77);
        let points: Vec<(f64, f64)> = (0..2000).map(|k| (f64::from(k), noise.next())).collect();
        assert_eq!(long_term(&points).expect("enough rows").swing, None);
    }
}
