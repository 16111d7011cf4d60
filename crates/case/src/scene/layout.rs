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
    /// the role starts from. A fitted grid is new after a stage with an immersed canopy: the mesh-mover starts from none before that.
    pub fn source_stage(&self, stage: usize, role: Role) -> Option<usize> {
        let ran = |s: &usize| self.roles(&self.stages[*s]).contains(&role);
        let source = (0..stage).rev().find(ran)?;
        (role != Role::Mesh || self.last_immersed(stage) < Some(source)).then_some(source)
    }

    /// The latest stage before `stage` with flow around an immersed canopy.
    fn last_immersed(&self, stage: usize) -> Option<usize> {
        let flows = |s: &usize| self.stages[*s].kind.roles().contains(&Role::Flow);
        (0..stage).rev().filter(flows).find(|s| self.is_immersed(&self.stages[*s]))
    }

    /// The state file that `role` starts `stage` from, if an earlier stage wrote one.
    pub fn source_state(&self, out: &Path, stage: usize, role: Role) -> Option<PathBuf> {
        let source = self.source_stage(stage, role)?;
        Some(state_file(&state_folder(out, self, source), role))
    }

    /// Whether the fitted flow grid of the first stage with the flow is built around a shape that an earlier stage computes.
    pub fn grid_awaits_shape(&self) -> bool {
        let flows = |s: &crate::Stage| s.kind.roles().contains(&Role::Flow);
        let first = self.stages.iter().position(flows).unwrap_or(0);
        self.stages[..first].iter().any(|s| s.kind == StageKind::PreInflation)
    }

    /// The canopy shape that the fitted flow grid of `stage` is built around: written by
    /// the structure's latest *uncoupled* stage, so that all later stages share
    /// one start grid; after a stage with an immersed canopy, the shape at its end. `None`: the unstressed shape.
    pub fn grid_shape(&self, out: &Path, stage: usize) -> Option<PathBuf> {
        let inflated = (0..stage).rev().find(|&s| self.stages[s].kind == StageKind::PreInflation);
        let structure = |s: &usize| self.stages[*s].kind.roles().contains(&Role::Structure);
        let immersed = self.last_immersed(stage).and_then(|s| (0..=s).rev().find(structure));
        let source = inflated.max(immersed)?;
        Some(canopy_file(&state_folder(out, self, source)))
    }
}
