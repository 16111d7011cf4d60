//! The undisturbed air of a stage over time and height.

use std::sync::Arc;

use crate::{Scene, StageTimes, Wind, WindProfile};

/// Velocity of the undisturbed air over ground: [`Wind`] over time, and its change with height by `[flow.shear]`.
#[derive(Clone, Debug, Default)]
pub struct AirMotion {
    wind: Wind,
    /// The wind by height, and that part of it which `wind` holds, m/s.
    by_height: Option<(Arc<WindProfile>, [f64; 3])>,
}

/// The undisturbed air at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AirByHeight {
    /// What is the same at all heights, m/s.
    everywhere: [f64; 3],
    profile: Option<Arc<WindProfile>>,
}

impl AirMotion {
    /// `wind` with `profile` added.
    pub fn by_height(wind: Wind, profile: WindProfile) -> Self {
        Self { wind, by_height: Some((Arc::new(profile), [0.0; 3])) }
    }

    /// The air over time, without the change with height.
    pub fn wind(&self) -> &Wind {
        &self.wind
    }

    /// The air at `t`, s since the start of the stage.
    pub fn at(&self, t: f64) -> AirByHeight {
        let wind = self.wind.at(t);
        match &self.by_height {
            None => AirByHeight { everywhere: wind, profile: None },
            Some((profile, held)) => AirByHeight {
                everywhere: std::array::from_fn(|i| wind[i] - held[i]),
                profile: Some(Arc::clone(profile)),
            },
        }
    }
}

impl AirByHeight {
    /// A velocity (m/s) at all heights.
    pub fn uniform(velocity: [f64; 3]) -> Self {
        Self { everywhere: velocity, profile: None }
    }

    /// With `profile` added, whose heights count from the ground.
    pub fn with_profile(self, profile: WindProfile) -> Self {
        Self { profile: Some(Arc::new(profile)), ..self }
    }

    /// Velocity at `height` (m above ground), m/s.
    pub fn over_ground(&self, height: f64) -> [f64; 3] {
        let Some(profile) = &self.profile else { return self.everywhere };
        let more = profile.at(height);
        std::array::from_fn(|i| self.everywhere[i] + more[i])
    }
}

impl Scene {
    /// Undisturbed air in `stage`, with the stages before it as long as `times` says.
    pub fn air_motion(&self, stage: usize, times: &StageTimes) -> AirMotion {
        let wind = self.wind(stage, times);
        let by_height = self.flow.as_ref().and_then(|flow| {
            let shear = flow.shear.as_ref()?;
            Some((Arc::new(shear.profile_of(flow.wind_m_s)), flow.wind_m_s))
        });
        AirMotion { wind, by_height }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gust adds the same at all heights; the profile replaces the wind at its reference height.
    #[test]
    fn wind_of_a_time_and_a_height() {
        let profile = WindProfile::Linear { wind: [6.0, 2.0, 0.0], reference: 10.0, slope: 0.05 };
        let held = [6.0, 2.0, 0.0];
        let wind = Wind::uniform([6.0, 2.0, 0.5]);
        let air = AirMotion { wind, by_height: Some((Arc::new(profile.clone()), held)) };
        for height in [0.0, 10.0, 42.0] {
            let factor = 1.0 + 0.05 * (height - 10.0);
            let found = air.at(3.0).over_ground(height);
            for (x, exact) in found.into_iter().zip([6.0 * factor, 2.0 * factor, 0.5]) {
                assert!((x - exact).abs() < 1e-13, "{height} {found:?}");
            }
        }
        let everywhere = AirByHeight::uniform([0.0, 0.0, 0.5]);
        assert_eq!(air.at(3.0), everywhere.clone().with_profile(profile));
        assert_eq!(everywhere.over_ground(1e3), [0.0, 0.0, 0.5]);
    }
}
