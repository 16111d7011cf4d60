//! Description of a scene for `ripstop check`: canopy, masses, flow grid, effects, coupling, stages.

use case::{Discretisation, LoadShape, Role, Scene, Solve, Stage, StageKind};
use coupling::descent::DescentModel;
use coupling::interface::CanopyInterface;
use coupling::schemes::describe;
use effects::effects;
use terminal::counted;

use crate::facts::immersed_sizes;
use crate::shared_memory;

/// The description of the scene; `first`: the first stage to run, from 0.
pub fn scene(scene: &Scene, interface: &CanopyInterface, first: usize) -> Vec<String> {
    let mut lines = vec![scene.caption()];
    if scene.has_canopy() {
        lines.extend(canopy(scene, interface));
    } else {
        lines.push("canopy: none".into());
    }
    if scene.flow.is_some() {
        lines.extend(scene.views(first).iter().map(|view| flow_grid(view, interface)));
    }
    lines.push(shared_memory::line(scene, first, interface));
    lines.push("effects:".into());
    for effect in effects(scene) {
        let state = if effect.on { "on " } else { "off" };
        lines.push(format!("  {state} {:<28} {} ({})", effect.key, effect.what, effect.role.program()));
    }
    if scene.stages.iter().any(|s| s.kind == StageKind::Coupled) {
        let mut both: Vec<String> = scene.views(first).iter().map(coupling).collect();
        both.dedup();
        lines.extend(both);
    }
    lines
}

/// The description of stage `at` (from 0): programs and duration.
pub fn stage(scene: &Scene, at: usize) -> String {
    let stage = &scene.stages[at];
    // Named where stages differ.
    let both = scene.views(0).len() > 1 && stage.kind.roles().contains(&Role::Flow);
    let method = match scene.discretisation(stage) {
        _ if !both => "",
        Discretisation::Fitted => ", fitted grid",
        Discretisation::Immersed => ", immersed canopy",
    };
    format!("  {}. {}: {}{method}; {}", at + 1, stage.name, what(scene, stage), time(stage))
}

/// Sizes and masses of the canopy.
fn canopy(scene: &Scene, interface: &CanopyInterface) -> [String; 2] {
    let sizes = interface.sizes;
    let mesh = format!(
        "canopy: {} interface nodes, {} faces; mesh of {} nodes, {} triangles, {} cables",
        interface.nodes(),
        interface.faces.len(),
        sizes.nodes,
        sizes.triangles,
        sizes.cables
    );
    let payload = DescentModel::of(scene, interface).map_or_else(String::new, |m| {
        let weight = m.mass_kg * m.gravity_m_s2;
        let coefficient = m.drag_coefficient(weight).map_or_else(String::new, |c| {
            format!("; drag balances the weight of {weight:.1} N at a drag coefficient of {c:.3}")
        });
        format!(", with payload {:.3} kg{coefficient}", m.mass_kg)
    });
    let parts = interface.masses.parts();
    let parts: Vec<String> = parts
        .into_iter()
        .map(|(name, mass)| match name.as_str() {
            "fabric" => format!("fabric {mass:.4} kg ({:.3} m2)", sizes.fabric_area),
            _ => format!("{name} {mass:.4} kg"),
        })
        .collect();
    let all = interface.masses.suspended();
    [mesh, format!("masses: {}; in all {all:.4} kg{payload}", parts.join(", "))]
}

fn what(scene: &Scene, stage: &Stage) -> String {
    match stage.kind {
        StageKind::PreInflation if !scene.has_fabric() => "cables alone".into(),
        StageKind::PreInflation => format!(
            "structure alone under {} Pa",
            stage.pressure_pa.map_or_else(|| "?".into(), |p| p.to_string())
        ),
        StageKind::FlowOnly if !scene.has_canopy() => "flow alone around rigid bodies at rest".into(),
        StageKind::FlowOnly => "flow alone around the canopy at rest".into(),
        StageKind::Prescribed
            if stage.motions.is_empty() && !stage.body_motions.iter().any(|m| scene.moves_canopy(m)) =>
        {
            "mesh and flow around rigid bodies with prescribed motion".into()
        }
        StageKind::Prescribed if scene.is_immersed(stage) => {
            "flow around the canopy with prescribed motion".into()
        }
        StageKind::Prescribed => "mesh and flow around the canopy with prescribed motion".into(),
        StageKind::Trajectory => "trajectory of a point mass, without a program".into(),
        StageKind::Coupled => {
            let programs = if scene.is_immersed(stage) {
                "coupled structure and flow"
            } else {
                "coupled structure, mesh and flow"
            };
            programs.to_owned() + if scene.descent.is_some() { ", with the descent" } else { "" }
        }
    }
}

fn time(stage: &Stage) -> String {
    let substeps = if stage.kind.roles().contains(&Role::Structure) {
        format!(" x {} substeps", stage.substeps)
    } else {
        String::new()
    };
    match stage.solve {
        _ if stage.steady.is_some() => "to a steady state".into(),
        Solve::Static => "static equilibrium".into(),
        Solve::Dynamic => {
            let windows = counted(stage.windows(), "window");
            format!("{} s in {windows} of {} s{substeps}", stage.duration_s, stage.window_s)
        }
    }
}

/// Coupling scheme and load interpolation.
fn coupling(scene: &Scene) -> String {
    let c = &scene.coupling;
    let load = match scene.load_shape() {
        LoadShape::Mean => "mean",
        LoadShape::Constant => "constant",
        LoadShape::Linear => "linear",
    };
    format!("coupling: {}; load over the substeps: {load}", describe(c))
}

/// Sizes and quality of the flow grid around the unstressed canopy.
fn flow_grid(scene: &Scene, interface: &CanopyInterface) -> String {
    if let Some(g) = scene.flow.as_ref().and_then(|f| f.immersed.as_ref()) {
        let cells = mesh::structure_mesh(scene).map_or(0, |mesh| immersed_sizes(g, &mesh).cells);
        let device = match g.device {
            case::FlowDevice::Cpu => "",
            case::FlowDevice::Gpu => "; steps on a GPU",
        };
        return format!(
            "flow grid: Cartesian, {cells} cells around the unstressed canopy, {} m wide at the canopy, which moves through it{device}",
            g.spacing_m
        );
    }
    let made =
        mesh::structure_mesh(scene).and_then(|canopy| mesh::draft_grid(scene, &canopy, &interface.coords));
    match made {
        Ok(grid) => {
            let sizes = format!(
                "flow grid: {} cells, {} nodes, far field of {} faces",
                grid.cells.len(),
                grid.coords.len(),
                grid.boundary.len()
            );
            match mesh::FaceTable::new(&grid) {
                Ok(faces) => {
                    let report = mesh::QualityReport::new(&grid, &faces).to_string();
                    let around = if scene.has_canopy() { "; around the unstressed canopy" } else { "" };
                    format!("{sizes}{around}:\n  {}", report.trim_end().replace('\n', "\n  "))
                }
                Err(_) => sizes + "; its quality is in grid.txt in the folder of each stage",
            }
        }
        Err(mesh::MeshError::Parameter { .. }) => "flow grid: none, see the inspection".into(),
        Err(error) => format!("flow grid: built around the inflated shape at the start of a stage ({error})"),
    }
}
