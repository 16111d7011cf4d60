//! Checks of the suspension lines: tension, slack and crossings as cut, length, mass, stretch under the weight.

use std::collections::BTreeMap;

use mesh::{CableKind, Point, StructureMesh};

use super::fabric::safety_factor;
use super::facts::{Facts, digits, percent};
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::table::{Check, When};

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "lines.initial-tension",
        what: "no suspension line is stretched or far too long before anything moves",
        estimate: "tension E A e (1 + 2 e)^1/2 at the Green strain e of each line between its ends as cut; slack \
                   1 - distance / rest length",
        range: "warning where a line carries more than half of its share of the weight (without a descent: a strain \
                above 0.1 %), or is slack by more than 25 %; error above a Green strain of 0.25",
        source: "nylon lines break at 20 to 30 % elongation; the ATPS has inner lines slack by 12 %",
        severity: Error,
        remedy: "lengthen the lines, or move descent.body.attachments_m towards each other: line_length_m is the \
                 length of the longest line where all meet in one point",
        when: When::Before(initial_tension),
    },
    Check {
        id: "lines.crossing",
        what: "suspension lines do not cross each other",
        estimate: "pairs of lines whose chords cross in the horizontal plane",
        range: "warning above 0 pairs",
        source: "geometry: lines of a parachute reach their confluence points in the order of the skirt",
        severity: Warning,
        remedy: "lines take descent.body.attachments_m in turn, in the order of the rim: list one attachment for \
                 each line in that order (repeat a point for the lines that share it), or a single one",
        when: When::Before(crossing),
    },
    Check {
        id: "lines.length",
        what: "lines and risers are as long as those of parachutes",
        estimate: "(mean suspension line + riser) / D_0 with the nominal diameter D_0 = (4 S_0 / pi)^1/2",
        range: "0.5 to 2: warning outside",
        source: "Knacke, Parachute Recovery Systems Design Manual (1992): 0.8 to 1.25 is usual; flat circular \
                 parachutes have 0.6 to 1.5; the ATPS has 0.57",
        severity: Warning,
        remedy: "give canopy.line_length_m in metres",
        when: When::Before(length),
    },
    Check {
        id: "lines.linear-density",
        what: "the lines weigh what cord weighs",
        estimate: "area_m2 x density_kg_m3, kg/m",
        range: "0.0002 to 0.2 kg/m: warning outside",
        source: "MIL-C-5040 cord type I weighs 1.4 g/m, type III 6.6 g/m; heavy webbing 0.1 kg/m",
        severity: Warning,
        remedy: "give area_m2 in m2 (a cord of 2 mm has 3.1e-6) and density_kg_m3 in kg/m3",
        when: When::Before(linear_density),
    },
    Check {
        id: "lines.stretch",
        what: "the lines' strain under the weight lies where their law is valid",
        estimate: "m g / (n E A) for n lines that share the weight",
        range: "warning above 0.1; error above 1",
        source: "nylon cord breaks at 20 to 30 %; an opening shock is 1.1 to 1.8 times the steady load (Knacke)",
        severity: Error,
        remedy: "check descent.payload_mass_kg (kg), lines.youngs_modulus_pa (nylon cord: 5e8 to 5e9 Pa) and \
                 lines.area_m2 (m2)",
        when: When::Before(stretch),
    },
    Check {
        id: "lines.strength",
        what: "the lines carry the weight",
        estimate: "n strength_n / (m g) for n lines that share the weight; only where the scene or its material has a strength",
        range: "warning below 1; below lines.safety_factor the figure says so",
        source: "statics; an opening shock is 1.1 to 1.8 times the steady load (Knacke), and lines do not share it evenly",
        severity: Warning,
        remedy: "choose a stronger lines.material or more lines; give strength_n in N (1 lb is 4.45 N)",
        when: When::Before(strength),
    },
];

/// A suspension line as cut.
struct Line {
    /// Its ends.
    ends: [u32; 2],
    /// Rest length, m.
    rest: f64,
    /// Length along its nodes, m.
    length: f64,
}

impl Line {
    /// Elongation over the rest length; below zero: slack.
    fn elongation(&self) -> f64 {
        self.length / self.rest - 1.0
    }

    fn green_strain(&self) -> f64 {
        let stretch = self.length / self.rest;
        0.5 * (stretch * stretch - 1.0)
    }
}

fn distance(a: Point, b: Point) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// The lines of a kind, each from its cable elements.
fn lines(mesh: &StructureMesh, kind: CableKind) -> Vec<Line> {
    let mut all: BTreeMap<u32, (f64, f64, Vec<u32>)> = BTreeMap::new();
    for c in mesh.cables.iter().filter(|c| c.kind == kind) {
        let [a, b] = c.nodes.map(|n| mesh.coords[n as usize]);
        let (rest, length, ends) = all.entry(c.line).or_default();
        *rest += c.rest_length;
        *length += distance(a, b);
        for n in c.nodes {
            // A node between two elements is no end.
            match ends.iter().position(|e| *e == n) {
                Some(i) => drop(ends.swap_remove(i)),
                None => ends.push(n),
            }
        }
    }
    all.into_values()
        .filter_map(|(rest, length, ends)| Some(Line { ends: ends.try_into().ok()?, rest, length }))
        .collect()
}

fn initial_tension(f: &Facts<'_>) -> Vec<Judged> {
    let Some(material) = &f.scene.lines else { return Vec::new() };
    let all = lines(&f.mesh, CableKind::SuspensionLine);
    let stiffness = material.youngs_modulus_pa * material.area_m2;
    let Some(tautest) = all.iter().max_by(|a, b| a.elongation().total_cmp(&b.elongation())) else {
        return Vec::new();
    };
    let strain = tautest.green_strain().max(0.0);
    let tension = stiffness * strain * (1.0 + 2.0 * strain).sqrt();
    let slackest = all.iter().map(|l| -l.elongation()).fold(0.0, f64::max);
    let share = f.weight() / all.len() as f64;
    let high = if share > 0.0 { tension > 0.5 * share } else { strain > 1e-3 };
    let severity = match (strain > 0.25, high || slackest > 0.25) {
        (true, _) => Error,
        (false, true) => Warning,
        _ => Note,
    };
    let key = if f.scene.payload_body().is_some() { "descent.body.attachments_m" } else { "canopy" };
    let weight =
        if share > 0.0 { format!("; its share of the weight is {} N", digits(share)) } else { String::new() };
    let figure = format!(
        "of {} lines the tautest begins with {} N (elongation {}), the slackest is slack by {}{weight}",
        all.len(),
        digits(tension),
        percent(tautest.elongation().max(0.0)),
        percent(slackest)
    );
    vec![Judged::new(severity, key, figure)]
}

/// Whether the horizontal projections of two segments cross between their ends.
fn cross(a: [Point; 2], b: [Point; 2]) -> bool {
    let side = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    // Segments that only touch have a zero side, to round-off.
    let least = 1e-9 * distance(a[0], a[1]) * distance(b[0], b[1]);
    let apart = |s: f64, t: f64| s * t < 0.0 && s.abs() > least && t.abs() > least;
    apart(side(a[0], a[1], b[0]), side(a[0], a[1], b[1]))
        && apart(side(b[0], b[1], a[0]), side(b[0], b[1], a[1]))
}

fn crossing(f: &Facts<'_>) -> Vec<Judged> {
    let all = lines(&f.mesh, CableKind::SuspensionLine);
    let chords: Vec<[Point; 2]> = all.iter().map(|l| l.ends.map(|n| f.mesh.coords[n as usize])).collect();
    let mut pairs = 0usize;
    let mut first = None;
    for (i, a) in chords.iter().enumerate() {
        for (j, b) in chords.iter().enumerate().skip(i + 1) {
            if cross(*a, *b) {
                pairs += 1;
                first.get_or_insert((i + 1, j + 1));
            }
        }
    }
    let Some((i, j)) = first else { return Vec::new() };
    let body = f.scene.payload_body().is_some();
    let key = if body { "descent.body.attachments_m" } else { "canopy" };
    let figure =
        format!("{pairs} pairs of the {} lines cross each other, first lines {i} and {j}", all.len());
    vec![Judged::new(Warning, key, figure)]
}

fn length(f: &Facts<'_>) -> Vec<Judged> {
    let mean = |kind| {
        let all = lines(&f.mesh, kind);
        all.iter().map(|l| l.rest).sum::<f64>() / all.len().max(1) as f64
    };
    let lines = mean(CableKind::SuspensionLine);
    if !f.is_parachute() || lines == 0.0 {
        return Vec::new();
    }
    let (whole, nominal) = (lines + mean(CableKind::Riser), f.nominal_diameter());
    let ratio = whole / nominal;
    let severity = if (0.5..=2.0).contains(&ratio) { Note } else { Warning };
    let key = match f.scene.canopy {
        case::Canopy::Atps(_) => "canopy.suspension_line_length_m",
        case::Canopy::Gmsh(_) => "canopy.file",
        _ => "canopy.line_length_m",
    };
    let figure = format!(
        "lines and risers of {} m, {} times the nominal diameter of {} m",
        digits(whole),
        digits(ratio),
        digits(nominal)
    );
    vec![Judged::new(severity, key, figure)]
}

fn linear_density(f: &Facts<'_>) -> Vec<Judged> {
    let Some(l) = f.scene.lines.as_ref().filter(|_| f.is_parachute()) else { return Vec::new() };
    let mass = l.area_m2 * l.density_kg_m3;
    let severity = if (2e-4..=0.2).contains(&mass) { Note } else { Warning };
    let figure = format!(
        "the lines weigh {} g/m and are {} mm thick, {} kg in all",
        digits(1e3 * mass),
        digits(1e3 * f.numbers.line_diameter),
        digits(f.numbers.line_mass)
    );
    vec![Judged::new(severity, "lines.area_m2", figure)]
}

fn stretch(f: &Facts<'_>) -> Vec<Judged> {
    let count = lines(&f.mesh, CableKind::SuspensionLine).len();
    let Some(l) = f.scene.lines.as_ref().filter(|_| count > 0 && f.weight() > 0.0) else {
        return Vec::new();
    };
    let strain = f.weight() / (count as f64 * l.youngs_modulus_pa * l.area_m2);
    let severity = if strain > 1.0 {
        Error
    } else if strain > 0.1 {
        Warning
    } else {
        Note
    };
    let figure =
        format!("the weight of {} N stretches {count} lines by {}", digits(f.weight()), percent(strain));
    vec![Judged::new(severity, "lines.youngs_modulus_pa", figure)]
}

fn strength(f: &Facts<'_>) -> Vec<Judged> {
    let count = lines(&f.mesh, CableKind::SuspensionLine).len();
    let material = f.scene.lines.as_ref().filter(|_| count > 0 && f.weight() > 0.0);
    let Some((l, strength)) = material.and_then(|l| Some((l, l.strength_n?))) else { return Vec::new() };
    let share = f.weight() / count as f64;
    let factor = safety_factor(strength / share, l.safety_factor);
    let figure = format!("each of {count} lines carries {} N of the weight: {factor}", digits(share));
    let severity = if strength < share { Warning } else { Note };
    vec![Judged::new(severity, "lines.strength_n", figure)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_cross_or_only_touch() {
        let at = |x: f64, y: f64| [x, y, 7.0 * x];
        assert!(cross([at(0.0, 0.0), at(1.0, 1.0)], [at(0.0, 1.0), at(1.0, 0.0)]));
        // A shared end, an end on the other, one beside the other.
        assert!(!cross([at(0.0, 0.0), at(1.0, 1.0)], [at(0.0, 0.0), at(1.0, 0.0)]));
        assert!(!cross([at(0.0, 0.0), at(1.0, 1.0)], [at(0.5, 0.5), at(1.0, 0.0)]));
        assert!(!cross([at(0.0, 0.0), at(1.0, 1.0)], [at(2.0, 0.0), at(3.0, 1.0)]));
    }
}
