//! Check of rigid bodies that move as prescribed: room for the grid between them and the boundary.

use case::OuterBoundary;
use mesh::Clearance;

use super::facts::{Facts, digits, percent};
use super::finding::Judged;
use super::finding::Severity::{Note, Warning};
use super::table::{Check, When};

/// Displacement over gap above which the cells between deform so much that they may become invalid.
const LARGEST_SHARE: f64 = 0.5;
/// Displacement out of a plane, relative to the shortest edge of the body, that counts as round-off.
const ROUND_OFF: f64 = 1e-6;

/// The row.
pub const CHECKS: &[Check] = &[Check {
    id: "mesh.body-motion",
    what: "the cells around a rigid body have room for its motion, and patches that share nodes with it stay plane",
    estimate: "largest displacement of a node of the body at the ends of windows, over the smallest distance at the start between \
               the body and boundary nodes that are fixed; displacement of shared nodes normal to patches that do not move",
    range: "warning above half the distance, and for a displacement out of a plane; otherwise a note",
    source: "docs/records/verification.md: at half the distance the smallest cell has 32 % of its volume at the start, at 80 % it has \
             2 %",
    severity: Warning,
    remedy: "reduce the motion, enlarge the grid, set mesh.outer_boundary = \"sliding\", or name all patches in the \
             [[stage.body_motion]], so that the whole grid moves",
    when: When::Before(body_motion),
}];

fn body_motion(f: &Facts<'_>) -> Vec<Judged> {
    let moves = f.stages().any(|(_, s)| !s.body_motions.is_empty());
    let canopy = &f.mesh.coords[..f.mesh.n_canopy];
    // Where there is no grid, `flow.grid` reports why.
    let Some(grid) = moves.then(|| mesh::flow_grid(f.scene, &f.mesh, canopy).ok()).flatten() else {
        return Vec::new();
    };
    let sliding = f.scene.mesh.outer_boundary == OuterBoundary::Sliding;
    let clearance = |(k, stage)| mesh::clearance(stage, &grid, sliding).map(|c| (k, c));
    f.stages().filter_map(clearance).flat_map(|(k, c)| judged(k, &c)).collect()
}

fn judged(stage: usize, c: &Clearance) -> Vec<Judged> {
    let key = format!("stage[{stage}].body_motion");
    let share = c.displacement / c.gap;
    let severity = if share > LARGEST_SHARE { Warning } else { Note };
    let room = if c.gap.is_finite() {
        format!("{} of the {} m between it and the fixed boundary", percent(share), digits(c.gap))
    } else {
        "no boundary is fixed".into()
    };
    let edges = c.displacement / c.edge;
    let figure = format!(
        "the body moves up to {} m, {} of its shortest cell edges; {room}",
        digits(c.displacement),
        digits(edges)
    );
    let mut found = vec![Judged::new(severity, key.clone(), figure)];
    if c.out_of_plane > ROUND_OFF * c.edge {
        let figure = format!(
            "the body moves nodes that it shares with a patch at rest by {} m normal to that patch, which does not stay plane",
            digits(c.out_of_plane)
        );
        let remedy = "move along the patch only, or name the patch in the [[stage.body_motion]] too";
        found.push(Judged::new(Warning, key, figure).remedy(remedy));
    }
    found
}
