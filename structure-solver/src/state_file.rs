//! Saved states: the whole structure in global order, so that any rank count
//! reads what any other wrote. The only place that names the file format.

use std::path::Path;

use archive::codec::compact;
use archive::hash::fnv1a_of_numbers;
use comm::Comm;

use crate::model::Model;
use crate::newton::State;

const KIND: [u8; 8] = *b"ripstruc";
/// Displacements, velocities and accelerations, `[nodes][9]`.
const VERSION: u32 = 2;

/// A state file that could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file cannot be read, or its content is not a state of this structure.
    #[error(transparent)]
    File(#[from] archive::Error),
    /// Another rank failed; its message says why.
    #[error("another rank could not write or read the saved state")]
    Elsewhere,
}

/// Rows of owned entities of all ranks, in global order, on every rank. Collective.
pub fn gather(comm: &Comm, global: &[u64], rows: &[f64], width: usize, total: usize) -> Vec<f64> {
    let index = comm.all_gather_var(global);
    let values = comm.all_gather_var(rows);
    let mut all = vec![0.0; total * width];
    for (g, row) in index.iter().zip(values.chunks_exact(width)) {
        all[*g as usize * width..][..width].copy_from_slice(row);
    }
    all
}

/// Writes `state` of `nodes` nodes in all to `path`. Collective: every rank gets
/// whether it went well.
pub fn save(model: &Model, state: &State, nodes: usize, path: &Path) -> Result<(), StateError> {
    let mut rows = Vec::with_capacity(9 * model.n_owned());
    for i in 0..model.n_owned() {
        for part in [&state.u, &state.v, &state.a] {
            rows.extend_from_slice(&part[3 * i..3 * i + 3]);
        }
    }
    let values = gather(&model.comm, model.numbering.owned(), &rows, 9, nodes);
    let result = if model.comm.is_root() { write(path, &values) } else { Ok(()) };
    agree(&model.comm, result)
}

fn write(path: &Path, values: &[f64]) -> Result<(), StateError> {
    archive::save(path, KIND, VERSION, &values)?;
    Ok(())
}

/// Reads the state of a structure with `nodes` nodes in all. Collective.
pub fn load(model: &Model, nodes: usize, path: &Path) -> Result<State, StateError> {
    let values = agree(&model.comm, read(path, nodes))?;
    let mut state = State::rest(model.n_local());
    for (i, &g) in model.numbering.global.iter().enumerate() {
        let row = &values[9 * g as usize..][..9];
        state.u[3 * i..3 * i + 3].copy_from_slice(&row[..3]);
        state.v[3 * i..3 * i + 3].copy_from_slice(&row[3..6]);
        state.a[3 * i..3 * i + 3].copy_from_slice(&row[6..]);
    }
    Ok(state)
}

fn read(path: &Path, nodes: usize) -> Result<Vec<f64>, StateError> {
    let values = archive::load_or_earlier(path, KIND, VERSION, version_1)?;
    let unfit = |reason| Err(archive::Error::content(path, reason).into());
    if values.len() != 9 * nodes {
        let found = values.len() / 9;
        return unfit(format!(
            "it holds a structure of {found} nodes, but the scene's has {nodes}: the canopy was changed since"
        ));
    }
    if values.iter().any(|v| !v.is_finite()) {
        return unfit("it contains values that are not finite".into());
    }
    Ok(values)
}

/// The values of a file of version 1: kind, version, nodes, checksum and values in compact form.
fn version_1(bytes: &[u8]) -> Option<Vec<f64>> {
    let (kind, version, nodes, sum, values): ([u8; 8], u32, u64, u64, Vec<f64>) =
        compact::decode(bytes).ok()?;
    let whole = Some(values.len() as u64) == nodes.checked_mul(9) && sum == fnv1a_of_numbers(&values);
    (kind == KIND && version == 1 && whole).then_some(values)
}

/// An error on one rank becomes an error on every rank.
pub(crate) fn agree<T>(comm: &Comm, result: Result<T, StateError>) -> Result<T, StateError> {
    let all = comm.all(result.is_ok());
    match result {
        Ok(_) if !all => Err(StateError::Elsewhere),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values() -> Vec<f64> {
        (0..18).map(|i| f64::from(i) * 0.1).collect()
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("structure.bin");
        write(&path, &values()).expect("written");
        assert_eq!(read(&path, 2).expect("read"), values());
    }

    #[test]
    fn files_of_version_1_are_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("structure.bin");
        let bytes = compact::encode(&(KIND, 1u32, 2u64, fnv1a_of_numbers(&values()), values()));
        std::fs::write(&path, &bytes).expect("written");
        assert_eq!(read(&path, 2).expect("read"), values());
        assert!(read(&path, 3).expect_err("another size").to_string().contains("2 nodes"));
        let mut bytes = bytes;
        *bytes.last_mut().expect("bytes") ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        assert!(read(&path, 2).is_err());
    }

    #[test]
    fn damage_and_other_structures_are_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("structure.bin");
        write(&path, &values()).expect("written");
        assert!(read(&path, 3).expect_err("another size").to_string().contains("2 nodes"));
        let mut bytes = std::fs::read(&path).expect("bytes");
        let last = bytes.len() - 3;
        bytes[last] ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        assert!(read(&path, 2).expect_err("damage").to_string().contains("checksum"));
        std::fs::write(&path, &bytes[..40]).expect("written");
        assert!(read(&path, 2).is_err());
        std::fs::write(&path, b"something else").expect("written");
        assert!(read(&path, 2).expect_err("foreign").to_string().contains("not of the kind"));
        assert!(read(&folder.path().join("none.bin"), 2).is_err());
    }
}
