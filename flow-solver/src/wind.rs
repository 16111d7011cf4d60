//! The undisturbed air: a steady wind and a gust.

use std::f64::consts::TAU;

use crate::geometry::vec3::{Vec3, add, scale};

/// Velocity of the undisturbed air relative to the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wind {
    /// Always there, m/s.
    pub steady: Vec3,
    /// Height of the gust, m/s.
    pub gust: Vec3,
    /// When the gust begins, s.
    pub start: f64,
    /// How long it lasts, s. Zero: there is none.
    pub duration: f64,
}

impl Wind {
    /// Velocity at `time`: the gust is `(1 - cos) / 2` of its height.
    pub fn at(&self, time: f64) -> Vec3 {
        let phase = (time - self.start) / self.duration;
        // Also false where there is no gust, and the phase is not a number.
        if !(0.0..=1.0).contains(&phase) || self.duration <= 0.0 {
            return self.steady;
        }
        add(self.steady, scale(0.5 * (1.0 - (TAU * phase).cos()), self.gust))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gust_comes_and_goes() {
        let w = Wind { steady: [1.0, 0.0, 0.0], gust: [0.0, 4.0, 0.0], start: 2.0, duration: 3.0 };
        for quiet in [0.0, 2.0, 5.0, 7.0] {
            assert!((w.at(quiet)[1]).abs() < 1e-14);
        }
        assert!((w.at(3.5)[1] - 4.0).abs() < 1e-14);
        assert!((w.at(2.75)[1] - 2.0).abs() < 1e-14);
        assert_eq!(Wind { duration: 0.0, ..w }.at(2.0), [1.0, 0.0, 0.0]);
    }
}
