//! The checkpoint that a run resumes from.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use terminal::counted;

use super::progress::Progress;
use super::record::Record;
use super::seal::Seal;
use super::{draft, old, remove};

/// A saved state from which a run can be resumed.
#[derive(Clone, Debug)]
pub struct Point {
    /// Index of the stage.
    pub stage: usize,
    /// Content of the state.
    pub seal: Seal,
    /// Folder: `state`, `state.new` or `state.old`.
    folder: PathBuf,
}

/// The last complete state of the run, and notes on incomplete states that are skipped.
pub fn find(scene: &Scene, out: &Path, record: &Record) -> (Option<Point>, Vec<String>) {
    let mut notes = Vec::new();
    for stage in (record.first..scene.stages.len()).rev() {
        let state = case::state_folder(out, scene, stage);
        let mut best: Option<Point> = None;
        for folder in [state.clone(), draft(&state), old(&state)] {
            if !folder.is_dir() {
                continue;
            }
            match Seal::of(&folder) {
                // State of an earlier run in the same folder.
                Ok(seal) if seal.run != record.run => {}
                Ok(seal) => {
                    if best.as_ref().is_none_or(|b| seal.windows > b.seal.windows) {
                        best = Some(Point { stage, seal, folder });
                    }
                }
                Err(why) => notes
                    .push(format!("the state in {} is incomplete ({why}) and is skipped", folder.display())),
            }
        }
        if best.is_some() {
            return (best, notes);
        }
    }
    (None, notes)
}

impl Point {
    /// The part of the coupler.
    ///
    /// # Errors
    /// The file is of another version.
    pub fn progress(&self) -> Result<Progress, RunError> {
        Progress::load(&self.folder)
    }

    /// Moves the state to the folder `state` of its stage and returns that folder.
    ///
    /// # Errors
    /// A folder cannot be moved.
    pub fn adopt(&mut self, scene: &Scene, out: &Path) -> Result<PathBuf, RunError> {
        let state = case::state_folder(out, scene, self.stage);
        if self.folder != state {
            remove(&state)?;
            std::fs::rename(&self.folder, &state).map_err(RunError::file("rename", &self.folder))?;
            self.folder.clone_from(&state);
        }
        remove(&draft(&state))?;
        Ok(state)
    }
}

/// Message on the saved state of the run in `out`, with the `command` that resumes it; `None` without a saved state.
pub fn hint(scene: &Scene, command: &str, out: &Path) -> Option<String> {
    let record = Record::read(out).ok()?;
    let (point, notes) = find(scene, out, &record);
    let Point { seal, .. } = point?;
    let place = format!("after {} of stage `{}`", counted(seal.windows, "window"), seal.name);
    let mut text: String = notes.iter().map(|n| format!("{n}\n")).collect();
    if seal.cannot.is_empty() {
        text += &format!("saved {place}; resume with: {command}");
    } else {
        text +=
            &format!("saved {place}, but {} cannot restart from a saved state", seal.cannot.join(" and "));
    }
    Some(text)
}
