//! A scene with its defaults filled in: the only place of these defaults.

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
    /// Velocity of the frame at the start, m/s; 0 without `[descent]`.
    pub initial_velocity_m_s: [f64; 3],
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
    /// The scene with all defaults filled in.
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
            initial_velocity_m_s: descent.map_or([0.0; 3], |d| {
                let [x, y] = d.initial_drift_m_s;
                [x, y, -d.initial_speed_m_s]
            }),
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
        Self { dynamic_viscosity_pa_s, turbulence: None, wall_treatment: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: &str = "name = \"still\"\n[canopy]\nkind = \"air-bag\"\n[fabric]\nyoungs_modulus_pa = 1e8\npoisson_ratio = 0.3\n\
                         thickness_m = 1e-4\ndensity_kg_m3 = 600\n[[stage]]\nname = \"on\"\nkind = \"pre-inflation\"\n\
                         pressure_pa = 10\nsolve = \"static\"\n";

    fn resolved(more: &str) -> Resolved {
        let file = std::path::Path::new("scene.toml");
        crate::parse(file, &format!("{STILL}{more}")).unwrap_or_else(|e| panic!("{e}")).resolved()
    }

    #[test]
    fn what_is_left_out_is_standard_air_and_gravity_without_speed_or_mass() {
        let r = resolved("");
        assert_eq!((r.air, r.canopy_air), (UndisturbedAir::SEA_LEVEL, CanopyAir::default()));
        assert_eq!((r.gravity_m_s2, r.initial_speed_m_s, r.payload_mass_kg), (9.80665, 0.0, 0.0));
        assert_eq!((r.wind_m_s, r.line_diameter_m), ([0.0; 3], 0.0));
    }

    /// Eddies that are resolved keep their energy; inviscid flow and a Reynolds average have none to keep.
    #[test]
    fn upwind_share_follows_the_equations() {
        let share = |flow: &str| resolved_flow(flow).upwind_share();
        assert_eq!(share("[flow]\n"), 1.0);
        assert_eq!(share("[flow.viscosity]\n"), 0.0);
        for (model, expected) in
            [("wale", 0.0), ("smagorinsky", 0.0), ("des97", 0.0), ("ddes", 0.0), ("spalart-allmaras", 1.0)]
        {
            let viscosity = format!("[flow.viscosity]\nturbulence = \"{model}\"\n");
            assert_eq!(share(&viscosity), expected, "{model}");
            assert_eq!(share(&format!("{viscosity}[flow.convection]\nupwind_share = 0.3\n")), 0.3, "{model}");
        }
    }

    fn resolved_flow(flow: &str) -> crate::Flow {
        let scene = crate::parse(std::path::Path::new("scene.toml"), &format!("{STILL}{flow}"));
        scene.unwrap_or_else(|e| panic!("{e}")).flow.expect("a flow")
    }

    #[test]
    fn what_is_given_is_taken() {
        let descent =
            "payload_mass_kg = 100\ninitial_speed_m_s = 4\ngravity_m_s2 = 1.6\nreference_area_m2 = 40\n";
        let lines = "[lines]\nyoungs_modulus_pa = 1e9\narea_m2 = 1e-6\ndensity_kg_m3 = 900\n";
        let flow = "[flow]\ndensity_kg_m3 = 0.02\ntemperature_k = 210\nwind_m_s = [1, 0, 0]\n";
        let r = resolved(&format!("[descent]\n{descent}{lines}{flow}"));
        assert_eq!(
            (r.air.density_kg_m3, r.air.temperature_k, r.canopy_air.density_kg_m3),
            (0.02, 210.0, 0.02)
        );
        assert_eq!(r.air.dynamic_viscosity_pa_s, UndisturbedAir::SEA_LEVEL.dynamic_viscosity_pa_s);
        assert!((r.canopy_air.sound_m_s - (287.05f64 * 210.0).sqrt()).abs() < 1e-12);
        assert_eq!((r.gravity_m_s2, r.initial_speed_m_s, r.payload_mass_kg), (1.6, 4.0, 100.0));
        assert!((r.line_diameter_m - 1.1283792e-3).abs() < 1e-9 && r.wind_m_s == [1.0, 0.0, 0.0]);
        let r = resolved(&format!("{lines}[lines.drag]\ndiameter_m = 0.02\n{flow}"));
        assert_eq!(r.line_diameter_m, 0.02);
    }
}
