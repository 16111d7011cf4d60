//! File with the shape of the canopy: written by the structure solver, read to build the flow grid. Its layout is part of the contract
//! (`docs/reference/contract.md`), because external structure solvers write it as well.

use std::path::Path;

use archive::codec::compact;
use archive::hash::fnv1a_of_numbers;
use archive::shape::{MAGIC, Shape, VERSION};

use crate::vtk::write_aside;
use crate::{MeshError, Point};

/// Saves the positions of the canopy nodes, m, in the order of the interface.
///
/// # Errors
/// The file cannot be written.
pub fn save_shape(path: &Path, positions: &[Point]) -> Result<(), MeshError> {
    let bytes = archive::shape::encode(positions);
    write_aside(path, |out| out.write_all(&bytes).map_err(|e| e.to_string()))
}

/// Loads what [`save_shape`] saved; `expected` is the number of canopy nodes.
///
/// # Errors
/// A missing, foreign or damaged file, one of another version, or of another canopy.
pub fn load_shape(path: &Path, expected: usize) -> Result<Vec<Point>, MeshError> {
    let bytes = std::fs::read(path).map_err(|source| MeshError::Io { path: path.into(), source })?;
    let bad = |reason: String| MeshError::File { path: path.into(), reason };
    if bytes.get(..8) != Some(&MAGIC) {
        return Err(bad("is not a canopy shape file of ripstop".into()));
    }
    let file: Shape = compact::decode(&bytes).map_err(|e| bad(format!("is damaged: {e}")))?;
    if file.version != VERSION {
        return Err(bad(format!(
            "has format version {}, but this program reads version {VERSION}",
            file.version
        )));
    }
    let count = file.positions.len();
    if file.count != count as u64 || file.checksum != fnv1a_of_numbers(file.positions.as_flattened()) {
        return Err(bad("is damaged: its checksum does not match".into()));
    }
    if count != expected {
        return Err(bad(format!(
            "has {count} canopy nodes, but the canopy of this scene has {expected}; rerun the earlier stage"
        )));
    }
    if let Some(node) = file.positions.iter().position(|x| x.iter().any(|v| !v.is_finite())) {
        return Err(bad(format!("the position of node {node} is not a finite number")));
    }
    Ok(file.positions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_round_trip_is_exact_and_damage_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("canopy.bin");
        let shape: Vec<Point> = (0..50).map(|i| [f64::from(i), 0.1, -1e-300]).collect();
        save_shape(&path, &shape).unwrap();
        assert_eq!(load_shape(&path, 50).unwrap(), shape);
        let reason = |expected| match load_shape(&path, expected) {
            Err(MeshError::File { reason, .. }) => reason,
            other => panic!("{other:?}"),
        };
        assert!(reason(49).contains("50 canopy nodes"));
        let good = std::fs::read(&path).unwrap();
        // A damaged byte or a cut is found wherever it is.
        for at in (0..good.len()).step_by(23).chain(0..30) {
            let mut bad = good.clone();
            bad[at] ^= 0x40;
            std::fs::write(&path, &bad).unwrap();
            reason(50);
            std::fs::write(&path, &good[..at]).unwrap();
            reason(50);
        }
        assert!(matches!(load_shape(&folder.path().join("none"), 50), Err(MeshError::Io { .. })));
    }
}
