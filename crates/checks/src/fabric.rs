//! Checks of the fabric: mass, thickness, strain under load.

use case::Law;

use super::facts::{Facts, digits, percent};
use super::finding::Judged;
use super::finding::Severity::{self, Error, Note, Warning};
use super::table::{Check, When};

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "fabric.areal-density",
        what: "the areal density is that of parachute cloth",
        estimate: "thickness_m x density_kg_m3, kg/m2",
        range: "parachute cloth has 0.02 to 0.5 kg/m2: warning outside; error below 1e-4 kg/m2 (0.1 micrometres of \
                polymer) and above 5 kg/m2 (ten times the heaviest cloth)",
        source: "cloth of PIA-C-7020 has 1.1 to 1.6 oz/yd2 (0.037 to 0.054 kg/m2), PIA-C-44378 0.040 kg/m2, duck of \
                 PIA-C-7219 9.5 oz/yd2 (0.32 kg/m2); the range leaves a margin to lighter and heavier ones",
        severity: Error,
        remedy: "give thickness_m in metres (3e-5 is 0.03 mm) and density_kg_m3 in kg/m3 (nylon 1140): \
                 their product is the areal density",
        when: When::Before(areal_density),
    },
    Check {
        id: "fabric.thickness",
        what: "the fabric is thin enough for a membrane model",
        estimate: "thickness_m",
        range: "parachute cloth is 0.02 to 1 mm thick: warning outside; error above 10 mm",
        source: "cloth of PIA-C-7020 is 0.076 to 0.10 mm thick as woven; its 0.037 kg/m2 correspond to 0.03 mm of solid nylon",
        severity: Error,
        remedy: "give thickness_m in metres: 0.03 mm is 3e-5",
        when: When::Before(thickness),
    },
    Check {
        id: "fabric.density",
        what: "the density is that of a fabric",
        estimate: "density_kg_m3",
        range: "fabrics have 300 to 3000 kg/m3: warning outside; error below the density of the air",
        source: "polyethylene 970, nylon 1140, aramid 1440, glass 2500 kg/m3; half of a woven cloth is voids",
        severity: Error,
        remedy: "give density_kg_m3 in kg/m3: nylon has 1140, not 1.14 (g/cm3)",
        when: When::Before(density),
    },
    Check {
        id: "fabric.strain",
        what: "the estimated strain is within the range of the material model",
        estimate: "Green strain E = p R / (E_Y t) of a wrinkled canopy of radius R = width / 2 that carries the load \
                   pressure p along one direction (exact for a cylinder of St. Venant-Kirchhoff fabric); peaks at seams \
                   and line attachments are about four times it (ATPS: 0.16 estimated, 0.63 in the run). With law = \
                   \"neo-hookean\" the stretch (1 - 3 p R / (E_Y t))^(-1/3) of such a cylinder",
        range: "St. Venant-Kirchhoff is valid to a Green strain of 0.1 to 0.2: warning above 0.1; error above 5, \
                beyond all textiles even if the estimate is three times too large. Neo-Hookean: warning above a stretch of \
                1.5, and where the cylinder has no equilibrium, from 3 p R = E_Y t on; error above p R = 5 E_Y t",
        source: "nylon cloth breaks at 20 to 40 % elongation; above 0.2 the model is softer than any measured cloth. Rubber in \
                 tension follows the neo-Hookean law to a stretch of about 1.5 (Treloar, The Physics of Rubber Elasticity, from memory)",
        severity: Error,
        remedy: "check fabric.youngs_modulus_pa (nylon cloth: 2e8 to 2e9 Pa) and thickness_m; if the soft modulus is \
                 intended, as in the paper's ATPS, strains and stresses are those of the model, not of a real cloth",
        when: When::Before(strain),
    },
    Check {
        id: "fabric.start",
        what: "fabric sewn from flat panels starts without tension",
        estimate: "principal stretches of all triangles at the start relative to their flat shape; quality 4 3^1/2 A / (sum of squared edges) of the flat triangles; only where the \
                   canopy comes from a pattern file",
        range: "warning where a triangle is stretched by more than 0.1 %, or slack by more than 1 % in fabric that carries compression",
        source: "a strain of 0.1 % in cloth of 3e4 N/m is 30 N/m, a tenth of the force of an open canopy; slack cloth that wrinkles has no stress",
        severity: Warning,
        remedy: "place the panels nearer to their sewn shape (start in the pattern file), or set fabric.wrinkling = true",
        when: When::Before(start),
    },
    Check {
        id: "fabric.strength",
        what: "the fabric carries the load pressure",
        estimate: "strength_n_m over p R, the force for each width of a canopy of radius R = width / 2 under the load pressure p; only where \
                   the scene or its material has a strength. Peaks at seams and line attachments are about four times p R",
        range: "warning below 1; below fabric.safety_factor the figure says so",
        source: "membrane force of a cylinder that carries p along one direction; half of it in a sphere",
        severity: Warning,
        remedy: "choose a stronger fabric.material, or reduce the load; give strength_n_m in N/m (1 lb/in is 175 N/m)",
        when: When::Before(strength),
    },
    Check {
        id: "fabric.mass-ratio",
        what: "the coupling scheme is stable for the ratio of fabric mass to added mass",
        estimate: "m* = (fabric, kg/m2) / (8/(3 pi) rho R), the mass of the fabric over the added mass of a disk of radius \
                   R = width / 2",
        range: "warning for m* < 1 with coupling.scheme = \"staggered\" (except the sequence \"added-mass\"), or with \
                coupling.load_interpolation = \"linear\" and more than one substep",
        source: "Causin, Gerbeau and Nobile, CMAME 194 (2005): staggered schemes are unstable for m* < 1; docs/records/stability.md \
                 for load_interpolation = \"linear\"",
        severity: Warning,
        remedy: "set coupling.scheme = \"implicit\" and coupling.load_interpolation = \"mean\", the defaults",
        when: When::Before(mass_ratio),
    },
];

/// Severity of a value: a note within `warn`, a warning within `stop`, otherwise an error.
fn outside(value: f64, warn: [f64; 2], stop: [f64; 2]) -> Severity {
    let within = |[low, high]: [f64; 2]| (low..=high).contains(&value);
    match (within(warn), within(stop)) {
        (_, false) => Error,
        (false, true) => Warning,
        (true, true) => Note,
    }
}

fn areal_density(f: &Facts<'_>) -> Vec<Judged> {
    if !f.is_parachute() {
        return Vec::new();
    }
    let weight = f.numbers.fabric_kg_m2;
    let severity = outside(weight, [0.02, 0.5], [1e-4, 5.0]);
    // The value with the larger ratio to nylon cloth of 0.05 mm is the likely mistake.
    let far = |value: f64, usual: f64| (value / usual).ln().abs();
    let fabric = &f.scene.fabric;
    let key = if far(fabric.thickness_m, 5e-5) > far(fabric.density_kg_m3, 1140.0) {
        "fabric.thickness_m"
    } else {
        "fabric.density_kg_m3"
    };
    vec![Judged::new(severity, key, format!("the areal density of the fabric is {} kg/m2", digits(weight)))]
}

fn thickness(f: &Facts<'_>) -> Vec<Judged> {
    let t = f.scene.fabric.thickness_m;
    let severity = outside(t, [2e-5, 1e-3], [0.0, 1e-2]);
    if !f.is_parachute() || severity == Note {
        return Vec::new();
    }
    vec![Judged::new(severity, "fabric.thickness_m", format!("the fabric is {} mm thick", digits(1e3 * t)))]
}

fn density(f: &Facts<'_>) -> Vec<Judged> {
    let rho = f.scene.fabric.density_kg_m3;
    let severity = outside(rho, [300.0, 3000.0], [f.numbers.density, f64::INFINITY]);
    if !f.is_parachute() || severity == Note {
        return Vec::new();
    }
    let figure = format!(
        "the density of the fabric is {} kg/m3; air has {} kg/m3, nylon 1140 kg/m3",
        digits(rho),
        digits(f.numbers.density)
    );
    vec![Judged::new(severity, "fabric.density_kg_m3", figure)]
}

/// Green strain of a cylinder of radius `r` under `p`: from $`p\,\mathrm dA = \mathrm dW`$ with
/// $`W = \tfrac12 E_Y t E^2`$ per reference area, $`E = p r / (E_Y t)`$ at any stretch.
fn green_strain(p: f64, r: f64, stiffness: f64) -> f64 {
    p * r / stiffness
}

/// Stretch, slack and quality of sewn fabric at its start.
fn start(f: &Facts<'_>) -> Vec<Judged> {
    if f.mesh.flat.is_empty() {
        return Vec::new();
    }
    let stretches = (0..f.mesh.triangles.len()).map(|t| f.mesh.starting_stretches(t));
    let [most, least] = stretches.fold([0.0_f64, 1.0_f64], |m, s| [m[0].max(s[0]), m[1].min(s[1])]);
    let (stretch, slack) = ((most - 1.0).max(0.0), 1.0 - least);
    let loaded = stretch > 1e-3 || (!f.scene.fabric.wrinkling && slack > 0.01);
    let figure = format!(
        "{} triangles of {:.3} m2, of a quality of at least {}, start stretched by at most {} and slack by at most {}",
        f.mesh.triangles.len(),
        f.numbers.fabric_area,
        digits(f.mesh.least_quality()),
        percent(stretch),
        percent(slack)
    );
    vec![Judged::new(if loaded { Warning } else { Note }, "canopy.file", figure)]
}

fn strain(f: &Facts<'_>) -> Vec<Judged> {
    let fabric = &f.scene.fabric;
    let (p, load) = f.load_pressure();
    if p == 0.0 {
        return Vec::new();
    }
    let strain = green_strain(p, 0.5 * f.numbers.width, fabric.softest_modulus_pa() * fabric.thickness_m);
    if fabric.law == Law::NeoHookean {
        return vec![neo_hookean_stretch(strain, p, load)];
    }
    let figure = format!(
        "a Green strain of about {} (stretch {}) under {} Pa, {load}; peak values are about four times higher",
        digits(strain),
        digits((1.0 + 2.0 * strain).sqrt()),
        digits(p)
    );
    vec![Judged::new(outside(strain, [0.0, 0.1], [0.0, 5.0]), "fabric.youngs_modulus_pa", figure)]
}

/// Stretch $`\lambda`$ of a wrinkled neo-Hookean cylinder, whose stress in the reference shape is $`S = \tfrac13 E_Y (1 - \lambda^{-3})`$:
/// $`\lambda = (1 - 3 p r / (E_Y t))^{-1/3}`$, from the strain of [`green_strain`] under `p`.
fn neo_hookean_stretch(strain: f64, p: f64, load: &str) -> Judged {
    let stretch = (1.0 - 3.0 * strain).powf(-1.0 / 3.0);
    let (severity, found) = if stretch.is_finite() {
        let severity = if stretch > 1.5 { Warning } else { Note };
        (severity, format!("a stretch of about {}", digits(stretch)))
    } else {
        let found =
            format!("p R is {} of E_Y t, and a cylinder has no equilibrium above a third", percent(strain));
        // A modulus in a wrong unit is refused as with the other law.
        (if strain > 5.0 { Error } else { Warning }, found)
    };
    let figure = format!("{found} under {} Pa, {load}; peak values are higher", digits(p));
    Judged::new(severity, "fabric.youngs_modulus_pa", figure)
}

fn strength(f: &Facts<'_>) -> Vec<Judged> {
    let Some(strength) = f.scene.fabric.strength_n_m else { return Vec::new() };
    let (p, load) = f.load_pressure();
    if p == 0.0 {
        return Vec::new();
    }
    let force = 0.5 * p * f.numbers.width;
    let factor = safety_factor(strength / force, f.scene.fabric.safety_factor);
    let figure = format!(
        "the fabric carries about {} N/m under {} Pa, {load}: {factor}; peak values are about four times higher",
        digits(force),
        digits(p)
    );
    let severity = if strength < force { Warning } else { Note };
    vec![Judged::new(severity, "fabric.strength_n_m", figure)]
}

/// A safety factor in words, with the required one where it is below that.
pub(super) fn safety_factor(factor: f64, required: Option<f64>) -> String {
    let below = required.filter(|required| factor < *required);
    let below = below.map_or(String::new(), |required| format!(", below the required {}", digits(required)));
    format!("safety factor {}{below}", digits(factor))
}

fn mass_ratio(f: &Facts<'_>) -> Vec<Judged> {
    if !f.has(case::StageKind::Coupled) {
        return Vec::new();
    }
    let n = &f.numbers;
    let added = 8.0 / (3.0 * std::f64::consts::PI) * n.density * 0.5 * n.width;
    let ratio = n.fabric_kg_m2 / added;
    let c = &f.scene.coupling;
    let explicit =
        c.scheme == case::Scheme::Staggered && c.staggered.sequence != case::StaggeredSequence::AddedMass;
    let linear = f.scene.load_shape() == case::LoadShape::Linear
        && f.stages_of(case::StageKind::Coupled).any(|(_, s)| s.substeps > 1);
    let figure = format!("the mass of the fabric is {} of the added mass of the air", percent(ratio));
    let (severity, key) = match (ratio < 1.0, explicit, linear) {
        (true, true, _) => (Warning, "coupling.scheme"),
        (true, false, true) => (Warning, "coupling.load_interpolation"),
        _ => (Note, "fabric.density_kg_m3"),
    };
    vec![Judged::new(severity, key, figure)]
}
