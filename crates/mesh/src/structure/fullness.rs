//! Fullness of sails: edges of the cloth that are longer than the gore is wide.
//!
//! A gore of the width w between its seams has at a ring the edge length $`w (1 + f)`$ with the fullness f, linear along a section between its upper and lower edge.
//! The n cells across lie on an arc between the seams, outwards and normal to the gore, with n equal chords:
//! ```math
//! \frac{n \sin(\alpha / n)}{\sin\alpha} = 1 + f
//! ```
//! with half the angle of the arc $`\alpha`$. The shape as cut is thus a canopy whose sails bulge as if they were slightly inflated: every edge has its length, the cloth is
//! without stress, and seams lie where they lie without fullness.

use std::f64::consts::PI;

use case::GoreSection;

use super::gored::is_slot;
use crate::geometry::{Point, Vec3};

/// A ring of nodes across a gore.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    /// Length over the width of the gore, less 1.
    pub fullness: f64,
    /// Angle of the gore below the horizontal, the mean of the sections at the ring, rad.
    angle: f64,
}

/// Fullness at each ring of `sections` with these numbers of `cells` along them. A ring at a gap is that of the fabric next to it. Both edges of a slot bulge
/// along one normal, so that they do not cross.
pub(super) fn edges(sections: &[GoreSection], cells: &[usize]) -> Vec<Edge> {
    let mut all: Vec<Edge> = Vec::new();
    let radians = |k: usize| sections[k].angle_deg.to_radians();
    for (k, (s, &cells)) in sections.iter().zip(cells).enumerate() {
        let slot = is_slot(s);
        let angle = if slot { 0.5 * (radians(k - 1) + radians(k + 1)) } else { radians(k) };
        let at = |i: usize| {
            let t = i as f64 / cells as f64;
            s.upper_fullness + t * (s.lower_fullness - s.upper_fullness)
        };
        if let Some(first) = all.last_mut() {
            // Fabric on both sides has one fullness; a gap has none.
            first.fullness = first.fullness.max(at(0));
            first.angle = match k.checked_sub(1).is_some_and(|above| is_slot(&sections[above])) {
                true => first.angle,
                false if slot => angle,
                false => 0.5 * (first.angle + angle),
            };
        } else {
            all.push(Edge { fullness: at(0), angle });
        }
        all.extend((1..=cells).map(|i| Edge { fullness: at(i), angle }));
    }
    all
}

impl Edge {
    /// Nodes across the gore from the seam at `a` up to that at `b`, which is the first of the next gore, in `cells` equal chords.
    pub fn nodes(&self, a: Point, b: Point, cells: usize) -> impl Iterator<Item = Point> {
        let [a, b] = [a, b].map(Vec3::from);
        let half = 0.5 * (b - a);
        let middle = 0.5 * (a + b);
        let radial = Vec3::new(middle.x, middle.y, 0.0).normalize();
        let normal = radial * self.angle.sin() + Vec3::new(0.0, 0.0, self.angle.cos());
        let alpha = half_angle(self.fullness, cells);
        let place = move |i: usize| {
            if i == 0 {
                return a.into();
            }
            let theta = alpha * (2.0 * i as f64 / cells as f64 - 1.0);
            let [along, out] = [theta.sin(), theta.cos() - alpha.cos()].map(|x| x / alpha.sin());
            (middle + half * along + normal * (out * half.norm())).into()
        };
        (0..cells).map(place)
    }
}

/// Half the angle (rad) of an arc whose `cells` equal chords are longer than its chord by the share `fullness`.
fn half_angle(fullness: f64, cells: usize) -> f64 {
    let n = cells as f64;
    let excess = |alpha: f64| n * (alpha / n).sin() / alpha.sin() - 1.0;
    // It grows with the angle, from 0 to infinity at half a turn.
    let (mut low, mut high) = (0.0, PI);
    while let middle = 0.5 * (low + high)
        && low < middle
        && middle < high
    {
        if excess(middle) < fullness {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use case::{Canopy, GoreProfile, GoredCanopy, TapePlace, Tapes};

    use super::*;
    use crate::structure::tests::scene;
    use crate::{CableKind, StructureMesh, geometry::at, structure_mesh};

    const GORES: f64 = 24.0;

    fn section(length: f64, angle_deg: f64, fullness: [f64; 2]) -> GoreSection {
        let [upper_fullness, lower_fullness] = fullness;
        GoreSection { length, angle_deg, upper_fullness, lower_fullness, ..GoreSection::default() }
    }

    fn canopy(sections: Vec<GoreSection>, cells_per_gore: u32) -> GoredCanopy {
        GoredCanopy {
            profile: GoreProfile::Sections,
            sections,
            nominal_diameter_m: 8.0,
            gores: 24,
            vent_diameter_m: Some(0.8),
            cone_angle_deg: None,
            cells_per_gore,
            cells_along: 8,
            line_length_m: 8.0,
            segments_per_line: 1,
            risers: None,
        }
    }

    fn meshed(p: &GoredCanopy) -> StructureMesh {
        structure_mesh(&scene(Canopy::Gored(p.clone()))).unwrap()
    }

    /// Length of ring `ring`, m, and distance of its seams.
    fn ring(mesh: &StructureMesh, p: &GoredCanopy, ring: usize) -> [f64; 2] {
        let columns = (p.gores * p.cells_per_gore) as usize;
        let node = |c: usize| at(&mesh.coords, (ring * columns + c % columns) as u32);
        let around =
            |step: usize| (0..columns).step_by(step).map(|c| (node(c) - node(c + step)).norm()).sum::<f64>();
        [around(1), around(p.cells_per_gore as usize)]
    }

    /// Edges of every ring are longer than the gores are wide by their fullness, all cells across have one length, seams stay, and no face is turned or flat.
    #[test]
    fn edges_have_their_fullness() {
        for cells in [2, 4, 6] {
            let full = canopy(vec![section(3.0, 20.0, [0.0, 0.04]), section(1.0, 60.0, [0.04, 0.12])], cells);
            let straight = canopy(vec![section(3.0, 20.0, [0.0; 2]), section(1.0, 60.0, [0.0; 2])], cells);
            let [a, b] = [&full, &straight].map(meshed);
            for (k, fullness) in [0.0, 0.04 / 6.0, 0.04 / 3.0, 0.02, 0.08 / 3.0, 0.1 / 3.0, 0.04, 0.08, 0.12]
                .into_iter()
                .enumerate()
            {
                let ([edge, width], [straight, _]) = (ring(&a, &full, k), ring(&b, &straight, k));
                assert!((width / straight - 1.0).abs() < 1e-12, "{cells} {k}");
                assert!((edge / width - 1.0 - fullness).abs() < 1e-12, "{cells} {k}: {}", edge / width);
            }
            let columns = (24 * cells) as usize;
            let last = |c: usize| at(&a.coords, (8 * columns + c) as u32);
            let chords: Vec<f64> = (0..cells as usize).map(|c| (last(c) - last(c + 1)).norm()).collect();
            assert!(chords.iter().all(|c| (c / chords[0] - 1.0).abs() < 1e-12), "{chords:?}");
            assert_eq!((a.skirt(), a.n_canopy), (b.skirt(), b.n_canopy));
            let areas = a.triangles.iter().zip(&b.triangles).map(|(s, t)| {
                let area = |m: &StructureMesh, t: &[u32; 3]| {
                    let [x, y, z] = t.map(|n| at(&m.coords, n));
                    (y - x).cross(&(z - x))
                };
                area(&a, s).dot(&area(&b, t)) / area(&b, t).norm_squared()
            });
            assert!(areas.into_iter().all(|ratio| ratio > 0.7));
        }
    }

    /// The cloth of a cylindrical band with one fullness has the area of the straight band times the longer edge, and is bulged outwards.
    #[test]
    fn area_of_a_full_band_is_exact() {
        for (cells, fullness) in [(2, 0.1), (4, 0.1), (4, 0.5)] {
            let flat = section(3.0, 0.0, [0.0; 2]);
            let gap = GoreSection { length: 0.2, angle_deg: 90.0, gap: true, ..GoreSection::default() };
            let band = |fullness| {
                let p = canopy(vec![flat, gap, section(1.0, 90.0, [fullness; 2])], cells);
                let mut s = scene(Canopy::Gored(p.clone()));
                let tape =
                    Some(case::Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..case::Tape::default() });
                s.tapes = Some(Tapes { hem: tape, seams: tape, ..Tapes::default() });
                structure_mesh(&s).unwrap()
            };
            let [full, straight] = [fullness, 0.0].map(band);
            let disk = straight.fabric_area(|_| true);
            let width = straight.cable_length(CableKind::Tape(TapePlace::Hem));
            let hem = full.cable_length(CableKind::Tape(TapePlace::Hem));
            assert!((hem / width - 1.0 - fullness).abs() < 1e-12);
            let seams = |m: &StructureMesh| m.cable_length(CableKind::Tape(TapePlace::Seams));
            assert!((seams(&full) - seams(&straight)).abs() < 1e-12);
            // Height of the band by the drawing.
            let columns = (24 * cells) as usize;
            let z = |ring: usize| straight.coords[ring * columns][2];
            let height = z(straight.n_canopy / columns - 3) - z(straight.n_canopy / columns - 1);
            let more = full.fabric_area(|_| true) - disk;
            assert!((more / (fullness * width * height) - 1.0).abs() < 1e-9, "{more} {height}");
            let reach = |m: &StructureMesh| {
                m.coords[..m.n_canopy].iter().map(|x| x[0].hypot(x[1])).fold(0.0, f64::max)
            };
            assert!(reach(&full) > reach(&straight) + 0.01 / GORES);
        }
    }

    fn has_flat_faces(mesh: &StructureMesh) -> bool {
        mesh.triangles.iter().any(|t| {
            let [a, b, c] = t.map(|n| at(&mesh.coords, n));
            (b - a).cross(&(c - a)).norm() < 1e-6
        })
    }

    /// Two sails that are joined at the seams alone: their edges are as long as their fullness says and lie in one plane, the slot between them has the area of the two polygons,
    /// seams run through, and tapes follow both edges. The cloth is that of sails with a gap between them.
    #[test]
    fn a_slot_opens_between_two_edges() {
        for (cells, [upper, lower]) in [(2, [0.1, 0.0]), (4, [0.12, 0.02]), (6, [0.05, 0.2])] {
            let slotted = canopy(
                vec![
                    section(2.0, 20.0, [0.0, upper]),
                    GoreSection { crescent_slot: true, ..section(2.0, 50.0, [lower, 0.0]) },
                ],
                cells,
            );
            let mut s = scene(Canopy::Gored(slotted.clone()));
            let tape = Some(case::Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..case::Tape::default() });
            s.tapes = Some(Tapes { vents: tape, seams: tape, ..Tapes::default() });
            let mesh = structure_mesh(&s).unwrap();
            let (gores, cells) = (24, cells as usize);
            let columns = gores * cells;
            // A whole ring more, less the nodes of the seams.
            assert_eq!(mesh.n_canopy, 9 * columns + columns - gores);
            let layout = super::super::gored::GoreLayout::new(&slotted);
            let edge = |ring: usize| -> Vec<Vec3> {
                (0..=cells).map(|c| at(&mesh.coords, layout.node(c, ring))).collect()
            };
            let [above, below] = [edge(4), edge(5)];
            assert_eq!([above[0], above[cells]], [below[0], below[cells]]);
            let width = (above[cells] - above[0]).norm();
            let area =
                |x: &[Vec3]| x.windows(2).map(|p| 0.5 * (p[0] - x[0]).cross(&(p[1] - x[0]))).sum::<Vec3>();
            let segment = |fullness: f64| {
                if fullness == 0.0 {
                    return 0.0;
                }
                let (alpha, n) = (half_angle(fullness, cells), cells as f64);
                let radius = 0.5 * width / alpha.sin();
                0.5 * radius * radius * (n * (2.0 * alpha / n).sin() - (2.0 * alpha).sin())
            };
            let exact = segment(upper) - segment(lower);
            let open = area(&above).norm() - area(&below).norm();
            assert!(
                exact.abs() > 0.01 * width * width && (open / exact - 1.0).abs() < 1e-9,
                "{cells}: {open} {exact}"
            );
            // In one plane: the areas are parallel.
            assert!(area(&above).cross(&area(&below)).norm() < 1e-12);
            // Along the mean of the normals of both sails, 35 degrees below the horizontal.
            let bulge = above[cells / 2] - 0.5 * (above[0] + above[cells]);
            if upper > 0.0 {
                let slope = bulge.xy().norm() / bulge.z;
                assert!((slope - 35_f64.to_radians().tan()).abs() < 1e-9, "{slope}");
            }
            let length = |x: &[Vec3]| x.windows(2).map(|p| (p[1] - p[0]).norm()).sum::<f64>();
            for (x, fullness) in [(&above, upper), (&below, lower)] {
                assert!((length(x) / width - 1.0 - fullness).abs() < 1e-12);
            }
            let tapes = |place| mesh.cable_length(CableKind::Tape(place));
            let vent = length(&edge(0));
            let bands = gores as f64 * (vent + length(&above) + length(&below));
            assert!((tapes(TapePlace::Vents) / bands - 1.0).abs() < 1e-12);
            let rings: Vec<Vec3> = (0..=9).map(|ring| at(&mesh.coords, layout.node(0, ring))).collect();
            let radial = gores as f64 * (length(&rings) + rings[0].xy().norm());
            assert!((tapes(TapePlace::Seams) / radial - 1.0).abs() < 1e-12);
            assert!(!has_flat_faces(&mesh));
            assert_eq!(mesh.faces.len(), 8 * columns);
        }
    }

    /// Half angles by hand: two chords are longer than their sum of projections by 1 over the cosine of half the angle.
    #[test]
    fn two_chords_are_a_tent() {
        assert!((half_angle(0.25, 2) - 2.0 * (0.8_f64).acos()).abs() < 1e-12);
        // Many chords are an arc: alpha over sin alpha, pi / 2 at a quarter of a turn.
        assert!((half_angle(0.5 * PI - 1.0, 100_000) - 0.5 * PI).abs() < 1e-6);
    }
}
