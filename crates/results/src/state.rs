//! Saved state of the coupler.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use coupling::schemes::InterfaceState;

use crate::checkpoint::unusable;

const KIND: [u8; 8] = *b"ripcoupl";
const VERSION: u32 = 3;

/// File of the coupler's state in a state folder.
pub fn coupler_file(folder: &Path) -> PathBuf {
    folder.join("coupler.bin")
}

/// Writes the state at the end of a window.
///
/// # Errors
/// The file cannot be written.
pub fn save(folder: &Path, state: &InterfaceState) -> Result<(), RunError> {
    archive::save(&coupler_file(folder), KIND, VERSION, state).map(|_| ()).map_err(unusable)
}

/// Reads the state written by [`save`], for a canopy of `nodes` nodes and `faces` faces.
///
/// # Errors
/// [`RunError::Input`] for a missing or damaged file, or one of another kind or canopy.
pub fn load(folder: &Path, nodes: usize, faces: usize) -> Result<InterfaceState, RunError> {
    let path = coupler_file(folder);
    let refuse = |why: String| RunError::Input(archive::Error::content(&path, why).to_string());
    let state: InterfaceState = archive::load(&path, KIND, VERSION).map_err(unusable)?;
    let loads = || [&state.load, &state.load_before].into_iter().flatten();
    if state.displacement.len() != 3 * nodes || loads().any(|l| l.len() != faces * channel::LOAD_WIDTH) {
        return Err(refuse(format!(
            "it contains a canopy of {} nodes, but the canopy of the scene has {nodes}",
            state.displacement.len() / 3
        )));
    }
    let s = &state;
    let motion = [s.velocity, s.acceleration, s.position];
    let numbers = s.displacement.iter().chain(loads().flatten()).chain(motion.as_flattened());
    if let Some(wrong) = numbers.into_iter().find(|x| !x.is_finite()) {
        return Err(refuse(format!("it contains the value {wrong}")));
    }
    Ok(state)
}

/// Copies the saved states of the stages before stage `before` from one results folder to another.
///
/// # Errors
/// A folder or file cannot be written.
pub fn copy_states(scene: &Scene, before: usize, from: &Path, to: &Path) -> Result<(), RunError> {
    for stage in 0..before {
        let (source, target) = (case::state_folder(from, scene, stage), case::state_folder(to, scene, stage));
        let Ok(entries) = std::fs::read_dir(&source) else { continue };
        std::fs::create_dir_all(&target).map_err(RunError::file("create", &target))?;
        for entry in entries.flatten().filter(|e| e.path().is_file()) {
            let copy = target.join(entry.file_name());
            if copy != entry.path() {
                std::fs::copy(entry.path(), &copy).map_err(RunError::file("write", &copy))?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn state_is_read_back_and_refused_for_another_canopy() {
        let folder = tempfile::tempdir().unwrap();
        let state = InterfaceState {
            displacement: vec![0.1; 6],
            load: Some(vec![2.0; 4]),
            load_before: Some(vec![1.5; 4]),
            velocity: [0.5, 0.0, -4.0],
            acceleration: [0.0, 0.1, 0.2],
            position: [1.0, 2.0, -30.0],
        };
        save(folder.path(), &state).unwrap();
        assert_eq!(load(folder.path(), 2, 1).unwrap(), state);
        assert!(load(folder.path(), 3, 1).unwrap_err().to_string().contains("canopy of 2 nodes"));
        std::fs::write(coupler_file(folder.path()), b"x").unwrap();
        assert!(load(folder.path(), 2, 1).unwrap_err().to_string().contains("not of the kind"));
    }
}
