//! The results of a complete or incomplete run.

use std::path::{Path, PathBuf};

use case::{Scene, StageKind};
use coupling::error::RunError;
use figures::snapshots::{Kind, RunSnapshots};
use results::alternation::Alternation;
use results::history;
use results::run_state::{RunState, RunStatus};
use results::settled::SettledMean;
use results::strength::SafetyFactor;
use results::wake::Wake;
use serde_json::Value;

/// Columns of a history, by name.
#[derive(Default)]
pub(super) struct Columns(Vec<(String, Vec<f64>)>);

impl Columns {
    /// A column with at least one finite value.
    pub(super) fn get(&self, name: &str) -> Option<&[f64]> {
        let (_, values) = self.0.iter().find(|(n, _)| n == name)?;
        values.iter().any(|v| v.is_finite()).then_some(&values[..])
    }

    /// The settled mean of a column; `None` for fewer than 40 values or a constant column.
    pub(super) fn settled(&self, name: &str) -> Option<SettledMean> {
        SettledMean::of(name, &self.0)
    }

    /// Time and value of each row; empty without such a column.
    pub(super) fn series(&self, name: &str) -> Vec<(f64, f64)> {
        match (self.get("time_s"), self.get(name)) {
            (Some(time), Some(values)) => time.iter().copied().zip(values.iter().copied()).collect(),
            _ => Vec::new(),
        }
    }

    /// Value of the last row.
    pub(super) fn last(&self, name: &str) -> Option<f64> {
        self.get(name)?.last().copied().filter(|v| v.is_finite())
    }

    /// Sum over the rows; 0 without such a column.
    pub(super) fn sum(&self, name: &str) -> f64 {
        self.get(name).map_or(0.0, |v| v.iter().filter(|v| v.is_finite()).sum())
    }

    /// The largest value.
    pub(super) fn max(&self, name: &str) -> Option<f64> {
        self.get(name).map(|v| v.iter().copied().filter(|v| v.is_finite()).fold(f64::MIN, f64::max))
    }

    /// Mean and standard deviation over the last half of the rows.
    pub(super) fn late(&self, name: &str) -> Option<(f64, f64)> {
        let values = self.get(name)?;
        let late: Vec<f64> = values[values.len() / 2..].iter().copied().filter(|v| v.is_finite()).collect();
        if late.is_empty() {
            return None;
        }
        let n = late.len() as f64;
        let mean = late.iter().sum::<f64>() / n;
        Some((mean, (late.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()))
    }

    /// The wake of the stage; `None` where its history has none.
    pub(super) fn wake(&self) -> Option<Wake> {
        Wake::of_history(&self.0)
    }

    /// Alternation of the drag from window to window; `None` with fewer than 40 windows.
    pub(super) fn alternation(&self) -> Option<Alternation> {
        Alternation::of_history(&self.0)
    }

    /// All columns with their names.
    pub(super) fn all(&self) -> &[(String, Vec<f64>)] {
        &self.0
    }

    /// Safety factors of lines and risers, of which the parachute has `risers`.
    pub(super) fn safety_factors(&self, scene: &Scene, risers: usize) -> Vec<SafetyFactor> {
        SafetyFactor::of(scene, risers, &self.0)
    }

    /// Number of windows.
    pub(super) fn rows(&self) -> usize {
        self.0.first().map_or(0, |(_, v)| v.len())
    }

    /// Names of the columns that start with `start`.
    pub(super) fn starting(&self, start: &str) -> Vec<&str> {
        self.0.iter().map(|(n, _)| n.as_str()).filter(|n| n.starts_with(start)).collect()
    }
}

/// A stage with at least one accepted window.
pub(super) struct StageData {
    /// Index in the scene.
    pub(super) index: usize,
    /// History.
    pub(super) columns: Columns,
    /// Displacement of points of the canopy; no column without them.
    pub(super) points: Columns,
    /// Motion of a payload that is a body; no column of any other.
    pub(super) payload: Columns,
    /// Its entry in `summary.json`.
    pub(super) summary: Option<Value>,
}

/// A run.
pub(super) struct Run {
    /// Results folder.
    pub(super) folder: PathBuf,
    /// Snapshots.
    pub(super) results: RunSnapshots,
    /// `summary.json`; `None` before the end of the run.
    pub(super) summary: Option<Value>,
    /// Stages with at least one accepted window, in the order of the scene.
    pub(super) stages: Vec<StageData>,
    /// Data that the run did not write, and what writes them.
    pub(super) missing: Vec<String>,
    /// Whether it runs, or how it ended.
    pub(super) state: RunState,
}

/// Value of a key of a JSON object as text; empty if it is missing or no text.
pub(super) fn text<'a>(value: Option<&'a Value>, key: &str) -> &'a str {
    value.and_then(|v| v.get(key)).and_then(Value::as_str).unwrap_or_default()
}

/// Value of a key of a JSON object as a number.
pub(super) fn number(value: Option<&Value>, key: &str) -> Option<f64> {
    value.and_then(|v| v.get(key)).and_then(Value::as_f64)
}

impl Run {
    /// Reads the folder of a run.
    ///
    /// # Errors
    /// The folder or its scene is missing, no window was accepted, or a file is damaged.
    pub(super) fn open(folder: &Path) -> Result<Self, RunError> {
        let results = RunSnapshots::open(folder)?;
        let mut missing = Vec::new();
        let summary = summary(folder, &mut missing)?;
        let mut stages = Vec::new();
        for (index, stage) in results.scene.stages.iter().enumerate() {
            let path = case::stage_folder(folder, &results.scene, index).join("history.csv");
            let columns = read_history(&path, &mut missing)?;
            if columns.rows() == 0 {
                missing.push(format!("stage `{}`: no window was completed", stage.name));
                continue;
            }
            let of_stage =
                |list: &Value| list.as_array()?.iter().find(|s| text(Some(s), "name") == stage.name).cloned();
            let entry = summary.as_ref().and_then(|s| s.get("stages")).and_then(of_stage);
            let points = read_history(&path.with_file_name("points.csv"), &mut missing)?;
            let payload = read_history(&path.with_file_name("payload.csv"), &mut missing)?;
            stages.push(StageData { index, columns, points, payload, summary: entry });
        }
        if stages.is_empty() {
            return Err(RunError::Input(format!(
                "{} contains a scene but no window of any stage: the run ended before its first window \
                 (see <stage>/logs/), or its results were removed. Run the scene with `ripstop run`",
                folder.display()
            )));
        }
        let state = RunStatus::read(folder)?.state;
        let run = Self { folder: folder.into(), results, summary, stages, missing, state };
        run.with_missing_snapshots()
    }

    /// Whether any stage of the run in `folder` has completed a window.
    ///
    /// # Errors
    /// The folder or its scene is missing.
    pub(super) fn has_windows(folder: &Path) -> Result<bool, RunError> {
        let scene = RunSnapshots::open(folder)?.scene;
        let has = |index: usize| {
            let path = case::stage_folder(folder, &scene, index).join("history.csv");
            std::fs::read_to_string(path).is_ok_and(|text| text.matches('\n').count() > 1)
        };
        Ok((0..scene.stages.len()).any(has))
    }

    /// Whether all stages were completed.
    pub(super) fn is_complete(&self) -> bool {
        self.state == RunState::Complete
    }

    /// The state in one word.
    pub(super) fn state_word(&self) -> &'static str {
        match self.state {
            RunState::Running => "running",
            RunState::Complete => "complete",
            RunState::Interrupted(_) => "interrupted",
            RunState::Failed(_) => "failed",
            RunState::Killed => "not finished",
        }
    }

    /// The scene.
    pub(super) fn scene(&self) -> &Scene {
        &self.results.scene
    }

    /// Name and kind of a stage.
    pub(super) fn stage(&self, stage: &StageData) -> &case::Stage {
        &self.results.scene.stages[stage.index]
    }

    /// The main stage: the last coupled stage, else the last stage.
    pub(super) fn main(&self) -> &StageData {
        let coupled = |s: &&StageData| self.stage(s).kind == StageKind::Coupled;
        let last = self.stages.last().expect("a run that was opened has a stage");
        self.stages.iter().rev().find(coupled).unwrap_or(last)
    }

    fn with_missing_snapshots(mut self) -> Result<Self, RunError> {
        let mut missing = Vec::new();
        for stage in &self.stages {
            let described = self.stage(stage);
            let roles = described.kind.roles();
            for (role, kind, what, key) in [
                (case::Role::Structure, Kind::Canopy, "shapes of the canopy", "surface_every_windows = 4"),
                (case::Role::Flow, Kind::Flow, "slices of the flow", "volume_every_windows = 20"),
            ] {
                if roles.contains(&role) && self.results.times(stage.index, kind)?.is_none() {
                    missing.push(format!(
                        "stage `{}`: {what}; set `{key}` in `[output]` of the scene to write them",
                        described.name
                    ));
                }
            }
        }
        self.missing.extend(missing);
        Ok(self)
    }
}

fn summary(folder: &Path, missing: &mut Vec<String>) -> Result<Option<Value>, RunError> {
    let path = folder.join("summary.json");
    if !path.is_file() {
        missing.push(
            "machine, versions, command and warnings: summary.json is missing, so the run has not finished or was killed"
                .into(),
        );
        return Ok(None);
    }
    let bytes = std::fs::read_to_string(&path).map_err(RunError::file("read", &path))?;
    serde_json::from_str(&bytes).map(Some).map_err(|e| {
        RunError::Input(format!(
            "{} is damaged ({e}). Remove it to write the report without it",
            path.display()
        ))
    })
}

/// The complete rows of a history: a killed run may leave an incomplete last line.
fn read_history(path: &Path, missing: &mut Vec<String>) -> Result<Columns, RunError> {
    if !path.is_file() {
        return Ok(Columns::default());
    }
    let (columns, incomplete) = history::read_complete_rows(path)?;
    if incomplete {
        missing.push(format!("the last line of {}: it is incomplete", path.display()));
    }
    Ok(Columns(columns))
}
