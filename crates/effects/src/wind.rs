//! The wind that a scene prescribes, at the place of the falling frame.

use case::{Scene, StageTimes, WindProfile};

use super::numbers::length;

/// Wind that changes with height, and where the frame starts in it.
#[derive(Clone, Debug)]
pub struct Sheared {
    /// Height of the frame's origin at the start, m above ground.
    pub start_height_m: f64,
    /// The wind at each height.
    pub profile: WindProfile,
}

/// Wind of one stage as a function of time and of the way fallen.
#[derive(Clone, Debug, Default)]
pub struct Wind {
    /// Over time, as the programs evaluate it.
    pub air: case::Wind,
    /// Wind at the reference height of the shear, m/s.
    pub reference: [f64; 3],
    /// Changes the steady part with height.
    pub shear: Option<Sheared>,
    /// Horizontal velocity of the frame, m/s: the wind is relative to it.
    pub drift: [f64; 2],
}

/// Takes all gusts from a scene.
pub fn remove_gusts(scene: &mut Scene) {
    scene.stages.iter_mut().for_each(|stage| stage.gust = None);
    if let Some(flow) = &mut scene.flow {
        flow.gust = None;
    }
}

impl Wind {
    /// Of stage `stage` of `scene`.
    pub fn of(scene: &Scene, stage: usize) -> Self {
        let Some(flow) = &scene.flow else { return Self::default() };
        let air = scene.wind(stage, &StageTimes::planned(scene));
        let reference = flow.wind_m_s;
        let shear = flow
            .shear
            .as_ref()
            .map(|s| Sheared { start_height_m: s.start_height_m, profile: s.profile_of(reference) });
        let [x, y, _] = scene.resolved().initial_velocity_m_s;
        Self { air, reference, shear, drift: [x, y] }
    }

    /// A steady wind everywhere, m/s.
    pub fn uniform(steady: [f64; 3]) -> Self {
        Self { air: case::Wind::uniform(steady), reference: steady, ..Self::default() }
    }

    /// The wind `time` seconds after the start of the stage at a frame that has fallen by `fallen`
    /// metres, relative to its drift, m/s.
    pub fn at(&self, time: f64, fallen: f64) -> [f64; 3] {
        let air = self.air.at(time);
        let [x, y] = self.drift;
        let relative = [air[0] - x, air[1] - y, air[2]];
        let Some(s) = &self.shear else { return relative };
        let mean = s.profile.at(s.start_height_m - fallen);
        std::array::from_fn(|i| relative[i] - self.reference[i] + mean[i])
    }

    /// Largest difference of the wind over `span` metres below the start, m/s.
    pub fn change_over(&self, span: f64) -> f64 {
        let Some(s) = &self.shear else { return 0.0 };
        let top = s.profile.at(s.start_height_m);
        (1..=32)
            .map(|k| s.profile.at(s.start_height_m - span * f64::from(k) / 32.0))
            .map(|w| length(&std::array::from_fn(|i| w[i] - top[i])))
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use case::{Shear, ShearProfile};

    use super::*;

    fn shear(profile: ShearProfile) -> Shear {
        Shear {
            start_height_m: 40.0,
            profile,
            reference_height_m: 10.0,
            exponent: 0.5,
            roughness_m: 0.1,
            slope_per_m: 0.01,
            height_m: vec![0.0, 10.0, 30.0],
            table_m_s: vec![[0.0; 3], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]],
            turbulence: None,
        }
    }

    /// A table gives the wind itself.
    fn winds(profile: ShearProfile) -> [f64; 3] {
        if profile == ShearProfile::Table { [0.0; 3] } else { [3.0, 0.0, 0.0] }
    }

    /// Values by hand: 40 m is four reference heights, 20 m two.
    #[test]
    fn profiles_give_the_wind_at_a_height() {
        let wind = |profile, fallen| {
            let (s, reference) = (shear(profile), winds(profile));
            let sheared = Sheared { start_height_m: s.start_height_m, profile: s.profile_of(reference) };
            Wind { shear: Some(sheared), ..Wind::uniform(reference) }.at(0.0, fallen)[0]
        };
        assert!((wind(ShearProfile::Power, 0.0) - 6.0).abs() < 1e-12);
        assert!((wind(ShearProfile::Linear, 20.0) - 3.3).abs() < 1e-12);
        assert!((wind(ShearProfile::Log, 0.0) - 3.0 * 400f64.ln() / 100f64.ln()).abs() < 1e-12);
        for (fallen, value) in [(0.0, 4.0), (20.0, 3.0), (35.0, 1.0), (60.0, 0.0)] {
            assert!((wind(ShearProfile::Table, fallen) - value).abs() < 1e-12, "{fallen}");
        }
    }
}
