//! Air in a closed volume under the canopy.
//!
//! Where no boundary sets the pressure under the canopy, it is what the air stores: with the volume $`V_c`$ in which it is enclosed it falls by
//! ```math
//! \Delta p = -K\, \Delta V, \qquad K = \rho c^2 / V_c
//! ```
//! where the canopy sweeps $`\Delta V`$. Against a light fabric that is a constraint: the added mass of the surrogate has no part of it, and the secants get it
//! shape by shape. The stiffness $`K`$ is found from the first response that is one pressure and far larger than that of added mass.
//!
//! A fluid that has to pass a narrow opening responds in the same way to motions within a window, by its inertia, but does not keep the pressure: its volume
//! changes from window to window without it ([`ClosedVolume::stores`]).

use channel::LOAD_WIDTH;
use serde::{Deserialize, Serialize};

use crate::geometry::{Vec3, at, distinct};
use crate::schemes::least_squares::norm;

/// Share of one pressure in a response that shows a closed volume. First responses have at least 0.999 of it in `closed-box` and `cavity`, up to 0.93 in the
/// open `channel`.
const ONE_PRESSURE: f64 = 0.99;
/// Change of the pressure over the load above which a response over a smaller change of the volume gives a better stiffness: below, the tolerance of the flow
/// is in it (2 % of the load: 1.1 to 3.1e5 Pa/m3 instead of 2.0e5 in `closed-box`).
const CLEAR: f64 = 0.1;

/// What is known of the volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClosedVolume {
    /// K, Pa/m3; 0: none is known.
    stiffness: f64,
    /// Change of the volume from which it was found, m3.
    found_over: f64,
    /// No window has shown that its pressure does not follow the volume.
    stores: bool,
}

/// What a response shows of the volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// Nothing new.
    Nothing,
    /// A better stiffness.
    Better,
    /// That it is closed.
    Closed,
}

impl ClosedVolume {
    /// K, Pa/m3; 0: none is known.
    pub fn stiffness(&self) -> f64 {
        self.stiffness
    }

    /// Whether the pressure follows the volume from window to window.
    pub fn stores(&self) -> bool {
        self.stores
    }

    /// Compares the change of the mean pressure `change` (Pa) over a window, in which the canopy swept `volume` (m3), with that of the volume, where that is clear against the
    /// size `load` (Pa) of the pressures.
    pub fn compare(&mut self, volume: f64, change: f64, load: f64) {
        let expected = self.pressure(volume);
        if expected.abs() > CLEAR * load {
            self.stores = (change - expected).abs() < 0.5 * expected.abs();
        }
    }

    /// Pressure of the volume grown by `volume` (m3), Pa.
    pub fn pressure(&self, volume: f64) -> f64 {
        -self.stiffness * volume
    }

    /// Takes K from loads `[faces][LOAD_WIDTH]` (Pa) that changed by `change` where the canopy swept `volume` (m3), a response that is far larger than that of added
    /// mass; `load`: norm of the loads.
    pub fn identify(&mut self, volume: f64, change: &[f64], load: f64) -> Finding {
        let faces = (change.len() / LOAD_WIDTH) as f64;
        let mean = change.iter().step_by(LOAD_WIDTH).sum::<f64>() / faces;
        let one_pressure = mean.abs() * faces.sqrt();
        let stiffness = -mean / volume;
        if !(one_pressure > ONE_PRESSURE * norm(change) && stiffness.is_finite() && stiffness > 0.0) {
            return Finding::Nothing;
        }
        let found =
            Self { stiffness, found_over: volume.abs(), stores: self.stores || self.stiffness == 0.0 };
        if self.stiffness == 0.0 {
            *self = found;
            return Finding::Closed;
        }
        if one_pressure > CLEAR * load && found.found_over < self.found_over {
            *self = found;
            return Finding::Better;
        }
        Finding::Nothing
    }
}

/// Volume (m3) that `faces` with the area vectors `areas` (m2) sweep under a `displacement` of the nodes, `[nodes][3]` (m), to first order.
pub fn swept(faces: &[[u32; 4]], areas: &[Vec3], displacement: &[f64]) -> f64 {
    let of = |(face, area): (&[u32; 4], &Vec3)| {
        let nodes = distinct(face);
        nodes.iter().map(|&n| at(displacement, n).dot(area)).sum::<f64>() / nodes.len() as f64
    };
    faces.iter().zip(areas).map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Loads of four faces with the pressures `p`.
    fn loads(p: [f64; 4]) -> Vec<f64> {
        p.iter().flat_map(|&p| [p, 0.0, 0.0, 0.0]).collect()
    }

    #[test]
    fn one_pressure_shows_a_closed_volume_and_a_smaller_clear_change_its_stiffness() {
        let mut air = ClosedVolume::default();
        let identify = |air: &mut ClosedVolume, volume, p| air.identify(volume, &loads(p), 2.0);
        assert_eq!(identify(&mut air, 1e-3, [-1.0, -0.5, -1.0, -1.0]), Finding::Nothing, "not one pressure");
        assert_eq!(identify(&mut air, 1e-3, [1.0; 4]), Finding::Nothing, "grows with the volume");
        assert_eq!(identify(&mut air, 0.0, [1.0; 4]), Finding::Nothing);
        assert_eq!((air.stiffness(), air.pressure(1.0)), (0.0, 0.0));
        assert_eq!(identify(&mut air, 1e-3, [-300.0; 4]), Finding::Closed);
        assert_eq!(identify(&mut air, 2e-3, [-900.0; 4]), Finding::Nothing, "a larger change");
        assert_eq!(
            identify(&mut air, -1e-6, [0.09; 4]),
            Finding::Nothing,
            "within the tolerance of the flow"
        );
        assert_eq!(identify(&mut air, -1e-5, [2.0, 2.01, 1.99, 2.0]), Finding::Better);
        assert!((air.stiffness() - 2e5).abs() < 1e-6 && (air.pressure(1e-4) + 20.0).abs() < 1e-9);
    }

    #[test]
    fn pressure_that_follows_the_volume_over_a_window_is_stored() {
        let mut air = ClosedVolume::default();
        air.compare(1e-5, -2.0, 2.0);
        assert!(!air.stores(), "nothing is known");
        air.identify(-1e-5, &loads([2.0; 4]), 2.0);
        assert!(air.stores(), "until a window shows that it does not");
        for (volume, change, stores) in [
            (1e-5, -2.0, true),
            (1e-5, -0.9, false),
            (1e-6, -0.11, false), // expected: a tenth of the load
            (1e-5, -2.9, true),
            (0.9e-6, 2.0, true),
            (1e-4, -2.0, false),
        ] {
            air.compare(volume, change, 2.0);
            assert_eq!(air.stores(), stores, "{volume} {change}");
        }
    }
}
