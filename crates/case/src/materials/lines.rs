//! Lines of the library.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Basis::{Estimate, SpecifiedMaximum, SpecifiedMinimum, Typical};
use super::{Entry, LB, LB_FT, Published, Source, Value, four_digits, published};

/// Lines of the library, with sources in the reference of materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LineMaterial {
    /// MIL-C-5040 / PIA-C-5040 type I: nylon cord of 95 lb.
    #[serde(rename = "pia-c5040-type1")]
    PiaC5040Type1,
    /// MIL-C-5040 / PIA-C-5040 type IIA: nylon cord without core, 225 lb.
    #[serde(rename = "pia-c5040-type2a")]
    PiaC5040Type2a,
    /// MIL-C-5040 / PIA-C-5040 type II: nylon cord of 400 lb.
    #[serde(rename = "pia-c5040-type2")]
    PiaC5040Type2,
    /// MIL-C-5040 / PIA-C-5040 type III: nylon cord of 550 lb ("550 paracord").
    #[serde(rename = "pia-c5040-type3")]
    PiaC5040Type3,
    /// Nylon cord without core in the style of MIL-C-7515, 400 lb.
    #[serde(rename = "nylon-coreless-400")]
    NylonCoreless400,
    /// Polyester (Dacron) cord without core, PIA-C-2754 type I, 600 lb.
    #[serde(rename = "dacron-600")]
    Dacron600,
    /// Spectra (Dyneema) line of 400 lb.
    #[serde(rename = "spectra-400")]
    Spectra400,
    /// PIA-C-1200 type IIA: Spectra (Dyneema) cord without core, 600 lb.
    #[serde(rename = "pia-c1200-type2a")]
    PiaC1200Type2a,
    /// Spectra (Dyneema) line of 525 lb.
    #[serde(rename = "spectra-525")]
    Spectra525,
    /// Spectra (Dyneema) line of 725 lb.
    #[serde(rename = "spectra-725")]
    Spectra725,
    /// Spectra (Dyneema) line of 825 lb.
    #[serde(rename = "spectra-825")]
    Spectra825,
    /// Vectran line of 750 lb.
    #[serde(rename = "vectran-750")]
    Vectran750,
    /// Kevlar cord of 1000 lb, in the style of MIL-C-87129.
    #[serde(rename = "kevlar-1000")]
    Kevlar1000,
    /// Lines of the paper's ATPS.
    #[serde(rename = "atps-paper")]
    AtpsPaper,
}

/// What is published about a cord.
struct Cord {
    material: LineMaterial,
    title: &'static str,
    /// Strength, lb.
    lb: Published,
    /// Elongation at break, %.
    elongation: Published,
    weight: Weight,
    /// Density of the fibre, kg/m3.
    density: f64,
    note: &'static str,
}

/// What is published about its weight.
enum Weight {
    /// Feet for each pound.
    FeetPerPound(Published),
    /// Linear density, g/m.
    Linear(Published),
    /// Estimated from a strength for each linear density, N/tex = MN m/kg.
    Specific(Published),
}

/// Elongation of cords of MIL-C-5040, %.
const NYLON_30: Published = published(30.0, SpecifiedMinimum, Source::Paracord);
/// Elongation of polyethylene fibre at break, %.
const POLYETHYLENE: Published = published(3.5, Typical, Source::Teijin);
/// Strength of Spectra braid for each linear density: 400 lb at 1.203 g/m, N/tex.
const SPECTRA_BRAID: Published = published(1.479, Estimate, Source::FruityChutes);
/// Share of the strength of yarn that the braid of [`SPECTRA_BRAID`] has: 2.65 N/tex for Spectra 900.
const BRAID: f64 = 1.479 / 2.65;

const ESTIMATED_WEIGHT: &str = "The weight is estimated from the strength, by the strength to weight of the 400 lb line. The modulus is that of straight \
     fibre; a braid is softer at first.";

/// The cords but those of the paper.
const CORDS: &[Cord] = &[
    Cord {
        material: LineMaterial::PiaC5040Type1,
        title: "nylon cord, MIL-C-5040 / PIA-C-5040 type I",
        lb: published(95.0, SpecifiedMinimum, Source::Memory),
        elongation: NYLON_30,
        weight: Weight::FeetPerPound(published(950.0, SpecifiedMaximum, Source::RocketMaterials)),
        density: 1140.0,
        note: "",
    },
    Cord {
        material: LineMaterial::PiaC5040Type2a,
        title: "nylon cord without core, MIL-C-5040 / PIA-C-5040 type IIA",
        lb: published(225.0, Typical, Source::Spherachutes),
        elongation: NYLON_30,
        weight: Weight::Linear(published(3.007, Typical, Source::Spherachutes)),
        density: 1140.0,
        note: "Elongation as that of type III.",
    },
    Cord {
        material: LineMaterial::PiaC5040Type2,
        title: "nylon cord, MIL-C-5040 / PIA-C-5040 type II",
        lb: published(400.0, SpecifiedMinimum, Source::Memory),
        elongation: NYLON_30,
        weight: Weight::FeetPerPound(published(265.0, SpecifiedMaximum, Source::Memory)),
        density: 1140.0,
        note: "Elongation as that of type III.",
    },
    Cord {
        material: LineMaterial::PiaC5040Type3,
        title: "nylon cord, MIL-C-5040 / PIA-C-5040 type III",
        lb: published(550.0, SpecifiedMinimum, Source::Paracord),
        elongation: NYLON_30,
        weight: Weight::FeetPerPound(published(225.0, SpecifiedMaximum, Source::Paracord)),
        density: 1140.0,
        note: "About 4 mm thick as braided: give `lines.drag.diameter_m` for the drag of lines.",
    },
    Cord {
        material: LineMaterial::NylonCoreless400,
        title: "nylon cord without core, in the style of MIL-C-7515 / PIA-C-7515",
        lb: published(400.0, Typical, Source::FruityChutes),
        elongation: NYLON_30,
        weight: Weight::Linear(published(3.718, Typical, Source::FruityChutes)),
        density: 1140.0,
        note: "The maker's type IIIa. Elongation as that of MIL-C-5040 type III; that of MIL-C-7515 was not found.",
    },
    Cord {
        material: LineMaterial::Dacron600,
        title: "polyester (Dacron) cord without core, PIA-C-2754 type I",
        lb: published(600.0, Typical, Source::Memory),
        elongation: published(15.0, Typical, Source::RopeFibres),
        weight: Weight::FeetPerPound(published(180.0, SpecifiedMaximum, Source::PiaC2754d)),
        density: 1380.0,
        note: "Smaller end of the elongations of polyester.",
    },
    Cord {
        material: LineMaterial::Spectra400,
        title: "Spectra (Dyneema) line",
        lb: published(400.0, Typical, Source::FruityChutes),
        elongation: POLYETHYLENE,
        weight: Weight::Linear(published(1.203, Typical, Source::FruityChutes)),
        density: 980.0,
        note: "The modulus is that of straight fibre; a braid is softer at first.",
    },
    Cord {
        material: LineMaterial::PiaC1200Type2a,
        title: "Spectra (Dyneema) cord without core, PIA-C-1200 type IIA",
        lb: published(600.0, SpecifiedMinimum, Source::PiaC1200),
        elongation: POLYETHYLENE,
        weight: Weight::Specific(SPECTRA_BRAID),
        density: 980.0,
        note: ESTIMATED_WEIGHT,
    },
    Cord {
        material: LineMaterial::Spectra525,
        title: "Spectra (Dyneema) line",
        lb: published(525.0, Typical, Source::Memory),
        elongation: POLYETHYLENE,
        weight: Weight::Specific(SPECTRA_BRAID),
        density: 980.0,
        note: ESTIMATED_WEIGHT,
    },
    Cord {
        material: LineMaterial::Spectra725,
        title: "Spectra (Dyneema) line",
        lb: published(725.0, Typical, Source::Memory),
        elongation: POLYETHYLENE,
        weight: Weight::Specific(SPECTRA_BRAID),
        density: 980.0,
        note: ESTIMATED_WEIGHT,
    },
    Cord {
        material: LineMaterial::Spectra825,
        title: "Spectra (Dyneema) line",
        lb: published(825.0, Typical, Source::Memory),
        elongation: POLYETHYLENE,
        weight: Weight::Specific(SPECTRA_BRAID),
        density: 980.0,
        note: ESTIMATED_WEIGHT,
    },
    Cord {
        material: LineMaterial::Vectran750,
        title: "Vectran (liquid crystal polyester) line",
        lb: published(750.0, Typical, Source::Memory),
        elongation: published(3.8, Typical, Source::Teijin),
        weight: Weight::Specific(published(2.01 * BRAID, Estimate, Source::TensionTechnology)),
        density: 1410.0,
        note: "The weight is estimated: yarn of 2.01 N/tex, of which a braid has the share that Spectra line has. The modulus is that of \
               straight fibre.",
    },
    Cord {
        material: LineMaterial::Kevlar1000,
        title: "Kevlar cord, in the style of MIL-C-87129 / PIA-C-87129",
        lb: published(1000.0, Typical, Source::Memory),
        elongation: published(5.0, Typical, Source::Mit),
        weight: Weight::Specific(published(2.03 * BRAID, Estimate, Source::TensionTechnology)),
        density: 1440.0,
        note: "The weight is estimated: yarn of 2.03 N/tex, of which a braid has the share that Spectra line has.",
    },
];

impl LineMaterial {
    /// All of them, in the order of the page.
    pub const ALL: [LineMaterial; 14] = [
        LineMaterial::PiaC5040Type1,
        LineMaterial::PiaC5040Type2a,
        LineMaterial::PiaC5040Type2,
        LineMaterial::PiaC5040Type3,
        LineMaterial::NylonCoreless400,
        LineMaterial::Dacron600,
        LineMaterial::Spectra400,
        LineMaterial::PiaC1200Type2a,
        LineMaterial::Spectra525,
        LineMaterial::Spectra725,
        LineMaterial::Spectra825,
        LineMaterial::Vectran750,
        LineMaterial::Kevlar1000,
        LineMaterial::AtpsPaper,
    ];

    /// Name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            LineMaterial::PiaC5040Type1 => "pia-c5040-type1",
            LineMaterial::PiaC5040Type2a => "pia-c5040-type2a",
            LineMaterial::PiaC5040Type2 => "pia-c5040-type2",
            LineMaterial::PiaC5040Type3 => "pia-c5040-type3",
            LineMaterial::NylonCoreless400 => "nylon-coreless-400",
            LineMaterial::Dacron600 => "dacron-600",
            LineMaterial::Spectra400 => "spectra-400",
            LineMaterial::PiaC1200Type2a => "pia-c1200-type2a",
            LineMaterial::Spectra525 => "spectra-525",
            LineMaterial::Spectra725 => "spectra-725",
            LineMaterial::Spectra825 => "spectra-825",
            LineMaterial::Vectran750 => "vectran-750",
            LineMaterial::Kevlar1000 => "kevlar-1000",
            LineMaterial::AtpsPaper => "atps-paper",
        }
    }

    /// What the library gives: keys of `[lines]`.
    pub fn entry(self) -> Entry {
        match CORDS.iter().find(|c| c.material == self) {
            Some(cord) => cord.entry(),
            None => atps_paper(),
        }
    }

    /// The same as keys of `[risers]`: axial stiffness, mass for each metre and strength.
    pub fn riser_values(self) -> Vec<(&'static str, f64)> {
        let entry = self.entry();
        let get = |key: &str| entry.get(key).unwrap_or(f64::NAN);
        let area = get("area_m2");
        let mut values = vec![
            ("axial_stiffness_n", four_digits(get("youngs_modulus_pa") * area)),
            ("mass_kg_m", four_digits(get("density_kg_m3") * area)),
        ];
        values.extend(entry.get("strength_n").map(|s| ("strength_n", s)));
        values
    }
}

impl Cord {
    fn entry(&self) -> Entry {
        let strength = self.lb.figure * LB;
        let (kg_m, figure, from) = match &self.weight {
            Weight::FeetPerPound(p) => (LB_FT / p.figure, format!("{} ft/lb", p.figure), p),
            Weight::Linear(p) => (1e-3 * p.figure, format!("{} g/m", p.figure), p),
            Weight::Specific(p) => (1e-6 * strength / p.figure, format!("{:.2} N/tex", p.figure), p),
        };
        let area = kg_m / self.density;
        let fibre = published(self.density, Typical, Source::Teijin);
        let values = vec![
            Value::of("density_kg_m3", self.density, format!("{} g/cm³", 1e-3 * self.density), &fibre),
            Value::of("area_m2", area, figure, from),
            Value::of("strength_n", strength, format!("{} lb", self.lb.figure), &self.lb),
            Value::secant_modulus(strength / area, &self.elongation),
        ];
        Entry { name: self.material.name(), title: self.title, values, note: self.note }
    }
}

fn atps_paper() -> Entry {
    let values = vec![
        Value::of_paper("youngs_modulus_pa", 5.342e8),
        Value::of_paper("area_m2", 3.11e-6),
        Value::of_paper("density_kg_m3", 1223.50932),
    ];
    Entry {
        name: LineMaterial::AtpsPaper.name(),
        title: "lines of the paper's ATPS",
        values,
        note: "No strength is given.",
    }
}
