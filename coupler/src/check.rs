//! `ripstop check`: the planned stages and programs, and the findings of the inspection.

use checks::{Inspection, description};
use coupling::error::RunError;
use results::program::program_folder;

use crate::launch::LaunchPlan;
use crate::run::{Prepared, RunOptions, inspection, prepare};

/// Loads and inspects a scene; returns a description of the run and the findings.
///
/// # Errors
/// As `ripstop run` before its inspection of the scene.
pub fn report(options: &RunOptions) -> Result<(String, Inspection), RunError> {
    let prepared = prepare(options)?;
    let inspection = inspection(&prepared, options)?;
    let Prepared { scene, out, interface, first, .. } = &prepared;
    let mut lines = description::scene(scene, interface, *first);
    lines.push("stages:".into());
    for stage in *first..scene.stages.len() {
        lines.push(description::stage(scene, stage));
        lines.extend(programs(&prepared, options, stage)?);
    }
    lines.push(format!("results: {}", out.display()));
    lines.push(inspection.text());
    Ok((lines.join("\n"), inspection))
}

/// The findings of the inspection as JSON: an array of [`results::finding::Finding`].
///
/// # Errors
/// As [`report()`].
pub fn json(options: &RunOptions) -> Result<(String, Inspection), RunError> {
    let inspection = inspection(&prepare(options)?, options)?;
    Ok((serde_json::to_string_pretty(&inspection.findings).unwrap_or_default(), inspection))
}

/// The command lines of a stage.
fn programs(prepared: &Prepared, options: &RunOptions, stage: usize) -> Result<Vec<String>, RunError> {
    let plan = LaunchPlan {
        scene: &prepared.scene,
        scene_file: &prepared.file,
        stage,
        session: "SESSION",
        out: &prepared.out,
        programs: &program_folder()?,
        scratch: &std::env::temp_dir(),
        mpirun: &options.mpirun,
        resume: None,
    };
    Ok(match plan.programs() {
        Ok(programs) => programs.iter().map(|p| format!("       {}", p.line())).collect(),
        Err(error) => vec![format!("       missing: {error}")],
    })
}
