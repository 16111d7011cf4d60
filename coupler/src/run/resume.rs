//! The restart point of an interrupted run.

use std::path::Path;

use case::Scene;
use coupling::error::RunError;
use results::checkpoint::{self, Point, Progress, Record};
use results::summary::StageSummary;
use terminal::{Console, counted};

use super::prepare::Prepared;

/// The restart point in the folder of the results.
pub(super) struct Resume {
    record: Record,
    point: Option<Point>,
    /// The stage to continue with, from 0.
    pub stage: usize,
    /// Progress within that stage. `None`: it runs from its start.
    pub within: Option<Progress>,
    /// Summaries of the completed stages.
    pub summaries: Vec<StageSummary>,
    /// All stages are complete.
    pub complete: bool,
}

impl Resume {
    /// Reads the folder of the results without changing it.
    pub fn find(prepared: &Prepared, console: &Console) -> Result<Self, RunError> {
        let Prepared { scene, file, out, .. } = prepared;
        let record = Record::read(out)?;
        let (point, notes) = checkpoint::find(scene, out, &record);
        notes.iter().for_each(|note| console.warning(note));
        let record = record.renewed(scene, file, point.as_ref())?;
        let stage = record.first;
        let mut this =
            Self { record, point: None, stage, within: None, summaries: Vec::new(), complete: false };
        let Some(point) = point else {
            console.line("there is no saved window: the run starts from the beginning");
            return Ok(this);
        };
        let ended = has_ended(scene, &point);
        this.stage = point.stage + usize::from(ended);
        this.complete = this.stage == scene.stages.len();
        let mut warnings = this.read_summaries(scene, out);
        if !ended {
            let within = this.within.insert(progress_within(&point, console)?);
            warnings.clone_from(&within.warnings);
        } else if !this.complete {
            console.line(&format!("stage `{}` is complete: continuing with the next", point.seal.name));
        }
        console.restore_warnings(warnings);
        this.point = Some(point);
        Ok(this)
    }

    /// Reads the summaries of the completed stages. Returns the warnings of the last one.
    fn read_summaries(&mut self, scene: &Scene, out: &Path) -> Vec<String> {
        let mut warnings = Vec::new();
        for before in self.record.first..self.stage {
            if let Ok(progress) = Progress::load(&case::state_folder(out, scene, before)) {
                warnings = progress.warnings;
                self.summaries.push(StageSummary {
                    speeds: progress.speeds,
                    wake_samples: progress.wake,
                    ..progress.summary
                });
            }
        }
        warnings
    }

    /// Moves the state to its folder. Returns the identity of the run.
    pub fn begin(&mut self, scene: &Scene, out: &Path) -> Result<u64, RunError> {
        if let Some(point) = &mut self.point {
            point.adopt(scene, out)?;
        }
        self.record.write(out)?;
        Ok(self.record.run)
    }
}

/// Whether the stage of a saved state has ended. A stage that was stopped early, or was lengthened since, has not.
fn has_ended(scene: &Scene, point: &Point) -> bool {
    let stage = &scene.stages[point.stage];
    let planned = stage.planned_s();
    match point.seal.ended.as_deref() {
        None => false,
        Some("complete" | "stopped as asked") => planned <= point.seal.time_s * (1.0 + 1e-9),
        Some(_) => true,
    }
}

/// The progress of a stage that was saved before its end.
fn progress_within(point: &Point, console: &Console) -> Result<Progress, RunError> {
    let seal = &point.seal;
    if !seal.cannot.is_empty() {
        return Err(RunError::Input(format!(
            "the run was interrupted within stage `{}`, where {} saved no state to restart from: a program that supports it \
             announces the effect `resume` (docs/reference/contract.md). `--stage {}` without --resume runs \
             the stage from its start",
            seal.name,
            seal.cannot.join(" and "),
            seal.name
        )));
    }
    let progress = point.progress()?;
    console.line(&format!(
        "resuming stage `{}` after {} (t = {:.4} s)",
        seal.name,
        counted(seal.windows, "window"),
        seal.time_s
    ));
    Ok(progress)
}
