//! The International Standard Atmosphere (ISO 2533).

/// Acceleration of gravity (m/s2) and gas constant (J/(kg K)) of the standard.
const GRAVITY: f64 = 9.80665;
const GAS_CONSTANT: f64 = 287.05287;
/// Temperature (K) and pressure (Pa) at sea level, lapse rate of the troposphere (K/m), altitude of its end (m).
const SEA_LEVEL: [f64; 2] = [288.15, 101_325.0];
const LAPSE: f64 = 6.5e-3;
const TROPOPAUSE: f64 = 11_000.0;

/// Geopotential altitudes of the two lowest layers of the standard, m.
pub const ALTITUDES: std::ops::RangeInclusive<f64> = -2_000.0..=20_000.0;

/// Air of the standard atmosphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandardAir {
    /// Temperature, K.
    pub temperature_k: f64,
    /// Pressure, Pa.
    pub pressure_pa: f64,
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Dynamic viscosity by Sutherland's formula, Pa s.
    pub dynamic_viscosity_pa_s: f64,
}

impl StandardAir {
    /// At a geopotential `altitude` (m) within [`ALTITUDES`].
    ///
    /// # Examples
    ///
    /// ```
    /// let air = case::StandardAir::at(5_000.0);
    /// assert!((air.density_kg_m3 - 0.73612).abs() < 1e-5);
    /// ```
    pub fn at(altitude: f64) -> Self {
        let [warm, ground] = SEA_LEVEL;
        let temperature = |h: f64| warm - LAPSE * h.min(TROPOPAUSE);
        let t = temperature(altitude);
        let below = ground * (t / warm).powf(GRAVITY / (LAPSE * GAS_CONSTANT));
        let above = (altitude - TROPOPAUSE).max(0.0);
        let pressure = below * (-GRAVITY * above / (GAS_CONSTANT * t)).exp();
        Self {
            temperature_k: t,
            pressure_pa: pressure,
            density_kg_m3: pressure / (GAS_CONSTANT * t),
            dynamic_viscosity_pa_s: 1.458e-6 * t * t.sqrt() / (t + 110.4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ISO 2533, table 1: geopotential altitude, temperature, pressure, density; viscosity of the U.S. Standard Atmosphere 1976.
    #[test]
    fn air_is_that_of_the_tables() {
        for (altitude, t, p, density, viscosity) in [
            (0.0, 288.15, 101_325.0, 1.225, 1.7894e-5),
            (1_000.0, 281.65, 89_874.6, 1.11164, 1.7578e-5),
            (5_000.0, 255.65, 54_019.9, 0.736116, 1.6280e-5),
            (11_000.0, 216.65, 22_632.1, 0.363918, 1.4216e-5),
            (20_000.0, 216.65, 5_474.89, 0.0880349, 1.4216e-5),
        ] {
            let air = StandardAir::at(altitude);
            let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-4;
            assert!(near(air.temperature_k, t) && near(air.pressure_pa, p), "{altitude}: {air:?}");
            assert!(near(air.density_kg_m3, density), "{altitude}: {air:?}");
            assert!(near(air.dynamic_viscosity_pa_s, viscosity), "{altitude}: {air:?}");
        }
    }
}
