//! The law of wind by height, for the flow and for estimates.

use crate::{Shear, ShearProfile};

/// Wind over height, m above ground (Stull, An Introduction to Boundary Layer Meteorology, 1988, chapter 9).
#[derive(Clone, Debug, PartialEq)]
pub enum WindProfile {
    /// $(z/z_r)^\alpha$ times a wind.
    Power {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $z_r$, m.
        reference: f64,
        /// $\alpha$.
        exponent: f64,
    },
    /// $\ln(z/z_0)/\ln(z_r/z_0)$ times a wind: the neutral surface layer.
    Log {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $z_r$, m.
        reference: f64,
        /// $z_0$, m.
        roughness: f64,
    },
    /// $1 + s (z - z_r)$ times a wind.
    Linear {
        /// Wind at the reference height, m/s.
        wind: [f64; 3],
        /// $z_r$, m.
        reference: f64,
        /// $s$, 1/m.
        slope: f64,
    },
    /// Linear between given heights, constant beyond.
    Table {
        /// Ascending heights, m.
        heights: Vec<f64>,
        /// Wind at each, m/s.
        winds: Vec<[f64; 3]>,
    },
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
}
