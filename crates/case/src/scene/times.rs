//! How long stages take, and what the clocks of a run show.

use std::path::{Path, PathBuf};

use crate::{Clock, Role, Scene, Stage, StageKind, state_folder};

/// File of a folder of saved states: time since the start of the stage.
const FILE: &str = "time.toml";

/// Time of a saved state since the start of its stage.
#[derive(serde::Serialize, serde::Deserialize)]
struct SavedTime {
    time_s: f64,
}

/// Writes the time of the state in `folder`, s since the start of its stage.
///
/// # Errors
/// The file cannot be written; with its path.
pub fn save_time(folder: &Path, time_s: f64) -> Result<(), (PathBuf, std::io::Error)> {
    let path = folder.join(FILE);
    std::fs::write(&path, format!("time_s = {time_s:?}\n")).map_err(|e| (path, e))
}

fn saved_time(folder: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(folder.join(FILE)).ok()?;
    toml::from_str::<SavedTime>(&text).ok().map(|s| s.time_s).filter(|t| t.is_finite() && *t >= 0.0)
}

/// Time that each stage takes, s.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTimes(Vec<f64>);

impl StageTimes {
    /// As the scene plans them.
    pub fn planned(scene: &Scene) -> Self {
        Self(scene.stages.iter().map(Stage::planned_s).collect())
    }

    /// For a run that is about to start or continue `stage`: the stages before it took as long as their states
    /// below `out` say, for a stage may end early; as planned where no state says.
    pub fn completed(scene: &Scene, out: &Path, stage: usize) -> Self {
        let mut times = Self::planned(scene);
        for (k, time) in times.0.iter_mut().enumerate().take(stage) {
            *time = saved_time(&state_folder(out, scene, k)).unwrap_or(*time);
        }
        times
    }

    /// Time that `stage` takes, s.
    pub fn of(&self, stage: usize) -> f64 {
        self.0.get(stage).copied().unwrap_or(0.0)
    }

    /// Time of the run at the start of `stage`, s.
    pub fn start(&self, stage: usize) -> f64 {
        self.0.iter().take(stage).fold(0.0, |sum, t| sum + t)
    }

    /// What `clock` shows at the start of `stage`, s.
    pub fn clock(&self, scene: &Scene, stage: usize, clock: Clock) -> f64 {
        match clock {
            Clock::Stage => 0.0,
            Clock::Run => self.start(stage),
            Clock::Release => {
                // Sums over the stages between: exactly zero at the release itself.
                let release = scene.release_stage();
                let between = |a: usize, b: usize| self.0[a..b].iter().fold(0.0, |sum, t| sum + t);
                if stage < release { -between(stage, release) } else { between(release, stage) }
            }
        }
    }
}

impl Scene {
    /// The first stage in which the canopy moves in the flow; without one, the first with the flow; without
    /// that, the first.
    pub fn release_stage(&self) -> usize {
        let moves = |s: &Stage| matches!(s.kind, StageKind::Coupled | StageKind::Prescribed);
        let flows = |s: &Stage| s.kind.roles().contains(&Role::Flow);
        let first = |which: &dyn Fn(&Stage) -> bool| self.stages.iter().position(which);
        first(&moves).or_else(|| first(&flows)).unwrap_or(0)
    }
}
