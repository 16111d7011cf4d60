//! Tapes and webbings of the library.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Basis::{Estimate, Secant, SpecifiedMaximum, SpecifiedMinimum};
use super::{Entry, LB, OZ_YD, Published, Source, Value, published};

/// Tapes and webbings of the library, with sources in the reference of materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TapeMaterial {
    /// MIL-T-5038 / PIA-T-5038 type III: nylon tape of 1/2 inch, 250 lb.
    #[serde(rename = "pia-t5038-type3-half-inch")]
    PiaT5038Type3HalfInch,
    /// MIL-T-5038 / PIA-T-5038 type III: nylon tape of 1 inch, 525 lb.
    #[serde(rename = "pia-t5038-type3-inch")]
    PiaT5038Type3Inch,
    /// MIL-T-5038 / PIA-T-5038 type IV: nylon webbing of 1 inch, 1000 lb.
    #[serde(rename = "pia-t5038-type4-inch")]
    PiaT5038Type4Inch,
    /// MIL-T-8363 type I: nylon tape of 350 lb.
    #[serde(rename = "mil-t8363-type1")]
    MilT8363Type1,
    /// MIL-T-8363 type III: nylon webbing of 400 lb.
    #[serde(rename = "mil-t8363-type3")]
    MilT8363Type3,
    /// MIL-T-8363 type V: nylon webbing of 1000 lb.
    #[serde(rename = "mil-t8363-type5")]
    MilT8363Type5,
    /// MIL-T-8363 type IV: nylon webbing of 2600 lb.
    #[serde(rename = "mil-t8363-type4")]
    MilT8363Type4,
    /// MIL-W-4088 / PIA-W-4088 type VIII: nylon webbing of 1 23/32 inches, 4000 lb.
    #[serde(rename = "pia-w4088-type8")]
    PiaW4088Type8,
    /// PIA-W-1100 type XVII: nylon webbing of 1 inch with tubular edges, 2500 lb.
    #[serde(rename = "pia-w1100-type17")]
    PiaW1100Type17,
    /// PIA-W-1100 type VII: nylon webbing of 1 23/32 inches with tubular edges, 6000 lb.
    #[serde(rename = "pia-w1100-type7")]
    PiaW1100Type7,
    /// PIA-W-1100 type XIII: nylon webbing of 1 23/32 inches with tubular edges, 7000 lb.
    #[serde(rename = "pia-w1100-type13")]
    PiaW1100Type13,
}

/// What is published about a tape.
struct Band {
    material: TapeMaterial,
    title: &'static str,
    /// Strength, lb.
    lb: Published,
    /// Weight, ounces for each yard; `None`: estimated by [`SPECIFIC`].
    oz_yd: Option<Published>,
}

/// Elongation at break of nylon, %.
const NYLON_20: Published = published(20.0, SpecifiedMinimum, Source::Mit);
/// Strength of nylon webbing for each linear density: 7000 lb at 2.90 oz/yd, N/tex.
const SPECIFIC: Published = published(0.346, Estimate, Source::Memory);

const fn band(material: TapeMaterial, title: &'static str, lb: f64, source: Source) -> Band {
    Band { material, title, lb: published(lb, SpecifiedMinimum, source), oz_yd: None }
}

/// The tapes and webbings.
const BANDS: &[Band] = &[
    band(
        TapeMaterial::PiaT5038Type3HalfInch,
        "nylon tape of 1/2 inch, MIL-T-5038 / PIA-T-5038 type III",
        250.0,
        Source::Memory,
    ),
    band(
        TapeMaterial::PiaT5038Type3Inch,
        "nylon tape of 1 inch, MIL-T-5038 / PIA-T-5038 type III",
        525.0,
        Source::Memory,
    ),
    band(
        TapeMaterial::PiaT5038Type4Inch,
        "nylon webbing of 1 inch, MIL-T-5038 / PIA-T-5038 type IV",
        1000.0,
        Source::Memory,
    ),
    band(TapeMaterial::MilT8363Type1, "nylon tape, MIL-T-8363 type I", 350.0, Source::MilT8363b),
    band(TapeMaterial::MilT8363Type3, "nylon webbing, MIL-T-8363 type III", 400.0, Source::MilT8363b),
    band(TapeMaterial::MilT8363Type5, "nylon webbing, MIL-T-8363 type V", 1000.0, Source::MilT8363b),
    band(TapeMaterial::MilT8363Type4, "nylon webbing, MIL-T-8363 type IV", 2600.0, Source::MilT8363b),
    Band {
        oz_yd: Some(published(1.62, SpecifiedMaximum, Source::Memory)),
        ..band(
            TapeMaterial::PiaW4088Type8,
            "nylon webbing of 1 23/32 inches, MIL-W-4088 / PIA-W-4088 type VIII",
            4000.0,
            Source::Memory,
        )
    },
    band(
        TapeMaterial::PiaW1100Type17,
        "nylon webbing of 1 inch with tubular edges, PIA-W-1100 type XVII",
        2500.0,
        Source::PiaW1100a,
    ),
    band(
        TapeMaterial::PiaW1100Type7,
        "nylon webbing of 1 23/32 inches with tubular edges, PIA-W-1100 type VII",
        6000.0,
        Source::PiaW1100a,
    ),
    band(
        TapeMaterial::PiaW1100Type13,
        "nylon webbing of 1 23/32 inches with tubular edges, PIA-W-1100 type XIII",
        7000.0,
        Source::PiaW1100a,
    ),
];

impl TapeMaterial {
    /// All of them, in the order of the page.
    pub const ALL: [TapeMaterial; 11] = [
        TapeMaterial::PiaT5038Type3HalfInch,
        TapeMaterial::PiaT5038Type3Inch,
        TapeMaterial::PiaT5038Type4Inch,
        TapeMaterial::MilT8363Type1,
        TapeMaterial::MilT8363Type3,
        TapeMaterial::MilT8363Type5,
        TapeMaterial::MilT8363Type4,
        TapeMaterial::PiaW4088Type8,
        TapeMaterial::PiaW1100Type17,
        TapeMaterial::PiaW1100Type7,
        TapeMaterial::PiaW1100Type13,
    ];

    /// Name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            TapeMaterial::PiaT5038Type3HalfInch => "pia-t5038-type3-half-inch",
            TapeMaterial::PiaT5038Type3Inch => "pia-t5038-type3-inch",
            TapeMaterial::PiaT5038Type4Inch => "pia-t5038-type4-inch",
            TapeMaterial::MilT8363Type1 => "mil-t8363-type1",
            TapeMaterial::MilT8363Type3 => "mil-t8363-type3",
            TapeMaterial::MilT8363Type5 => "mil-t8363-type5",
            TapeMaterial::MilT8363Type4 => "mil-t8363-type4",
            TapeMaterial::PiaW4088Type8 => "pia-w4088-type8",
            TapeMaterial::PiaW1100Type17 => "pia-w1100-type17",
            TapeMaterial::PiaW1100Type7 => "pia-w1100-type7",
            TapeMaterial::PiaW1100Type13 => "pia-w1100-type13",
        }
    }

    /// What the library gives: keys of `[risers]`, of which a table of `[tapes]` takes stiffness and mass.
    pub fn entry(self) -> Entry {
        let none = Entry { name: self.name(), title: "", values: Vec::new(), note: "" };
        BANDS.iter().find(|b| b.material == self).map_or(none, Band::entry)
    }
}

impl Band {
    fn entry(&self) -> Entry {
        let strength = self.lb.figure * LB;
        let (mass, note) = match &self.oz_yd {
            Some(p) => (Value::of("mass_kg_m", p.figure * OZ_YD, format!("{} oz/yd", p.figure), p), ""),
            None => {
                let (kg_m, figure) =
                    (1e-6 * strength / SPECIFIC.figure, format!("{} N/tex", SPECIFIC.figure));
                let note = "The weight is estimated from the strength, by the strength to weight of webbing of 7000 lb and 2.90 oz/yd.";
                (Value::of("mass_kg_m", kg_m, figure, &SPECIFIC), note)
            }
        };
        let stiffness = strength / (0.01 * NYLON_20.figure);
        let broken = format!("{} % at break", NYLON_20.figure);
        let values = vec![
            mass,
            Value::of("strength_n", strength, format!("{} lb", self.lb.figure), &self.lb),
            Value { basis: Secant, ..Value::of("axial_stiffness_n", stiffness, broken, &NYLON_20) },
        ];
        Entry { name: self.material.name(), title: self.title, values, note }
    }
}
