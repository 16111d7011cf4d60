//! Dryden turbulence as a sum of cosines: a function of time without a state.
//!
//! A frame passes through frozen turbulence at the speed $`V`$. With $`x = \omega L / V`$ the one-sided spectra of MIL-F-8785C (1980), section 3.7.1.2, are
//! ```math
//! \Phi_\parallel(\omega) = \sigma^2 \frac{2L}{\pi V} \frac{1}{1 + x^2}, \qquad
//! \Phi_\perp(\omega) = \sigma^2 \frac{L}{\pi V} \frac{1 + 3x^2}{(1 + x^2)^2}
//! ```
//! along the passage and across it. Their shares of the variance below $`x`$ are
//! ```math
//! F_\parallel(x) = \frac{2}{\pi} \arctan x, \qquad F_\perp(x) = \frac{1}{\pi} \left(2 \arctan x - \frac{x}{1 + x^2}\right)
//! ```
//! Each of [`BANDS`] bands of equal ratio from $`x`$ = [`LOWEST`] to [`HIGHEST`] is one cosine (Shinozuka and Deodatis, Applied Mechanics Reviews 44,
//! 1991). Its variance $`a^2/2`$ is that of the band, $`\sigma^2 (F(x_2) - F(x_1))`$. Its frequency lies at a random place of the band, uniform in the logarithm, so
//! that no two frequencies are commensurable and the signal does not repeat; its phase is random. The bands hold 1 - 4/(1000 pi) = 99.87 % of the
//! variance of both spectra.
//!
//! MIL-HDBK-1797 writes the transverse spectrum with a length of twice this one: its $`L_v`$ is half of the $`L_\perp`$ here.

use std::f64::consts::{PI, TAU};

use super::random::SplitMix;

/// Cosines of each component.
pub(crate) const BANDS: usize = 120;
/// Lowest and highest $`\omega L / V`$ of the bands.
pub(crate) const LOWEST: f64 = 1e-3;
/// See [`LOWEST`].
pub(crate) const HIGHEST: f64 = 1e3;
/// $`\omega L / V`$ above which 1 % of the variance lies across the passage ($`3/(\pi x)`$), and less along it.
pub(crate) const SMALL: f64 = 100.0;

/// What a turbulence is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dryden {
    /// Root mean square of each component, m/s.
    pub(crate) rms: [f64; 3],
    /// Length scale $`L`$ of each component, m.
    pub(crate) lengths: [f64; 3],
    /// Speed $`V`$ of the passage, m/s.
    pub(crate) speed: f64,
    /// Axis of the passage, 0 to 2: the component along it has the longitudinal spectrum.
    pub(crate) along: usize,
    /// Chooses frequencies and phases.
    pub(crate) seed: u32,
}

/// One cosine, $`a \cos(\omega t + \phi)`$.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wave {
    amplitude: f64,
    omega: f64,
    phase: f64,
}

/// The velocity of a [`Dryden`] turbulence over time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DrydenTurbulence {
    waves: [Vec<Wave>; 3],
}

/// Share of the variance below $`x = \omega L / V`$, along the passage or across it.
fn share_below(x: f64, along: bool) -> f64 {
    if along { 2.0 * x.atan() / PI } else { (2.0 * x.atan() - x / (1.0 + x * x)) / PI }
}

impl DrydenTurbulence {
    /// The cosines of a turbulence.
    pub(crate) fn new(of: &Dryden) -> Self {
        let mut random = SplitMix::new(of.seed);
        let ratio = (HIGHEST / LOWEST).ln() / BANDS as f64;
        let edge = |k: f64| LOWEST * (ratio * k).exp();
        let mut wave = |c: usize, k: usize| {
            let [low, high] = [k, k + 1].map(|k| share_below(edge(k as f64), c == of.along));
            Wave {
                amplitude: of.rms[c] * (2.0 * (high - low)).sqrt(),
                omega: edge(k as f64 + random.share()) * of.speed / of.lengths[c],
                phase: TAU * random.share(),
            }
        };
        Self { waves: [0, 1, 2].map(|c| (0..BANDS).map(|k| wave(c, k)).collect()) }
    }

    /// Velocity at `t` (s), m/s.
    pub(crate) fn at(&self, t: f64) -> [f64; 3] {
        [0, 1, 2].map(|c| self.component(c, t))
    }

    fn component(&self, c: usize, t: f64) -> f64 {
        self.waves[c].iter().map(|w| w.amplitude * (w.omega * t + w.phase).cos()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RMS: [f64; 3] = [1.5, 2.0, 0.5];
    const LENGTHS: [f64; 3] = [50.0, 80.0, 20.0];
    const SPEED: f64 = 5.0;

    fn dryden(seed: u32) -> Dryden {
        Dryden { rms: RMS, lengths: LENGTHS, speed: SPEED, along: 2, seed }
    }

    /// The density as the specification prints it.
    fn density(c: usize, omega: f64) -> f64 {
        let (l, s) = (LENGTHS[c] / SPEED, RMS[c] * RMS[c]);
        let x2 = (l * omega) * (l * omega);
        match c {
            2 => s * 2.0 * l / PI / (1.0 + x2),
            _ => s * l / PI * (1.0 + 3.0 * x2) / ((1.0 + x2) * (1.0 + x2)),
        }
    }

    /// Integral of the density between two frequencies: Simpson's rule in their logarithm.
    fn integral(c: usize, [low, high]: [f64; 2]) -> f64 {
        let (n, width) = (2000, (high / low).ln());
        let value = |k: usize| {
            let omega = low * (width * k as f64 / n as f64).exp();
            let weight = if k == 0 || k == n { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
            weight * density(c, omega) * omega
        };
        (0..=n).map(value).sum::<f64>() * width / (3.0 * n as f64)
    }

    /// Each wave lies in its band and has the variance of the density there, to the error of Simpson's rule.
    #[test]
    fn every_band_has_the_variance_of_the_spectrum() {
        let air = DrydenTurbulence::new(&dryden(7));
        let ratio = (HIGHEST / LOWEST).powf(1.0 / BANDS as f64);
        for (c, length) in LENGTHS.into_iter().enumerate() {
            let unit = SPEED / length;
            for (k, w) in air.waves[c].iter().enumerate() {
                let low = unit * LOWEST * ratio.powi(k as i32);
                let exact = integral(c, [low, low * ratio]);
                let found = 0.5 * w.amplitude * w.amplitude;
                assert!((found / exact - 1.0).abs() < 1e-9, "{c} {k}: {found} {exact}");
                assert!(w.omega > low * (1.0 - 1e-9) && w.omega < low * ratio * (1.0 + 1e-9), "{c} {k}");
            }
        }
    }

    /// 4/(1000 pi) of the variance lies outside of the bands, to order x^3 at their ends.
    #[test]
    fn bands_keep_all_but_a_thousandth_of_the_variance() {
        let air = DrydenTurbulence::new(&dryden(7));
        for (c, rms) in RMS.into_iter().enumerate() {
            let sum: f64 = air.waves[c].iter().map(|w| 0.5 * w.amplitude * w.amplitude).sum();
            let kept = sum / (rms * rms);
            assert!((kept - (1.0 - 4.0 / (1000.0 * PI))).abs() < 1e-8, "{c}: {kept}");
        }
        let beyond = [true, false].map(|along| 1.0 - share_below(SMALL, along));
        assert!((beyond[1] - 3.0 / (PI * SMALL)).abs() < 1e-5 && beyond[0] < beyond[1], "{beyond:?}");
        assert!(beyond[1] < 0.01, "{beyond:?}");
    }

    /// Products of components at times that are `later` s apart, mean over random times within 1e7 length scales.
    fn correlation(air: &DrydenTurbulence, [a, b]: [usize; 2], later: f64) -> f64 {
        const SAMPLES: u32 = 20_000;
        let mut random = SplitMix::new(99);
        let product = |_| {
            let t = 1e7 * random.share();
            air.component(a, t) * air.component(b, t + later)
        };
        (0..SAMPLES).map(product).sum::<f64>() / (f64::from(SAMPLES) * RMS[a] * RMS[b])
    }

    /// Correlations of the signal are $`e^{-s}`$ along the passage and $`e^{-s} (1 - s/2)`$ across it, $`s = V \tau / L`$. The mean over N = 20 000 times
    /// has a deviation of $`\sqrt{2/N}`$ = 1 % or less, each cosine moves the correlation at most by its variance times the change of its phase by the place in the
    /// band, 3.7 % times 3.3 %, which over 20 cosines adds up to 0.6 %, and 0.13 % is missing: 4 % is more than three deviations. The two spectra differ by 18 % at s = 1.
    #[test]
    fn correlation_in_time_is_that_of_the_spectrum() {
        let air = DrydenTurbulence::new(&dryden(3));
        for (c, length) in LENGTHS.into_iter().enumerate() {
            for s in [0.0f64, 0.3, 1.0, 2.0, 3.0] {
                let exact = (-s).exp() * if c == 2 { 1.0 } else { 1.0 - 0.5 * s };
                let found = correlation(&air, [c, c], s * length / SPEED);
                assert!((found - exact).abs() < 0.04, "component {c}, s = {s}: {found}, exact {exact}");
            }
        }
    }

    /// The components are independent, also with the same length: their mean product deviates from zero by $`1/\sqrt N`$ = 0.7 %, of which 3 % is four.
    #[test]
    fn components_are_not_correlated() {
        let air = DrydenTurbulence::new(&Dryden { lengths: [50.0; 3], ..dryden(3) });
        for pair in [[0, 1], [0, 2], [1, 2]] {
            let found = correlation(&air, pair, 0.0);
            assert!(found.abs() < 0.03, "{pair:?}: {found}");
        }
    }

    /// Of a normal distribution 0.27 % lies beyond three deviations, 0.006 % beyond four: the largest of 40 000 values is 3.5 to 5.
    #[test]
    fn values_are_distributed_normally() {
        let air = DrydenTurbulence::new(&dryden(5));
        let mut random = SplitMix::new(17);
        let values: Vec<f64> = (0..40_000).map(|_| air.component(0, 1e7 * random.share()) / RMS[0]).collect();
        let beyond = values.iter().filter(|v| v.abs() > 3.0).count() as f64 / 40_000.0;
        let most = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        assert!((0.0015..0.004).contains(&beyond) && (3.5..5.0).contains(&most), "{beyond} {most}");
    }

    /// Each component is the sum of its own cosines.
    #[test]
    fn velocity_is_the_sum_of_the_cosines_of_each_component() {
        let (air, t) = (DrydenTurbulence::new(&dryden(5)), 12.5);
        for (c, found) in air.at(t).into_iter().enumerate() {
            let wave = |w: &Wave| {
                w.amplitude * (w.omega * t).cos() * w.phase.cos()
                    - w.amplitude * (w.omega * t).sin() * w.phase.sin()
            };
            let exact: f64 = air.waves[c].iter().map(wave).sum();
            // Arguments of up to 1e3 * 12.5 / 4 rad have a round-off of 5e-13 rad.
            assert!((found - exact).abs() < 1e-11, "{c}: {found} {exact}");
        }
    }

    /// Places in the bands and phases are uniform: means 1/2, mean squares 1/3, with deviations of 0.29 and 0.30 over the square root of 3600; 0.02 is four. Equal places
    /// would make a periodic signal, and equal phases a peak at its start.
    #[test]
    fn places_and_phases_are_uniform() {
        let width = (HIGHEST / LOWEST).ln() / BANDS as f64;
        let [mut places, mut phases] = [Vec::new(), Vec::new()];
        for seed in 1..=10 {
            for (c, waves) in DrydenTurbulence::new(&dryden(seed)).waves.iter().enumerate() {
                let low = LOWEST * SPEED / LENGTHS[c];
                let place = |(k, w): (usize, &Wave)| (w.omega / low).ln() / width - k as f64;
                places.extend(waves.iter().enumerate().map(place));
                phases.extend(waves.iter().map(|w| w.phase / TAU));
            }
        }
        for values in [places, phases] {
            let mean = |power| values.iter().map(|v: &f64| v.powi(power)).sum::<f64>() / values.len() as f64;
            assert!(
                (mean(1) - 0.5).abs() < 0.02 && (mean(2) - 1.0 / 3.0).abs() < 0.02,
                "{} {}",
                mean(1),
                mean(2)
            );
        }
    }

    #[test]
    fn a_seed_gives_its_digits_and_another_seed_others() {
        let at = |seed| DrydenTurbulence::new(&dryden(seed)).at(12.5);
        assert_eq!(at(1), at(1));
        assert!((0..3).all(|c| at(1)[c] != at(2)[c]));
    }
}
