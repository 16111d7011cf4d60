//! Saved states: the whole structure in global order, so that any rank count
//! reads what any other wrote. The only place that names the file format.

use std::io::Write;
use std::path::{Path, PathBuf};

use comm::Comm;
use serde::{Deserialize, Serialize};

use crate::model::Model;
use crate::newton::State;

const MAGIC: [u8; 8] = *b"ripstruc";
const VERSION: u32 = 1;

/// A state file that could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: std::io::Error,
    },
    /// The content is not a state of this structure.
    #[error("{path} {reason}; run the stage that writes it again")]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Another rank failed; its message says why.
    #[error("another rank could not write or read the saved state")]
    Elsewhere,
}

#[derive(Serialize, Deserialize)]
struct File {
    magic: [u8; 8],
    version: u32,
    nodes: u64,
    checksum: u64,
    /// Displacements, velocities and accelerations, `[nodes][9]`.
    values: Vec<f64>,
}

/// FNV-1a over the bytes of the values.
fn checksum(values: &[f64]) -> u64 {
    values
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3))
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

/// Writes `state` of `nodes` nodes in all to `path`. Collective: every rank learns
/// whether it went well.
pub fn save(model: &Model, state: &State, nodes: usize, path: &Path) -> Result<(), StateError> {
    let mut rows = Vec::with_capacity(9 * model.n_owned());
    for i in 0..model.n_owned() {
        for part in [&state.u, &state.v, &state.a] {
            rows.extend_from_slice(&part[3 * i..3 * i + 3]);
        }
    }
    let values = gather(&model.comm, model.numbering.owned(), &rows, 9, nodes);
    let result = if model.comm.is_root() { write(path, values) } else { Ok(()) };
    agree(&model.comm, result)
}

fn write(path: &Path, values: Vec<f64>) -> Result<(), StateError> {
    let nodes = (values.len() / 9) as u64;
    let file = File { magic: MAGIC, version: VERSION, nodes, checksum: checksum(&values), values };
    let bytes = bincode::serde::encode_to_vec(&file, bincode::config::standard())
        .map_err(|e| StateError::Content { path: path.into(), reason: e.to_string() })?;
    // Aside first: a reader, or a run that dies here, never sees half a file.
    let aside = path.with_extension("part");
    let attempt = || {
        let mut out = std::fs::File::create(&aside)?;
        out.write_all(&bytes)?;
        out.sync_all()?;
        std::fs::rename(&aside, path)
    };
    attempt().map_err(|source| StateError::Io { path: path.into(), source })
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
    let bytes = std::fs::read(path).map_err(|source| StateError::Io { path: path.into(), source })?;
    let bad = |reason: String| StateError::Content { path: path.into(), reason };
    if bytes.get(..8) != Some(&MAGIC) {
        return Err(bad("is not a saved state of the structure-solver".into()));
    }
    // A damaged length must not reserve memory without end.
    let config = bincode::config::standard().with_limit::<{ 1 << 32 }>();
    let (file, used): (File, usize) =
        bincode::serde::decode_from_slice(&bytes, config).map_err(|e| bad(format!("is damaged ({e})")))?;
    if file.version != VERSION {
        return Err(bad(format!("has version {}, this program reads version {VERSION}", file.version)));
    }
    if used != bytes.len()
        || Some(file.values.len() as u64) != file.nodes.checked_mul(9)
        || file.checksum != checksum(&file.values)
    {
        return Err(bad("is damaged (its checksum does not match)".into()));
    }
    if file.nodes != nodes as u64 {
        return Err(bad(format!(
            "holds a structure of {} nodes, but the scene's has {nodes}: the canopy was changed since",
            file.nodes
        )));
    }
    if file.values.iter().any(|v| !v.is_finite()) {
        return Err(bad("holds values that are not finite".into()));
    }
    Ok(file.values)
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
        write(&path, values()).expect("written");
        assert_eq!(read(&path, 2).expect("read"), values());
    }

    #[test]
    fn damage_and_other_structures_are_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("structure.bin");
        write(&path, values()).expect("written");
        assert!(read(&path, 3).expect_err("another size").to_string().contains("2 nodes"));
        let mut bytes = std::fs::read(&path).expect("bytes");
        let last = bytes.len() - 3;
        bytes[last] ^= 1;
        std::fs::write(&path, &bytes).expect("written");
        assert!(read(&path, 2).expect_err("damage").to_string().contains("checksum"));
        std::fs::write(&path, &bytes[..40]).expect("written");
        assert!(read(&path, 2).is_err());
        std::fs::write(&path, b"something else").expect("written");
        assert!(read(&path, 2).expect_err("foreign").to_string().contains("not a saved state"));
        assert!(read(&folder.path().join("none.bin"), 2).is_err());
    }
}
