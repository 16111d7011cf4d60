//! Checks of the tapes: what they weigh, and what an element of a grid stands for.

use case::TapePlace;
use mesh::{Cable, CableKind};

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Note, Warning};
use super::table::{Check, When};

/// Tapes for each element of a grid below and above which the mesh does not have the grid of the scene.
const TAPES_FOR_EACH: [f64; 2] = [0.5, 2.0];
/// Mass for each metre of webbing and tape, kg/m.
const LINEAR_DENSITY: [f64; 2] = [2e-4, 0.2];

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "tapes.linear-density",
        what: "tapes weigh what tape and webbing weigh",
        estimate: "mass_kg_m of each place; length and mass in all",
        range: "0.0002 to 0.2 kg/m: warning outside",
        source: "as lines.linear-density: tape of 10 mm width weighs 2 to 10 g/m, heavy webbing 0.1 kg/m",
        severity: Warning,
        remedy: "give mass_kg_m in kg/m: 3.8 g/m are 0.0038",
        when: When::Before(linear_density),
    },
    Check {
        id: "tapes.grid",
        what: "the elements of a grid of tapes stand for about one tape each",
        estimate: "tapes for each element, by which its axial stiffness and mass are scaled: mean weighted by length, and largest",
        range: "mean of 0.5 to 2: warning outside",
        source: "length, mass and stiffness of the grid are right on every mesh; the fabric between two tapes that are one element is not",
        severity: Warning,
        remedy: "choose canopy.cells_across and the cells along the arms so that a cell is about as wide as tapes.grid.spacing_m, or \
                 take the result as that of smeared tapes",
        when: When::Before(grid),
    },
];

fn linear_density(f: &Facts<'_>) -> Vec<Judged> {
    let Some(tapes) = &f.scene.tapes else { return Vec::new() };
    let one = |(place, tape): (TapePlace, case::Tape)| {
        let length = f.mesh.cable_length(CableKind::Tape(place));
        let [low, high] = LINEAR_DENSITY;
        let severity = if (low..=high).contains(&tape.mass_kg_m) { Note } else { Warning };
        let figure = format!(
            "tapes.{} weigh {} g/m: {} m and {} kg in all",
            place.name(),
            digits(1e3 * tape.mass_kg_m),
            digits(length),
            digits(length * tape.mass_kg_m)
        );
        Judged::new(severity, format!("tapes.{}.mass_kg_m", place.name()), figure)
    };
    tapes.places().map(one).collect()
}

fn grid(f: &Facts<'_>) -> Vec<Judged> {
    let Some(g) = f.scene.tapes.as_ref().and_then(|t| t.grid) else { return Vec::new() };
    let of_grid = |c: &&Cable| c.kind == CableKind::Tape(TapePlace::Grid);
    let elements = f.mesh.cables.iter().filter(of_grid);
    let (mut length, mut tape, mut largest) = (0.0, 0.0, 0.0f64);
    for c in elements {
        length += c.rest_length;
        tape += c.share * c.rest_length;
        largest = largest.max(c.share);
    }
    let mean: f64 = tape / length;
    let [low, high] = TAPES_FOR_EACH;
    let severity = if (low..=high).contains(&mean) { Note } else { Warning };
    let figure = format!(
        "each element stands for {} tapes in the mean, {} at most: tapes every {} m on {} m of mesh lines",
        digits(mean),
        digits(largest),
        digits(g.spacing_m),
        digits(length)
    );
    vec![Judged::new(severity, "tapes.grid.spacing_m", figure)]
}
