//! One mean of several independent runs of a scene, as with several seeds of a perturbation.

use serde::Serialize;

use crate::long_term::student;
use crate::settled::{SettledMean, decimals, label};

/// The method of [`PooledMean`] in words.
pub const METHOD: &str = "settled means of independent runs, weighted by the inverse square of their standard errors; the standard error of the result is increased \
                          by the ratio of the scatter of the runs to that which their standard errors imply, where this is above 1 (as the Particle Data Group does); 95 % \
                          interval by Student's t with the degrees of freedom of Welch and Satterthwaite";

/// Mean of a quantity over several runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PooledMean {
    /// Column of `history.csv`; mean and interval have its unit.
    pub quantity: String,
    /// Mean of the runs, weighted by the inverse square of their standard errors.
    pub mean: f64,
    /// Half width of its 95 % confidence interval.
    pub interval_95: f64,
    /// Number of runs in it.
    pub runs: u64,
    /// Number of runs that are not in it, because their mean has no interval.
    pub left_out: u64,
    /// Scatter of the runs over that which their standard errors imply. Above about 2 the runs differ by more than chance: each is too short, or they are
    /// not the same scene.
    pub scatter: f64,
}

impl PooledMean {
    /// Of the means of one quantity; `None` unless two of them have an interval.
    pub fn of(means: &[&SettledMean]) -> Option<Self> {
        // Mean, standard error and degrees of freedom of each run.
        let runs: Vec<(f64, f64, usize)> = means
            .iter()
            .filter_map(|m| {
                let freedom = (m.batches as usize).saturating_sub(1);
                let error = m.interval_95.filter(|h| *h > 0.0)? / student(freedom);
                Some((m.mean, error, freedom))
            })
            .collect();
        if runs.len() < 2 {
            return None;
        }
        let weight = |error: f64| 1.0 / (error * error);
        let weights: f64 = runs.iter().map(|(_, error, _)| weight(*error)).sum();
        let mean = runs.iter().map(|(m, error, _)| m * weight(*error)).sum::<f64>() / weights;
        let squares: f64 = runs.iter().map(|(m, error, _)| ((m - mean) / error).powi(2)).sum();
        let scatter = (squares / (runs.len() - 1) as f64).sqrt();
        let variance: f64 = runs.iter().map(|(_, error, n)| weight(*error).powi(2) / *n as f64).sum();
        let freedom = (weights * weights / variance) as usize;
        let interval_95 = student(freedom) * scatter.max(1.0) / weights.sqrt();
        let (count, all) = (runs.len() as u64, means.len() as u64);
        Some(Self {
            quantity: means[0].quantity.clone(),
            mean,
            interval_95,
            runs: count,
            left_out: all - count,
            scatter,
        })
    }

    /// Mean and interval in words.
    pub fn line(&self) -> String {
        let (name, unit) = label(&self.quantity);
        let places = decimals(self.interval_95);
        let left_out = match self.left_out {
            0 => String::new(),
            n => format!(", {n} without an interval left out"),
        };
        let differ = if self.scatter > 2.0 { "; the runs differ by more than chance" } else { "" };
        format!(
            "{name} {:.places$} ± {:.places$} {unit} (95 %, {} runs{left_out}; scatter {:.1} of that expected{differ})",
            self.mean, self.interval_95, self.runs, self.scatter
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(mean: f64, interval_95: Option<f64>, batches: u64) -> SettledMean {
        let time: Vec<f64> = (1..=2000).map(|k| 0.02 * f64::from(k)).collect();
        let speed = time.iter().map(|t| 4.6 + 0.4 * (3.0 * t).sin()).collect();
        let columns = [("time_s".into(), time), ("descent_speed_m_s".into(), speed)];
        let any = SettledMean::of("descent_speed_m_s", &columns).expect("a mean");
        SettledMean { mean, interval_95, batches, ..any }
    }

    #[test]
    fn equal_runs_halve_the_variance() {
        let a = run(4.5, Some(0.08), 9);
        let pooled = PooledMean::of(&[&a, &a]).expect("two runs");
        assert_eq!((pooled.mean, pooled.runs, pooled.left_out, pooled.scatter), (4.5, 2, 0, 0.0));
        // Sixteen degrees of freedom instead of eight: at most 2.262 instead of 2.306.
        let expected = 0.08 / 2f64.sqrt() * 2.262 / 2.306;
        assert!((pooled.interval_95 - expected).abs() < 1e-12, "{pooled:?}");
        assert!(
            pooled.line().starts_with("descent speed 4.500 ± 0.055 m/s (95 %, 2 runs; "),
            "{}",
            pooled.line()
        );
    }

    #[test]
    fn precise_runs_weigh_more_and_scatter_widens_the_interval() {
        let [wide, narrow, none] = [run(4.0, Some(0.4), 9), run(4.2, Some(0.1), 9), run(9.0, None, 3)];
        let pooled = PooledMean::of(&[&wide, &narrow, &none]).expect("two runs");
        assert!((pooled.mean - (4.0 + 16.0 * 4.2) / 17.0).abs() < 1e-12, "{pooled:?}");
        assert_eq!((pooled.runs, pooled.left_out), (2, 1));
        assert!(pooled.line().contains("1 without an interval left out"), "{}", pooled.line());
        let far = run(4.9, Some(0.1), 9);
        let apart = PooledMean::of(&[&narrow, &far]).expect("two runs");
        // Standard errors of 0.1 / 2.306: the difference of 0.7 is 11.4 standard errors of it.
        assert!((apart.scatter - 0.7 / 2f64.sqrt() / (0.1 / 2.306)).abs() < 1e-9, "{apart:?}");
        assert!((apart.interval_95 - 0.35 * 2.262).abs() < 1e-9, "{apart:?}");
        assert!(apart.line().contains("more than chance"), "{}", apart.line());
        assert_eq!(PooledMean::of(&[&narrow, &none]), None);
    }

    /// The interval covers the true mean of pairs of wake-like runs as often as it claims, within what 400 pairs can show.
    #[test]
    fn pooled_interval_has_its_nominal_coverage() {
        let mut state = 7u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            };
            (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
        };
        let mut sample = |batches: usize| {
            let x: Vec<f64> = (0..batches).map(|_| 0.3 * normal()).collect();
            let mean = x.iter().sum::<f64>() / batches as f64;
            let variance =
                x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (batches * (batches - 1)) as f64;
            run(4.5 + mean, Some(student(batches - 1) * variance.sqrt()), batches as u64)
        };
        let covered = (0..400)
            .filter(|k| {
                let (a, b) = (sample(5 + k % 5), sample(9 - k % 4));
                let pooled = PooledMean::of(&[&a, &b]).expect("two runs");
                (pooled.mean - 4.5).abs() <= pooled.interval_95
            })
            .count();
        // 95 % of 400 are 380 ± 9 (two standard deviations); estimated weights cost some coverage, the scatter adds some.
        assert!((368..=396).contains(&covered), "{covered} of 400");
    }
}
