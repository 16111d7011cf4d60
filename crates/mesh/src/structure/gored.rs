//! Canopies of gores: panels from the crown vent to the skirt, sewn along radial seams.
//!
//! In the constructed shape gore k of N lies between the seams at the angles $`2 \pi k / N`$ and $`2 \pi (k + 1) / N`$ and is straight across: at the distance s
//! along its middle line its width is $`w = 2 r \tan(\pi / N)`$, with r the distance of the middle line from the axis. A gore is a flat panel (flat and
//! conical canopies) or one that is curved along its length only (hemispherical), so that the cloth is without stress there. The nominal diameter $`D_0`$ is that of
//! a circle with the area $`S_0`$ of all gores, vent included (Knacke, Parachute Recovery Systems Design Manual, 1991, chapter 5):
//! ```math
//! S_0 = \tfrac{\pi}{4} D_0^2 = N \int w\, ds =
//!   N \tan(\pi / N) \begin{cases} s_m^2 \cos\mu & \text{flat } (\mu = 0) \text{ and conical} \\ 2 R^2 & \text{hemispherical} \end{cases}
//! ```

use std::f64::consts::PI;

use case::{GoreProfile, GoredCanopy, TapePlace, Tapes};

use super::{positive, refuse};
use crate::geometry::Point;
use crate::{CableKind, MeshError, StructureMesh};

/// Nodes of a canopy of gores: rings from the vent to the skirt.
pub(super) struct GoreLayout {
    gores: usize,
    /// Cells across a gore and along it.
    across: usize,
    along: usize,
}

impl GoreLayout {
    pub fn new(p: &GoredCanopy) -> Self {
        let [gores, across, along] = [p.gores, p.cells_per_gore, p.cells_along].map(|n| n as usize);
        Self { gores, across, along }
    }

    /// Columns of nodes around the axis.
    fn columns(&self) -> usize {
        self.gores * self.across
    }

    /// Node in a column, counted around the axis from seam 0, and a ring, counted from the vent.
    fn node(&self, column: usize, ring: usize) -> u32 {
        (ring * self.columns() + column % self.columns()) as u32
    }

    /// Node of seam `gore` in a ring.
    fn seam(&self, gore: usize, ring: usize) -> u32 {
        self.node(gore * self.across, ring)
    }
}

/// Middle line of the gores.
struct MiddleLine {
    profile: GoreProfile,
    /// Its angle below the horizontal, and the radius of a hemisphere, m.
    cone: f64,
    radius: f64,
    /// Its places at the vent and at the skirt: distance from the apex, m; of a hemisphere the angle from the axis.
    ends: [f64; 2],
}

impl MiddleLine {
    fn new(p: &GoredCanopy) -> Result<Self, MeshError> {
        let n = f64::from(p.gores);
        let area = 0.25 * PI * positive("canopy.nominal_diameter_m", p.nominal_diameter_m)?.powi(2);
        let cone = p.cone_angle_deg.unwrap_or(0.0).to_radians();
        let shares = n * (PI / n).tan();
        // From the axis to the middle of a side of the vent, whose corners lie on its circle.
        let vent = 0.5 * p.vent_diameter() * (PI / n).cos();
        let radius = (area / (2.0 * shares)).sqrt();
        let ends = match p.profile {
            GoreProfile::Flat | GoreProfile::Conical => {
                [vent / cone.cos(), (area / (shares * cone.cos())).sqrt()]
            }
            GoreProfile::Hemispherical => [(vent / radius).min(1.0).asin(), 0.5 * PI],
        };
        if ends[0] >= ends[1] {
            return Err(refuse(
                "canopy.vent_diameter_m",
                p.vent_diameter(),
                "the vent is as wide as the canopy",
            ));
        }
        Ok(Self { profile: p.profile, cone, radius, ends })
    }

    /// Distance from the axis and height at the share `t` of the way from the vent to the skirt, m. The skirt is at the height 0.
    fn at(&self, t: f64) -> [f64; 2] {
        let [vent, skirt] = self.ends;
        let s = vent + t * (skirt - vent);
        match self.profile {
            GoreProfile::Flat | GoreProfile::Conical => [s * self.cone.cos(), (skirt - s) * self.cone.sin()],
            GoreProfile::Hemispherical => [self.radius * s.sin(), self.radius * s.cos()],
        }
    }
}

/// Fabric, lines and payload.
pub(super) fn gored(p: &GoredCanopy, payload_mass: Option<f64>) -> Result<StructureMesh, MeshError> {
    let layout = GoreLayout::new(p);
    let middle = MiddleLine::new(p)?;
    let mut mesh = StructureMesh::default();
    for ring in 0..=layout.along {
        let [r, z] = middle.at(ring as f64 / layout.along as f64);
        // Seams are as far from the axis as the corners of a polygon, the cloth between them is straight.
        let corner = |gore: usize| {
            let angle = 2.0 * PI * gore as f64 / layout.gores as f64;
            [angle.cos(), angle.sin()].map(|x| x * r / (PI / layout.gores as f64).cos())
        };
        for gore in 0..layout.gores {
            let [a, b] = [corner(gore), corner(gore + 1)];
            for i in 0..layout.across {
                let t = i as f64 / layout.across as f64;
                mesh.coords.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), z]);
            }
        }
    }
    mesh.n_canopy = mesh.coords.len();
    for column in 0..layout.columns() {
        let (gore, i) = (column / layout.across, column % layout.across);
        for ring in 0..layout.along {
            let at = |c: usize, r: usize| layout.node(column + c, ring + r);
            // Mirrored about the middle of the gore.
            let straight = 2 * i < layout.across;
            mesh.push_quad([at(0, 0), at(0, 1), at(1, 1), at(1, 0)], gore as u32, straight);
        }
    }
    add_lines(p, &layout, payload_mass, &mut mesh)?;
    Ok(mesh)
}

/// One line from each seam at the skirt to the confluence point below the canopy.
fn add_lines(
    p: &GoredCanopy,
    layout: &GoreLayout,
    payload_mass: Option<f64>,
    mesh: &mut StructureMesh,
) -> Result<(), MeshError> {
    let length = positive("canopy.line_length_m", p.line_length_m)?;
    let skirt: Point = mesh.coords[layout.seam(0, layout.along) as usize];
    let reach = skirt[0].hypot(skirt[1]);
    if length <= reach {
        return Err(refuse(
            "canopy.line_length_m",
            length,
            format!("must exceed {reach:.4} m, the radius of the skirt"),
        ));
    }
    let payload = mesh.push_node([0.0, 0.0, skirt[2] - (length * length - reach * reach).sqrt()]);
    for gore in 0..layout.gores {
        let ends = [layout.seam(gore, layout.along), payload];
        mesh.push_line(ends, length, p.segments_per_line as usize, CableKind::SuspensionLine, gore as u32);
    }
    mesh.fixed.push((payload, [true; 3]));
    mesh.point_masses.extend(payload_mass.map(|mass| (payload, mass)));
    Ok(())
}

impl StructureMesh {
    /// Tapes of a canopy of gores: the skirt band (`hem`), the vent band (`vents`), and the radials along the seams, each of which runs on as a vent line to the seam
    /// on the other side (`seams`).
    pub(super) fn tape_gores(&mut self, p: &GoredCanopy, tapes: &Tapes) {
        let layout = GoreLayout::new(p);
        for (place, ring) in [(TapePlace::Hem, layout.along), (TapePlace::Vents, 0)] {
            if tapes.section(place).is_some() {
                self.tape(place, (0..=layout.columns()).map(|column| layout.node(column, ring)));
            }
        }
        if tapes.seams.is_some() {
            for gore in 0..layout.gores / 2 {
                let other = gore + layout.gores / 2;
                let up = (0..=layout.along).rev().map(|ring| layout.seam(gore, ring));
                let down = (0..=layout.along).map(|ring| layout.seam(other, ring));
                self.tape(TapePlace::Seams, up.chain(down));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use case::{Canopy, Tape};

    use super::*;
    use crate::structure::tests::scene;
    use crate::structure_mesh;

    fn canopy(profile: GoreProfile) -> GoredCanopy {
        GoredCanopy {
            profile,
            nominal_diameter_m: 8.53,
            gores: 28,
            vent_diameter_m: Some(0.85),
            cone_angle_deg: (profile == GoreProfile::Conical).then_some(25.0),
            cells_per_gore: 2,
            cells_along: 10,
            line_length_m: 7.0,
            segments_per_line: 1,
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
        let tape = Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01 });
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
}
