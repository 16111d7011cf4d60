//! Preparation of a scene for a run: loading, overrides of the command line, checks.

use std::path::{Path, PathBuf};

use case::Scene;
use checks::Inspection;
use checks::facts::Machine;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;

use super::folder::SCENE;
use super::options::RunOptions;
use crate::settings::{Setting, changed};

/// A loaded and checked scene with its overrides and its canopy.
pub struct Prepared {
    /// The scene with all overrides.
    pub scene: Scene,
    /// Absolute path of its file; still to be written if `text` is set.
    pub file: PathBuf,
    /// Text of the scene, if the command line overrides values.
    pub text: Option<String>,
    /// Absolute folder of the results.
    pub out: PathBuf,
    /// Its canopy.
    pub interface: CanopyInterface,
    /// First stage to run.
    pub first: usize,
    /// The scene as each stage sees it ([`Scene::for_stage`]).
    pub views: Vec<Scene>,
}

/// Findings of the inspection of a prepared scene.
///
/// # Errors
/// Parameters from which no canopy mesh can be built.
pub fn inspection(prepared: &Prepared, options: &RunOptions) -> Result<Inspection, RunError> {
    let Prepared { scene, interface, first, out, .. } = prepared;
    let machine = Machine::here(out, !options.mpirun.is_empty());
    let settings: Vec<String> = options.settings.iter().map(Setting::to_string).collect();
    Inspection::of(scene, interface, *first, machine, &options.scene, &settings)
}

/// Loads and checks everything that can be checked before a program starts.
///
/// # Errors
/// [`RunError::Input`] with a message for the user.
pub fn prepare(options: &RunOptions) -> Result<Prepared, RunError> {
    let (mut scene, text) = if options.settings.is_empty() {
        (case::load(&options.scene).map_err(|e| RunError::Input(e.to_string()))?, None)
    } else {
        let (scene, text) = changed(&options.scene, &options.settings)?;
        (scene, Some(text))
    };
    for (role, ranks) in &options.ranks {
        *scene.ranks.of_mut(*role) = *ranks;
    }
    if scene.flow_on_gpu() && scene.ranks.flow > 1 {
        return Err(RunError::Input(format!(
            "a GPU computes the flow of one rank, and --ranks gives {} to the flow: leave it out, or set flow.immersed.device to \"cpu\"",
            scene.ranks.flow
        )));
    }
    scene.programs.extend(options.programs.iter().cloned());
    let interface = CanopyInterface::new(&scene)?;
    let first = match &options.stage {
        None => 0,
        Some(name) => scene.stages.iter().position(|s| &s.name == name).ok_or_else(|| {
            let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
            RunError::Input(format!("the scene has no stage `{name}`; it has: {}", names.join(", ")))
        })?,
    };
    let (elements, kind) = match scene.has_fabric() {
        true => (interface.sizes.triangles, "membrane"),
        false => (interface.sizes.cables, "cable"),
    };
    if scene.has_canopy() && scene.ranks.structure as usize > elements {
        return Err(RunError::Input(format!(
            "{} ranks for the structure, but its mesh has only {elements} {kind} elements: use fewer ranks",
            scene.ranks.structure
        )));
    }
    let out = options
        .out
        .clone()
        .or_else(|| scene.output.folder.clone())
        .unwrap_or_else(|| Path::new("runs").join(&scene.name));
    let absolute = |path: &Path| std::path::absolute(path).map_err(RunError::file("resolve", path));
    let out = absolute(&out)?;
    let file = if text.is_some() { out.join(SCENE) } else { absolute(&options.scene)? };
    let views = (0..scene.stages.len()).map(|stage| scene.for_stage(stage)).collect();
    Ok(Prepared { file, text, out, scene, interface, first, views })
}
