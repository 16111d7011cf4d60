//! Mean of a signal that swings, with its confidence interval and its main period.

/// What a signal settles to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Swings {
    /// The start is left out up to this time, s.
    pub(super) from: f64,
    /// Mean of what follows.
    pub(super) mean: f64,
    /// Half of the mean's 95 % confidence interval, from this many batches; `None` where they are too
    /// few, or follow one another.
    pub(super) margin: Option<(f64, usize)>,
    /// The main period, s, and its share of the variance; `None` where none stands out.
    pub(super) period: Option<(f64, f64)>,
}

/// Fewest rows that are looked at.
const FEWEST: usize = 40;
/// Fewest batches that a margin is taken of.
const LEAST_BATCHES: usize = 4;
const MOST_BATCHES: usize = 10;
/// Least squares of the steps from batch to batch over those about the mean (von Neumann's ratio, 2 where
/// batches are independent): below, they follow one another, and their spread says nothing.
const INDEPENDENT: f64 = 1.0;
/// Least share of the variance that makes a period the main one.
const STANDS_OUT: f64 = 0.25;
/// Steps of frequency in that of one swing over the whole signal.
const STEPS: usize = 4;
/// Most swings over the whole signal that are looked for.
const MOST_SWINGS: usize = 200;

/// Quantile 0.975 of Student's t for 3 to 9 degrees of freedom.
const STUDENT: [f64; 7] = [3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// Looks at points (time, value) with rising times; `None` where they are few, or constant.
///
/// The start is left out so far that the marginal standard error of the rest is least, half of the
/// signal at most (MSER: White, Simulation 69, 1997). The main period is the peak of the
/// periodogram of the rest, its trend removed, under a Hann window. The interval comes from means
/// of batches of equal length (Student's t); a batch holds whole main periods, so that the
/// swing is averaged out in each and their means hardly depend on one another.
pub(super) fn swings(points: &[(f64, f64)]) -> Option<Swings> {
    let (time, values) = even(points)?;
    let step = (time.1 - time.0) / (values.len() - 1) as f64;
    let cut = settled(&values);
    let rest = &values[cut..];
    let period = main_period(rest, step);
    let steps = period.map_or(1.0, |(p, _)| p / step);
    // Whole periods in a batch, as few as make ten batches at most.
    let periods = (rest.len() as f64 / steps / MOST_BATCHES as f64).ceil().max(1.0);
    let length = periods * steps;
    let batches = (rest.len() as f64 / length) as usize;
    let used = &rest[rest.len() - (batches.max(1) as f64 * length).min(rest.len() as f64) as usize..];
    let mean = average(used);
    let edge = |b: usize| (b as f64 * length) as usize;
    let means: Vec<f64> =
        (0..batches).map(|b| average(&used[edge(b)..edge(b + 1).min(used.len())])).collect();
    let spread = means.iter().map(|m| (m - average(&means)).powi(2)).sum::<f64>();
    let steps_between = means.windows(2).map(|m| (m[1] - m[0]).powi(2)).sum::<f64>();
    let margin = (batches >= LEAST_BATCHES && steps_between >= INDEPENDENT * spread).then(|| {
        let error = (spread / ((batches - 1) * batches) as f64).sqrt();
        (STUDENT[(batches - LEAST_BATCHES).min(STUDENT.len() - 1)] * error, batches)
    });
    let from = time.0 + step * (values.len() - used.len()) as f64;
    Some(Swings { from, mean, margin, period })
}

fn average(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

/// Values at as many even times (first, last), between the points by straight lines.
fn even(points: &[(f64, f64)]) -> Option<((f64, f64), Vec<f64>)> {
    let points: Vec<(f64, f64)> = points.iter().copied().filter(|p| p.1.is_finite()).collect();
    if points.len() < FEWEST {
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

/// How many values belong to the start.
fn settled(values: &[f64]) -> usize {
    let mut best = (f64::INFINITY, 0);
    // Mean and sum of squares of the rest, built from the end.
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
    // Amplitude of the swing that is done `swings` times over the values.
    let amplitude = |swings: f64| {
        let (s, c) = (turn * swings).sin_cos();
        let (mut re, mut im, mut cos, mut sin) = (0.0, 0.0, 1.0, 0.0);
        for v in &hann {
            re += v * cos;
            im += v * sin;
            // Turned on: thousands of products keep twelve digits.
            (cos, sin) = (cos * c - sin * s, sin * c + cos * s);
        }
        2.0 * f64::hypot(re, im) / n as f64
    };
    let most = MOST_SWINGS.min(n / 4);
    let at = |j: usize| j as f64 / STEPS as f64;
    let all: Vec<f64> = (0..=most * STEPS).map(|j| amplitude(at(j))).collect();
    // A swing is seen twice at least.
    let peak = (2 * STEPS..all.len() - 1).max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
    let share = 0.5 * all[peak] * all[peak] / variance;
    let [a, b, c] = [all[peak - 1], all[peak], all[peak + 1]];
    // Of a fall that continues below two swings this is no peak.
    if share < STANDS_OUT || a > b || c > b {
        return None;
    }
    let bend = a - 2.0 * b + c;
    let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
    let swings = at(peak) + shift / STEPS as f64;
    Some((n as f64 * step / swings, share.min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers without order, even between -1 and 1.
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
    fn a_swing_after_a_start_is_found_with_its_period_and_mean() {
        let f = |t: f64| 4.4 + 3.0 * (-t / 0.3).exp() + 0.6 * (std::f64::consts::TAU * t / 2.17 + 0.4).sin();
        let found = swings(&signal(4000, f)).expect("enough rows");
        let (period, share) = found.period.expect("a period");
        assert!((period / 2.17 - 1.0).abs() < 0.005 && share > 0.9, "{period} {share}");
        let (margin, batches) = found.margin.expect("nine periods");
        assert!(found.from > 0.3 && found.from < 3.5 && batches >= 7, "{found:?}");
        assert!((found.mean - 4.4).abs() < 2e-3 && margin < 0.02, "{found:?}");
    }

    #[test]
    fn uneven_times_change_little() {
        let f = |t: f64| 1.0 + (5.0 * t).sin();
        let mut points = signal(3000, f);
        points.retain(|p| p.0 > 6.0 || ((p.0 / 0.005).round() as u64).is_multiple_of(2));
        let found = swings(&points).expect("enough rows");
        let (period, _) = found.period.expect("a period");
        assert!((period * 5.0 / std::f64::consts::TAU - 1.0).abs() < 0.005, "{period}");
        assert!((found.mean - 1.0).abs() < 5e-3, "{found:?}");
    }

    #[test]
    fn the_interval_holds_as_often_as_it_says() {
        let (mut told, mut held, mut period) = (0, 0, 0);
        for seed in 1..=100 {
            let mut noise = Noise(seed * 0x9e37_79b9);
            let mut slow = 0.0;
            let phase = 3.0 * noise.next();
            let points: Vec<(f64, f64)> = (0..4000)
                .map(|k| {
                    // Forgets within half a second, beside a swing of two.
                    slow = 0.99 * slow + 0.1 * noise.next();
                    let t = 0.005 * f64::from(k);
                    (t, 2.0 + slow + 0.6 * (std::f64::consts::PI * t + phase).sin())
                })
                .collect();
            let found = swings(&points).expect("enough rows");
            let Some((margin, _)) = found.margin else { continue };
            told += 1;
            held += i32::from((found.mean - 2.0).abs() < margin);
            period += i32::from(found.period.is_some_and(|(p, _)| (p - 2.0).abs() < 0.1));
        }
        // 95 %, and what chance and few batches take from it.
        assert!(told >= 85 && held * 100 >= told * 88 && period >= told * 97 / 100, "{told} {held} {period}");
    }

    #[test]
    fn few_rows_constants_and_noise_claim_nothing() {
        assert_eq!(swings(&signal(FEWEST - 1, f64::sin)), None);
        assert_eq!(swings(&signal(500, |_| 3.0)), None);
        let one_swing = swings(&signal(400, |t| (std::f64::consts::PI * t).sin())).expect("enough rows");
        assert_eq!((one_swing.period, one_swing.margin), (None, None), "seen once only");
        let mut noise = Noise(77);
        let points: Vec<(f64, f64)> = (0..2000).map(|k| (f64::from(k), noise.next())).collect();
        assert_eq!(swings(&points).expect("enough rows").period, None);
    }
}
