//! Flat cross canopies: two equal panels of width W and length L, of the constructed area $`S_0 = 2 L W - W^2`$ (Knacke, Parachute Recovery Systems Design
//! Manual, 1991, chapter 5).

use case::{CrossCanopy, Tapes};

use super::atps::{AtpsLayout, turn};
use super::suspension::{Payload, Suspension};
use super::{even, positive, refuse};
use crate::{MeshError, StructureMesh};

/// Numbers of the nodes.
fn layout(x: &CrossCanopy) -> Result<AtpsLayout, MeshError> {
    Ok(AtpsLayout::cross(even("canopy.cells_across", x.cells_across)?, x.cells_along_arm as usize))
}

/// Fabric, lines and payload. All lines have one length; those of the arms' corners are taut in the shape as cut.
pub(super) fn cross(x: &CrossCanopy, payload: &Payload<'_>) -> Result<StructureMesh, MeshError> {
    let layout = layout(x)?;
    let (n, m) = (layout.n, layout.m);
    let half_width = 0.5 * positive("canopy.panel_width_m", x.panel_width_m)?;
    let half_length = 0.5 * positive("canopy.panel_length_m", x.panel_length_m)?;
    let mut mesh = StructureMesh { coords: vec![[0.0; 3]; layout.nodes()], ..Default::default() };
    mesh.n_canopy = layout.nodes();
    // From -1 to 1, exactly antisymmetric.
    let across = |a: usize| half_width * ((2.0 * a as f64 - n as f64) / n as f64);
    for j in 0..=n {
        for i in 0..=n {
            mesh.coords[layout.top(i, j) as usize] = [across(i), across(j), 0.0];
        }
    }
    for b in 1..=m {
        let out = half_width + (half_length - half_width) * b as f64 / m as f64;
        for (k, a) in (0..4).flat_map(|k| (0..=n).map(move |a| (k, a))) {
            mesh.coords[layout.arm(k, a, b) as usize] = turn(k, [out, across(a), 0.0]);
        }
    }
    layout.push_faces(&mut mesh, |k| k as u32 + 1);
    let lines = x.lines_per_arm as usize;
    if !(2..=n + 1).contains(&lines) {
        return Err(refuse(
            "canopy.lines_per_arm",
            lines,
            format!("must be from 2 to cells_across + 1 = {}", n + 1),
        ));
    }
    let end = |k, l| layout.arm(k, layout.column_of_line(l, lines), m);
    let ends: Vec<u32> =
        (0..4).flat_map(|k| (0..lines).map(move |l| (k, l))).map(|(k, l)| end(k, l)).collect();
    Suspension {
        ends: &ends,
        reach: (half_length.hypot(half_width), "the distance of an arm's corner from the axis"),
        length: x.line_length_m,
        segments: x.segments_per_line,
        risers: x.risers.as_ref(),
        payload,
    }
    .add(&mut mesh)?;
    Ok(mesh)
}

impl StructureMesh {
    /// Tapes of a cross: along its outline (`hem`) and in a grid.
    pub(super) fn tape_cross(&mut self, x: &CrossCanopy, tapes: &Tapes) -> Result<(), MeshError> {
        let layout = layout(x)?;
        let (n, m) = (layout.n, layout.m);
        let arm = |k: usize| {
            let out = (0..m).map(move |b| (k, 0, b));
            let end = (0..n).map(move |a| (k, a, m));
            out.chain(end).chain((1..=m).rev().map(move |b| (k, n, b)))
        };
        let outline: Vec<u32> = (0..4).flat_map(arm).map(|(k, a, b)| layout.arm(k, a, b)).collect();
        self.tape_sheet(&outline, tapes);
        self.tape_panels(&layout, tapes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use case::{Canopy, Tape, TapePlace};

    use super::*;
    use crate::structure::tests::scene;
    use crate::{CableKind, structure_mesh};

    fn canopy() -> CrossCanopy {
        CrossCanopy {
            panel_width_m: 2.0,
            panel_length_m: 6.0,
            cells_across: 4,
            cells_along_arm: 5,
            lines_per_arm: 3,
            line_length_m: 7.0,
            segments_per_line: 2,
            risers: None,
        }
    }

    /// Area and outline by the drawing; free edges between the arms; lines end on the arms' corners and middles.
    #[test]
    fn cross_is_as_drawn() {
        let mut with = scene(Canopy::Cross(canopy()));
        with.tapes = Some(Tapes {
            hem: Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..Tape::default() }),
            ..Tapes::default()
        });
        let mesh = structure_mesh(&with).unwrap();
        assert!((mesh.fabric_area(|_| true) - 20.0).abs() < 1e-12);
        assert_eq!(mesh.n_canopy, 25 + 4 * 5 * 5);
        assert_eq!(mesh.faces.len(), 16 + 4 * 20);
        let outline = 4.0 * (2.0 + 2.0 * 2.0);
        assert!((mesh.cable_length(CableKind::Tape(TapePlace::Hem)) - outline).abs() < 1e-12);
        assert_eq!(mesh.node_sets["rim"].len(), 4 * (2 * 5 + 4 + 1) - 4);
        let skirt = mesh.skirt();
        assert_eq!(skirt.len(), 12);
        let at = |n: u32| mesh.coords[n as usize];
        assert!(skirt.iter().all(|&n| at(n)[0].abs().max(at(n)[1].abs()) == 3.0));
        let taut = |c: &crate::Cable| {
            let [a, b] = c.nodes.map(at);
            (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt() - c.rest_length
        };
        let lines: Vec<f64> =
            mesh.cables.iter().filter(|c| c.kind == CableKind::SuspensionLine).map(taut).collect();
        assert_eq!(lines.len(), 24);
        assert!(lines.iter().all(|slack| *slack < 1e-12));
        assert_eq!(lines.iter().filter(|slack| slack.abs() < 1e-12).count(), 16);
    }

    #[test]
    fn crosses_that_cannot_be_rigged_are_refused() {
        let refused = |x: CrossCanopy| structure_mesh(&scene(Canopy::Cross(x))).unwrap_err().to_string();
        assert!(refused(CrossCanopy { line_length_m: 3.1, ..canopy() }).contains("corner"));
        assert!(refused(CrossCanopy { lines_per_arm: 6, ..canopy() }).contains("lines_per_arm"));
    }
}
