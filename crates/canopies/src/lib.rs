//! Canopy types by their drawings: proportions, figures of handbooks, and scenes to start from ([`scene`]).
//!
//! Proportions are those of a usual canopy of the type; a scene made from them is to be changed to the drawing at hand. Figures of handbooks are for the nominal
//! area $`S_0 = \pi D_0^2 / 4`$ of all fabric, vents and slots included.

mod scene;

use std::f64::consts::PI;

pub use scene::{Experiment, SceneSizes, scene};

/// A type of canopy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanopyType {
    /// Triangular gores in one plane.
    FlatCircular,
    /// Gores at one angle below the horizontal.
    Conical,
    /// Gores along a quarter of a circle.
    Hemispherical,
    /// A flat disk and a skirt below it.
    ExtendedSkirt,
    /// A flat ring.
    Annular,
    /// Rings of fabric with slots between them.
    Ringslot,
    /// A cone of narrow ribbons.
    Ribbon,
    /// Rings, and sails with fullness below them.
    Ringsail,
    /// A disk, an opening and a cylindrical band.
    DiskGapBand,
    /// Two flat panels that cross.
    Cross,
    /// One flat square sheet.
    Square,
    /// The cross parachute of the paper, arms stitched at the hem.
    Atps,
}

/// Drag coefficient on the nominal area, opening force coefficient at infinite mass and filling constant of a type. From the tables 5-1 to 5-6 of Knacke, Parachute
/// Recovery Systems Design Manual (1991), as quoted from memory; the tables themselves were not opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandbookFigures {
    /// Lowest and highest drag coefficient $`C_{D0}`$ of a steady descent.
    pub drag_coefficient: [f64; 2],
    /// Largest force over the drag of the open canopy at the same speed, $`C_X`$, at infinite mass.
    pub opening_force_coefficient: Option<f64>,
    /// Filling time times speed over nominal diameter, n, unreefed.
    pub filling_constant: Option<f64>,
}

/// Risers of a type: their number, which divides the lines into groups of equal size, and their sizes over the nominal diameter. Of personnel parachutes, whose risers are 0.76 m
/// long; quoted from memory, no drawing was opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RiserFigures {
    /// Number of risers and of confluence points.
    pub count: u32,
    /// Length of a riser over the nominal diameter.
    pub length: f64,
    /// Diameter of the circle of the attachments at the payload over the nominal diameter: the width of shoulders, 0.3 m.
    pub spread: f64,
    /// The parachute whose they are.
    pub of: &'static str,
}

impl CanopyType {
    /// All of them, in the order of the reference.
    pub const ALL: [CanopyType; 12] = [
        CanopyType::FlatCircular,
        CanopyType::Conical,
        CanopyType::Hemispherical,
        CanopyType::ExtendedSkirt,
        CanopyType::Annular,
        CanopyType::Ringslot,
        CanopyType::Ribbon,
        CanopyType::Ringsail,
        CanopyType::DiskGapBand,
        CanopyType::Cross,
        CanopyType::Square,
        CanopyType::Atps,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            CanopyType::FlatCircular => "flat-circular",
            CanopyType::Conical => "conical",
            CanopyType::Hemispherical => "hemispherical",
            CanopyType::ExtendedSkirt => "extended-skirt",
            CanopyType::Annular => "annular",
            CanopyType::Ringslot => "ringslot",
            CanopyType::Ribbon => "ribbon",
            CanopyType::Ringsail => "ringsail",
            CanopyType::DiskGapBand => "disk-gap-band",
            CanopyType::Cross => "cross",
            CanopyType::Square => "square",
            CanopyType::Atps => "atps",
        }
    }

    /// What it is, and what its scene simplifies.
    pub fn description(self) -> &'static str {
        match self {
            CanopyType::FlatCircular => {
                "triangular gores in one plane, crown vent of 1 % of the area, four risers"
            }
            CanopyType::Conical => "gores 20 degrees below the horizontal",
            CanopyType::Hemispherical => "gores along a quarter of a circle",
            CanopyType::ExtendedSkirt => {
                "a flat disk and a skirt of a tenth of its diameter that keeps the width of the gores, four risers"
            }
            CanopyType::Annular => {
                "a flat ring whose opening has 40 % of the nominal diameter; its middle is not pulled down by lines"
            }
            CanopyType::Ringslot => {
                "slots narrower than a cell of the flow are a cloth with the pressure loss of the geometric porosity, 18 %"
            }
            CanopyType::Ribbon => {
                "conical; ribbons are a cloth with the pressure loss of the geometric porosity, 22 %"
            }
            CanopyType::Ringsail => {
                "rings and sails along a quarter of a sphere; slots and fullness of the sails are a cloth with the pressure loss of the geometric porosity, 8 %"
            }
            CanopyType::DiskGapBand => {
                "the proportions of the parachute of Tianwen-1 (disk 0.722, gap 0.043, band 0.122, vent 0.070, lines 1.70 nominal diameters)"
            }
            CanopyType::Cross => "two flat panels, width over length 0.3, arms not stitched",
            CanopyType::Square => "one flat sheet with lines along its rim",
            CanopyType::Atps => {
                "the cross parachute of the ATPS: Table 2 of the paper, arms stitched at the hem"
            }
        }
    }

    /// Figures of handbooks; `None` where no table has the type.
    pub fn handbook(self) -> Option<HandbookFigures> {
        let figures = |low, high, opening: Option<f64>, filling: Option<f64>| {
            Some(HandbookFigures {
                drag_coefficient: [low, high],
                opening_force_coefficient: opening,
                filling_constant: filling,
            })
        };
        match self {
            CanopyType::FlatCircular => figures(0.75, 0.80, Some(1.7), Some(8.0)),
            CanopyType::Conical => figures(0.75, 0.90, Some(1.8), None),
            CanopyType::Hemispherical => figures(0.62, 0.77, Some(1.6), None),
            CanopyType::ExtendedSkirt => figures(0.78, 0.87, Some(1.4), Some(10.0)),
            CanopyType::Annular => figures(0.85, 0.95, Some(1.4), None),
            CanopyType::Ringslot => figures(0.56, 0.65, Some(1.05), Some(14.0)),
            CanopyType::Ribbon => figures(0.50, 0.55, Some(1.05), Some(14.0)),
            CanopyType::Ringsail => figures(0.75, 0.90, Some(1.1), Some(7.0)),
            CanopyType::DiskGapBand => figures(0.52, 0.58, Some(1.3), None),
            CanopyType::Cross => figures(0.60, 0.85, Some(1.2), Some(11.7)),
            CanopyType::Square | CanopyType::Atps => None,
        }
    }

    /// Risers, where parachutes of the type usually have them; `None`: all lines of the scene run to one point.
    pub fn risers(self) -> Option<RiserFigures> {
        let four = |diameter: f64, of| RiserFigures {
            count: 4,
            length: 0.76 / diameter,
            spread: 0.3 / diameter,
            of,
        };
        match self {
            CanopyType::FlatCircular => Some(four(8.53, "C-9: 28 lines in groups of 7")),
            CanopyType::ExtendedSkirt => Some(four(10.67, "T-10, whose 30 lines are in groups of 7 and 8")),
            _ => None,
        }
    }

    /// Share of the nominal area that slots leave open and that no grid resolves.
    pub fn geometric_porosity(self) -> Option<f64> {
        match self {
            CanopyType::Ringslot => Some(0.18),
            CanopyType::Ribbon => Some(0.22),
            CanopyType::Ringsail => Some(0.08),
            _ => None,
        }
    }

    /// Drag coefficient that sizes the payload of a scene: the middle of the handbook's range, or 0.7.
    pub fn usual_drag_coefficient(self) -> f64 {
        self.handbook().map_or(0.7, |h| 0.5 * (h.drag_coefficient[0] + h.drag_coefficient[1]))
    }
}

/// Nominal area of a nominal diameter (m), m2.
pub fn nominal_area(diameter: f64) -> f64 {
    0.25 * PI * diameter * diameter
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_distinct_and_figures_are_ranges() {
        for (k, t) in CanopyType::ALL.into_iter().enumerate() {
            assert!(CanopyType::ALL[..k].iter().all(|o| o.name() != t.name()));
            if let Some(h) = t.handbook() {
                let [low, high] = h.drag_coefficient;
                assert!(0.2 < low && low < high && high < 1.2, "{t:?}");
                assert!((low..=high).contains(&t.usual_drag_coefficient()));
            }
        }
    }
}
