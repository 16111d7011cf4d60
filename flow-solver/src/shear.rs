//! Wind that changes with height above ground.
//!
//! The far field brings each face the wind at its height. The frame sinks, so heights follow
//! from the position of a face in the frame and the height of the frame's origin, which is
//! integrated from the frame's velocity as the grid fluxes are.

use crate::geometry::Metrics;
use crate::geometry::vec3::{Vec3, scale, sub};
use crate::topology::Topology;

/// A profile over height, m above ground.
#[derive(Clone, Debug, PartialEq)]
pub enum Profile {
    /// $(z/z_r)^\alpha$ times a wind.
    Power {
        /// Wind at the reference height, m/s.
        wind: Vec3,
        /// $z_r$, m.
        reference: f64,
        /// $\alpha$.
        exponent: f64,
    },
    /// $\ln(z/z_0)/\ln(z_r/z_0)$ times a wind: the neutral surface layer.
    Log {
        /// Wind at the reference height, m/s.
        wind: Vec3,
        /// $z_r$, m.
        reference: f64,
        /// $z_0$, m.
        roughness: f64,
    },
    /// $1 + s (z - z_r)$ times a wind.
    Linear {
        /// Wind at the reference height, m/s.
        wind: Vec3,
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
        winds: Vec<Vec3>,
    },
}

impl Profile {
    /// Wind at `height`, m/s. On the ground and below, power and logarithmic laws give calm.
    pub fn at(&self, height: f64) -> Vec3 {
        match self {
            Self::Power { wind, reference, exponent } => {
                scale((height.max(0.0) / reference).powf(*exponent), *wind)
            }
            Self::Log { wind, reference, roughness } => {
                scale((height.max(*roughness) / roughness).ln() / (reference / roughness).ln(), *wind)
            }
            Self::Linear { wind, reference, slope } => scale(1.0 + slope * (height - reference), *wind),
            Self::Table { heights, winds } => {
                let k = heights.partition_point(|h| *h < height);
                if k == 0 || k == heights.len() {
                    return winds[k.min(heights.len() - 1)];
                }
                let s = (height - heights[k - 1]) / (heights[k] - heights[k - 1]);
                std::array::from_fn(|d| winds[k - 1][d] + s * (winds[k][d] - winds[k - 1][d]))
            }
        }
    }
}

/// A profile and where the falling frame is in it.
#[derive(Clone, Debug)]
pub struct Sheared {
    profile: Profile,
    /// Height of the frame's origin at the last accepted instant, m.
    pub height: f64,
    /// Height at the end of the step, m.
    next: f64,
    /// Wind at the frame's origin at the start, m/s: what the profile is measured from.
    base: Vec3,
}

impl Sheared {
    /// A frame whose origin starts at `height`.
    pub fn new(profile: Profile, height: f64) -> Self {
        Self { base: profile.at(height), profile, height, next: height }
    }

    /// What a scene asks for; `wind` is its wind at the reference height.
    pub fn of_scene(s: &case::Shear, wind: Vec3) -> Self {
        let reference = s.reference_height_m;
        let profile = match s.profile {
            case::ShearProfile::Power => Profile::Power { wind, reference, exponent: s.exponent },
            case::ShearProfile::Log => Profile::Log { wind, reference, roughness: s.roughness_m },
            case::ShearProfile::Linear => Profile::Linear { wind, reference, slope: s.slope_per_m },
            case::ShearProfile::Table => {
                Profile::Table { heights: s.height_m.clone(), winds: s.table_m_s.clone() }
            }
        };
        Self::new(profile, s.start_height_m)
    }

    /// Wind at the start at the frame's origin, m/s: the wind that the solver is told.
    pub fn base(&self) -> Vec3 {
        self.base
    }

    /// What the wind at `z` (m, in the frame, at the last accepted instant) has more than the base.
    pub fn excess(&self, z: f64) -> Vec3 {
        sub(self.profile.at(self.height + z), self.base)
    }

    /// The frame moves upwards by `rise` (m) in the coming step: fills what the wind has more
    /// than the base on all faces that are not between two cells.
    pub fn advance(&mut self, rise: f64, topology: &Topology, metrics: &Metrics, excess: &mut [Vec3]) {
        self.next = self.height + rise;
        for (e, f) in excess.iter_mut().zip(topology.cells.len() as u32..) {
            *e = sub(self.profile.at(self.next + metrics.border(f)[2]), self.base);
        }
    }

    /// The step is taken.
    pub fn accept(&mut self) {
        self.height = self.next;
    }

    /// Continues at a saved height.
    pub fn restore(&mut self, height: f64) {
        self.height = height;
        self.next = height;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles() {
        let wind = [6.0, 0.0, 0.0];
        let power = Profile::Power { wind, reference: 10.0, exponent: 0.5 };
        assert_eq!([power.at(40.0)[0], power.at(10.0)[0], power.at(-3.0)[0]], [12.0, 6.0, 0.0]);
        let log = Profile::Log { wind, reference: 10.0, roughness: 0.1 };
        assert!((log.at(1.0)[0] - 3.0).abs() < 1e-14 && log.at(0.05)[0] == 0.0);
        let linear = Profile::Linear { wind, reference: 10.0, slope: 0.1 };
        assert!((linear.at(25.0)[0] - 15.0).abs() < 1e-14);
        let winds = vec![[0.0, 0.0, 0.0], [4.0, 2.0, 0.0], [4.0, 4.0, 0.0]];
        let table = Profile::Table { heights: vec![0.0, 10.0, 30.0], winds };
        assert_eq!(table.at(5.0), [2.0, 1.0, 0.0]);
        assert_eq!(table.at(20.0), [4.0, 3.0, 0.0]);
        assert_eq!((table.at(-1.0), table.at(99.0)), ([0.0; 3], [4.0, 4.0, 0.0]));
    }
}
