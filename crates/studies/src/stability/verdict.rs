//! What a sample came to: stable, stable but inaccurate, or unstable.

use serde::{Deserialize, Serialize};

use super::exact::Exact;

/// A stable sample is inaccurate where its frequency or amplitude is off by more than this
/// share, or where the coupling has created more than this share of its energy.
pub const ACCURATE: f64 = 0.1;
/// A volume beyond this many times its start is growth: the exact one never exceeds 1.
const GROWTH: f64 = 1.5;
/// So is kinetic energy of the fabric, over the last quarter of the windows, above this many
/// times the exact maximum...
const RESTLESS: f64 = 10.0;
/// ...and above this many times that of the second quarter.
const RISING: f64 = 2.0;

/// The three colours of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// No growth; frequency, amplitude and energy within [`ACCURATE`].
    Stable,
    /// No growth, but off.
    Inaccurate,
    /// Growth, or ended by a detected divergence.
    Unstable,
}

impl Class {
    /// As in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Inaccurate => "inaccurate",
            Self::Unstable => "unstable",
        }
    }
}

/// What is seen of a vibration: values after each window.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Times, s.
    pub time: Vec<f64>,
    /// Volume under the panel, m3.
    pub volume: Vec<f64>,
    /// Kinetic energy of the fabric, J.
    pub kinetic: Vec<f64>,
    /// Energy that the coupling added in all windows so far, J.
    pub energy_error: Vec<f64>,
    /// Coupling iterations.
    pub iterations: Vec<f64>,
}

/// The verdict on a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Class.
    pub class: Class,
    /// Windows done.
    pub windows: usize,
    /// Mean coupling iterations in a window.
    pub iterations: f64,
    /// Frequency over the exact one, less 1; `None` where it cannot be determined.
    pub frequency_error: Option<f64>,
    /// Amplitude at that frequency over the exact one, less 1.
    pub amplitude_error: Option<f64>,
    /// What the coupling created over the energy of the vibration; the most along the way.
    pub energy_created: f64,
    /// Why it ended early.
    pub failure: Option<String>,
}

impl Verdict {
    /// On what was seen; `failure` is why the run ended early.
    pub fn new(seen: &Seen, exact: &Exact, failure: Option<String>) -> Self {
        let windows = seen.time.len();
        let iterations = seen.iterations.iter().sum::<f64>() / windows.max(1) as f64;
        let created = seen.energy_error.iter().copied().fold(0.0, f64::max) / exact.energy();
        let fit = fit(seen, exact);
        let mut verdict = Self {
            class: Class::Unstable,
            windows,
            iterations,
            frequency_error: fit.map(|f| f[0] - 1.0),
            amplitude_error: fit.map(|f| f[1] - 1.0),
            energy_created: created,
            failure,
        };
        if verdict.failure.is_some() || windows == 0 || grows(seen, exact) {
            return verdict;
        }
        let accurate = |e: Option<f64>| e.is_some_and(|e| e.abs() <= ACCURATE);
        let within =
            accurate(verdict.frequency_error) && accurate(verdict.amplitude_error) && created <= ACCURATE;
        verdict.class = if within { Class::Stable } else { Class::Inaccurate };
        verdict
    }
}

fn grows(seen: &Seen, exact: &Exact) -> bool {
    let start = exact.volume(0.0, 1.0).abs();
    if seen.volume.iter().chain(&seen.kinetic).any(|v| !v.is_finite()) {
        return true;
    }
    if seen.volume.iter().any(|v| v.abs() > GROWTH * start) {
        return true;
    }
    let n = seen.kinetic.len();
    let most = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    let (second, last) = (most(&seen.kinetic[n / 4..n / 2]), most(&seen.kinetic[n - n / 4..]));
    // All that vibrates could be in the fabric for a moment where it is heavy.
    let bound =
        (0..=200).map(|i| exact.fabric_energy(exact.period() * f64::from(i) / 200.0)).fold(0.0, f64::max);
    last > RESTLESS * bound && last > RISING * second
}

/// Stretch of the frequencies and factor of the amplitude that fit the volume best.
fn fit(seen: &Seen, exact: &Exact) -> Option<[f64; 2]> {
    let scale: f64 = seen.volume.iter().map(|v| v * v).sum();
    if seen.time.len() < 4 || !scale.is_finite() || scale == 0.0 {
        return None;
    }
    // The amplitude is linear: what is left after the best one, by stretch.
    let trial = |stretch: f64| {
        let (mut ab, mut bb) = (0.0, 0.0);
        for (t, v) in seen.time.iter().zip(&seen.volume) {
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

    fn swing(
        exact: &Exact,
        windows: usize,
        per_period: f64,
        stretch: f64,
        amplitude: impl Fn(f64) -> f64,
    ) -> Seen {
        let time: Vec<f64> = (1..=windows).map(|i| i as f64 * exact.period() / per_period).collect();
        let volume = time.iter().map(|&t| amplitude(t) * exact.volume(t, stretch)).collect();
        let kinetic = time.iter().map(|&t| amplitude(t).powi(2) * exact.fabric_energy(t)).collect();
        Seen { volume, kinetic, energy_error: vec![0.0; windows], iterations: vec![3.0; windows], time }
    }

    #[test]
    fn classes() {
        let exact = Exact::new(&scene()).unwrap();
        let verdict = |seen: &Seen| Verdict::new(seen, &exact, None);
        let good = verdict(&swing(&exact, 32, 32.0, 0.97, |_| 0.95));
        assert_eq!((good.class, good.windows, good.iterations), (Class::Stable, 32, 3.0));
        assert!((good.frequency_error.unwrap() + 0.03).abs() < 1e-6);
        assert!((good.amplitude_error.unwrap() + 0.05).abs() < 1e-6);
        assert_eq!(verdict(&swing(&exact, 32, 32.0, 0.8, |_| 1.0)).class, Class::Inaccurate);
        assert_eq!(verdict(&swing(&exact, 32, 32.0, 1.0, |_| 0.8)).class, Class::Inaccurate);
        // A twentieth of a period is enough to see the frequency of a smooth answer.
        let short = verdict(&swing(&exact, 100, 2000.0, 1.05, |_| 1.0));
        assert_eq!(short.class, Class::Stable);
        assert!((short.frequency_error.unwrap() - 0.05).abs() < 1e-3);
        let growing = swing(&exact, 32, 32.0, 1.0, |t| (3.0 * t).exp());
        assert_eq!(verdict(&growing).class, Class::Unstable);
        // Fabric that shakes without moving a volume.
        let mut shaking = swing(&exact, 32, 32.0, 1.0, |_| 1.0);
        shaking
            .kinetic
            .iter_mut()
            .enumerate()
            .for_each(|(i, k)| *k += 1e-9 * exact.energy() * 2f64.powi(i as i32));
        assert_eq!(verdict(&shaking).class, Class::Unstable);
        let mut leaky = swing(&exact, 32, 32.0, 1.0, |_| 1.0);
        leaky.energy_error[20] = 0.2 * exact.energy();
        assert_eq!(verdict(&leaky).class, Class::Inaccurate);
        let failed = Verdict::new(&growing, &exact, Some("diverged".into()));
        assert_eq!(failed.class, Class::Unstable);
        assert_eq!(verdict(&Seen::default()).class, Class::Unstable);
    }
}
