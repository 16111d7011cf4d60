//! Files that a program saves at the end of a window or stage.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{Fault, Role};

const KIND: [u8; 8] = *b"particip";

/// Saves the state of a program below `folder`, complete or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn save_state(folder: &Path, role: Role, state: &impl Serialize) -> Result<(), Fault> {
    let file = folder.join(format!("{}.bin", role.name()));
    archive::save(&file, KIND, 1, state).map(drop).map_err(Fault::new)
}

/// Loads what [`save_state`] saved; `file` is that of [`crate::Run::state`].
///
/// # Errors
/// A missing, damaged or foreign file: the earlier stage ran with another program.
pub fn load_state<T: DeserializeOwned>(file: &Path) -> Result<T, Fault> {
    archive::load(file, KIND, 1)
        .map_err(|e| Fault::new(format!("{e}; run the earlier stage with this program too")))
}

/// Saves the positions of the canopy nodes, m: a structure writes them with its state, and the flow grid of later stages is built around
/// them.
///
/// # Errors
/// The file cannot be written.
pub fn write_shape(folder: &Path, positions: &[[f64; 3]]) -> Result<(), Fault> {
    let file = folder.join("canopy.bin");
    archive::write_whole(&file, &[&archive::shape::encode(positions)])
        .map_err(|e| Fault::new(format!("cannot write {}: {e}", file.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_states_and_shapes_are_read() {
        let folder = tempfile::tempdir().unwrap();
        save_state(folder.path(), Role::Flow, &vec![1.5, -2.0]).unwrap();
        let file = folder.path().join("flow.bin");
        assert_eq!(load_state::<Vec<f64>>(&file).unwrap(), [1.5, -2.0]);
        std::fs::write(&file, "foreign").unwrap();
        let refused = load_state::<Vec<f64>>(&file).expect_err("foreign").message;
        assert!(refused.contains("flow.bin") && refused.contains("with this program too"), "{refused}");

        let positions = [[0.0, 1.0, 2.0], [3.0, 4.0, 5.5]];
        write_shape(folder.path(), &positions).unwrap();
        assert_eq!(mesh::load_shape(&folder.path().join("canopy.bin"), 2).unwrap(), positions);
    }
}
