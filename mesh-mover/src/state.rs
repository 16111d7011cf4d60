//! The accepted state in a file, in the order of the whole grid, so that any
//! number of ranks can go on from it.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

const MAGIC: [u8; 8] = *b"ripgrid\0";
const VERSION: u32 = 2;

/// Positions of the whole grid (flat, m) as of the last accepted windows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// At the end of the last accepted window.
    pub now: Vec<f64>,
    /// One window earlier; empty before the first window.
    pub before: Vec<f64>,
    /// Length of the last window, s.
    pub dt: f64,
    /// The reference grid where it is not the start grid; else empty.
    pub reference: Vec<f64>,
    /// The grid that was made last in the place of the scene's start grid; else empty.
    pub start: Vec<f64>,
    /// What was left at its start of a way to that grid; empty where it is over.
    pub offset: Vec<f64>,
    /// Windows of that way: done and in all.
    pub way: [u32; 2],
}

#[derive(Serialize, Deserialize)]
struct File {
    magic: [u8; 8],
    version: u32,
    checksum: u64,
    state: State,
}

/// Why a state could not be stored or read.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// Trouble with the file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file holds something else.
    #[error("{} {reason}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl State {
    /// Writes the file whole: a reader sees the old one or the new one.
    ///
    /// # Errors
    /// [`StateError::Io`].
    pub fn save(&self, path: &Path) -> Result<(), StateError> {
        let io = |source| StateError::Io { path: path.into(), source };
        let file = File { magic: MAGIC, version: VERSION, checksum: checksum(self), state: self.clone() };
        let bytes = bincode::serde::encode_to_vec(&file, bincode::config::standard())
            .map_err(|e| io(std::io::Error::other(e)))?;
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(io)?;
        }
        let aside = path.with_extension("bin.part");
        fs::write(&aside, bytes).and_then(|()| fs::rename(&aside, path)).map_err(io)
    }

    /// Reads a state of a grid of `nodes` nodes.
    ///
    /// # Errors
    /// A missing, foreign or damaged file, one of another version or another grid.
    pub fn load(path: &Path, nodes: usize) -> Result<Self, StateError> {
        let bytes = fs::read(path).map_err(|source| StateError::Io { path: path.into(), source })?;
        let unfit = |reason: String| StateError::Unfit { path: path.into(), reason };
        if bytes.get(..8) != Some(&MAGIC) {
            return Err(unfit("is not a saved state of the mesh-mover".into()));
        }
        // A damaged length must not reserve memory without end.
        let config = bincode::config::standard().with_limit::<{ 1 << 34 }>();
        let (file, used): (File, usize) = bincode::serde::decode_from_slice(&bytes, config)
            .map_err(|e| unfit(format!("is damaged ({e}): run the earlier stage again")))?;
        if file.version != VERSION {
            return Err(unfit(format!("has format version {}, this program reads {VERSION}", file.version)));
        }
        let s = file.state;
        if used != bytes.len() || checksum(&s) != file.checksum {
            return Err(unfit(
                "is damaged (its checksum does not match): run the earlier stage again".into(),
            ));
        }
        let fits = |v: &Vec<f64>, may_miss: bool| v.len() == 3 * nodes || (may_miss && v.is_empty());
        let maybe = [&s.before, &s.reference, &s.start, &s.offset];
        if !fits(&s.now, false) || !maybe.into_iter().all(|v| fits(v, true)) {
            return Err(unfit(format!(
                "holds a grid of {} nodes, this scene's grid has {nodes}: run the earlier stage again",
                s.now.len() / 3
            )));
        }
        if !s.now.iter().chain(maybe.into_iter().flatten()).chain([&s.dt]).all(|x| x.is_finite()) {
            return Err(unfit("holds values that are not finite: run the earlier stage again".into()));
        }
        let second_order_without_length = !s.before.is_empty() && s.dt <= 0.0;
        if s.dt < 0.0 || second_order_without_length || s.way[0] > s.way[1] {
            return Err(unfit(format!(
                "has a last window of {} s and stands at {} of {} windows: run the earlier stage again",
                s.dt, s.way[0], s.way[1]
            )));
        }
        Ok(s)
    }
}

/// FNV-1a over the bits of all numbers.
fn checksum(s: &State) -> u64 {
    let way = s.way.map(f64::from);
    let all = s.now.iter().chain(&s.before).chain(&s.reference).chain(&s.start).chain(&s.offset);
    all.chain(&way)
        .chain(std::iter::once(&s.dt))
        .flat_map(|v| v.to_bits().to_le_bytes())
        .fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comes_back_or_says_why_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/mesh.bin");
        let state = State {
            now: vec![1.0, -0.0, 3.5],
            before: vec![0.1, 0.2, 0.3],
            dt: 5e-3,
            offset: vec![0.5, 0.0, 1.0],
            way: [3, 7],
            ..State::default()
        };
        state.save(&path).unwrap();
        assert_eq!(State::load(&path, 1).unwrap(), state);
        assert!(State::load(&path, 2).unwrap_err().to_string().contains("has 2"));
        let mut bytes = fs::read(&path).unwrap();
        let at = bytes.len() - 12;
        bytes[at] ^= 1;
        fs::write(&path, &bytes).unwrap();
        assert!(State::load(&path, 1).unwrap_err().to_string().contains("damaged"));
        bytes[0] = 0;
        fs::write(&path, &bytes).unwrap();
        assert!(State::load(&path, 1).unwrap_err().to_string().contains("not a saved state"));
        assert!(matches!(State::load(&folder.path().join("none"), 1), Err(StateError::Io { .. })));
    }
}
