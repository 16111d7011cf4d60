//! The undisturbed air in the falling frame, which lines and a free payload meet.

use std::path::Path;

use case::{AirByHeight, AirMotion, Scene, StageKind, StageTimes};
use channel::{Fault, Window};
use mesh::geometry::Vec3;
use serde::{Deserialize, Serialize};

/// Velocity of the air by place in the falling frame, at one time.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    air: AirByHeight,
    /// Height of the frame's origin above ground, m.
    height: f64,
    /// Velocity of the frame over ground, m/s.
    frame: Vec3,
}

impl Stream {
    /// The same `velocity` (m/s, relative to the frame) everywhere.
    pub fn uniform(velocity: Vec3) -> Self {
        Self { air: AirByHeight::uniform(velocity.into()), ..Self::default() }
    }

    /// In a frame whose origin is at `height` (m above ground) and moves with `frame` (m/s over ground).
    pub fn new(air: AirByHeight, height: f64, frame: Vec3) -> Self {
        Self { air, height, frame }
    }

    /// Velocity at `z` (m, in the frame) relative to the frame, m/s.
    #[inline]
    pub fn at(&self, z: f64) -> Vec3 {
        Vec3::from(self.air.over_ground(self.height + z)) - self.frame
    }
}

/// The undisturbed air of a stage along the way of the frame.
#[derive(Clone, Debug)]
pub struct AirAlongFall {
    air: AirMotion,
    place: FramePlace,
    /// The frame falls in this stage while the structure moves.
    falls: bool,
    /// Something depends on the height.
    by_height: bool,
}

/// Place of the frame at the last accepted time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct FramePlace {
    /// Height of its origin above ground, m.
    height_m: f64,
}

const FILE: &str = "frame.bin";
const KIND: [u8; 8] = *b"ripframe";
const VERSION: u32 = 1;

impl AirAlongFall {
    /// Of `stage` of `scene`, after earlier stages that took `times` and left their state in the folder `before`.
    ///
    /// # Errors
    /// A state that cannot be read.
    pub fn new(
        scene: &Scene,
        stage: usize,
        times: &StageTimes,
        before: Option<&Path>,
    ) -> Result<Self, Fault> {
        let by_height = scene.shear().is_some() && scene.structure_meets_wind();
        let falls = scene.stages[stage].kind == StageKind::Coupled;
        let start = if falls { scene.release_height() } else { scene.shear().map(|s| s.start_height_m) };
        let mut this = Self {
            air: scene.air_motion(stage, times),
            place: FramePlace { height_m: start.unwrap_or(0.0) },
            falls,
            by_height,
        };
        let fell = |k: usize| scene.stages[k].kind == StageKind::Coupled;
        if let Some(folder) = before.filter(|_| (0..stage).any(fell)) {
            this.load(folder)?;
        }
        Ok(this)
    }

    /// The air at the end of the window `w`.
    pub fn at_end(&self, w: &Window) -> Stream {
        Stream::new(self.air.at(w.time + w.dt), self.height_at_end(w), w.frame_velocity.into())
    }

    /// Height of the frame's origin at the end of `w`, by the mean of its velocities at both ends, m.
    fn height_at_end(&self, w: &Window) -> f64 {
        let rise = (w.frame_velocity[2] - 0.5 * w.frame_acceleration[2] * w.dt) * w.dt;
        self.place.height_m + if self.falls { rise } else { 0.0 }
    }

    /// The window `w` is accepted.
    pub fn accept(&mut self, w: &Window) {
        self.place.height_m = self.height_at_end(w);
    }

    /// Writes the place of the frame where something depends on it; one rank does it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), Fault> {
        if !self.by_height {
            return Ok(());
        }
        archive::save(&folder.join(FILE), KIND, VERSION, &self.place).map(|_| ()).map_err(Fault::new)
    }

    /// Continues at the place that [`AirAlongFall::save`] wrote.
    ///
    /// # Errors
    /// The file is not there, or damaged.
    pub fn load(&mut self, folder: &Path) -> Result<(), Fault> {
        if !self.by_height {
            return Ok(());
        }
        let path = folder.join(FILE);
        let place: FramePlace = archive::load(&path, KIND, VERSION).map_err(Fault::new)?;
        if !place.height_m.is_finite() {
            let why = format!("the height of the frame is {}", place.height_m);
            return Err(Fault::new(archive::Error::content(&path, &why)));
        }
        self.place = place;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(profile: case::WindProfile, height_m: f64) -> AirAlongFall {
        let air = AirMotion::by_height(case::Wind::uniform([0.0; 3]), profile);
        AirAlongFall { air, place: FramePlace { height_m }, falls: true, by_height: true }
    }

    /// Free fall from rest: the height by the mean velocity of each window is exact, and survives a restart.
    #[test]
    fn height_of_a_frame_in_free_fall() {
        let profile = case::WindProfile::Linear { wind: [1.0, 0.0, 0.0], reference: 1.0, slope: 1.0 };
        let mut air = along(profile.clone(), 50.0);
        let (dt, g) = (0.1, 9.81);
        let window = |k: u32| Window {
            index: u64::from(k),
            time: f64::from(k) * dt,
            dt,
            frame_velocity: [0.0, 0.0, -g * dt * f64::from(k + 1)],
            frame_acceleration: [0.0, 0.0, -g],
            ..Window::default()
        };
        let folder = tempfile::tempdir().expect("a folder");
        for k in 0..20 {
            if k == 10 {
                air.save(folder.path()).expect("written");
                air = along(profile.clone(), 50.0);
                air.load(folder.path()).expect("read");
            }
            // A repeated window starts from the same height.
            let [once, again] = [0, 1].map(|_| air.at_end(&window(k)).at(2.0));
            assert_eq!(once, again);
            let fallen = 0.5 * g * (dt * f64::from(k + 1)).powi(2);
            assert!((once[0] - (52.0 - fallen)).abs() < 1e-12 * 50.0, "{k} {once:?}");
            assert!((once[2] - g * dt * f64::from(k + 1)).abs() < 1e-12);
            air.accept(&window(k));
        }
        air.falls = false;
        let before = air.place;
        air.accept(&window(20));
        assert_eq!(air.place, before);
    }
}
