//! `ripstop check`: what would run, and why.

use case::{Acceleration, CouplingOrder, LoadShape, Scheme, Solve, StageKind, StaggeredSequence};
use checks::Inspection;
use coupling::descent::DescentModel;
use coupling::error::RunError;
use effects::effects;
use results::program::program_folder;

use crate::launch::LaunchPlan;
use crate::run::{Prepared, RunOptions, inspection, prepare};

/// Loads and inspects a scene, and describes the run.
///
/// # Errors
/// Whatever `ripstop run` would refuse before it inspects the scene.
pub fn report(options: &RunOptions) -> Result<(String, Inspection), RunError> {
    let prepared = prepare(options)?;
    let inspection = inspection(&prepared, options)?;
    let Prepared { scene, file, out, interface, first, .. } = &prepared;
    let mut lines = vec![scene.caption()];
    let sizes = interface.sizes;
    lines.push(format!(
        "canopy: {} interface nodes, {} faces; mesh of {} nodes, {} triangles, {} cables",
        interface.nodes(),
        interface.faces.len(),
        sizes.nodes,
        sizes.triangles,
        sizes.cables
    ));
    lines.push(format!(
        "masses: fabric {:.4} kg ({:.3} m2), lines {:.4} kg{}",
        interface.masses.fabric,
        sizes.fabric_area,
        interface.masses.cables,
        DescentModel::of(scene, interface).map_or_else(String::new, |m| format!(
            ", with payload {:.3} kg; drag balances the weight of {:.1} N at a coefficient of {:.3}",
            m.mass_kg,
            m.mass_kg * m.gravity_m_s2,
            m.drag_coefficient(m.mass_kg * m.gravity_m_s2)
        ))
    ));
    if scene.flow.is_some() {
        lines.push(flow_grid_line(&prepared));
    }
    lines.push(crate::launch::memory::line(scene, *first, interface));
    lines.push("effects:".into());
    for effect in effects(scene) {
        let state = if effect.on { "on " } else { "off" };
        lines.push(format!("  {state} {:<28} {} ({})", effect.key, effect.what, effect.role.program()));
    }
    if scene.stages.iter().any(|s| s.kind == StageKind::Coupled) {
        lines.push(coupling(scene));
    }
    lines.push("stages:".into());
    for (at, stage) in scene.stages.iter().enumerate().skip(*first) {
        let why = match stage.kind {
            StageKind::PreInflation => format!(
                "structure alone under {} Pa",
                stage.pressure_pa.map_or_else(|| "?".into(), |p| p.to_string())
            ),
            StageKind::FlowOnly => "flow alone around the canopy held still".into(),
            StageKind::Prescribed => "mesh and flow around the canopy that moves as prescribed".into(),
            StageKind::Coupled => {
                "structure, mesh and flow coupled".to_owned()
                    + if scene.descent.is_some() { ", with the descent" } else { "" }
            }
        };
        let substeps = if !stage.kind.roles().contains(&case::Role::Structure) {
            String::new()
        } else {
            format!(" x {} substeps", stage.substeps)
        };
        let time = match stage.solve {
            _ if stage.steady.is_some() => "to a steady state".into(),
            Solve::Static => "at rest".into(),
            Solve::Dynamic => {
                format!(
                    "{} s in {} windows of {} s{substeps}",
                    stage.duration_s,
                    stage.windows(),
                    stage.window_s
                )
            }
        };
        lines.push(format!("  {}. {}: {why}; {time}", at + 1, stage.name));
        let plan = LaunchPlan {
            scene,
            scene_file: file,
            stage: at,
            session: "SESSION",
            out,
            programs: &program_folder()?,
            scratch: &std::env::temp_dir(),
            mpirun: &options.mpirun,
            resume: None,
        };
        match plan.programs() {
            Ok(programs) => lines.extend(programs.iter().map(|p| format!("       {}", p.line()))),
            Err(error) => lines.push(format!("       missing: {error}")),
        }
    }
    lines.push(format!("results: {}", out.display()));
    lines.push(inspection.text());
    Ok((lines.join("\n"), inspection))
}

fn coupling(scene: &case::Scene) -> String {
    let c = &scene.coupling;
    let scheme = match c.scheme {
        Scheme::Staggered => {
            let order = c.staggered.predictor;
            match c.staggered.sequence {
                StaggeredSequence::StructureFirst if order == 0 => {
                    "staggered: each program once in a window, with the pressures of the last".to_owned()
                }
                StaggeredSequence::StructureFirst => {
                    format!("staggered: structure first, under loads extrapolated with order {order}")
                }
                StaggeredSequence::FlowFirst => {
                    format!("staggered: flow first, around a canopy extrapolated with order {order}")
                }
                StaggeredSequence::AddedMass => {
                    format!(
                        "staggered: structure first with added mass implicit, the rest extrapolated with order {order}"
                    )
                }
                StaggeredSequence::HalfStep => {
                    format!(
                        "staggered: flow half a window off, around a canopy extrapolated with order {order}"
                    )
                }
            }
        }
        Scheme::Implicit => {
            let by = match c.acceleration {
                Acceleration::Constant => format!("relaxation {}", c.relaxation),
                Acceleration::Aitken => format!("Aitken's relaxation from {}", c.relaxation),
                Acceleration::IqnIls => {
                    format!("IQN-ILS with the secants of {} earlier windows", c.reused_windows)
                }
                Acceleration::IbqnLs => "block quasi-Newton with secants of the flow".to_owned(),
                Acceleration::IqnImvj => {
                    format!("IQN-IMVJ with the secants of {} earlier windows", c.reused_windows)
                }
            };
            let order = match c.order {
                CouplingOrder::GaussSeidel => "implicit",
                CouplingOrder::Jacobi => "implicit in Jacobi order",
            };
            format!(
                "{order}: at most {} iterations a window to {:.0e}, accelerated by {by}",
                c.max_iterations, c.tolerance
            )
        }
    };
    let load = match c.load {
        LoadShape::Mean => "mean",
        LoadShape::Constant => "constant",
        LoadShape::Linear => "linear",
    };
    format!("coupling: {scheme}; load over the substeps: {load}")
}

/// Sizes of the flow grid: its topology is that around the unstressed canopy.
fn flow_grid_line(prepared: &Prepared) -> String {
    let made = mesh::structure_mesh(&prepared.scene)
        .and_then(|canopy| mesh::draft_grid(&prepared.scene, &canopy, &prepared.interface.coords));
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
                    format!(
                        "{sizes}; around the unstressed canopy:\n  {}",
                        report.trim_end().replace('\n', "\n  ")
                    )
                }
                Err(_) => sizes + "; its quality stands in grid.txt of each stage's folder",
            }
        }
        Err(mesh::MeshError::Parameter { .. }) => "flow grid: none, see the inspection".into(),
        Err(error) => format!("flow grid: made from the inflated shape at the start of a stage ({error})"),
    }
}
