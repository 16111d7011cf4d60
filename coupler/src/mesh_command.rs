//! `ripstop mesh`: the initial data of a stage as JSON, for solvers in any language.

use std::collections::BTreeMap;
use std::path::PathBuf;

use case::{Clock, Role, Scene, StageTimes};
use clap::Args;
use coupling::error::RunError;
use mesh::{FlowGrid, StructureMesh};
use serde::Serialize;

use crate::run::{Prepared, RunOptions, prepare};
use crate::settings::Setting;

/// Arguments of `ripstop mesh`.
#[derive(Args, Clone, Debug)]
pub struct MeshArgs {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage of the scene, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub stage: usize,
    /// Folder of the results [default: the scene's output.folder, or runs/NAME with the name of the scene]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Include the flow grid at the start of the stage
    #[arg(long)]
    pub grid: bool,
    /// Override a value of the scene (repeatable), as `ripstop run`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<Setting>,
}

/// The initial data of a stage.
#[derive(Serialize)]
struct StageStart {
    /// The scene with all defaults.
    scene: Scene,
    stage: usize,
    structure: StructureMesh,
    /// Saved state of each role, where an earlier stage wrote one.
    states: BTreeMap<Role, PathBuf>,
    /// Time of each clock of the scene at the start of the stage, s.
    clocks: BTreeMap<&'static str, f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    grid: Option<FlowGrid>,
}

/// The stage as JSON.
///
/// # Errors
/// [`RunError::Input`]: the scene is invalid, the stage does not exist, or the saved canopy
/// shape of an earlier stage is missing.
pub fn json(args: &MeshArgs) -> Result<String, RunError> {
    let input = |e: &dyn std::fmt::Display| RunError::Input(e.to_string());
    let options = RunOptions {
        scene: args.scene.clone(),
        out: args.out.clone(),
        settings: args.settings.clone(),
        ..RunOptions::default()
    };
    let Prepared { scene, out, .. } = prepare(&options)?;
    if args.stage >= scene.stages.len() {
        let n = scene.stages.len();
        return Err(input(&format!("--stage {}: the scene has {n} stages, counted from 0", args.stage)));
    }
    let scene = scene.for_stage(args.stage);
    let structure = mesh::structure_mesh(&scene).map_err(|e| input(&e))?;
    let grid = if args.grid {
        let positions = match scene.grid_shape(&out, args.stage) {
            Some(path) => mesh::load_shape(&path, structure.n_canopy).map_err(|e| input(&e))?,
            None => structure.coords[..structure.n_canopy].to_vec(),
        };
        Some(mesh::flow_grid(&scene, &structure, &positions).map_err(|e| input(&e))?)
    } else {
        None
    };
    let state = |role| Some((role, scene.source_state(&out, args.stage, role)?));
    let states = Role::ALL.into_iter().filter_map(state).collect();
    let times = StageTimes::completed(&scene, &out, args.stage);
    let clocks = [("stage", Clock::Stage), ("release", Clock::Release), ("run", Clock::Run)]
        .map(|(name, clock)| (name, times.clock(&scene, args.stage, clock)))
        .into();
    let start = StageStart { stage: args.stage, structure, states, clocks, grid, scene };
    serde_json::to_string(&start).map_err(|e| input(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(stage: usize, grid: bool) -> Result<serde_json::Value, RunError> {
        let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../cases/square-drop/scene.toml").into();
        changed(scene, stage, grid, &[])
    }

    fn changed(
        scene: PathBuf,
        stage: usize,
        grid: bool,
        settings: &[&str],
    ) -> Result<serde_json::Value, RunError> {
        let settings = settings.iter().map(|text| text.parse().expect("a setting")).collect();
        let text = json(&MeshArgs { scene, stage, out: Some("/nowhere".into()), grid, settings })?;
        Ok(serde_json::from_str(&text).expect("JSON"))
    }

    #[test]
    fn settings_replace_values_of_the_scene() {
        let scene: PathBuf = concat!(env!("CARGO_MANIFEST_DIR"), "/../cases/square-drop/scene.toml").into();
        let found = changed(
            scene.clone(),
            0,
            false,
            &["canopy.cells_across=4", "canopy.line_count=8", "coupling.relaxation=0.2"],
        );
        let found = found.expect("a scene of the repository");
        assert_eq!(found["structure"]["faces"].as_array().map(Vec::len), Some(16));
        assert_eq!(found["scene"]["coupling"]["relaxation"], 0.2);
        let wrong = changed(scene, 0, false, &["coupling.relaxation=2"]).expect_err("an invalid value");
        assert!(wrong.to_string().contains("--set coupling.relaxation=2"), "{wrong}");
    }

    #[test]
    fn stage_data_contain_scene_meshes_and_states() {
        let start = square(0, true).expect("a scene of the repository");
        assert_eq!(start["structure"]["faces"].as_array().map(Vec::len), Some(144));
        assert_eq!(start["structure"]["cables"].as_array().map(Vec::len), Some(24));
        assert_eq!(start["grid"]["canopy_nodes"].as_array().map(Vec::len), Some(169));
        assert_eq!(start["states"], serde_json::json!({}));
        // A default that the file leaves out, under the name that it has there.
        assert_eq!(start["scene"]["stage"][1]["name"], "developed-flow");
        assert_eq!(start["scene"]["coupling"]["relaxation"], 0.1);
    }

    #[test]
    fn later_stages_name_saved_states() {
        let start = square(2, false).expect("no file is read");
        assert_eq!(start["states"]["structure"], "/nowhere/pre-inflation/state/structure.bin");
        assert_eq!(start["states"]["flow"], "/nowhere/developed-flow/state/flow.bin");
        assert!(start["states"].get("mesh").is_none() && start.get("grid").is_none());
        // One second of inflation, 0.2 s of flow, then the release.
        let clocks = |stage| square(stage, false).expect("no file is read")["clocks"].clone();
        let shown = |stage: f64, release: f64, run: f64| serde_json::json!({ "stage": stage, "release": release, "run": run });
        assert_eq!([clocks(1), clocks(2)], [shown(0.0, -0.2, 1.0), shown(0.0, 0.0, 1.2)]);
        let missing = square(2, true).expect_err("no shape").to_string();
        assert!(missing.contains("/nowhere/pre-inflation/state/canopy.bin"), "{missing}");
        assert!(square(3, false).expect_err("three stages").to_string().contains("--stage 3"));
    }
}
