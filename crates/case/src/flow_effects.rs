//! Effects of the flow beyond its basic equations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Flow;

/// Specific gas constant of dry air, J/(kg K).
pub const GAS_CONSTANT: f64 = 287.05;
/// Ratio of its specific heats.
pub const HEAT_RATIO: f64 = 1.4;

impl Flow {
    /// Speed of sound in the undisturbed air as the scene's equations have it, m/s: isothermal without the
    /// energy equation.
    pub fn sound_speed(&self) -> f64 {
        let ratio = if self.energy.is_some() { HEAT_RATIO } else { 1.0 };
        (ratio * GAS_CONSTANT * self.temperature_k).sqrt()
    }
}

/// Fabric that lets air through: the pressure jump is `a v + b v |v|` for air that passes at
/// `v` relative to the fabric. Either a cloth by name or both coefficients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Permeability {
    /// A common cloth.
    pub cloth: Option<Cloth>,
    /// Viscous coefficient `a`, Pa s/m.
    pub viscous_pa_s_m: Option<f64>,
    /// Inertial coefficient `b`, Pa s2/m2.
    pub inertial_pa_s2_m2: Option<f64>,
}

/// Cloths of parachutes with their permeability at sea level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cloth {
    /// MIL-C-7020 type III, nylon rip-stop of 1.1 oz/yd2: a = 254 Pa s/m, b = 37.6 Pa s2/m2,
    /// a fit to measurements (weak at low pressure).
    MilC7020Type3,
    /// MIL-C-44378, calendered nylon of low porosity: a = 8170 Pa s/m, b = 0, from its limit
    /// of 3 cubic feet a minute through a square foot at half an inch of water
    /// (0.01524 m/s at 124.5 Pa).
    MilC44378,
}

impl Cloth {
    /// All of them.
    pub const ALL: [Cloth; 2] = [Cloth::MilC7020Type3, Cloth::MilC44378];

    /// Name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Cloth::MilC7020Type3 => "mil-c7020-type3",
            Cloth::MilC44378 => "mil-c44378",
        }
    }
}

impl Permeability {
    /// Viscous (Pa s/m) and inertial (Pa s2/m2) coefficients; one that is not given is zero.
    pub fn coefficients(&self) -> (f64, f64) {
        match self.cloth {
            Some(Cloth::MilC7020Type3) => (254.0, 37.6),
            Some(Cloth::MilC44378) => (8170.0, 0.0),
            None => (self.viscous_pa_s_m.unwrap_or(0.0), self.inertial_pa_s2_m2.unwrap_or(0.0)),
        }
    }
}

/// Wind that changes with height above ground. But for a table, the wind at each height is
/// `wind_m_s` times a factor that is 1 at `reference_height_m`. It holds in all stages: `[stage.wind]` beside it is
/// refused; a gust adds the same to the wind at all heights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shear {
    /// Height above ground of the origin of the falling frame when the first flow stage
    /// begins, m. It sinks as the frame falls.
    pub start_height_m: f64,
    /// The profile.
    pub profile: ShearProfile,
    /// Height at which the wind is `wind_m_s`, m.
    #[serde(default = "ten_metres")]
    pub reference_height_m: f64,
    /// Exponent of the power law.
    #[serde(default = "one_seventh")]
    pub exponent: f64,
    /// Roughness length of the logarithmic law, m.
    #[serde(default = "grass")]
    pub roughness_m: f64,
    /// Change of the factor with height of the linear law, 1/m.
    #[serde(default)]
    pub slope_per_m: f64,
    /// Ascending heights of the table, m.
    #[serde(default)]
    pub height_m: Vec<f64>,
    /// Wind at each height of the table, m/s; linear in between, constant beyond.
    #[serde(default)]
    pub table_m_s: Vec<[f64; 3]>,
}

fn ten_metres() -> f64 {
    10.0
}
fn one_seventh() -> f64 {
    1.0 / 7.0
}
fn grass() -> f64 {
    0.03
}

/// How the wind grows with height.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ShearProfile {
    /// `(z / reference)^exponent`.
    Power,
    /// `ln(z / roughness) / ln(reference / roughness)`.
    Log,
    /// `1 + slope (z - reference)`.
    Linear,
    /// From `height_m` and `table_m_s`.
    Table,
}

/// A flow-only stage that marches to a steady state instead of through time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Steady {
    /// The state is steady once the residual of the steady equations has fallen by this
    /// factor.
    pub residual_drop: f64,
    /// Or once the force on the canopy has changed by less than this share of itself over
    /// the last ten steps.
    pub force_change: f64,
    /// Steps at most; a flow that is not steady by then ends the run.
    pub max_steps: u32,
    /// Courant number of a cell of mean size in the last, longest steps.
    pub max_courant: f64,
}

impl Default for Steady {
    fn default() -> Self {
        Self { residual_drop: 1e-4, force_change: 1e-5, max_steps: 500, max_courant: 1e3 }
    }
}
