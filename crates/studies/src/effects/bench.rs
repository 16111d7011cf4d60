//! Runs of a scene and of its variants, for measurements.

use std::fs;
use std::path::{Path, PathBuf};

use crate::accuracy::quantities::reduce;
use case::{Role, Scene, StageKind, Statistic};

use coupling::error::RunError;
use results::history;
use results::state::copy_states;
use results::summary::StageSummary;

use super::Work;

/// Runs scenes like `ripstop run`; unconverged windows are accepted.
pub trait Runner {
    /// Runs the scene in `file` with results in `out`: all stages, or one stage (name, number of windows). Returns the
    /// summary of the last stage.
    ///
    /// # Errors
    /// The run fails.
    fn run(
        &self,
        file: &Path,
        out: &Path,
        stage: Option<(&str, u64)>,
    ) -> Result<Option<StageSummary>, RunError>;
}

/// Result of a run of the measured stage.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Descent speed (m/s), drag (N) and line tension (N): means over the second half of the run.
    pub answer: [Option<f64>; 3],
    /// Work of the run.
    pub work: Work,
}

/// A temporary folder in which variants of a scene run.
pub struct Bench<'a> {
    folder: PathBuf,
    scene: &'a Scene,
    stage: usize,
    windows: u64,
    earlier: Option<&'a Path>,
    runner: &'a dyn Runner,
}

impl<'a> Bench<'a> {
    /// Prepares runs of `windows` windows of stage `stage`; `earlier`: results folder with the initial states of the stage.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn new(
        scene: &'a Scene,
        stage: usize,
        windows: u64,
        earlier: Option<&'a Path>,
        runner: &'a dyn Runner,
    ) -> Result<Self, RunError> {
        let folder = std::env::temp_dir().join(format!("ripstop-effects-{}", std::process::id()));
        fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        Ok(Self { folder, scene, stage, windows, earlier, runner })
    }

    fn states(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}-before"))
    }

    /// Whether an effect of `programs` acts in a stage that runs here before the measured one.
    pub fn acts_before(&self, programs: &[&str]) -> bool {
        let roles = |k: StageKind| k.roles().iter().any(|r| programs.contains(&r.program()));
        self.earlier.is_none() && self.scene.stages[..self.stage].iter().any(|s| roles(s.kind))
    }

    /// Computes or copies the initial states of the measured stage, under the name `name`.
    ///
    /// # Errors
    /// A run fails, or a file cannot be copied.
    pub fn prepare(&self, name: &str, scene: &Scene) -> Result<(), RunError> {
        let target = self.states(name);
        if let Some(from) = self.earlier {
            return copy_states(self.scene, self.stage, from, &target);
        }
        if self.stage == 0 {
            return Ok(());
        }
        let first = first_stages(scene, self.stage);
        let file = self.write(&format!("{name}-before"), &first)?;
        self.runner.run(&file, &target, None)?;
        Ok(())
    }

    fn write(&self, name: &str, scene: &Scene) -> Result<PathBuf, RunError> {
        let file = self.folder.join(format!("{name}.toml"));
        let mut scene = scene.clone();
        // Absolute paths, because the variant runs in another folder.
        let files = [
            scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).map(|g| &mut g.path),
            scene.canopy.file_mut(),
        ];
        for path in files.into_iter().flatten() {
            *path = std::path::absolute(&*path).map_err(RunError::file("resolve", &*path))?;
        }
        let text = toml::to_string(&scene)
            .map_err(|e| RunError::Input(format!("the changed scene cannot be written: {e}")))?;
        fs::write(&file, text).map_err(RunError::file("write", &file))?;
        Ok(file)
    }

    /// Runs the measured stage of `scene` from the prepared states `states`.
    ///
    /// # Errors
    /// The run fails.
    pub fn run(&self, name: &str, states: &str, scene: &Scene) -> Result<Outcome, RunError> {
        let file = self.write(name, &first_stages(scene, self.stage + 1))?;
        let out = self.folder.join(name);
        copy_states(scene, self.stage, &self.states(states), &out)?;
        let stage = &scene.stages[self.stage];
        let summary = self.runner.run(&file, &out, Some((&stage.name, self.windows)))?;
        let columns = history::read(&out.join(&stage.name).join("history.csv"))?;
        let column = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_slice());
        let sum =
            |name: &str| column(name).map_or(0, |v| v.iter().filter(|x| x.is_finite()).sum::<f64>() as u64);
        let s = summary.as_ref();
        Ok(Outcome {
            answer: answer(stage.kind, scene.has_cables(), column),
            work: Work {
                busy_s: s.map_or([0.0; 3], |s| [s.structure_busy_s, s.flow_busy_s, s.mesh_busy_s]),
                iterations: s.map_or(0, |s| s.iterations),
                structure_steps: sum("structure_newton_steps"),
                flow_iterations: sum("flow_iterations"),
                windows: s.map_or(0, |s| s.windows),
            },
        })
    }
}

impl Drop for Bench<'_> {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// The scene with its first `count` stages and without snapshots.
fn first_stages(scene: &Scene, count: usize) -> Scene {
    let mut first = scene.clone();
    first.output.surface_every_windows = 0;
    first.output.volume_every_windows = 0;
    first.stages.truncate(count);
    let stages: Vec<&str> = first.stages.iter().map(|s| s.name.as_str()).collect();
    // Reefing that is released in a removed stage remains.
    for r in &mut first.reefing {
        if r.release_stage.as_ref().is_some_and(|name| !stages.contains(&name.as_str())) {
            (r.release_stage, r.release_s, r.release_ramp_s) = (None, 0.0, 0.0);
        }
    }
    first
}

/// Means over the second half of the history of a stage; the last value of a static stage.
fn answer<'c>(kind: StageKind, lines: bool, column: impl Fn(&str) -> Option<&'c [f64]>) -> [Option<f64>; 3] {
    let runs = |role| kind.roles().contains(&role);
    let mean = |name: &str| {
        let (time, values) = (column("time_s")?, column(name)?);
        let end = *time.last()?;
        let value = reduce(time, values, Statistic::Mean, 0.5 * end, end)?;
        value.is_finite().then_some(value)
    };
    [
        (kind == StageKind::Coupled).then(|| mean("descent_speed_m_s")).flatten(),
        if runs(Role::Flow) { mean("drag_n") } else { mean("vertical_load_n") },
        (lines && runs(Role::Structure)).then(|| mean("riser_force_n")).flatten(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_means_over_the_second_half() {
        let time = [0.1, 0.2, 0.3, 0.4];
        let (speed, drag, riser) = ([4.0, 5.0, 6.0, 7.0], [10.0, 20.0, 20.0, 20.0], [0.0, 1.0, 3.0, 5.0]);
        let column = |name: &str| -> Option<&[f64]> {
            Some(match name {
                "time_s" => &time,
                "descent_speed_m_s" => &speed,
                "drag_n" => &drag,
                "riser_force_n" => &riser,
                _ => return None,
            })
        };
        let close = |a: Option<f64>, b: f64| assert!((a.expect("a value") - b).abs() < 1e-12, "{a:?} {b}");
        let all = answer(StageKind::Coupled, true, column);
        close(all[0], 6.0);
        close(all[1], 20.0);
        close(all[2], 3.0);
        let flow = answer(StageKind::FlowOnly, true, column);
        assert!(flow[0].is_none() && flow[2].is_none());
        assert!(answer(StageKind::PreInflation, false, column).iter().all(Option::is_none));
    }
}
