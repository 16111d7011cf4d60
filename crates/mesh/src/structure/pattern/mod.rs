//! Canopies from pattern files: flat panels, sewn along their edges.
//!
//! Each panel is triangulated flat, once for all copies. Nodes of sewn edges are one node; the flat triangles are the reference shapes of the membrane
//! ([`StructureMesh::flat`]), because a sewn canopy has in general no position in space in which its cloth is without stress.

mod cut;
mod error;
mod outline;
mod sewing;
mod start;
#[cfg(test)]
mod tests;
mod triangulate;
mod union;

use std::f64::consts::TAU;

use case::pattern::Pattern;
use case::{PatternCanopy, TapePlace, Tapes};

use self::cut::{EdgeAt, Panel, find, panels};
pub use self::error::PatternError;
use self::outline::{Flat, Outline};
use self::sewing::Sewing;
use self::start::{MOST_STRETCH, Piece, Placement, relax, turn};
use super::refusals::positive;
use super::suspension::{Payload, Suspension};
use crate::geometry::{Point, Vec3};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// Fabric, lines, tapes and payload.
pub(super) fn pattern(
    p: &PatternCanopy,
    tapes: Option<&Tapes>,
    payload: &Payload<'_>,
) -> Result<StructureMesh, MeshError> {
    let file = Pattern::read(&p.file)?;
    let size = positive("canopy.element_size_m", p.element_size_m)?;
    let bad = |source: PatternError| MeshError::Pattern { path: p.file.clone(), source: Box::new(source) };
    let (mut mesh, ends) = assemble(&file, size, tapes).map_err(bad)?;
    match (p.line_length_m, ends.is_empty()) {
        (Some(_), true) => {
            let reason = "the scene has canopy.line_length_m, and the pattern no [[attachment]]; add them, or remove the length";
            return Err(bad(PatternError::Entry { key: "attachment".into(), reason: reason.into() }));
        }
        (None, false) => {
            let reason =
                "the pattern has attachments, and the scene no canopy.line_length_m; add it, or remove them";
            return Err(bad(PatternError::Entry { key: "attachment".into(), reason: reason.into() }));
        }
        (None, true) => {}
        (Some(length), false) => {
            let reach =
                ends.iter().map(|&n| mesh.coords[n as usize]).map(|x| x[0].hypot(x[1])).fold(0.0, f64::max);
            Suspension {
                ends: &ends,
                reach: (reach, "the largest distance of an attachment from the axis"),
                length,
                segments: p.segments_per_line,
                risers: p.risers.as_ref(),
                payload,
            }
            .add(&mut mesh)?;
        }
    }
    // Tapes come after the lines, as in all canopies.
    let made: Vec<Cable> = mesh.cables.extract_if(.., |c| matches!(c.kind, CableKind::Tape(_))).collect();
    let lines = mesh.cables.iter().map(|c| c.line + 1).max().unwrap_or(0);
    mesh.cables.extend(made.into_iter().map(|c| Cable { line: c.line + lines, ..c }));
    Ok(mesh)
}

/// Principal stretches of a triangle of flat shape `flat` (m) at `coords` (m), the larger one first.
pub(super) fn stretches(nodes: [u32; 3], flat: [Flat; 3], coords: &[Point]) -> [f64; 2] {
    Piece::new(nodes, flat).stretches(coords).0
}

/// The fabric with its tapes, and the nodes from which lines run in the order of their angle.
fn assemble(
    file: &Pattern,
    size: f64,
    tapes: Option<&Tapes>,
) -> Result<(StructureMesh, Vec<u32>), PatternError> {
    if file.panels.is_empty() {
        return Err(PatternError::Entry {
            key: "panel".into(),
            reason: "the pattern has no [[panel]]".into(),
        });
    }
    let panels = panels(file, size)?;
    let sewing = Sewing::new(file, &panels)?;
    let mut mesh = fabric(&panels, &sewing)?;
    let outlines: Vec<Outline> = panels.iter().map(|p| p.outline.clone()).collect();
    let parts = Parts { file, panels: &panels, sewing: &sewing, outlines: &outlines };
    parts.holds(&mut mesh)?;
    parts.name_edges(&mut mesh);
    if let Some(tapes) = tapes {
        parts.tapes(tapes, &mut mesh)?;
    }
    let ends = parts.ends(&mesh.coords)?;
    Ok((mesh, ends))
}

/// Nodes, triangles and their flat shapes.
fn fabric(panels: &[Panel<'_>], sewing: &Sewing) -> Result<StructureMesh, PatternError> {
    let mut mesh = StructureMesh { n_canopy: sewing.n_nodes, ..StructureMesh::default() };
    let mut pieces = Vec::new();
    for (nodes, copy, local) in sewing.triangles(panels) {
        let panel = &panels[sewing.copies[copy].0];
        let flat = local.map(|n| panel.flat.points[n as usize]);
        let face = mesh.faces.len() as u32;
        mesh.faces.push([nodes[0], nodes[1], nodes[2], nodes[2]]);
        mesh.face_panel.push(copy as u32);
        mesh.triangles.push(nodes);
        mesh.triangle_face.push(face);
        mesh.flat.push(along_warp(flat, panel));
        pieces.push(Piece::new(nodes, flat));
    }
    let relaxed = relax(&pieces, place(panels, sewing)?);
    if relaxed.stretch > 1.0 + MOST_STRETCH {
        let (p, copy) = sewing.copies[mesh.face_panel[relaxed.piece] as usize];
        return Err(PatternError::Stretched {
            panel: panels[p].outline.panel.clone(),
            copy,
            stretch: relaxed.stretch - 1.0,
            limit: MOST_STRETCH,
            iterations: relaxed.iterations,
            at: relaxed.coords[mesh.triangles[relaxed.piece][0] as usize],
        });
    }
    mesh.coords = relaxed.coords;
    Ok(mesh)
}

/// A flat triangle in axes whose first one is the warp of its panel.
fn along_warp(flat: [Flat; 3], panel: &Panel<'_>) -> [Flat; 3] {
    let warp = panel.file.warp_deg.to_radians();
    let (sin, cos) = warp.sin_cos();
    // A drawing of the inner side shows the warp mirrored.
    let cos = panel.file.seen_from.mirror() * cos;
    flat.map(|x| [cos * x[0] + sin * x[1], cos * x[1] - sin * x[0]])
}

/// Positions of the nodes, m: the mean of those that the panels of a node place it at.
fn place(panels: &[Panel<'_>], sewing: &Sewing) -> Result<Vec<Point>, PatternError> {
    let placements = panels
        .iter()
        .map(|p| Placement::new(&p.outline.panel, &p.file.start))
        .collect::<Result<Vec<_>, _>>()?;
    let mut sums = vec![(Vec3::zeros(), 0.0); sewing.n_nodes];
    for ((p, copy), nodes) in sewing.copies.iter().zip(&sewing.nodes) {
        let file = panels[*p].file;
        let turn = turn(&file.start, *copy, file.copies);
        for (x, n) in panels[*p].flat.points.iter().zip(nodes) {
            let (sum, count) = &mut sums[*n as usize];
            *sum += Vec3::from(placements[*p].position(*x, file.seen_from.mirror(), turn));
            *count += 1.0;
        }
    }
    Ok(sums.into_iter().map(|(sum, count)| (sum / count).into()).collect())
}

/// The sewn pattern with what its edges carry.
struct Parts<'a> {
    file: &'a Pattern,
    panels: &'a [Panel<'a>],
    sewing: &'a Sewing,
    outlines: &'a [Outline],
}

impl Parts<'_> {
    /// Nodes from which lines run, once each, in the order of their angle about the z axis.
    fn ends(&self, coords: &[Point]) -> Result<Vec<u32>, PatternError> {
        let mut all = Vec::new();
        for (k, a) in self.file.attachments.iter().enumerate() {
            let edge = find(self.outlines, &format!("attachment[{k}]"), &a.edge)?;
            all.extend(self.sewing.nodes_of(self.panels, edge, Some(a.at)));
        }
        all.sort_unstable();
        all.dedup();
        let angle = |n: &u32| {
            let x = coords[*n as usize];
            // The first turn begins just before the x axis, so that round-off changes no order.
            (x[1].atan2(x[0]) + 1e-9).rem_euclid(TAU)
        };
        all.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        Ok(all)
    }

    /// Holds nodes in space.
    fn holds(&self, mesh: &mut StructureMesh) -> Result<(), PatternError> {
        let mut fixed = std::collections::BTreeMap::<u32, [bool; 3]>::new();
        for (k, h) in self.file.holds.iter().enumerate() {
            let key = format!("hold[{k}]");
            if h.components.is_empty() || h.components.chars().any(|c| !"xyz".contains(c)) {
                let reason =
                    format!("components = \"{}\" must be some of the letters x, y and z", h.components);
                return Err(PatternError::Entry { key, reason });
            }
            let edge = find(self.outlines, &key, &h.edge)?;
            for n in self.sewing.nodes_of(self.panels, edge, h.at) {
                let own = fixed.entry(n).or_default();
                (0..3).for_each(|i| own[i] |= h.components.contains(['x', 'y', 'z'][i]));
            }
        }
        mesh.fixed = fixed.into_iter().collect();
        Ok(())
    }

    /// Node sets `panel.edge` of all copies.
    fn name_edges(&self, mesh: &mut StructureMesh) {
        for (p, outline) in self.outlines.iter().enumerate() {
            for (e, edge) in outline.edges.iter().enumerate() {
                let nodes = self.sewing.nodes_of(self.panels, [p, e], None);
                mesh.node_sets.insert(format!("{}.{}", outline.panel, edge.name), nodes);
            }
        }
    }

    fn tapes(&self, tapes: &Tapes, mesh: &mut StructureMesh) -> Result<(), PatternError> {
        let lists = [
            (TapePlace::Hem, tapes.hem.is_some(), &self.file.hem, "hem"),
            (TapePlace::Vents, tapes.vents.is_some(), &self.file.vents, "vents"),
        ];
        for (place, _, edges, key) in lists.into_iter().filter(|(_, on, ..)| *on) {
            if edges.is_empty() {
                let reason = format!(
                    "the scene has [tapes.{key}], and the pattern no edges for it; list them as {key} = [\"panel.edge\"]"
                );
                return Err(PatternError::Entry { key: key.into(), reason });
            }
            for (k, name) in edges.iter().enumerate() {
                let at = find(self.outlines, &format!("{key}[{k}]"), name)?;
                for copy in 0..self.panels[at[0]].file.copies as usize {
                    self.tape(place, (at, copy), None, mesh);
                }
            }
        }
        if tapes.seams.is_some() {
            for j in self.sewing.joints.iter().filter(|j| self.file.seams[j.seam].tape) {
                self.tape(TapePlace::Seams, (j.edges[0], j.copies[0]), Some(j.edges[1]), mesh);
            }
        }
        Ok(())
    }

    /// A tape along an edge of a copy, with the flat lengths of the edge; on a seam with those of the shorter of both edges, onto which the other is gathered.
    fn tape(
        &self,
        place: TapePlace,
        (edge, copy): (EdgeAt, usize),
        other: Option<EdgeAt>,
        mesh: &mut StructureMesh,
    ) {
        let nodes = self.sewing.along(self.panels, edge, copy);
        let line = mesh.cables.iter().map(|c| c.line + 1).max().unwrap_or(0);
        let length = |[p, e]: EdgeAt| self.outlines[p].edges[e].length;
        let shorter = other.filter(|o| length(*o) < length(edge));
        for (i, pair) in nodes.windows(2).enumerate() {
            let rest_length = match shorter {
                Some([p, e]) => self.panels[p].part(e, nodes.len() - 2 - i),
                None => self.panels[edge[0]].part(edge[1], i),
            };
            let kind = CableKind::Tape(place);
            mesh.cables.push(Cable {
                nodes: [pair[0], pair[1]],
                rest_length,
                kind,
                line,
                share: 1.0,
                group: None,
            });
        }
    }
}
