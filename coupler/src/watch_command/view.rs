//! What `ripstop watch` reads of a run.

use std::path::{Path, PathBuf};

use case::{Scene, Stage};
use coupling::error::RunError;
use results::follow::Follower;
use results::progress::StageProgress;
use results::run_state::RunStatus;
use serde_json::Value;

use crate::diff_command::scene_of;

/// A run that is followed.
pub(super) struct Watched {
    folder: PathBuf,
    scene: Scene,
    pub(super) status: RunStatus,
    /// Index of the stage that is shown.
    stage: usize,
    rows: Follower,
    log: Log,
}

/// What is shown of a run.
pub(super) struct View<'a> {
    pub(super) scene: &'a Scene,
    pub(super) status: &'a RunStatus,
    pub(super) stage: &'a Stage,
    /// Number of the stage, from 1.
    pub(super) number: usize,
    /// Progress of that stage; `None` before it starts, and where an earlier version wrote none.
    pub(super) progress: Option<&'a StageProgress>,
    pub(super) rows: &'a Follower,
    /// Number of warnings, and the last one.
    pub(super) warnings: (usize, Option<&'a str>),
}

impl Watched {
    /// Opens the run in `folder`.
    ///
    /// # Errors
    /// No run there.
    pub(super) fn open(folder: &Path) -> Result<Self, RunError> {
        let status = RunStatus::read(folder)?;
        let scene = scene_of(folder)?;
        let rows = Follower::new(&history(folder, &scene, 0));
        Ok(Self { folder: folder.into(), scene, status, stage: 0, rows, log: Log::default() })
    }

    /// Reads what was written since the last call.
    ///
    /// # Errors
    /// A file cannot be read, or is damaged.
    pub(super) fn update(&mut self) -> Result<(), RunError> {
        self.status = RunStatus::read(&self.folder)?;
        let stage = self.current();
        if stage != self.stage {
            self.stage = stage;
            self.rows = Follower::new(&history(&self.folder, &self.scene, stage));
        }
        self.rows.update()?;
        self.log.update(&self.folder.join("ripstop.log"));
        Ok(())
    }

    /// The stage that runs, or was the last one to run.
    fn current(&self) -> usize {
        let last = self.scene.stages.len().saturating_sub(1);
        if let Some(progress) = &self.status.progress {
            return (progress.number - 1).min(last);
        }
        let begun = |at: &usize| history(&self.folder, &self.scene, *at).is_file();
        (0..=last).rev().find(begun).unwrap_or(0)
    }

    /// What is shown.
    pub(super) fn view(&self) -> View<'_> {
        View {
            scene: &self.scene,
            status: &self.status,
            stage: &self.scene.stages[self.stage],
            number: self.stage + 1,
            progress: self.status.progress.as_ref().filter(|p| p.number == self.stage + 1),
            rows: &self.rows,
            warnings: (self.log.warnings, self.log.last.as_deref()),
        }
    }
}

impl View<'_> {
    /// Completed planned windows, from the time of the last row: a window that was divided has several rows.
    pub(super) fn done(&self) -> u64 {
        let rows = self.rows.rows() as u64;
        let planned = self.stage.window_s > 0.0 && self.stage.duration_s > 0.0;
        match self.rows.last("time_s").filter(|_| planned) {
            Some(time) => ((time / self.stage.window_s + 1e-6) as u64).min(self.stage.windows()),
            None => rows.min(self.stage.windows()),
        }
    }

    /// A number of `summary.json`.
    pub(super) fn summary(&self, key: &str) -> Option<f64> {
        self.status.summary.as_ref()?.get(key).and_then(Value::as_f64)
    }
}

fn history(folder: &Path, scene: &Scene, stage: usize) -> PathBuf {
    case::stage_folder(folder, scene, stage).join("history.csv")
}

/// Warnings in the log of a run.
#[derive(Default)]
struct Log {
    /// Size of the log when it was read.
    size: u64,
    warnings: usize,
    last: Option<String>,
}

impl Log {
    /// Reads the log if its size has changed. A run without a log has no warnings to show.
    fn update(&mut self, path: &Path) {
        let size = path.metadata().map_or(0, |m| m.len());
        if size == self.size {
            return;
        }
        let text = std::fs::read_to_string(path).unwrap_or_default();
        // Date and time have 20 letters with the space after them.
        let warnings = text.lines().filter_map(|line| line.get(20..)?.strip_prefix("warning "));
        let all: Vec<&str> = warnings.collect();
        *self = Self { size, warnings: all.len(), last: all.last().map(|text| (*text).to_owned()) };
    }
}
