//! Library of parachute fabrics, lines, tapes and webbings: `material` of `[fabric]`, `[lines]`, `[risers]` and the tables of `[tapes]`.
//!
//! An entry gives the keys of its section that a scene leaves out. They are added to the TOML document before it is read, so that
//! programs see a scene with all its numbers; keys that the scene gives have priority. Each value has a basis and a source, and the
//! page `docs/reference/materials.md` states both.

mod fabrics;
mod fill;
mod lines;
mod risers;
mod sources;
mod tapes;

pub use fabrics::FabricMaterial;
pub(crate) use fill::{fill, needed, required_without_material};
pub use lines::LineMaterial;
pub use risers::RiserMaterial;
pub use sources::{Basis, Source};
pub use tapes::TapeMaterial;

/// Ounce for each square yard, kg/m2.
const OZ_YD2: f64 = 0.028_349_523_125 / 0.836_127_36;
/// Pound of force, N.
const LB: f64 = 4.448_221_615_260_5;
/// Pound of force for each inch, N/m.
const LB_IN: f64 = LB / 0.0254;
/// Ounce for each yard, kg/m.
const OZ_YD: f64 = 0.028_349_523_125 / 0.9144;
/// Linear density of a line of one foot for each pound, kg/m.
const LB_FT: f64 = 0.453_592_37 / 0.3048;

/// A published figure.
#[derive(Clone, Copy, Debug)]
struct Published {
    figure: f64,
    basis: Basis,
    source: Source,
}

const fn published(figure: f64, basis: Basis, source: Source) -> Published {
    Published { figure, basis, source }
}

/// The value of a key that an entry gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// Key in the section, such as `thickness_m` or `permeability.cfm_per_ft2`.
    pub key: &'static str,
    /// The value, in the unit of the key.
    pub value: f64,
    /// How it follows from the source.
    pub basis: Basis,
    /// The published figure with its unit; empty where the value follows from others.
    pub figure: String,
    /// Where the figure comes from; `None` where the value follows from others.
    pub source: Option<Source>,
}

impl Value {
    fn of(key: &'static str, value: f64, figure: String, from: &Published) -> Self {
        Self { key, value: four_digits(value), basis: from.basis, figure, source: Some(from.source) }
    }

    /// A value of the paper.
    fn of_paper(key: &'static str, value: f64) -> Self {
        Self { key, value, basis: Basis::Paper, figure: String::new(), source: Some(Source::Paper) }
    }

    /// The secant modulus (Pa) of a stress at break (Pa) and the elongation there (%).
    fn secant_modulus(stress: f64, elongation: &Published) -> Self {
        let modulus = stress / (0.01 * elongation.figure);
        let figure = format!("{} % at break", elongation.figure);
        Self { basis: Basis::Secant, ..Self::of("youngs_modulus_pa", modulus, figure, elongation) }
    }

    fn follows(key: &'static str, value: f64, basis: Basis) -> Self {
        Self { key, value: four_digits(value), basis, figure: String::new(), source: None }
    }
}

/// A fabric, line or tape of the library.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Name in a scene.
    pub name: &'static str,
    /// What it is.
    pub title: &'static str,
    /// The values that it gives.
    pub values: Vec<Value>,
    /// What to know about the values; may be empty.
    pub note: &'static str,
}

impl Entry {
    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<f64> {
        self.values.iter().find(|v| v.key == key).map(|v| v.value)
    }
}

/// The value with four significant digits.
fn four_digits(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}
