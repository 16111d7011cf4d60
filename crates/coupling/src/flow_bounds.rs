//! Bounds on speeds and pressures of the flow; beyond them a result is unphysical.
//!
//! $`W`$ is the sum of the largest speed of the undisturbed air past the canopy and of the largest speed of the
//! canopy's own motion so far in the stage; $`P`$ is the largest pressure that the scene applies or that carries the
//! weight. Inlets, outlets and walls with data of their own, and bodies that move, count in $`W`$ and $`P`$, their grid in $`L`$. Air reaches at most a few times
//! ```math
//! W + \sqrt{2P/\rho}
//! ```
//! (a sharp edge raises the speed of a stream by a factor of two to three on any grid; a jet out of a slit has
//! $`\sqrt{2P/\rho}`$), and its gauge pressure at most a few times
//! ```math
//! \tfrac12\rho W^2 + \rho W \min(c, L/\Delta t) + P
//! ```
//! from stagnation and from walls of size $`L`$ that change their speed by $`W`$ within a window, limited by acoustics
//! (the pressure of a piston, $`\rho c W`$). A result above ten times these estimates ends the stage with an error.
//! Slower growth is detected by the energy balances of structure and interface.

use case::{Role, Scene};
use channel::{STATS, flow_stats as stat, reported_place};
use serde::{Deserialize, Serialize};

use crate::boundary_drive::BoundaryDrive;
pub use crate::impossible_flow::ImpossibleFlow;
use crate::interface::CanopyInterface;

/// Accepted multiple of the estimates.
const FACTOR: f64 = 10.0;
/// Mach number below which speeds are not judged: still air contains only noise.
const LEAST_MACH: f64 = 1e-3;

/// Bounds on the flow of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlowBounds {
    /// Largest speed of the canopy in the frame so far, m/s.
    canopy: f64,
    /// Largest speed of the undisturbed air in the frame so far, or of an inlet or wall with data, m/s.
    stream: f64,
    density: f64,
    sound: f64,
    /// Largest pressure that the scene applies, or that carries the weight, Pa.
    pressure: f64,
    /// Size of the canopy, or of a grid that boundary data drive, m.
    size: f64,
}

impl FlowBounds {
    /// At the start of a stage; `None` for a scene without a flow.
    pub fn new(scene: &Scene, interface: &CanopyInterface) -> Option<Self> {
        let flow = scene.flow.as_ref()?;
        let extent = |c: usize| {
            let along = interface.coords.iter().map(|x| x[c]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        let size = (0..3).map(extent).fold(0.0, f64::max);
        let applied = scene.stages.iter().filter_map(|s| s.pressure_pa).fold(0.0, |m: f64, p| m.max(p.abs()));
        let weight = scene.descent.as_ref().map_or(0.0, |d| {
            let mass = d.payload_mass_kg + interface.masses.fabric + interface.masses.cables;
            mass * d.gravity_m_s2 / d.reference_area_m2
        });
        let drive = BoundaryDrive::new(scene).unwrap_or(BoundaryDrive { speed: 0.0, pressure: 0.0, size });
        Some(Self {
            canopy: 0.0,
            stream: drive.speed,
            density: flow.density_kg_m3,
            sound: flow.sound_speed(),
            pressure: applied + weight + drive.pressure,
            size: size.max(drive.size),
        })
    }

    /// Largest speed of stream and canopy so far, m/s.
    pub fn speed(&self) -> f64 {
        self.stream + self.canopy
    }

    /// Adds a window of length `dt` (s) with the velocity of the undisturbed air in the frame (m/s) at its end and
    /// the displacements (m) at both ends; then checks the statistics of its flow.
    ///
    /// # Errors
    /// [`ImpossibleFlow`].
    pub fn check(
        &mut self,
        dt: f64,
        air: [f64; 3],
        [before, after]: [&[f64]; 2],
        values: &[f64; STATS],
    ) -> Result<(), ImpossibleFlow> {
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        self.stream = self.stream.max(norm(&air));
        let moved = |(a, b): (&[f64], &[f64])| norm(&[b[0] - a[0], b[1] - a[1], b[2] - a[2]]) / dt;
        self.canopy =
            before.chunks_exact(3).zip(after.chunks_exact(3)).map(moved).fold(self.canopy, f64::max);
        let speed = self.speed();
        let [possible_speed, possible_pressure] = self.possible(dt);
        let error = |what, unit, found, possible, index| {
            let at = reported_place(values, index);
            Err(ImpossibleFlow {
                what,
                unit,
                found,
                at,
                possible,
                speed_m_s: speed,
                pressure_pa: self.pressure,
            })
        };
        let found = values[stat::MAX_MACH] * self.sound;
        // NaN is beyond any limit.
        let beyond = |limit: f64, found: f64| found > limit || found.is_nan();
        if beyond(FACTOR * possible_speed + LEAST_MACH * self.sound, found) {
            return error("speed", "m/s", found, possible_speed, stat::MAX_MACH_AT);
        }
        let (high, low) = (values[stat::MAX_PRESSURE].abs(), values[stat::MIN_PRESSURE].abs());
        let found = if high > low { high } else { low };
        // Acoustic pressure at the Mach number below which speeds are not judged.
        let floor = LEAST_MACH * self.density * self.sound * self.sound;
        if beyond(FACTOR * possible_pressure + floor, found) {
            return error("gauge pressure", "Pa", found, possible_pressure, stat::EXTREME_PRESSURE_AT);
        }
        Ok(())
    }

    /// Largest speed (m/s) and gauge pressure (Pa) that the motion so far can cause in a window of `dt` seconds.
    fn possible(&self, dt: f64) -> [f64; 2] {
        let speed = self.speed();
        let jet = (2.0 * self.pressure / self.density).sqrt();
        let inertia = self.density * speed * self.sound.min(self.size / dt);
        [speed + jet, 0.5 * self.density * speed * speed + inertia + self.pressure]
    }
}

/// Velocity of the undisturbed air in the falling frame at time `t` (s) of a stage, m/s.
pub fn undisturbed_air(wind: &case::Wind, t: f64, frame_velocity: [f64; 3]) -> [f64; 3] {
    let wind = wind.at(t);
    std::array::from_fn(|i| wind[i] - frame_velocity[i])
}

/// Statistics of the flow in a window.
pub fn flow_statistics(stats: &[channel::Stats; 3]) -> &[f64; STATS] {
    &stats[Role::Flow as usize].values
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The square canopy of 2 m at 4 m/s under 12 Pa.
    fn bounds() -> FlowBounds {
        FlowBounds { canopy: 0.0, stream: 0.0, density: 1.225, sound: 290.0, pressure: 24.0, size: 2.0 }
    }

    fn flow(speed: f64, pressure: f64) -> [f64; STATS] {
        let mut v = [0.0; STATS];
        (v[stat::MAX_MACH], v[stat::MAX_PRESSURE], v[stat::MIN_PRESSURE]) = (speed / 290.0, 5.0, -pressure);
        v
    }

    #[test]
    fn measured_flows_pass_and_unphysical_flows_fail() {
        let still = [0.0; 3];
        let check = |v: [f64; STATS]| bounds().check(5e-3, [0.0, 0.0, 4.0], [&still, &still], &v);
        // The largest of cases/hard at 4 m/s: an impulsive start (236 Pa), a snap (219 Pa), 7 m/s at the rim.
        assert_eq!(check(flow(7.05, 236.0)), Ok(()));
        let error = check(flow(200.0, 10.0)).expect_err("an impossible speed");
        assert_eq!(error.what, "speed");
        assert!(error.to_string().contains("coupling.scheme"), "{error}");
        assert_eq!(check(flow(5.0, 5e4)).expect_err("an impossible pressure").what, "gauge pressure");
        assert!(check(flow(f64::NAN, 10.0)).is_err());
    }

    #[test]
    fn errors_name_the_place_of_their_own_value() {
        let still = [0.0; 3];
        let message = |mut v: [f64; STATS]| {
            v[stat::MAX_MACH_AT..][..3].copy_from_slice(&[1.0, 2.0, 3.0]);
            v[stat::EXTREME_PRESSURE_AT..][..3].copy_from_slice(&[-1.0, 0.0, 0.5]);
            let error = bounds().check(5e-3, [0.0, 0.0, 4.0], [&still, &still], &v);
            error.expect_err("impossible").to_string()
        };
        let speed = message(flow(200.0, 10.0));
        assert!(speed.contains("speed of 2.000e2 m/s at (1.0000, 2.0000, 3.0000) m, "), "{speed}");
        let pressure = message(flow(5.0, 5e4));
        assert!(pressure.contains("5.000e4 Pa at (-1.0000, 0.0000, 0.5000) m, "), "{pressure}");
    }

    #[test]
    fn canopy_motion_raises_the_bounds_and_noise_in_still_air_passes() {
        let mut b = bounds();
        let (from, to) = ([0.0; 3], [0.0, 0.0, 0.05]);
        assert_eq!(b.check(5e-3, [0.0; 3], [&from, &to], &flow(150.0, 10.0)), Ok(()));
        // The largest motion so far counts: its pressure waves are still present.
        assert_eq!(b.check(5e-3, [0.0; 3], [&to, &to], &flow(150.0, 10.0)), Ok(()));
        let mut quiet = FlowBounds { pressure: 0.0, ..bounds() };
        assert_eq!(quiet.check(0.04, [0.0; 3], [&from, &from], &flow(0.1, 50.0)), Ok(()));
        assert!(quiet.check(0.04, [0.0; 3], [&from, &from], &flow(1.0, 0.0)).is_err());
    }
}
