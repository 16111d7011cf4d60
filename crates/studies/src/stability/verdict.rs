//! Classification of a sample: stable, stable but inaccurate, or unstable.

use serde::{Deserialize, Serialize};

use super::exact::Exact;

/// Maximum relative error of frequency and amplitude, and maximum energy added by the coupling relative to the energy of
/// the vibration, of an accurate sample.
pub const ACCURATE: f64 = 0.1;
/// A volume above this multiple of its initial value is growth; the exact one never exceeds it.
const GROWTH: f64 = 1.5;
/// Kinetic energy of the fabric in the last quarter of the windows above this multiple of the exact maximum is growth,
const KINETIC_GROWTH: f64 = 10.0;
/// if it is also above this multiple of that in the second quarter.
const KINETIC_RISE: f64 = 2.0;

/// Class of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// No growth; frequency, amplitude and energy within [`ACCURATE`].
    Stable,
    /// No growth, but an error above [`ACCURATE`].
    Inaccurate,
    /// Growth, or ended by a detected divergence.
    Unstable,
}

impl Class {
    /// Name in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Inaccurate => "inaccurate",
            Self::Unstable => "unstable",
        }
    }
}

/// Observed vibration: values after each window.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// Times, s.
    pub time: Vec<f64>,
    /// Volume under the panel, m3.
    pub volume: Vec<f64>,
    /// Kinetic energy of the fabric, J.
    pub kinetic: Vec<f64>,
    /// Accumulated energy added by the coupling, J.
    pub energy_error: Vec<f64>,
    /// Coupling iterations.
    pub iterations: Vec<f64>,
}

/// Classification of a sample with its errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Class.
    pub class: Class,
    /// Completed windows.
    pub windows: usize,
    /// Mean coupling iterations per window.
    pub iterations: f64,
    /// Relative frequency error; `None` if it cannot be determined.
    pub frequency_error: Option<f64>,
    /// Relative amplitude error at that frequency.
    pub amplitude_error: Option<f64>,
    /// Maximum energy added by the coupling relative to the energy of the vibration.
    pub energy_created: f64,
    /// Reason of an early end.
    pub failure: Option<String>,
}

impl Verdict {
    /// Classifies the observed vibration; `failure`: reason of an early end.
    pub fn new(observed: &Observed, exact: &Exact, failure: Option<String>) -> Self {
        let windows = observed.time.len();
        let iterations = observed.iterations.iter().sum::<f64>() / windows.max(1) as f64;
        let created = observed.energy_error.iter().copied().fold(0.0, f64::max) / exact.energy();
        let fit = fit(observed, exact);
        let mut verdict = Self {
            class: Class::Unstable,
            windows,
            iterations,
            frequency_error: fit.map(|f| f[0] - 1.0),
            amplitude_error: fit.map(|f| f[1] - 1.0),
            energy_created: created,
            failure,
        };
        if verdict.failure.is_some() || windows == 0 || grows(observed, exact) {
            return verdict;
        }
        let accurate = |e: Option<f64>| e.is_some_and(|e| e.abs() <= ACCURATE);
        let within =
            accurate(verdict.frequency_error) && accurate(verdict.amplitude_error) && created <= ACCURATE;
        verdict.class = if within { Class::Stable } else { Class::Inaccurate };
        verdict
    }
}

fn grows(observed: &Observed, exact: &Exact) -> bool {
    let start = exact.volume(0.0, 1.0).abs();
    if observed.volume.iter().chain(&observed.kinetic).any(|v| !v.is_finite()) {
        return true;
    }
    if observed.volume.iter().any(|v| v.abs() > GROWTH * start) {
        return true;
    }
    let n = observed.kinetic.len();
    let most = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    let (second, last) = (most(&observed.kinetic[n / 4..n / 2]), most(&observed.kinetic[n - n / 4..]));
    // Exact maximum over one period.
    let bound =
        (0..=200).map(|i| exact.fabric_energy(exact.period() * f64::from(i) / 200.0)).fold(0.0, f64::max);
    last > KINETIC_GROWTH * bound && last > KINETIC_RISE * second
}

/// Least-squares fit of the volume: factors of the frequencies and of the amplitude.
fn fit(observed: &Observed, exact: &Exact) -> Option<[f64; 2]> {
    let scale: f64 = observed.volume.iter().map(|v| v * v).sum();
    if observed.time.len() < 4 || !scale.is_finite() || scale == 0.0 {
        return None;
    }
    // Linear in the amplitude: residual with the best amplitude for a given frequency factor.
    let trial = |stretch: f64| {
        let (mut ab, mut bb) = (0.0, 0.0);
        for (t, v) in observed.time.iter().zip(&observed.volume) {
            let e = exact.volume(*t, stretch);
            ab += v * e;
            bb += e * e;
        }
        let amplitude = if bb > 0.0 { ab / bb } else { 0.0 };
        (scale - amplitude * ab, amplitude)
    };
    let steps = 240;
    let at = |i: i32| 0.25 * 16f64.powf(f64::from(i) / f64::from(steps));
    let best = (0..=steps).min_by(|a, b| trial(at(*a)).0.total_cmp(&trial(at(*b)).0))?;
    let (mut low, mut high) = (at(best - 1), at(best + 1));
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        if trial(low + third).0 < trial(high - third).0 { high -= third } else { low += third }
    }
    let stretch = 0.5 * (low + high);
    Some([stretch, trial(stretch).1])
}

#[cfg(test)]
mod tests {
    use super::super::exact::tests::scene;
    use super::*;

    fn vibration(
        exact: &Exact,
        windows: usize,
        per_period: f64,
        stretch: f64,
        amplitude: impl Fn(f64) -> f64,
    ) -> Observed {
        let time: Vec<f64> = (1..=windows).map(|i| i as f64 * exact.period() / per_period).collect();
        let volume = time.iter().map(|&t| amplitude(t) * exact.volume(t, stretch)).collect();
        let kinetic = time.iter().map(|&t| amplitude(t).powi(2) * exact.fabric_energy(t)).collect();
        Observed { volume, kinetic, energy_error: vec![0.0; windows], iterations: vec![3.0; windows], time }
    }

    #[test]
    fn vibrations_are_classified() {
        let exact = Exact::new(&scene()).unwrap();
        let verdict = |observed: &Observed| Verdict::new(observed, &exact, None);
        let good = verdict(&vibration(&exact, 32, 32.0, 0.97, |_| 0.95));
        assert_eq!((good.class, good.windows, good.iterations), (Class::Stable, 32, 3.0));
        assert!((good.frequency_error.unwrap() + 0.03).abs() < 1e-6);
        assert!((good.amplitude_error.unwrap() + 0.05).abs() < 1e-6);
        assert_eq!(verdict(&vibration(&exact, 32, 32.0, 0.8, |_| 1.0)).class, Class::Inaccurate);
        assert_eq!(verdict(&vibration(&exact, 32, 32.0, 1.0, |_| 0.8)).class, Class::Inaccurate);
        // A twentieth of a period is enough to determine the frequency of a smooth solution.
        let short = verdict(&vibration(&exact, 100, 2000.0, 1.05, |_| 1.0));
        assert_eq!(short.class, Class::Stable);
        assert!((short.frequency_error.unwrap() - 0.05).abs() < 1e-3);
        let growing = vibration(&exact, 32, 32.0, 1.0, |t| (3.0 * t).exp());
        assert_eq!(verdict(&growing).class, Class::Unstable);
        // Growth of the kinetic energy without a change of volume.
        let mut shaking = vibration(&exact, 32, 32.0, 1.0, |_| 1.0);
        shaking
            .kinetic
            .iter_mut()
            .enumerate()
            .for_each(|(i, k)| *k += 1e-9 * exact.energy() * 2f64.powi(i as i32));
        assert_eq!(verdict(&shaking).class, Class::Unstable);
        let mut leaky = vibration(&exact, 32, 32.0, 1.0, |_| 1.0);
        leaky.energy_error[20] = 0.2 * exact.energy();
        assert_eq!(verdict(&leaky).class, Class::Inaccurate);
        let failed = Verdict::new(&growing, &exact, Some("diverged".into()));
        assert_eq!(failed.class, Class::Unstable);
        assert_eq!(verdict(&Observed::default()).class, Class::Unstable);
    }
}
