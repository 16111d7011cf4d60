//! Where a run's files lie, the same for every program.

use std::path::{Path, PathBuf};

use crate::{Role, Scene, StageKind};

/// Folder of a stage below the run's folder: histories, snapshots, logs.
pub fn stage_folder(out: &Path, scene: &Scene, stage: usize) -> PathBuf {
    out.join(&scene.stages[stage].name)
}

/// Folder of a stage's saved states.
pub fn state_folder(out: &Path, scene: &Scene, stage: usize) -> PathBuf {
    stage_folder(out, scene, stage).join("state")
}

/// File of a role's saved state in a [`state_folder`].
pub fn state_file(folder: &Path, role: Role) -> PathBuf {
    folder.join(format!("{}.bin", role.name()))
}

/// File of the canopy's shape (positions of the interface nodes, m, in the
/// falling frame), written by the structure with its state.
pub fn canopy_file(folder: &Path) -> PathBuf {
    folder.join("canopy.bin")
}

impl Scene {
    /// The stage whose means a summary and a report quote: the last coupled one, else the last.
    pub fn main_stage(&self) -> usize {
        let coupled = self.stages.iter().rposition(|s| s.kind == StageKind::Coupled);
        coupled.unwrap_or(self.stages.len().saturating_sub(1))
    }

    /// The latest stage before `stage` in which `role` ran: its state is where
    /// the role starts from.
    pub fn source_stage(&self, stage: usize, role: Role) -> Option<usize> {
        (0..stage).rev().find(|&s| self.stages[s].kind.roles().contains(&role))
    }

    /// The state file that `role` starts `stage` from, if an earlier stage wrote one.
    pub fn source_state(&self, out: &Path, stage: usize, role: Role) -> Option<PathBuf> {
        let source = self.source_stage(stage, role)?;
        Some(state_file(&state_folder(out, self, source), role))
    }

    /// The canopy shape that the flow grid of `stage` is built around: written by
    /// the structure's latest *uncoupled* stage, so that all later stages share
    /// one start grid. `None`: the unstressed shape.
    pub fn grid_shape(&self, out: &Path, stage: usize) -> Option<PathBuf> {
        let source = (0..stage).rev().find(|&s| self.stages[s].kind == StageKind::PreInflation)?;
        Some(canopy_file(&state_folder(out, self, source)))
    }
}
