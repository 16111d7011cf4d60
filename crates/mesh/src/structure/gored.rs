//! Canopies of gores: panels from the crown vent to the skirt, sewn along radial seams.
//!
//! In the constructed shape gore k of N lies between the seams at the angles $`2 \pi k / N`$ and $`2 \pi (k + 1) / N`$ and is straight across: at the distance s
//! along its middle line its width is $`w = 2 r \tan(\pi / N)`$, with r the distance of the middle line from the axis. A gore is a flat panel (flat and
//! conical canopies), a chain of flat panels (sections), or one that is curved along its length only (hemispherical), so that the cloth is without stress there. The
//! nominal diameter $`D_0`$ is that of a circle with the area $`S_0`$ of all gores, vent and gaps included (Knacke, Parachute Recovery Systems Design Manual, 1991,
//! chapter 5):
//! ```math
//! S_0 = \tfrac{\pi}{4} D_0^2 = N \int w\, ds = 2 N \tan(\pi / N) \int r\, ds
//! ```
//! The vent counts as the first section continued to the axis.
//!
//! Sails with fullness ([`fullness`]) are straight across only at their seams. Where two of them are joined at the seams alone, their edges enclose a crescent slot.

use std::f64::consts::PI;

use case::{GoreProfile, GoreSection, GoredCanopy, TapePlace, Tapes};

use super::fullness;
use super::suspension::{Payload, Suspension};
use super::{positive, refuse};
use crate::geometry::Point;
use crate::{MeshError, StructureMesh};

/// Nodes of a canopy of gores: rings from the vent to the skirt.
pub(super) struct GoreLayout {
    gores: usize,
    /// Cells across a gore.
    across: usize,
    /// Whether the row between a ring and the next is fabric, not an opening.
    fabric: Vec<bool>,
    /// Nodes of all rings, column by column. The seams pass a slot: both of its rings have their nodes.
    nodes: Vec<u32>,
}

impl GoreLayout {
    pub fn new(p: &GoredCanopy) -> Self {
        let counts = cells(&sections(p), p.cells_along as usize);
        let rows = || sections(p).into_iter().zip(&counts).flat_map(|(s, n)| std::iter::repeat_n(s, *n));
        let (gores, across) = (p.gores as usize, p.cells_per_gore as usize);
        let mut nodes: Vec<u32> = (0..(gores * across) as u32).collect();
        let mut next = nodes.len() as u32;
        for row in rows() {
            for column in 0..gores * across {
                let seam = column % across == 0;
                let above = nodes[nodes.len() - gores * across];
                nodes.push(if is_slot(&row) && seam { above } else { next });
                next = next.max(nodes[nodes.len() - 1] + 1);
            }
        }
        Self { gores, across, fabric: rows().map(|row| !row.gap).collect(), nodes }
    }

    /// Rows of cells along a gore, gaps included.
    fn along(&self) -> usize {
        self.fabric.len()
    }

    /// Columns of nodes around the axis.
    fn columns(&self) -> usize {
        self.gores * self.across
    }

    /// Node in a column, counted around the axis from seam 0, and a ring, counted from the vent.
    pub fn node(&self, column: usize, ring: usize) -> u32 {
        self.nodes[ring * self.columns() + column % self.columns()]
    }

    /// Node of seam `gore` in a ring.
    fn seam(&self, gore: usize, ring: usize) -> u32 {
        self.node(gore * self.across, ring)
    }

    /// Rings at the crown vent and on both sides of each gap.
    fn inner_edges(&self) -> impl Iterator<Item = usize> + '_ {
        let at_gap = |&ring: &usize| self.fabric[ring - 1] != self.fabric[ring];
        std::iter::once(0).chain((1..self.along()).filter(at_gap))
    }
}

/// Whether a section is a slot between two sails: without length, its rings are joined at the seams.
pub(super) fn is_slot(s: &GoreSection) -> bool {
    s.gap && s.length == 0.0
}

/// Sections of the gores, slots among them; a profile of one piece is one section.
fn sections(p: &GoredCanopy) -> Vec<GoreSection> {
    let slot = GoreSection { gap: true, ..GoreSection::default() };
    let with_slot = |s: &GoreSection| s.crescent_slot.then_some(slot).into_iter().chain([*s]);
    match p.profile {
        GoreProfile::Sections => p.sections.iter().flat_map(with_slot).collect(),
        _ => vec![GoreSection {
            length: 1.0,
            angle_deg: p.cone_angle_deg.unwrap_or(0.0),
            ..GoreSection::default()
        }],
    }
}

/// Rows of cells of each section: one of a gap, and `along` of those of fabric together, by their length, at least one each.
fn cells(sections: &[GoreSection], along: usize) -> Vec<usize> {
    let fabric = || sections.iter().enumerate().filter(|(_, s)| !s.gap);
    let total: f64 = fabric().map(|(_, s)| s.length).sum();
    let mut counts = vec![1; sections.len()];
    for _ in fabric().count()..along {
        // The section whose cells are longest.
        let cell = |k: usize| sections[k].length / total / counts[k] as f64;
        let longest = fabric().map(|(k, _)| k).max_by(|&a, &b| cell(a).total_cmp(&cell(b)));
        if let Some(k) = longest {
            counts[k] += 1;
        }
    }
    counts
}

/// Distance from the axis and height of the middle line of the gores at each ring, m. The skirt is at the height 0.
fn rings(p: &GoredCanopy) -> Result<Vec<[f64; 2]>, MeshError> {
    let n = f64::from(p.gores);
    let area = 0.25 * PI * positive("canopy.nominal_diameter_m", p.nominal_diameter_m)?.powi(2);
    // S0 over N tan(pi / N): the integral of 2 r ds.
    let integral = area / (n * (PI / n).tan());
    // From the axis to the middle of a side of the vent, whose corners lie on its circle.
    let vent = 0.5 * p.vent_diameter() * (PI / n).cos();
    let too_wide =
        || Err(refuse("canopy.vent_diameter_m", p.vent_diameter(), "the vent is as wide as the canopy"));
    if p.profile == GoreProfile::Hemispherical {
        let radius = (0.5 * integral).sqrt();
        if vent >= radius {
            return too_wide();
        }
        let first = (vent / radius).asin();
        let at = |ring: u32| {
            let angle = first + f64::from(ring) / f64::from(p.cells_along) * (0.5 * PI - first);
            [radius * angle.sin(), radius * angle.cos()]
        };
        return Ok((0..=p.cells_along).map(at).collect());
    }
    let sections = sections(p);
    let scale = scale(&sections, vent, integral).filter(|s| *s > 0.0);
    let Some(scale) = scale else { return too_wide() };
    let mut at = vec![[vent, 0.0]];
    for (s, cells) in sections.iter().zip(cells(&sections, p.cells_along as usize)) {
        let [r, z] = at[at.len() - 1];
        let (sin, cos) = s.angle_deg.to_radians().sin_cos();
        let length = |i: usize| scale * s.length * i as f64 / cells as f64;
        at.extend((1..=cells).map(|i| [r + length(i) * cos, z - length(i) * sin]));
    }
    let least = at.iter().map(|x| x[0]).fold(f64::INFINITY, f64::min);
    if least < 0.5 * vent {
        let reason =
            format!("the gores come within {least:.4} m of the axis, nearer than half the vent's radius");
        return Err(refuse("canopy.section", "[[canopy.section]]", reason));
    }
    let skirt = at[at.len() - 1][1];
    at.iter_mut().for_each(|x| x[1] -= skirt);
    Ok(at)
}

/// The factor on the lengths of `sections` with which the integral of 2 r ds from the axis has the value `integral` (m2): a root of
/// $`A \lambda^2 + B \lambda + C = 0`$ with $`r = r_v + \lambda \sum l \cos\mu`$. `None` where the area falls as lengths grow, or the vent has it all.
fn scale(sections: &[GoreSection], vent: f64, integral: f64) -> Option<f64> {
    let (mut a, mut b, mut out) = (0.0, 0.0, 0.0);
    for s in sections {
        let cos = s.angle_deg.to_radians().cos();
        a += s.length * (2.0 * out + cos * s.length);
        b += 2.0 * vent * s.length;
        out += cos * s.length;
    }
    let c = vent * vent / sections.first()?.angle_deg.to_radians().cos() - integral;
    // The smaller positive root, without the difference of two large numbers: B > 0, C < 0.
    let root = (b * b - 4.0 * a * c).sqrt();
    let scale = -2.0 * c / (b + root);
    scale.is_finite().then_some(scale)
}

/// Fabric, lines and payload.
pub(super) fn gored(p: &GoredCanopy, payload: &Payload<'_>) -> Result<StructureMesh, MeshError> {
    let layout = GoreLayout::new(p);
    let mut mesh = StructureMesh::default();
    // A seam that passes a slot has its node already.
    let add = |mesh: &mut StructureMesh, node: u32, x: Point| {
        if node as usize == mesh.coords.len() {
            mesh.coords.push(x);
        }
    };
    let sails = fullness::edges(&sections(p), &cells(&sections(p), p.cells_along as usize));
    for (ring, [r, z]) in rings(p)?.into_iter().enumerate() {
        // Seams are as far from the axis as the corners of a polygon, the cloth between them is straight.
        let corner = |gore: usize| {
            let angle = 2.0 * PI * gore as f64 / layout.gores as f64;
            [angle.cos(), angle.sin()].map(|x| x * r / (PI / layout.gores as f64).cos())
        };
        for gore in 0..layout.gores {
            let [a, b] = [corner(gore), corner(gore + 1)];
            if let Some(edge) = sails.get(ring).filter(|e| e.fullness > 0.0) {
                let [a, b] = [a, b].map(|x| [x[0], x[1], z]);
                for (i, x) in edge.nodes(a, b, layout.across).enumerate() {
                    add(&mut mesh, layout.node(gore * layout.across + i, ring), x);
                }
                continue;
            }
            for i in 0..layout.across {
                let t = i as f64 / layout.across as f64;
                let x = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), z];
                add(&mut mesh, layout.node(gore * layout.across + i, ring), x);
            }
        }
    }
    mesh.n_canopy = mesh.coords.len();
    for column in 0..layout.columns() {
        let (gore, i) = (column / layout.across, column % layout.across);
        for ring in (0..layout.along()).filter(|&ring| layout.fabric[ring]) {
            let at = |c: usize, r: usize| layout.node(column + c, ring + r);
            // Mirrored about the middle of the gore.
            let straight = 2 * i < layout.across;
            mesh.push_quad([at(0, 0), at(0, 1), at(1, 1), at(1, 0)], gore as u32, straight);
        }
    }
    let ends: Vec<u32> = (0..layout.gores).map(|gore| layout.seam(gore, layout.along())).collect();
    let skirt = mesh.coords[ends[0] as usize];
    Suspension {
        ends: &ends,
        reach: (skirt[0].hypot(skirt[1]), "the radius of the skirt"),
        length: p.line_length_m,
        segments: p.segments_per_line,
        risers: p.risers.as_ref(),
        payload,
    }
    .add(&mut mesh)?;
    Ok(mesh)
}

impl StructureMesh {
    /// Tapes of a canopy of gores: the skirt band (`hem`), bands at the vent and at the edges of gaps and slots (`vents`), and the radials along the seams over gaps, each
    /// of which runs on as a vent line to the seam on the other side (`seams`).
    pub(super) fn tape_gores(&mut self, p: &GoredCanopy, tapes: &Tapes) {
        let layout = GoreLayout::new(p);
        let nodes = |ring: usize| {
            (0..=layout.columns()).map(move |column| (column, ring)).map(|(c, r)| layout.node(c, r))
        };
        if tapes.hem.is_some() {
            self.tape(TapePlace::Hem, nodes(layout.along()));
        }
        if tapes.vents.is_some() {
            layout.inner_edges().for_each(|ring| self.tape(TapePlace::Vents, nodes(ring)));
        }
        if tapes.seams.is_some() {
            for gore in 0..layout.gores / 2 {
                let other = gore + layout.gores / 2;
                let up = (0..=layout.along()).rev().map(|ring| layout.seam(gore, ring));
                let down = (0..=layout.along()).map(|ring| layout.seam(other, ring));
                let mut radial: Vec<u32> = up.chain(down).collect();
                radial.dedup();
                self.tape(TapePlace::Seams, radial.into_iter());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use case::{Canopy, Tape};

    use super::*;
    use crate::structure::tests::scene;
    use crate::{CableKind, structure_mesh};

    fn canopy(profile: GoreProfile) -> GoredCanopy {
        GoredCanopy {
            profile,
            sections: Vec::new(),
            nominal_diameter_m: 8.53,
            gores: 28,
            vent_diameter_m: Some(0.85),
            cone_angle_deg: (profile == GoreProfile::Conical).then_some(25.0),
            cells_per_gore: 2,
            cells_along: 10,
            line_length_m: 7.0,
            segments_per_line: 1,
            risers: None,
        }
    }

    const PROFILES: [GoreProfile; 3] = [GoreProfile::Flat, GoreProfile::Conical, GoreProfile::Hemispherical];

    /// Area of a regular polygon whose corners lie on a circle of diameter d.
    fn polygon(gores: f64, d: f64) -> f64 {
        0.125 * gores * d * d * (2.0 * PI / gores).sin()
    }

    /// The fabric has the area of the nominal diameter less that of the vent, gores have equal shares, and faces look up. The chords of a hemisphere along its
    /// meridians lose $`h^2 / 8`$ of the area, with the angle h of a cell.
    #[test]
    fn area_is_that_of_the_nominal_diameter() {
        for (profile, cells) in PROFILES.into_iter().flat_map(|p| [(p, 10), (p, 20)]) {
            let p = GoredCanopy { cells_along: cells, ..canopy(profile) };
            let mesh = structure_mesh(&scene(Canopy::Gored(p.clone()))).unwrap();
            let nominal = 0.25 * PI * p.nominal_diameter_m.powi(2);
            let cone = p.cone_angle_deg.unwrap_or(0.0).to_radians();
            let vent = polygon(28.0, 0.85) / cone.cos();
            let area = mesh.fabric_area(|_| true);
            let chords = match profile {
                GoreProfile::Hemispherical => (1.43 / f64::from(cells)).powi(2) / 8.0,
                _ => 0.0,
            };
            let error = (area + vent) / nominal - 1.0 + chords;
            assert!(error.abs() < 1e-12 + 0.1 * chords, "{profile:?}, {cells}: {error} {chords}");
            assert!((mesh.fabric_area(|gore| gore == 5) * 28.0 / area - 1.0).abs() < 1e-12);
            assert_eq!(mesh.faces.len(), 28 * 2 * cells as usize);
            let up = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|n| crate::geometry::at(&mesh.coords, n));
                (b - a).cross(&(c - a)).z > 0.0
            };
            assert!(mesh.triangles.iter().all(up));
        }
    }

    /// Seams lie on circles, the skirt at the height 0, the vent is open with its diameter, and lines are taut in the shape as cut.
    #[test]
    fn shape_is_as_constructed() {
        for (profile, height) in PROFILES.into_iter().zip([0.0, 1.64, 2.9]) {
            let p = canopy(profile);
            let mesh = structure_mesh(&scene(Canopy::Gored(p.clone()))).unwrap();
            let layout = GoreLayout::new(&p);
            let at = |gore: usize, ring: usize| mesh.coords[layout.seam(gore, ring) as usize];
            for gore in [0, 3, 17] {
                let [vent, skirt] = [at(gore, 0), at(gore, 10)];
                assert!((2.0 * vent[0].hypot(vent[1]) - 0.85).abs() < 1e-12, "{vent:?}");
                assert!(skirt[2].abs() < 1e-12 && (vent[2] - height).abs() < 0.1, "{profile:?} {vent:?}");
            }
            assert_eq!(mesh.skirt().len(), 28);
            let taut = |c: &crate::Cable| {
                let [a, b] = c.nodes.map(|n| mesh.coords[n as usize]);
                let l = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
                (l - c.rest_length).abs()
            };
            assert_eq!(mesh.cables.len(), 28);
            assert!(mesh.cables.iter().all(|c| taut(c) < 1e-12));
        }
    }

    /// Lengths of the bands and radials; radials cross the vent.
    #[test]
    fn tapes_follow_skirt_vent_and_seams() {
        let p = canopy(GoreProfile::Flat);
        let mut with = scene(Canopy::Gored(p));
        let tape = Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..Tape::default() });
        with.tapes = Some(Tapes { hem: tape, seams: tape, vents: tape, ..Tapes::default() });
        let mesh = structure_mesh(&with).unwrap();
        let length = |place| mesh.cable_length(CableKind::Tape(place));
        let side = |d: f64| 28.0 * d * (PI / 28.0).sin();
        let skirt = {
            let x = mesh.coords[(10 * 56) as usize];
            2.0 * x[0].hypot(x[1])
        };
        assert!((length(TapePlace::Hem) - side(skirt)).abs() < 1e-9);
        assert!((length(TapePlace::Vents) - side(0.85)).abs() < 1e-9);
        assert!((length(TapePlace::Seams) - 14.0 * skirt).abs() < 1e-9);
    }

    #[test]
    fn canopies_that_cannot_be_sewn_are_refused() {
        let refused = |change: &dyn Fn(&mut GoredCanopy)| {
            let mut p = canopy(GoreProfile::Flat);
            change(&mut p);
            structure_mesh(&scene(Canopy::Gored(p))).unwrap_err().to_string()
        };
        assert!(refused(&|p| p.line_length_m = 4.0).contains("the radius of the skirt"));
        assert!(refused(&|p| p.vent_diameter_m = Some(9.0)).contains("as wide as the canopy"));
    }

    /// A disk-gap-band canopy: areas of disk and band are those of the drawing, the gap has none, the lengths keep their ratios, and the nominal
    /// area includes vent and gap. Dimensions of the parachute of Tianwen-1 (D0 15.96 m, disk 11.53 m, vent 1.12 m, gap 0.69 m, band 1.94 m).
    #[test]
    fn sections_with_a_gap_make_a_disk_gap_band() {
        let section =
            |length, angle_deg, gap| GoreSection { length, angle_deg, gap, ..GoreSection::default() };
        let p = GoredCanopy {
            profile: GoreProfile::Sections,
            sections: vec![
                section(0.5 * (11.53 - 1.12), 0.0, false),
                section(0.69, 90.0, true),
                section(1.94, 90.0, false),
            ],
            nominal_diameter_m: 15.96,
            gores: 48,
            vent_diameter_m: Some(1.12),
            cells_along: 9,
            line_length_m: 27.15,
            ..canopy(GoreProfile::Flat)
        };
        let mut with = scene(Canopy::Gored(p.clone()));
        let tape = Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..Tape::default() });
        with.tapes = Some(Tapes { seams: tape, vents: tape, ..Tapes::default() });
        let mesh = structure_mesh(&with).unwrap();
        let layout = GoreLayout::new(&p);
        assert_eq!(layout.fabric, [vec![true; 6], vec![false], vec![true; 3]].concat());
        assert_eq!(mesh.faces.len(), 48 * 2 * 9);
        let at = rings(&p).unwrap();
        let [disk, gap, band] = [at[6], at[7], at[10]];
        let width = 2.0 * 48.0 * (PI / 48.0).tan();
        let nominal = 0.5 * width * disk[0] * disk[0] + width * disk[0] * (disk[1] - band[1]);
        assert!((nominal / (0.25 * PI * 15.96 * 15.96) - 1.0).abs() < 1e-12);
        let ratio = (disk[1] - gap[1]) / (gap[1] - band[1]);
        assert!((ratio - 0.69 / 1.94).abs() < 1e-12 && (gap[0] - disk[0]).abs() < 1e-12);
        // The drawing closes: its own lengths give its nominal diameter within 1 %.
        assert!((2.0 * disk[0] / (PI / 48.0).cos() / 11.53 - 1.0).abs() < 0.01, "{disk:?}");
        let fabric = nominal - polygon(48.0, 1.12) - width * disk[0] * (disk[1] - gap[1]);
        assert!((mesh.fabric_area(|_| true) / fabric - 1.0).abs() < 1e-12);
        // Radials cross the gap, and bands lie at the vent and at both edges of it.
        let length = |place| mesh.cable_length(CableKind::Tape(place));
        let corner = 1.0 / (PI / 48.0).cos();
        let radial = disk[0] * corner + disk[1] - band[1];
        assert!((length(TapePlace::Seams) / (48.0 * radial) - 1.0).abs() < 1e-12);
        assert!((length(TapePlace::Vents) / (width * (at[0][0] + 2.0 * disk[0])) - 1.0).abs() < 1e-12);
    }

    /// An extended skirt: the widest ring is where the skirt begins, which runs inwards. Cells go by length.
    #[test]
    fn extended_skirt_runs_inwards() {
        let section = |length, angle_deg| GoreSection { length, angle_deg, ..GoreSection::default() };
        let p = GoredCanopy {
            profile: GoreProfile::Sections,
            sections: vec![section(4.0, 0.0), section(0.4, 120.0)],
            cells_along: 6,
            ..canopy(GoreProfile::Flat)
        };
        let at = rings(&p).unwrap();
        assert_eq!(at.len(), 7);
        assert!(at[5][0] > at[6][0] && at[5][1] > at[6][1] && at[6][1] == 0.0, "{at:?}");
        let inwards = (at[5][0] - at[6][0]) / (at[5][1] - at[6][1]);
        assert!((inwards - 30_f64.to_radians().tan()).abs() < 1e-12);
        let nominal: f64 =
            at.windows(2).map(|w| (w[0][0] + w[1][0]) * (w[0][0] - w[1][0]).hypot(w[0][1] - w[1][1])).sum();
        let n = 28.0;
        let whole = n * (PI / n).tan() * (nominal + at[0][0] * at[0][0]);
        assert!((whole / (0.25 * PI * 8.53 * 8.53) - 1.0).abs() < 1e-12);
        let folded = GoredCanopy { sections: vec![section(4.0, 0.0), section(9.0, 170.0)], ..p };
        let error = structure_mesh(&scene(Canopy::Gored(folded))).unwrap_err().to_string();
        assert!(error.contains("of the axis"), "{error}");
    }
}
