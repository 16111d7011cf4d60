//! Suspension lines from the canopy to confluence points, and risers from there to the payload.
//!
//! Without risers all lines run to the payload's point on the axis. With `[canopy.risers]` the lines, in the order of the skirt, form groups of equal size. The
//! riser of a group points from its attachment $`a`$ at the payload to the mean $`m`$ of the group's nodes on the canopy, so that the confluence point is
//! ```math
//! c = a + R \frac{m - a}{|m - a|}
//! ```
//! with the length R of the riser. The depth of the payload is that at which the longest line is just taut: all risers have their length, no line is stretched.

use case::{CanopyRisers, Scene};

use super::refusals::{positive, refuse};
use crate::geometry::{Point, Vec3, at};
use crate::{CableKind, MeshError, StructureMesh};

/// The payload as its lines see it.
pub(super) struct Payload<'a> {
    /// Mass of a payload that is a point, kg.
    pub mass: Option<f64>,
    /// Attachments of a payload that is a body, from its centre of mass, m; else none.
    pub attachments: &'a [Point],
}

impl<'a> Payload<'a> {
    /// That of a scene. A body has its mass itself, not its nodes.
    pub fn of(scene: &'a Scene) -> Self {
        let body = scene.payload_body();
        Self {
            mass: scene.descent.as_ref().filter(|_| body.is_none()).map(|d| d.payload_mass_kg),
            attachments: body.map_or(&[], |b| &b.attachments_m),
        }
    }
}

/// Lines and risers of a canopy.
pub(super) struct Suspension<'a> {
    /// Nodes of the canopy on which lines begin, in the order of the skirt.
    pub ends: &'a [u32],
    /// Largest distance of these nodes from the axis, m, and what it is.
    pub reach: (f64, &'static str),
    /// Unstretched length of a line, m.
    pub length: f64,
    /// Cable elements of a line.
    pub segments: u32,
    /// Risers; `None`: all lines run to the payload.
    pub risers: Option<&'a CanopyRisers>,
    /// What the lines carry.
    pub payload: &'a Payload<'a>,
}

impl Suspension<'_> {
    /// Adds lines, risers and the nodes of the payload, which are held.
    pub fn add(&self, mesh: &mut StructureMesh) -> Result<(), MeshError> {
        let length = positive("canopy.line_length_m", self.length)?;
        let (reach, what) = self.reach;
        if length <= reach {
            return Err(refuse("canopy.line_length_m", length, format!("must exceed {reach:.4} m, {what}")));
        }
        match self.risers {
            Some(r) => self.add_with_risers(r, mesh),
            None => {
                let payload = mesh.push_node([0.0, 0.0, -self.depth_on_axis(mesh)]);
                self.push_lines(&[payload], mesh);
                self.hold(&[payload], mesh);
                Ok(())
            }
        }
    }

    /// Depth of a point on the axis below the height 0 at which the longest line is just taut, m.
    fn depth_on_axis(&self, mesh: &StructureMesh) -> f64 {
        let taut = |&n: &u32| {
            let x = mesh.coords[n as usize];
            let reach = x[0].hypot(x[1]);
            (self.length * self.length - reach * reach).sqrt() - x[2]
        };
        self.ends.iter().map(taut).fold(f64::INFINITY, f64::min)
    }

    /// Adds the lines, in groups of equal size to the `confluences`.
    fn push_lines(&self, confluences: &[u32], mesh: &mut StructureMesh) {
        let group = self.ends.len() / confluences.len();
        for (line, &end) in self.ends.iter().enumerate() {
            let ends = [end, confluences[line / group]];
            let segments = self.segments as usize;
            mesh.push_line(ends, self.length, segments, CableKind::SuspensionLine, line as u32);
        }
    }

    /// Holds the nodes of the payload, of which the first has its mass.
    fn hold(&self, nodes: &[u32], mesh: &mut StructureMesh) {
        mesh.fixed.extend(nodes.iter().map(|&n| (n, [true; 3])));
        mesh.point_masses.extend(self.payload.mass.map(|mass| (nodes[0], mass)));
    }

    fn add_with_risers(&self, r: &CanopyRisers, mesh: &mut StructureMesh) -> Result<(), MeshError> {
        let (count, lines) = (r.count as usize, self.ends.len());
        if count == 0 || !lines.is_multiple_of(count) {
            return Err(refuse("canopy.risers.count", count, format!("must divide the {lines} lines")));
        }
        positive("canopy.risers.length_m", r.length_m)?;
        let rigging = Rigging::new(self, r, mesh);
        let depth = rigging.depth().ok_or_else(|| {
            refuse(
                "canopy.line_length_m",
                self.length,
                "lines and risers are too short to meet below the canopy",
            )
        })?;
        let payload: Vec<u32> = if r.spread_m > 0.0 {
            rigging.attachments_at(depth).map(|a| mesh.push_node(a.into())).collect()
        } else {
            // The attachments of a body are made with the body.
            vec![mesh.push_node([0.0, 0.0, -depth])]
        };
        let confluences: Vec<u32> = rigging.confluences(depth).map(|c| mesh.push_node(c.into())).collect();
        self.push_lines(&confluences, mesh);
        for (k, &confluence) in confluences.iter().enumerate() {
            let ends = [confluence, payload[k % payload.len()]];
            mesh.push_line(ends, r.length_m, 1, CableKind::Riser, (lines + k) as u32);
        }
        self.hold(&payload, mesh);
        if payload.len() > 1 {
            mesh.node_sets.insert("payload".into(), payload);
        }
        mesh.node_sets.insert("confluence".into(), confluences);
        Ok(())
    }
}

/// Groups of lines and their risers, for any depth of the payload.
struct Rigging {
    /// Where the lines of each group begin, m.
    groups: Vec<Vec<Vec3>>,
    /// Mean of each group, m.
    middles: Vec<Vec3>,
    /// Attachment of each riser, from the payload's point, m.
    attachments: Vec<Vec3>,
    /// Length of a riser, m.
    riser: f64,
    /// Length of a line, m.
    line: f64,
}

impl Rigging {
    fn new(s: &Suspension<'_>, r: &CanopyRisers, mesh: &StructureMesh) -> Self {
        let count = r.count as usize;
        let group = |ends: &[u32]| ends.iter().map(|&n| at(&mesh.coords, n)).collect::<Vec<_>>();
        let groups: Vec<_> = s.ends.chunks(s.ends.len() / count).map(group).collect();
        let middles: Vec<Vec3> = groups.iter().map(|g| mean(g)).collect();
        let body: Vec<Vec3> = s.payload.attachments.iter().map(|a| Vec3::from(*a)).collect();
        let attachment = |(k, m): (usize, &Vec3)| match body.len() {
            0 if r.spread_m > 0.0 => Vec3::new(m.x, m.y, 0.0).normalize() * (0.5 * r.spread_m),
            0 => Vec3::zeros(),
            n => body[k % n] - mean(&body),
        };
        let attachments = middles.iter().enumerate().map(attachment).collect();
        Self { groups, middles, attachments, riser: r.length_m, line: s.length }
    }

    /// Attachments with the payload's point at `depth` (m) below the height 0.
    fn attachments_at(&self, depth: f64) -> impl Iterator<Item = Vec3> + '_ {
        self.attachments.iter().map(move |a| a - Vec3::new(0.0, 0.0, depth))
    }

    /// Confluence point of each group: a riser's length from its attachment, towards the middle of its lines.
    fn confluences(&self, depth: f64) -> impl Iterator<Item = Vec3> + '_ {
        let towards = move |(a, m): (Vec3, &Vec3)| a + (m - a) * (self.riser / (m - a).norm());
        self.attachments_at(depth).zip(&self.middles).map(towards)
    }

    /// Longest distance of a line's ends, m.
    fn longest(&self, depth: f64) -> f64 {
        let of_group = |(c, g): (Vec3, &Vec<Vec3>)| g.iter().map(|x| (x - c).norm()).fold(0.0, f64::max);
        self.confluences(depth).zip(&self.groups).map(of_group).fold(0.0, f64::max)
    }

    /// Depth at which the longest line is just taut, m, to the last digits; `None` where lines are too short.
    fn depth(&self) -> Option<f64> {
        let heights = || self.attachments.iter().map(|a| a.z.abs());
        let uneven = heights().fold(0.0, f64::max);
        let skirt = self.middles.iter().map(|m| m.z.abs()).fold(0.0, f64::max);
        // At the first depth every riser still points upwards; at the second every line is too long.
        let mut low = self.riser + uneven + skirt;
        let mut high = low + uneven + skirt + self.line + self.riser;
        if self.longest(low) >= self.line {
            return None;
        }
        // Halving stops at neighbouring numbers.
        while let middle = 0.5 * (low + high)
            && low < middle
            && middle < high
        {
            if self.longest(middle) <= self.line {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(low)
    }
}

fn mean(points: &[Vec3]) -> Vec3 {
    points.iter().fold(Vec3::zeros(), |sum, x| sum + x) / points.len() as f64
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use case::{Canopy, CrossCanopy, GoredCanopy, PayloadBody, Risers};

    use super::*;
    use crate::structure::tests::scene;
    use crate::{Cable, structure_mesh};

    fn gored(risers: Option<CanopyRisers>) -> Canopy {
        Canopy::Gored(GoredCanopy {
            profile: case::GoreProfile::Flat,
            sections: Vec::new(),
            nominal_diameter_m: 8.53,
            gores: 28,
            vent_diameter_m: None,
            cone_angle_deg: None,
            cells_per_gore: 2,
            cells_along: 4,
            line_length_m: 7.0,
            segments_per_line: 3,
            risers,
        })
    }

    fn cross(risers: Option<CanopyRisers>) -> Canopy {
        Canopy::Cross(CrossCanopy {
            panel_width_m: 2.0,
            panel_length_m: 6.0,
            cells_across: 6,
            cells_along_arm: 5,
            lines_per_arm: 6,
            line_length_m: 7.0,
            segments_per_line: 2,
            risers,
        })
    }

    const FOUR: CanopyRisers = CanopyRisers { count: 4, length_m: 0.9, spread_m: 0.4 };

    fn rigged(canopy: Canopy) -> Scene {
        let mut s = scene(canopy);
        s.risers = Some(Risers { axial_stiffness_n: 1e5, mass_kg_m: 0.05, ..Risers::default() });
        s
    }

    fn chord(mesh: &StructureMesh, c: &Cable) -> f64 {
        (at(&mesh.coords, c.nodes[0]) - at(&mesh.coords, c.nodes[1])).norm()
    }

    /// Elements of a kind by line.
    fn lines(mesh: &StructureMesh, kind: CableKind) -> BTreeMap<u32, Vec<Cable>> {
        let mut all: BTreeMap<u32, Vec<Cable>> = BTreeMap::new();
        mesh.cables.iter().filter(|c| c.kind == kind).for_each(|c| all.entry(c.line).or_default().push(*c));
        all
    }

    /// Groups of lines in the order of the skirt, each with its riser; lines and risers have their lengths, risers and the longest lines are taut.
    #[test]
    fn groups_of_lines_join_in_confluence_points() {
        for (canopy, of) in [(gored as fn(_) -> _, 28), (cross, 24)] {
            let risers = [FOUR, CanopyRisers { spread_m: 0.0, ..FOUR }, CanopyRisers { count: 2, ..FOUR }];
            for r in risers.into_iter().chain([CanopyRisers { count: 1, spread_m: 0.0, ..FOUR }]) {
                let mesh = structure_mesh(&rigged(canopy(Some(r)))).unwrap();
                let confluences = mesh.node_sets["confluence"].clone();
                assert_eq!(confluences.len(), r.count as usize);
                let mut longest: f64 = 0.0;
                let all = lines(&mesh, CableKind::SuspensionLine);
                assert_eq!(all.len(), of);
                for (line, elements) in all {
                    assert_eq!(
                        elements[elements.len() - 1].nodes[1],
                        confluences[line as usize * r.count as usize / of]
                    );
                    let rest: f64 = elements.iter().map(|c| c.rest_length).sum();
                    assert!((rest - 7.0).abs() < 1e-12);
                    longest = longest.max(elements.iter().map(|c| chord(&mesh, c)).sum());
                }
                assert!((longest - 7.0).abs() < 1e-12, "{r:?}: {longest}");
                let risers = lines(&mesh, CableKind::Riser);
                assert_eq!(risers.len(), r.count as usize);
                for (k, (line, riser)) in risers.into_iter().enumerate() {
                    assert_eq!((line as usize, riser.len(), riser[0].nodes[0]), (of + k, 1, confluences[k]));
                    assert_eq!(riser[0].rest_length, 0.9);
                    assert!((chord(&mesh, &riser[0]) - 0.9).abs() < 1e-12);
                }
            }
        }
    }

    /// Four groups are one group turned by quarters of a turn; attachments lie on the circle, below the middle of their lines; the skirt does not change.
    #[test]
    fn groups_are_turned_copies() {
        for canopy in [gored as fn(_) -> _, cross] {
            let mesh = structure_mesh(&rigged(canopy(Some(FOUR)))).unwrap();
            let plain = structure_mesh(&scene(canopy(None))).unwrap();
            assert_eq!(plain.skirt(), mesh.skirt());
            for set in ["confluence", "payload"] {
                let x: Vec<Vec3> = mesh.node_sets[set].iter().map(|&n| at(&mesh.coords, n)).collect();
                for (k, a) in x.iter().enumerate() {
                    let turned = Vec3::new(-a.y, a.x, a.z);
                    assert!((x[(k + 1) % 4] - turned).norm() < 1e-12, "{set}: {x:?}");
                }
            }
            let points = mesh.node_sets["payload"].iter().zip(&mesh.node_sets["confluence"]);
            for (a, c) in points.map(|(a, c)| (at(&mesh.coords, *a), at(&mesh.coords, *c))) {
                assert!((a.xy().norm() - 0.2).abs() < 1e-12 && a.z < c.z);
                // In one vertical plane with the axis, on one side of it.
                assert!(a.xy().perp(&c.xy()).abs() < 1e-12 && a.xy().dot(&c.xy()) > 0.0);
            }
        }
    }

    /// Length of lines and risers is the sum of the parts, and the mass of a payload point stays one.
    #[test]
    fn lengths_and_payload_are_complete() {
        let s = rigged(gored(Some(FOUR)));
        let mesh = structure_mesh(&s).unwrap();
        assert!((mesh.cable_length(CableKind::SuspensionLine) - 28.0 * 7.0).abs() < 1e-9);
        assert!((mesh.cable_length(CableKind::Riser) - 4.0 * 0.9).abs() < 1e-12);
        let section = CableKind::Riser.section(&s).unwrap();
        assert_eq!((section.axial_stiffness_n, section.mass_kg_m), (1e5, 0.05));
        assert_eq!(mesh.payload_point_mass(&s), 100.6975);
        assert_eq!((mesh.hung_point_masses(&s), mesh.fixed.len()), (0.0, 4));
    }

    /// Risers end at the attachments of a body, in turn, and are as long as they are cut.
    #[test]
    fn risers_reach_the_attachments_of_a_body() {
        let mut s = rigged(gored(Some(CanopyRisers { spread_m: 0.0, ..FOUR })));
        let arm = |x: f64, y: f64| [x, y, 0.4];
        let body = |attachments_m| PayloadBody {
            inertia_kg_m2: [3.0, 3.0, 4.0],
            attachments_m,
            initial_velocity_m_s: [0.0; 3],
            initial_spin_rad_s: [0.0; 3],
            initial_rotation_deg: [0.0; 3],
        };
        let attachments = vec![arm(0.2, 0.3), arm(-0.2, 0.3), arm(-0.2, -0.3), arm(0.2, -0.3)];
        s.descent.as_mut().unwrap().body = Some(body(attachments));
        let mesh = structure_mesh(&s).unwrap();
        let nodes = &mesh.node_sets["payload"];
        assert_eq!((nodes.len(), mesh.point_masses.len()), (4, 0));
        for (k, riser) in lines(&mesh, CableKind::Riser).values().enumerate() {
            assert_eq!(riser[0].nodes[1], nodes[k]);
            assert!((chord(&mesh, &riser[0]) - 0.9).abs() < 1e-12);
        }
        let longest = |elements: &Vec<Cable>| elements.iter().map(|c| chord(&mesh, c)).sum::<f64>();
        let longest = lines(&mesh, CableKind::SuspensionLine).values().map(longest).fold(0.0, f64::max);
        assert!((longest - 7.0).abs() < 1e-12, "{longest}");
        s.descent.as_mut().unwrap().body = Some(body(vec![[0.0; 3]; 5]));
        let error = structure_mesh(&s).unwrap_err().to_string();
        assert!(error.contains("only 4 lines"), "{error}");
    }

    #[test]
    fn risers_that_cannot_be_shared_are_refused() {
        let refused = |r| structure_mesh(&rigged(gored(Some(r)))).unwrap_err().to_string();
        assert!(refused(CanopyRisers { count: 5, ..FOUR }).contains("must divide the 28 lines"));
        assert!(refused(CanopyRisers { count: 0, ..FOUR }).contains("must divide"));
        assert!(refused(CanopyRisers { length_m: 0.0, ..FOUR }).contains("canopy.risers.length_m"));
    }

    /// Attachments on the far side of the axis, which the lines do not reach.
    #[test]
    fn lines_that_do_not_reach_their_riser_are_refused() {
        let mut s = rigged(gored(Some(CanopyRisers { count: 2, length_m: 0.2, spread_m: 0.0 })));
        let Canopy::Gored(g) = &mut s.canopy else { panic!("gores") };
        g.line_length_m = 4.5;
        s.descent.as_mut().unwrap().body = Some(PayloadBody {
            inertia_kg_m2: [3.0, 3.0, 4.0],
            attachments_m: vec![[0.0, -3.0, 0.0], [0.0, 3.0, 0.0]],
            initial_velocity_m_s: [0.0; 3],
            initial_spin_rad_s: [0.0; 3],
            initial_rotation_deg: [0.0; 3],
        });
        let error = structure_mesh(&s).unwrap_err().to_string();
        assert!(error.contains("too short to meet"), "{error}");
    }
}
