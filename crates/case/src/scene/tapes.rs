//! `[tapes]`: tapes sewn on the fabric, by place; `[risers]`: a section of their own.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Canopy;
use super::fabric::safety_factor;
use super::lines::{STRENGTH, hysteresis, retardation};
use crate::check::Check;
use crate::materials::required_without_material;
use crate::{RiserMaterial, Scene, TapeMaterial};

/// Tapes sewn on the fabric, by place. A place without a table has none. A tape is a line of cable elements on canopy nodes, at its
/// rest length in the cut shape, without prestress; its force is linear between Green strain and second Piola-Kirchhoff stress, as
/// that of lines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Tapes {
    /// Along the lower edge of the canopy.
    pub hem: Option<Tape>,
    /// Along the joints between panels: edges of the top, stitched edges of the arms.
    pub seams: Option<Tape>,
    /// Along both edges of each slit.
    pub vents: Option<Tape>,
    /// Along and across all panels.
    pub grid: Option<TapeGrid>,
    /// A tape that is shorter than its rest length carries nothing.
    pub tension_only: bool,
}

impl Default for Tapes {
    fn default() -> Self {
        Self { hem: None, seams: None, vents: None, grid: None, tension_only: true }
    }
}

/// Section of a tape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = required_without_material)]
pub struct Tape {
    /// Tape or webbing of the library: it gives the keys of this table that the scene leaves out. Absent: the scene gives them all.
    pub material: Option<TapeMaterial>,
    /// Axial stiffness EA: force for a strain of 1, N. The breaking strength over the elongation at break is its mean.
    pub axial_stiffness_n: f64,
    /// Mass for each metre, kg/m.
    pub mass_kg_m: f64,
    /// Breaking force of a tape, N. Absent: no safety factor.
    pub strength_n: Option<f64>,
    /// Safety factor that the tapes of this place should have: strength over largest tension. Absent: 1.
    pub safety_factor: Option<f64>,
    /// As `lines.retardation_time_s`: retardation time (Kelvin-Voigt), s.
    #[serde(default)]
    pub retardation_time_s: f64,
}

/// Tapes along and across all panels at a spacing in metres, so that every mesh has the same length of tape, mass and stiffness.
///
/// Each panel has an area A of fabric and so the length A / spacing of tape in each of its two directions, with the mass and the
/// stiffness of that length. Their elements lie on lines of the mesh. Where cells are smaller than the spacing, each tape lies on
/// the nearest line, on two lines with one half each where it lies midway. Where they are larger, each line stands for all tapes
/// of its share of the width, those at the edges of the panel too. Axial stiffness and mass of the elements are scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = required_without_material)]
pub struct TapeGrid {
    /// Tape or webbing of the library: it gives the stiffness and mass that the scene leaves out. Absent: the scene gives both.
    pub material: Option<TapeMaterial>,
    /// Axial stiffness EA of one tape: force for a strain of 1, N.
    pub axial_stiffness_n: f64,
    /// Mass for each metre of one tape, kg/m.
    pub mass_kg_m: f64,
    /// Distance between neighbouring tapes, m.
    pub spacing_m: f64,
    /// Breaking force of one tape, N. Absent: no safety factor.
    pub strength_n: Option<f64>,
    /// Safety factor that the tapes of this place should have: strength over largest tension. Absent: 1.
    pub safety_factor: Option<f64>,
    /// As `lines.retardation_time_s`: retardation time (Kelvin-Voigt), s.
    #[serde(default)]
    pub retardation_time_s: f64,
}

/// Section of the risers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = required_without_material)]
pub struct Risers {
    /// Line or webbing of the library that a riser consists of: it gives the keys of this table that the scene leaves out. Absent: the
    /// scene gives them all.
    pub material: Option<RiserMaterial>,
    /// Axial stiffness EA: force for a strain of 1, N.
    pub axial_stiffness_n: f64,
    /// Mass for each metre, kg/m.
    pub mass_kg_m: f64,
    /// Breaking force of a riser, N. Absent: no safety factor.
    pub strength_n: Option<f64>,
    /// Safety factor that risers should have: strength over largest tension. Absent: 1.
    pub safety_factor: Option<f64>,
    /// As `lines.hysteresis`: share of the work of stretching that a slow cycle from zero to a load and back does not return, at most 0.4. Absent: 0, elastic. Each stage
    /// starts as after a first loading; stages with `solve = "static"` have none.
    pub hysteresis: Option<f64>,
    /// As `lines.retardation_time_s`: retardation time (Kelvin-Voigt), s.
    #[serde(default)]
    pub retardation_time_s: f64,
}

/// Where a tape is sewn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum TapePlace {
    /// Lower edge of the canopy.
    Hem,
    /// Joints between panels.
    Seams,
    /// Edges of slits.
    Vents,
    /// Along and across the panels.
    Grid,
}

impl TapePlace {
    /// All of them, in the order of their tables.
    pub const ALL: [TapePlace; 4] = [TapePlace::Hem, TapePlace::Seams, TapePlace::Vents, TapePlace::Grid];

    /// Key of its table in `[tapes]`.
    pub fn name(self) -> &'static str {
        match self {
            TapePlace::Hem => "hem",
            TapePlace::Seams => "seams",
            TapePlace::Vents => "vents",
            TapePlace::Grid => "grid",
        }
    }
}

impl Tapes {
    /// Section of the tapes at `place`; for a grid that of one tape.
    pub fn section(&self, place: TapePlace) -> Option<Tape> {
        match place {
            TapePlace::Hem => self.hem,
            TapePlace::Seams => self.seams,
            TapePlace::Vents => self.vents,
            TapePlace::Grid => {
                let tape = |g: TapeGrid| Tape {
                    material: g.material,
                    axial_stiffness_n: g.axial_stiffness_n,
                    mass_kg_m: g.mass_kg_m,
                    strength_n: g.strength_n,
                    safety_factor: g.safety_factor,
                    retardation_time_s: g.retardation_time_s,
                };
                self.grid.map(tape)
            }
        }
    }

    /// The places that have tapes.
    pub fn places(&self) -> impl Iterator<Item = (TapePlace, Tape)> + '_ {
        TapePlace::ALL.into_iter().filter_map(|p| Some((p, self.section(p)?)))
    }
}

impl Canopy {
    /// The places of this canopy that can have tapes.
    pub fn tape_places(&self) -> &'static [TapePlace] {
        match self {
            Canopy::Atps(_) => &TapePlace::ALL,
            Canopy::Square(_) | Canopy::Panel(_) | Canopy::Cross(_) => &[TapePlace::Hem, TapePlace::Grid],
            Canopy::Circular(_) => &[TapePlace::Hem],
            Canopy::Gored(_) | Canopy::Pattern(_) => &[TapePlace::Hem, TapePlace::Seams, TapePlace::Vents],
            Canopy::AirBag(_) | Canopy::Gmsh(_) | Canopy::None => &[],
        }
    }
}

const STIFFNESS: &str =
    "an axial stiffness EA in N: modulus times cross-section, strength over elongation at break";
const MASS: &str = "a mass for each metre in kg/m: is the value in kilograms, not grams?";

/// Refuses an invalid strength and a safety factor without one.
fn strength(path: &str, strength_n: Option<f64>, factor: Option<f64>, c: &mut Check) {
    if let Some(strength) = strength_n {
        c.positive(&format!("{path}.strength_n"), strength, 1e8, STRENGTH);
    }
    safety_factor(path, factor, strength_n.is_some(), "strength_n", c);
}

fn section(path: &str, axial_stiffness_n: f64, mass_kg_m: f64, c: &mut Check) {
    c.positive(&format!("{path}.axial_stiffness_n"), axial_stiffness_n, 1e9, STIFFNESS);
    c.positive(&format!("{path}.mass_kg_m"), mass_kg_m, 10.0, MASS);
}

/// Refuses invalid sections, tapes where the canopy has no place for them, and risers without lines.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    if let Some(r) = &scene.risers {
        section("risers", r.axial_stiffness_n, r.mass_kg_m, c);
        strength("risers", r.strength_n, r.safety_factor, c);
        hysteresis("risers", r.hysteresis, c);
        retardation("risers", r.retardation_time_s, c);
        risers(scene, c);
    }
    let Some(t) = &scene.tapes else { return };
    if t.places().next().is_none() {
        c.refuse(
            "tapes",
            "[tapes] names no place",
            "add [tapes.hem], [tapes.seams], [tapes.vents] or [tapes.grid], or remove it",
        );
    }
    let can = scene.canopy.tape_places();
    for (place, tape) in t.places() {
        let path = format!("tapes.{}", place.name());
        section(&path, tape.axial_stiffness_n, tape.mass_kg_m, c);
        strength(&path, tape.strength_n, tape.safety_factor, c);
        retardation(&path, tape.retardation_time_s, c);
        if !can.contains(&place) {
            let places: Vec<_> = can.iter().map(|p| p.name()).collect();
            let help = if places.is_empty() {
                "remove it; in a mesh file, line elements of the physical group `reinforcements` are tapes with the section of [lines]".into()
            } else {
                format!("this kind of canopy has tapes at: {}", places.join(", "))
            };
            c.refuse(&path, format!("a canopy of this kind has no place `{}` for tapes", place.name()), help);
        }
    }
    if let Some(g) = &t.grid {
        c.range("tapes.grid.spacing_m", g.spacing_m, 1e-3..=100.0, "a distance in metres between tapes");
    }
    if matches!(&scene.canopy, Canopy::Atps(a) if a.reinforcements) {
        c.refuse(
            "tapes",
            "the scene has `canopy.reinforcements` and [tapes]: both put elements along the panel edges",
            "remove canopy.reinforcements and canopy.reinforcement_spacing_cells",
        );
    }
}

fn risers(scene: &Scene, c: &mut Check) {
    if scene.lines.is_none() {
        c.refuse(
            "risers",
            "the scene has [risers] but no [lines]",
            "add [lines] with their material, or remove [risers]",
        );
    }
    if matches!(scene.canopy, Canopy::Square(_) | Canopy::Circular(_) | Canopy::Panel(_) | Canopy::AirBag(_))
    {
        c.refuse(
            "risers",
            "a canopy of this kind has no risers",
            "remove [risers]; the canopies `atps`, `gored` and `cross` have them, and a mesh file in its physical group `risers`",
        );
    }
}
