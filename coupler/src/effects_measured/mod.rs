//! `ripstop effects SCENE`: the effects of a scene ranked by estimate, and measured by runs with and without each.

mod bench;
pub mod measure;

use coupling::error::RunError;
use effects::estimate::Scope;
use effects::numbers::Numbers;
use effects::report::ranking;

use crate::run::{Prepared, RunOptions, prepare};

/// The effects of a scene in the order of what they change in its answer.
///
/// # Errors
/// Whatever `ripstop run` would refuse before it starts a program.
pub fn scene_report(options: &RunOptions) -> Result<String, RunError> {
    let prepared = prepare(options)?;
    let Prepared { scene, interface, .. } = &prepared;
    let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
    let n = Numbers::new(scene, interface, &mesh);
    let scope = Scope::new(&n, measured_stage(options, scene), None);
    Ok(ranking(&scope).join("\n"))
}

/// The stage whose answer is judged: the one that the command line names, or the last one.
pub(super) fn measured_stage(options: &RunOptions, scene: &case::Scene) -> usize {
    let named = options.stage.as_ref().and_then(|name| scene.stages.iter().position(|s| &s.name == name));
    named.unwrap_or(scene.stages.len().saturating_sub(1))
}
