//! The checkpoint that a run resumes from.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use terminal::counted;

use super::progress::Progress;
use super::record::Record;
use super::seal::Seal;
use super::{draft, old, remove};

/// Where a run can be resumed.
#[derive(Clone, Debug)]
pub struct Point {
    /// Stage, from 0.
    pub stage: usize,
    /// What was saved.
    pub seal: Seal,
    /// Its folder: `state` or one beside it.
    folder: PathBuf,
}

/// The last whole state of the run, and what was passed over on the way to it.
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
                // Of a run that went before in the same folder.
                Ok(seal) if seal.run != record.run => {}
                Ok(seal) => {
                    if best.as_ref().is_none_or(|b| seal.windows > b.seal.windows) {
                        best = Some(Point { stage, seal, folder });
                    }
                }
                Err(why) => notes.push(format!(
                    "the state in {} is not whole ({why}) and is passed over",
                    folder.display()
                )),
            }
        }
        if best.is_some() {
            return (best, notes);
        }
    }
    (None, notes)
}

impl Point {
    /// The coupler's own part of the state.
    ///
    /// # Errors
    /// A file of another version.
    pub fn progress(&self) -> Result<Progress, RunError> {
        Progress::load(&self.folder)
    }

    /// Makes the state the one in the folder `state` of its stage; returns that folder.
    ///
    /// # Errors
    /// Trouble with the folders.
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

/// What was saved of the run whose results lie in `out`, and the `command` that resumes it. `None`: nothing was
/// saved.
pub fn hint(scene: &Scene, command: &str, out: &Path) -> Option<String> {
    let record = Record::read(out).ok()?;
    let (point, notes) = find(scene, out, &record);
    let Point { seal, .. } = point?;
    let place = format!("after {} of stage `{}`", counted(seal.windows, "window"), seal.name);
    let mut text: String = notes.iter().map(|n| format!("{n}\n")).collect();
    if seal.cannot.is_empty() {
        text += &format!("saved {place}; resume with: {command}");
    } else {
        text += &format!("saved {place}, but {} cannot be resumed", seal.cannot.join(" and "));
    }
    Some(text)
}
