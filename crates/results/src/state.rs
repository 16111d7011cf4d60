//! The coupler's own saved state, beside those of the programs.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use coupling::schemes::InterfaceState;
use serde::{Deserialize, Serialize};

const MAGIC: [u8; 8] = *b"ripcoupl";
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct File {
    magic: [u8; 8],
    version: u32,
    state: InterfaceState,
}

/// File of the coupler's state in a state folder.
pub fn coupler_file(folder: &Path) -> PathBuf {
    folder.join("coupler.bin")
}

/// Writes the state at the end of a window.
///
/// # Errors
/// Trouble with the file.
pub fn save(folder: &Path, state: &InterfaceState) -> Result<(), RunError> {
    let path = coupler_file(folder);
    let file = File { magic: MAGIC, version: VERSION, state: state.clone() };
    let bytes = bincode::serde::encode_to_vec(&file, bincode::config::standard())
        .map_err(|e| RunError::file("write", &path)(std::io::Error::other(e)))?;
    std::fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    std::fs::write(&path, bytes).map_err(RunError::file("write", &path))
}

/// Reads what [`save`] wrote, for a canopy of `nodes` nodes and `faces` faces.
///
/// # Errors
/// [`RunError::Input`] for a missing, damaged or foreign file.
pub fn load(folder: &Path, nodes: usize, faces: usize) -> Result<InterfaceState, RunError> {
    let path = coupler_file(folder);
    let refuse = |why: String| RunError::Input(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(&path).map_err(|e| refuse(format!("cannot read the saved state: {e}")))?;
    let config = bincode::config::standard().with_limit::<{ 1 << 32 }>();
    let head: Result<(([u8; 8], u32), usize), _> = bincode::serde::decode_from_slice(&bytes, config);
    if head.is_ok_and(|((magic, version), _)| magic == MAGIC && version != VERSION) {
        return Err(refuse("was saved by another version of ripstop: run the earlier stage again".into()));
    }
    let (file, _): (File, usize) = bincode::serde::decode_from_slice(&bytes, config)
        .map_err(|e| refuse(format!("the saved state is damaged: {e}")))?;
    if file.magic != MAGIC || file.version != VERSION {
        return Err(refuse("is not a coupler state".into()));
    }
    let loads = || [&file.state.load, &file.state.load_before].into_iter().flatten();
    if file.state.displacement.len() != 3 * nodes || loads().any(|l| l.len() != faces * channel::LOAD_WIDTH) {
        return Err(refuse(format!(
            "holds a canopy of {} nodes, the scene makes one of {nodes}: run the earlier stage again",
            file.state.displacement.len() / 3
        )));
    }
    let s = &file.state;
    let numbers = s.displacement.iter().chain(loads().flatten()).chain([&s.velocity, &s.acceleration]);
    if let Some(wrong) = numbers.into_iter().find(|x| !x.is_finite()) {
        return Err(refuse(format!("holds {wrong}: run the earlier stage again")));
    }
    Ok(file.state)
}

/// States of earlier stages, from which a stage starts, from one folder to another.
///
/// # Errors
/// Folders and files that cannot be written.
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
    fn comes_back_and_refuses_another_canopy() {
        let folder = tempfile::tempdir().unwrap();
        let state = InterfaceState {
            displacement: vec![0.1; 6],
            load: Some(vec![2.0; 4]),
            load_before: Some(vec![1.5; 4]),
            velocity: -4.0,
            acceleration: 0.2,
        };
        save(folder.path(), &state).unwrap();
        assert_eq!(load(folder.path(), 2, 1).unwrap(), state);
        assert!(load(folder.path(), 3, 1).unwrap_err().to_string().contains("canopy of 2 nodes"));
        std::fs::write(coupler_file(folder.path()), b"x").unwrap();
        assert!(load(folder.path(), 2, 1).unwrap_err().to_string().contains("damaged"));
    }
}
