//! Check of rigid bodies that move as prescribed: room for the grid between them and the boundary.

use case::{OuterBoundary, Stage};
use mesh::{CanopyRoom, Clearance, FlowGrid, Patch};

use super::facts::{Facts, digits, percent};
use super::finding::Judged;
use super::finding::Severity::{Note, Warning};
use super::table::{Check, When};

/// Displacement over gap above which the cells between deform so much that they may become invalid.
const LARGEST_SHARE: f64 = 0.5;
/// Displacement out of a plane, relative to the shortest edge of the body, that counts as round-off.
const ROUND_OFF: f64 = 1e-6;

/// Angle above which a grid that is fitted to a canopy was not verified to turn with it, degrees.
const LARGEST_ANGLE: f64 = 30.0;

/// The row.
pub const CHECKS: &[Check] = &[Check {
    id: "mesh.body-motion",
    what: "the cells around a rigid body have room for its motion, and patches that share nodes with it stay plane",
    estimate: "largest displacement of a node of the body at the ends of windows, over the smallest distance at the start between \
               the body and boundary nodes that are fixed; displacement of shared nodes normal to patches that do not move. Of a canopy that \
               is moved as a rigid body the angle, where the whole grid turns with it",
    range: "warning above half the distance, for a displacement out of a plane, and for a canopy in a grid that turns above 30 degrees; otherwise \
            a note. An immersed canopy has no bound",
    source: "docs/records/verification.md: at half the distance the smallest cell has 32 % of its volume at the start, at 80 % it has \
             2 %; decision 49: a grid that turned by 33 degrees kept its quality",
    severity: Warning,
    remedy: "reduce the motion, enlarge the grid, set mesh.outer_boundary = \"sliding\", or name all patches in the \
             [[stage.body_motion]], so that the whole grid moves",
    when: When::Before(body_motion),
}];

fn body_motion(f: &Facts<'_>) -> Vec<Judged> {
    let moves = |s: &Stage| !s.body_motions.is_empty();
    let fitted = f.stages().any(|(_, s)| moves(s) && !f.scene.is_immersed(s));
    let canopy = &f.mesh.coords[..f.mesh.n_canopy];
    // Where there is no grid, `flow.grid` reports why.
    let grid = fitted.then(|| mesh::flow_grid(f.scene, &f.mesh, canopy).ok()).flatten();
    let sliding = f.scene.mesh.outer_boundary == OuterBoundary::Sliding;
    let mut found = Vec::new();
    for (k, stage) in f.stages() {
        let grid = grid.as_ref().filter(|_| !f.scene.is_immersed(stage));
        if let Some(room) = mesh::canopy_room(f.scene, stage, canopy) {
            found.push(canopy_motion(f, (k, stage), &room, grid));
        }
        let clearance = grid.and_then(|grid| mesh::clearance(stage, grid, sliding));
        found.extend(clearance.iter().flat_map(|c| judged(k, c)));
    }
    found
}

/// Judges the motion of a canopy as a rigid body; `grid`: that fitted to it.
fn canopy_motion(
    f: &Facts<'_>,
    (k, stage): (usize, &Stage),
    room: &CanopyRoom,
    grid: Option<&FlowGrid>,
) -> Judged {
    let angle = room.angle.to_degrees();
    let moved = format!(
        "the canopy turns by up to {} degrees and moves up to {} m",
        digits(angle),
        digits(room.displacement)
    );
    let key = format!("stage[{k}].body_motion");
    let Some(grid) = grid else { return Judged::new(Note, key, moved) };
    // As the mesh-mover decides it.
    let turns = f.scene.mesh.outer_boundary == OuterBoundary::Fixed
        && !stage.body_motions.iter().any(|m| f.scene.moves_patches(m))
        && grid.boundary.iter().all(|(patch, _)| *patch == Patch::FarField);
    if turns {
        let severity = if angle > LARGEST_ANGLE { Warning } else { Note };
        let remedy = "reduce the angle, or use [flow.immersed], whose canopy moves through the grid";
        return Judged::new(severity, key, format!("{moved}; the grid turns with it")).remedy(remedy);
    }
    let gap = mesh::canopy_gap(grid);
    let share = room.displacement / gap;
    let severity = if share > LARGEST_SHARE { Warning } else { Note };
    let room =
        format!("{moved}, {} of the {} m between it and the outer boundary", percent(share), digits(gap));
    Judged::new(severity, key, room)
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
