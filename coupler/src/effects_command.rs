//! `ripstop effects SCENE`: effects ranked by their estimated change of the results, and measured by runs with and without each.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use coupling::error::RunError;
use effects::estimate::Scope;
use effects::numbers::Numbers;
use effects::report::ranking;
use results::summary::StageSummary;
use studies::effects::{Measurements, Runner, Runs, measurements};
use terminal::Console;

use crate::run::{Prepared, RunOptions, prepare, run};

/// The effects of a scene, ordered by their estimated change of its results.
///
/// # Errors
/// As `ripstop run` before it starts a program.
pub fn scene_report(options: &RunOptions) -> Result<String, RunError> {
    let prepared = prepare(options)?;
    let Prepared { scene, interface, .. } = &prepared;
    let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
    let n = Numbers::new(scene, interface, &mesh);
    let scope = Scope::new(&n, measured_stage(options, scene), None);
    Ok(ranking(&scope).join("\n"))
}

/// The stage whose results are compared: as named on the command line, else the last one.
fn measured_stage(options: &RunOptions, scene: &case::Scene) -> usize {
    let named = options.stage.as_ref().and_then(|name| scene.stages.iter().position(|s| &s.name == name));
    named.unwrap_or(scene.stages.len().saturating_sub(1))
}

/// Runs scenes in this process, until `stop`.
struct LocalRunner<'a> {
    stop: &'a AtomicBool,
}

impl Runner for LocalRunner<'_> {
    fn run(
        &self,
        file: &Path,
        out: &Path,
        stage: Option<(&str, u64)>,
    ) -> Result<Option<StageSummary>, RunError> {
        let options = RunOptions {
            scene: file.to_owned(),
            out: Some(out.to_owned()),
            stage: stage.map(|(name, _)| name.to_owned()),
            stop_after_windows: stage.map(|(_, windows)| windows),
            accept_unconverged: true,
            ..RunOptions::default()
        };
        let (summary, _) = run(&options, self.stop, &Console::new(true))?;
        Ok(summary.stages.last().cloned())
    }
}

/// Measures the effects of the scene by runs with and without each.
///
/// # Errors
/// Errors of the scene itself; the error of a variant is in its row.
pub fn measure(
    options: &RunOptions,
    runs: &Runs,
    earlier: Option<&Path>,
    stop: &AtomicBool,
    console: &Console,
) -> Result<Measurements, RunError> {
    let Prepared { scene, interface, .. } = prepare(options)?;
    let stage = measured_stage(options, &scene);
    measurements((&scene, &interface, stage), runs, earlier, &LocalRunner { stop }, console)
}
