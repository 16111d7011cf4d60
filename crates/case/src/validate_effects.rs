//! Sense and contradictions of the effects of lines, payload and skirt.

use crate::scene::*;
use crate::validate::Check;
use crate::{PayloadBody, Reefing};

/// Refuses what no structure could do, and effects that contradict each other.
pub(crate) fn effects(scene: &Scene, c: &mut Check) {
    if let Some(d) = scene.lines.as_ref().and_then(|l| l.drag.as_ref()) {
        c.range("lines.drag.coefficient", d.coefficient, 0.0, 10.0, true, "1.1 for a cylinder");
        c.range(
            "lines.drag.friction_coefficient",
            d.friction_coefficient,
            0.0,
            1.0,
            true,
            "of a wetted surface",
        );
        if let Some(w) = d.diameter_m {
            c.positive("lines.drag.diameter_m", w, 1.0, "a diameter in metres");
        }
        if let Some(flow) = &scene.flow {
            if flow.shear.is_some() {
                c.refuse(
                    "lines.drag",
                    "the drag of lines knows one wind for all heights, but the wind changes with height",
                    "remove [lines.drag] or [flow.shear]",
                );
            }
        } else {
            c.refuse(
                "lines.drag",
                "lines have drag in air, but the scene has none",
                "remove it, or add a [flow] section with the air",
            );
        }
    }
    if let Some(k) = &scene.fabric.contact {
        c.positive(
            "fabric.contact.distance_m",
            k.distance_m,
            1.0,
            "a distance in metres, below an edge of the mesh",
        );
        c.positive("fabric.contact.stiffness", k.stiffness, 100.0, "in shares of the fabric's own");
        if scene.ranks.structure > 1 {
            c.refuse(
                "fabric.contact",
                format!("contact is found on one rank, but the structure has {}", scene.ranks.structure),
                "set ranks.structure = 1",
            );
        }
    }
    let falls = scene.stages.iter().any(|s| s.kind == StageKind::Coupled);
    if let Some(d) = &scene.descent {
        if let Some(p) = &d.payload_drag {
            c.positive("descent.payload_drag.drag_area_m2", p.drag_area_m2, 1e4, "an area in m2");
        }
        if d.payload_drag.is_some() && scene.flow.as_ref().is_some_and(|f| f.shear.is_some()) {
            c.refuse(
                "descent.payload_drag",
                "the drag of the payload knows one wind for all heights, but the wind changes with height",
                "remove [descent.payload_drag] or [flow.shear]",
            );
        }
        if let Some(b) = &d.body {
            body(b, scene, falls, c);
        }
    }
    for (k, r) in scene.reefing.iter().enumerate() {
        reefing(r, &format!("reefing[{k}]"), scene, c);
    }
    prescribed(scene, c);
}

fn body(b: &PayloadBody, scene: &Scene, falls: bool, c: &mut Check) {
    let at = "descent.body";
    for value in b.inertia_kg_m2 {
        c.positive(&format!("{at}.inertia_kg_m2"), value, 1e9, "a moment of inertia in kg m2");
    }
    let [x, y, z] = b.inertia_kg_m2;
    if x + y < z || y + z < x || z + x < y {
        c.refuse(
            &format!("{at}.inertia_kg_m2"),
            format!("no body has the moments of inertia {x}, {y} and {z}"),
            "each is at most the sum of the other two",
        );
    }
    let finite = b.attachments_m.iter().all(|a| a.iter().all(|v| v.is_finite() && v.abs() < 100.0));
    if b.attachments_m.is_empty() || !finite {
        c.refuse(
            &format!("{at}.attachments_m"),
            format!(
                "the payload has {} attachments, or one that is not a place on it",
                b.attachments_m.len()
            ),
            "list at least one point in metres from its centre of mass",
        );
    }
    if !scene.has_cables() && !matches!(scene.canopy, Canopy::Gmsh(_)) {
        c.refuse(at, "no line holds the payload", "give the canopy lines, or remove [descent.body]");
    }
    if scene.fabric_gravity.is_none() {
        c.refuse(
            at,
            "a payload that moves in the falling frame needs the inertia of fabric and lines in that frame too",
            "add [fabric_gravity]",
        );
    }
    if !falls {
        c.refuse(at, "the payload is free in coupled stages only, and the scene has none", "remove it");
    }
}

fn reefing(r: &Reefing, at: &str, scene: &Scene, c: &mut Check) {
    c.positive(&format!("{at}.length_m"), r.length_m, 1e4, "a length in metres");
    c.range(&format!("{at}.draw_in_s"), r.draw_in_s, 0.0, 1e6, true, "in seconds");
    c.range(
        &format!("{at}.release_s"),
        r.release_s,
        0.0,
        1e6,
        true,
        "in seconds from the start of the stage",
    );
    c.range(&format!("{at}.release_ramp_s"), r.release_ramp_s, 0.0, 1e6, true, "in seconds");
    if scene.lines.is_none() {
        c.refuse(at, "the reefing line has no material", "add [lines]: it is made of them");
    }
    if !scene.has_cables() && !matches!(scene.canopy, Canopy::Gmsh(_)) {
        c.refuse(at, "a reefing line runs where lines are attached, and there are none", "remove it");
    }
    match &r.release_stage {
        None if r.release_s != 0.0 || r.release_ramp_s != 0.0 => c.refuse(
            &format!("{at}.release_s"),
            "the time of release belongs to no stage",
            "add `release_stage = \"...\"`",
        ),
        Some(name) => match scene.stages.iter().find(|s| &s.name == name) {
            Some(s) if s.kind.roles().contains(&Role::Structure) && s.solve == Solve::Dynamic => {
                if r.release_s > s.duration_s {
                    c.refuse(
                        &format!("{at}.release_s"),
                        format!(
                            "stage \"{name}\" ends at {} s, before the release at {} s",
                            s.duration_s, r.release_s
                        ),
                        "release earlier, or name a later stage",
                    );
                }
            }
            Some(_) => c.refuse(
                &format!("{at}.release_stage"),
                format!("stage \"{name}\" does not move the structure in time"),
                "name a stage of kind \"pre-inflation\" or \"coupled\" with a duration",
            ),
            None => c.refuse(
                &format!("{at}.release_stage"),
                format!("the scene has no stage \"{name}\""),
                "name one of its stages",
            ),
        },
        None => {}
    }
}

/// Stages whose canopy moves as prescribed.
fn prescribed(scene: &Scene, c: &mut Check) {
    for (k, s) in scene.stages.iter().enumerate().filter(|(_, s)| s.kind == StageKind::Prescribed) {
        if s.motions.is_empty() {
            c.refuse(
                &format!("stage[{k}].kind"),
                format!("stage \"{}\" moves the canopy as prescribed, but prescribes nothing", s.name),
                "add a [[stage.motion]], or use kind = \"flow-only\"",
            );
        }
        if !s.forces.is_empty() {
            c.refuse(
                &format!("stage[{k}].force"),
                "forces need a structure, and a prescribed motion has none",
                "remove them",
            );
        }
        if scene.stages[k..].iter().any(|s| s.kind.roles().contains(&Role::Structure)) {
            c.refuse(
                &format!("stage[{k}].kind"),
                "a later stage would start from a structure that has not moved along",
                "put stages of kind \"prescribed\" last",
            );
        }
    }
}
