//! The accepted state as a file, in global order, so that any number of ranks can continue from it.

use std::path::Path;

use archive::codec::compact;
use archive::hash::fnv1a_of_numbers;
use serde::{Deserialize, Serialize};

const KIND: [u8; 8] = *b"ripgrid\0";
const VERSION: u32 = 3;

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
    /// The last new grid, where it replaced the scene's start grid; else empty.
    pub start: Vec<f64>,
    /// Offset at the start of the transition to that grid; empty where it is complete.
    pub offset: Vec<f64>,
    /// Windows of that transition: completed and in all.
    pub transition: [u32; 2],
}

impl State {
    /// Writes the file atomically: a reader finds the old one or the new one.
    ///
    /// # Errors
    /// [`archive::Error::Io`].
    pub fn save(&self, path: &Path) -> Result<(), archive::Error> {
        archive::save(path, KIND, VERSION, self).map(|_| ())
    }

    /// Reads a state of a grid of `nodes` nodes.
    ///
    /// # Errors
    /// A missing, foreign or damaged file, or one of another version or grid.
    pub fn load(path: &Path, nodes: usize) -> Result<Self, archive::Error> {
        let s: Self = archive::load_or_earlier(path, KIND, VERSION, version_2)?;
        s.check(nodes).map_err(|reason| archive::Error::content(path, reason))?;
        Ok(s)
    }

    /// Checks that it belongs to a grid of `nodes` nodes and is finite.
    fn check(&self, nodes: usize) -> Result<(), String> {
        let s = self;
        let fits = |v: &Vec<f64>, may_miss: bool| v.len() == 3 * nodes || (may_miss && v.is_empty());
        let maybe = [&s.before, &s.reference, &s.start, &s.offset];
        if !fits(&s.now, false) || !maybe.into_iter().all(|v| fits(v, true)) {
            return Err(format!(
                "it holds a grid of {} nodes, this scene's grid has {nodes}",
                s.now.len() / 3
            ));
        }
        if !s.now.iter().chain(maybe.into_iter().flatten()).chain([&s.dt]).all(|x| x.is_finite()) {
            return Err("it contains values that are not finite".into());
        }
        let second_order_without_length = !s.before.is_empty() && s.dt <= 0.0;
        if s.dt < 0.0 || second_order_without_length || s.transition[0] > s.transition[1] {
            return Err(format!(
                "it has a last window of {} s and is at {} of {} windows of a grid transition",
                s.dt, s.transition[0], s.transition[1]
            ));
        }
        Ok(())
    }
}

/// The state in a file of version 2: kind, version, checksum of all numbers and state in compact form.
fn version_2(bytes: &[u8]) -> Option<State> {
    let (kind, version, sum, s): ([u8; 8], u32, u64, State) = compact::decode(bytes).ok()?;
    (kind == KIND && version == 2 && sum == checksum_of_version_2(&s)).then_some(s)
}

fn checksum_of_version_2(s: &State) -> u64 {
    let transition = s.transition.map(f64::from);
    let all = s.now.iter().chain(&s.before).chain(&s.reference).chain(&s.start).chain(&s.offset);
    fnv1a_of_numbers(all.chain(&transition).chain([&s.dt]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn state_is_restored_or_the_error_names_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/mesh.bin");
        let state = State {
            now: vec![1.0, -0.0, 3.5],
            before: vec![0.1, 0.2, 0.3],
            dt: 5e-3,
            offset: vec![0.5, 0.0, 1.0],
            transition: [3, 7],
            ..State::default()
        };
        state.save(&path).unwrap();
        assert_eq!(State::load(&path, 1).unwrap(), state);
        assert!(State::load(&path, 2).unwrap_err().to_string().contains("has 2"));
        let earlier = compact::encode(&(KIND, 2u32, checksum_of_version_2(&state), &state));
        let whole = fs::read(&path).unwrap();
        fs::write(&path, earlier).unwrap();
        assert_eq!(State::load(&path, 1).unwrap(), state);
        let mut bytes = whole;
        let at = bytes.len() - 12;
        bytes[at] ^= 1;
        fs::write(&path, &bytes).unwrap();
        assert!(State::load(&path, 1).unwrap_err().to_string().contains("damaged"));
        bytes[0] = 0;
        fs::write(&path, &bytes).unwrap();
        assert!(State::load(&path, 1).unwrap_err().to_string().contains("not of the kind"));
        assert!(State::load(&folder.path().join("none"), 1).unwrap_err().is_missing());
    }
}
