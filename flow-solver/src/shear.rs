//! Wind that changes with height above ground.
//!
//! The far field brings each face the wind at its height. The frame sinks, so heights follow
//! from the position of a face in the frame and the height of the frame's origin, which is
//! integrated from the frame's velocity as the grid fluxes are.

use crate::geometry::Metrics;
use crate::geometry::vec3::Vec3;
use crate::topology::Topology;

pub use case::WindProfile as Profile;

/// A profile and where the falling frame is in it.
#[derive(Clone, Debug)]
pub struct WindShear {
    profile: Profile,
    /// Height of the frame's origin at the last accepted time level, m.
    pub height: f64,
    /// Height at the end of the step, m.
    next: f64,
    /// Wind at the frame's origin at the start, m/s: what the profile is measured from.
    base: Vec3,
}

impl WindShear {
    /// A frame whose origin starts at `height`.
    pub fn new(profile: Profile, height: f64) -> Self {
        Self { base: profile.at(height).into(), profile, height, next: height }
    }

    /// The wind shear of a scene; `wind` is its wind at the reference height.
    pub fn of_scene(s: &case::Shear, wind: Vec3) -> Self {
        Self::new(s.profile_of(wind.into()), s.start_height_m)
    }

    /// Wind at the start at the frame's origin, m/s. It is the value of [`crate::Settings::wind`].
    pub fn base(&self) -> Vec3 {
        self.base
    }

    /// Difference of the wind at `z` (m, in the frame, at the last accepted time level) from the base wind, m/s.
    pub fn excess(&self, z: f64) -> Vec3 {
        Vec3::from(self.profile.at(self.height + z)) - self.base
    }

    /// The frame moves upwards by `rise` (m) in the coming step: fills what the wind has more
    /// than the base on all faces that are not between two cells.
    pub fn advance(&mut self, rise: f64, topology: &Topology, metrics: &Metrics, excess: &mut [Vec3]) {
        self.next = self.height + rise;
        for (e, f) in excess.iter_mut().zip(topology.cells.len() as u32..) {
            *e = Vec3::from(self.profile.at(self.next + metrics.border(f).z)) - self.base;
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
