//! A scene with what it leaves out filled in: the only place of these defaults.

use crate::{Lines, STANDARD_GRAVITY, Scene, Viscosity};

/// What programs compute with, whether the scene says it or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolved {
    /// Undisturbed air of `[flow]`; that at sea level where the scene has none.
    pub air: UndisturbedAir,
    /// Air that the fabric moves in: that of `[flow]`, and nothing where the scene has none.
    pub canopy_air: CanopyAir,
    /// Wind in the frame of the ground, m/s, where no stage and no gust changes it. Still air without `[flow]`.
    pub wind_m_s: [f64; 3],
    /// Acceleration of gravity, m/s2; the standard one without `[descent]`.
    pub gravity_m_s2: f64,
    /// Descent speed at the start, m/s, positive downwards; 0 without `[descent]`.
    pub initial_speed_m_s: f64,
    /// Mass of the payload, kg; 0 without `[descent]`.
    pub payload_mass_kg: f64,
    /// Diameter of lines across the air, m: `lines.drag.diameter_m`, or that of a round line; 0 without `[lines]`.
    pub line_diameter_m: f64,
}

/// Air far away from the canopy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UndisturbedAir {
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Temperature, K.
    pub temperature_k: f64,
    /// Dynamic viscosity, Pa s; that at sea level where the flow is inviscid.
    pub dynamic_viscosity_pa_s: f64,
}

/// Air that acts on the fabric as mass and pressure; zeros where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CanopyAir {
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Speed of sound by the scene's equations, m/s.
    pub sound_m_s: f64,
}

impl UndisturbedAir {
    /// International Standard Atmosphere at sea level (ISO 2533).
    pub const SEA_LEVEL: Self =
        Self { density_kg_m3: 1.225, temperature_k: 288.15, dynamic_viscosity_pa_s: 1.789e-5 };
}

impl Scene {
    /// The scene with what it leaves out filled in.
    pub fn resolved(&self) -> Resolved {
        let (flow, descent) = (self.flow.as_ref(), self.descent.as_ref());
        let viscosity = flow.and_then(|f| f.viscosity.clone()).unwrap_or_default();
        let at_sea_level = UndisturbedAir::SEA_LEVEL;
        Resolved {
            air: flow.map_or(at_sea_level, |f| UndisturbedAir {
                density_kg_m3: f.density_kg_m3,
                temperature_k: f.temperature_k,
                dynamic_viscosity_pa_s: viscosity.dynamic_viscosity_pa_s,
            }),
            canopy_air: flow.map_or_else(CanopyAir::default, |f| CanopyAir {
                density_kg_m3: f.density_kg_m3,
                sound_m_s: f.sound_speed(),
            }),
            wind_m_s: flow.map_or([0.0; 3], |f| f.wind_m_s),
            gravity_m_s2: descent.map_or(STANDARD_GRAVITY, |d| d.gravity_m_s2),
            initial_speed_m_s: descent.map_or(0.0, |d| d.initial_speed_m_s),
            payload_mass_kg: descent.map_or(0.0, |d| d.payload_mass_kg),
            line_diameter_m: self.lines.as_ref().map_or(0.0, Lines::diameter_m),
        }
    }
}

impl Lines {
    /// Diameter of a round line of this cross-section, m.
    pub fn round_diameter_m(&self) -> f64 {
        2.0 * (self.area_m2 / std::f64::consts::PI).sqrt()
    }

    /// Diameter across the air, m: the scene's, or that of a round line.
    pub fn diameter_m(&self) -> f64 {
        self.drag.as_ref().and_then(|d| d.diameter_m).unwrap_or_else(|| self.round_diameter_m())
    }
}

impl Default for Viscosity {
    /// Air at sea level, laminar.
    fn default() -> Self {
        let dynamic_viscosity_pa_s = UndisturbedAir::SEA_LEVEL.dynamic_viscosity_pa_s;
        Self { dynamic_viscosity_pa_s, turbulence: None }
    }
}
