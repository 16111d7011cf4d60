//! `[flow.shear]`: the law of wind by height.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::dryden::{Dryden, DrydenTurbulence, SMALL};
use crate::Flow;
use crate::check::Check;

/// Wind that changes with height above ground. Except with a table, the wind at each height is
/// `wind_m_s` times a factor that is 1 at `reference_height_m`. It holds in all stages: `[stage.wind]` together with it is
/// refused; a gust adds the same to the wind at all heights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shear {
    /// Height above ground of the origin of the falling frame when the first flow stage
    /// begins, m. It sinks as the frame falls.
    pub start_height_m: f64,
    /// The profile.
    pub profile: ShearProfile,
    /// Height at which the wind is `wind_m_s`, m.
    #[serde(default = "ten_metres")]
    pub reference_height_m: f64,
    /// Exponent of the power law.
    #[serde(default = "one_seventh")]
    pub exponent: f64,
    /// Roughness length of the logarithmic law, m.
    #[serde(default = "grass")]
    pub roughness_m: f64,
    /// Change of the factor with height of the linear law, 1/m.
    #[serde(default)]
    pub slope_per_m: f64,
    /// Ascending heights of the table, m.
    #[serde(default)]
    pub height_m: Vec<f64>,
    /// Wind at each height of the table, m/s; linear in between, constant beyond.
    #[serde(default)]
    pub table_m_s: Vec<[f64; 3]>,
    /// Frozen turbulence that the frame falls through, added to the profile. Absent: none.
    pub turbulence: Option<LayeredTurbulence>,
}

/// Horizontal turbulence that changes with height and not in time: the transverse Dryden spectrum of MIL-F-8785C over the height. Canopy, lines and
/// payload each meet the air of their own height. The vertical component is left out: one that changes with height alone would not
/// conserve mass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayeredTurbulence {
    /// Root mean square along x and y, m/s.
    pub rms_m_s: [f64; 2],
    /// Length scales of both, m.
    pub length_m: [f64; 2],
    /// Chooses wave numbers and phases: each seed another wind, the same in each run.
    #[serde(default = "first_seed")]
    pub seed: u32,
}

fn first_seed() -> u32 {
    1
}

impl LayeredTurbulence {
    /// Period (s) below which lies 1 % of the variance in a fall at `speed` (m/s): the shorter of both components.
    pub fn shortest_period(&self, speed: f64) -> Option<f64> {
        let moving = self.length_m.iter().zip(self.rms_m_s).filter(|(_, rms)| *rms > 0.0);
        let shortest = moving.map(|(length, _)| *length).reduce(f64::min)?;
        (speed > 0.0).then(|| std::f64::consts::TAU * shortest / (SMALL * speed))
    }

    fn compiled(&self) -> FrozenTurbulence {
        let [[x, y], [along, across]] = [self.rms_m_s, self.length_m];
        FrozenTurbulence(DrydenTurbulence::new(&Dryden {
            rms: [x, y, 0.0],
            lengths: [along, across, along],
            speed: 1.0,
            along: 2,
            seed: self.seed,
        }))
    }

    fn check(&self, c: &mut Check) {
        let at = |key: &str| format!("flow.shear.turbulence.{key}");
        for rms in self.rms_m_s {
            c.range(&at("rms_m_s"), rms, 0.0..=100.0, "m/s");
        }
        for length in self.length_m {
            c.positive(&at("length_m"), length, 1e5, "a length in m");
        }
    }
}

fn ten_metres() -> f64 {
    10.0
}
fn one_seventh() -> f64 {
    1.0 / 7.0
}
fn grass() -> f64 {
    0.03
}

/// How the wind grows with height.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ShearProfile {
    /// `(z / reference)^exponent`.
    Power,
    /// `ln(z / roughness) / ln(reference / roughness)`.
    Log,
    /// `1 + slope (z - reference)`.
    Linear,
    /// From `height_m` and `table_m_s`.
    Table,
}

/// Refuses laws without a wind, and invalid tables.
pub(super) fn check(s: &Shear, flow: &Flow, c: &mut Check) {
    let at = |key: &str| format!("flow.shear.{key}");
    c.range(&at("start_height_m"), s.start_height_m, 0.0..=1e5, "above ground, m");
    c.positive(&at("reference_height_m"), s.reference_height_m, 1e5, "above ground, m");
    let calm = flow.wind_m_s == [0.0; 3];
    let table = s.profile == ShearProfile::Table;
    if calm != table {
        c.refuse(
            &at("profile"),
            if calm {
                "the profile scales a wind that is zero"
            } else {
                "table and `wind_m_s` both give the wind"
            },
            if calm { "set flow.wind_m_s, the wind at `reference_height_m`" } else { "remove flow.wind_m_s" },
        );
    }
    match s.profile {
        ShearProfile::Power => {
            c.range(&at("exponent"), s.exponent, 0.0..=2.0, "0.1 to 0.3 is usual");
        }
        ShearProfile::Log => {
            c.positive(&at("roughness_m"), s.roughness_m, 0.5 * s.reference_height_m, "a length in metres");
        }
        ShearProfile::Linear => c.range(&at("slope_per_m"), s.slope_per_m, -10.0..=10.0, "in 1/m"),
        ShearProfile::Table => {}
    }
    heights(s, c);
    if let Some(t) = &s.turbulence {
        t.check(c);
    }
}

fn heights(s: &Shear, c: &mut Check) {
    let path = "flow.shear.height_m";
    let table = s.profile == ShearProfile::Table;
    let ascending = s.height_m.windows(2).all(|w| w[0] < w[1]);
    let finite = s.height_m.iter().chain(s.table_m_s.iter().flatten()).all(|v| v.is_finite());
    if table && (s.height_m.len() < 2 || s.height_m.len() != s.table_m_s.len() || !ascending || !finite) {
        c.refuse(
            path,
            format!("the table has {} heights and {} winds", s.height_m.len(), s.table_m_s.len()),
            "list at least two ascending heights and as many winds",
        );
    }
    let rows = s.height_m.len() + s.table_m_s.len();
    if !table && rows > 0 {
        c.refuse(path, "a table is given, but the profile is a law", "set profile = \"table\"");
    }
}

/// Wind over height, m above ground (Stull, An Introduction to Boundary Layer Meteorology, 1988, chapter 9).
#[derive(Clone, Debug, PartialEq)]
pub enum WindProfile {
    /// $`(z/z_r)^\alpha`$ times a wind.
    Power {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $`z_r`$, m.
        reference: f64,
        /// $`\alpha`$.
        exponent: f64,
    },
    /// $`\ln(z/z_0)/\ln(z_r/z_0)`$ times a wind: the neutral surface layer.
    Log {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $`z_r`$, m.
        reference: f64,
        /// $`z_0`$, m.
        roughness: f64,
    },
    /// $`1 + s (z - z_r)`$ times a wind.
    Linear {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $`z_r`$, m.
        reference: f64,
        /// $`s`$, 1/m.
        slope: f64,
    },
    /// Linear between given heights, constant beyond.
    Table {
        /// Ascending heights, m.
        heights: Vec<f64>,
        /// Wind at each, m/s.
        winds: Vec<[f64; 3]>,
    },
    /// Another profile with turbulence.
    Turbulent {
        /// The profile.
        mean: Box<WindProfile>,
        /// What is added.
        turbulence: FrozenTurbulence,
    },
}

/// [`LayeredTurbulence`] as a function of height.
#[derive(Clone, Debug, PartialEq)]
pub struct FrozenTurbulence(DrydenTurbulence);

impl FrozenTurbulence {
    /// Velocity at `height` (m), m/s.
    pub fn at(&self, height: f64) -> [f64; 3] {
        self.0.at(height)
    }
}

impl WindProfile {
    /// Wind at `height`, m/s. On the ground and below, power and logarithmic laws give calm.
    pub fn at(&self, height: f64) -> [f64; 3] {
        let (factor, wind) = match self {
            Self::Power { wind, reference, exponent } => {
                ((height.max(0.0) / reference).powf(*exponent), wind)
            }
            Self::Log { wind, reference, roughness } => {
                ((height.max(*roughness) / roughness).ln() / (reference / roughness).ln(), wind)
            }
            Self::Linear { wind, reference, slope } => (1.0 + slope * (height - reference), wind),
            Self::Table { heights, winds } => return in_table(heights, winds, height),
            Self::Turbulent { mean, turbulence } => {
                let (mean, more) = (mean.at(height), turbulence.at(height));
                return std::array::from_fn(|i| mean[i] + more[i]);
            }
        };
        wind.map(|w| factor * w)
    }
}

/// Between the two heights around `height`; the first and the last wind beyond them.
fn in_table(heights: &[f64], winds: &[[f64; 3]], height: f64) -> [f64; 3] {
    let k = heights.partition_point(|h| *h < height);
    if k == 0 || k == heights.len() {
        return winds[k.min(heights.len() - 1)];
    }
    let s = (height - heights[k - 1]) / (heights[k] - heights[k - 1]);
    std::array::from_fn(|d| winds[k - 1][d] + s * (winds[k][d] - winds[k - 1][d]))
}

impl Shear {
    /// The law of this shear; `wind` (m/s) blows at the reference height, and a table gives its own.
    pub fn profile_of(&self, wind: [f64; 3]) -> WindProfile {
        let mean = self.mean_profile(wind);
        match &self.turbulence {
            None => mean,
            Some(t) => WindProfile::Turbulent { mean: Box::new(mean), turbulence: t.compiled() },
        }
    }

    fn mean_profile(&self, wind: [f64; 3]) -> WindProfile {
        let reference = self.reference_height_m;
        match self.profile {
            ShearProfile::Power => WindProfile::Power { wind, reference, exponent: self.exponent },
            ShearProfile::Log => WindProfile::Log { wind, reference, roughness: self.roughness_m },
            ShearProfile::Linear => WindProfile::Linear { wind, reference, slope: self.slope_per_m },
            ShearProfile::Table => {
                WindProfile::Table { heights: self.height_m.clone(), winds: self.table_m_s.clone() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles() {
        let wind = [6.0, 0.0, 0.0];
        let power = WindProfile::Power { wind, reference: 10.0, exponent: 0.5 };
        assert_eq!([power.at(40.0)[0], power.at(10.0)[0], power.at(-3.0)[0]], [12.0, 6.0, 0.0]);
        let log = WindProfile::Log { wind, reference: 10.0, roughness: 0.1 };
        assert!((log.at(1.0)[0] - 3.0).abs() < 1e-14 && log.at(0.05)[0] == 0.0);
        let linear = WindProfile::Linear { wind, reference: 10.0, slope: 0.1 };
        assert!((linear.at(25.0)[0] - 15.0).abs() < 1e-14);
        let winds = vec![[0.0, 0.0, 0.0], [4.0, 2.0, 0.0], [4.0, 4.0, 0.0]];
        let table = WindProfile::Table { heights: vec![0.0, 10.0, 30.0], winds };
        assert_eq!(table.at(5.0), [2.0, 1.0, 0.0]);
        assert_eq!(table.at(20.0), [4.0, 3.0, 0.0]);
        assert_eq!((table.at(-1.0), table.at(99.0)), ([0.0; 3], [4.0, 4.0, 0.0]));
    }

    /// Turbulence is added to the profile: its means over 1e7 length scales are those of the profile, its variance that of the key (to the
    /// 0.13 % outside of the bands and the 1 % of a mean over 20 000 places), its correlation over a length across the fall is half of `1/e`. None along the fall.
    #[test]
    fn frozen_turbulence_has_the_statistics_of_its_spectrum() {
        let turbulence = LayeredTurbulence { rms_m_s: [2.0, 0.5], length_m: [40.0, 15.0], seed: 3 };
        let shear = Shear {
            start_height_m: 100.0,
            profile: ShearProfile::Linear,
            reference_height_m: 10.0,
            exponent: 0.0,
            roughness_m: 0.1,
            slope_per_m: 0.0,
            height_m: vec![],
            table_m_s: vec![],
            turbulence: Some(turbulence.clone()),
        };
        let wind = shear.profile_of([6.0, -1.0, 0.3]);
        let mut random = crate::scene::random::SplitMix::new(5);
        let (mut mean, mut products) = ([0.0; 3], [[0.0; 2]; 2]);
        let samples = 20_000;
        for _ in 0..samples {
            let z = 1e7 * random.share();
            let here = wind.at(z);
            assert_eq!(here[2], 0.3);
            for i in 0..3 {
                mean[i] += here[i] / f64::from(samples);
            }
            for i in 0..2 {
                let (base, rms) = ([6.0, -1.0][i], turbulence.rms_m_s[i]);
                let above = wind.at(z + turbulence.length_m[i])[i] - base;
                for (k, other) in [here[i] - base, above].into_iter().enumerate() {
                    products[i][k] += (here[i] - base) * other / (rms * rms * f64::from(samples));
                }
            }
        }
        let exact = [1.0, 0.5 * (-1.0f64).exp()];
        for i in 0..2 {
            assert!((mean[i] - [6.0, -1.0][i]).abs() < 0.03 * turbulence.rms_m_s[i], "{mean:?}");
            for k in 0..2 {
                assert!((products[i][k] - exact[k]).abs() < 0.04, "{i} {k} {products:?}");
            }
        }
        let other = Shear { turbulence: Some(LayeredTurbulence { seed: 4, ..turbulence }), ..shear };
        assert_ne!(other.profile_of([6.0, -1.0, 0.3]).at(50.0), wind.at(50.0));
    }
}
