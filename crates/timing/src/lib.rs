//! Wall time of a program by named parts, nested as they are called.
//!
//! ```
//! fn step() {
//!     let _step = timing::part("step");
//!     {
//!         let _part = timing::part("residual");
//!         // ... work ...
//!     }
//! }
//! step();
//! assert_eq!(timing::profile().parts[1].path, ["step", "residual"]);
//! ```
//!
//! Each thread is timed separately. A part needs two clock readings (about 50 ns): suitable for a solve, too
//! expensive for a face. Memory is allocated only when a part first occurs at its place in the tree.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

/// Environment variable with the file to which a program writes its [`Profile`] when it ends; unset: no file.
pub const FILE_VARIABLE: &str = "RIPSTOP_TIMINGS";

/// A part of a program's work, over all its calls.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Names from the outermost part to this one.
    pub path: Vec<String>,
    /// Number of calls.
    pub calls: u64,
    /// Wall seconds, including nested parts.
    pub seconds: f64,
}

/// The parts of a program's work, each after its parent, in the order of their first calls.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// The parts.
    pub parts: Vec<Part>,
}

struct Node {
    name: &'static str,
    within: usize,
    children: Vec<usize>,
    calls: u64,
    seconds: f64,
}

/// The parts of this thread; the first node represents the thread.
struct Tree {
    nodes: Vec<Node>,
    open: usize,
}

impl Tree {
    const fn new() -> Self {
        Self { nodes: Vec::new(), open: 0 }
    }

    fn enter(&mut self, name: &'static str) -> usize {
        if self.nodes.is_empty() {
            self.nodes.push(Node { name: "", within: 0, children: Vec::new(), calls: 0, seconds: 0.0 });
        }
        let known = self.nodes[self.open].children.iter().copied().find(|&c| self.nodes[c].name == name);
        self.open = known.unwrap_or_else(|| {
            let new = self.nodes.len();
            self.nodes.push(Node { name, within: self.open, children: Vec::new(), calls: 0, seconds: 0.0 });
            self.nodes[self.open].children.push(new);
            new
        });
        self.open
    }

    fn leave(&mut self, node: usize, seconds: f64) {
        // The tree may have been replaced in between by [`take`].
        if let Some(part) = self.nodes.get_mut(node) {
            part.calls += 1;
            part.seconds += seconds;
            self.open = part.within;
        }
    }

    fn parts(&self) -> Vec<Part> {
        let mut parts = Vec::new();
        let mut rest: Vec<usize> = self.nodes.first().map_or_else(Vec::new, |root| root.children.clone());
        rest.reverse();
        while let Some(at) = rest.pop() {
            let node = &self.nodes[at];
            let mut path = vec![node.name.to_owned()];
            let mut within = node.within;
            while within != 0 {
                path.push(self.nodes[within].name.to_owned());
                within = self.nodes[within].within;
            }
            path.reverse();
            parts.push(Part { path, calls: node.calls, seconds: node.seconds });
            rest.extend(node.children.iter().rev());
        }
        parts
    }
}

thread_local! {
    static TREE: RefCell<Tree> = const { RefCell::new(Tree::new()) };
}

/// Ends its part when dropped.
#[must_use = "the part ends where this is dropped: bind it to a name"]
pub struct Running {
    node: usize,
    since: Instant,
    // Not `Send`: belongs to its thread.
    _here: std::marker::PhantomData<*const ()>,
}

/// Starts the part `name` within the present part.
pub fn part(name: &'static str) -> Running {
    let node = TREE.with_borrow_mut(|tree| tree.enter(name));
    Running { node, since: Instant::now(), _here: std::marker::PhantomData }
}

/// Runs `work` as the part `name` and returns its result.
pub fn timed<T>(name: &'static str, work: impl FnOnce() -> T) -> T {
    let _part = part(name);
    work()
}

impl Drop for Running {
    fn drop(&mut self) {
        let seconds = self.since.elapsed().as_secs_f64();
        TREE.with_borrow_mut(|tree| tree.leave(self.node, seconds));
    }
}

/// Completed calls of all parts of this thread so far.
pub fn profile() -> Profile {
    TREE.with_borrow(|tree| Profile { parts: tree.parts() })
}

/// The same, and resets all counts. Parts in progress are omitted.
pub fn take() -> Profile {
    let tree = TREE.replace(Tree::new());
    Profile { parts: tree.parts().into_iter().filter(|p| p.calls > 0).collect() }
}

/// Error of writing or reading a profile.
#[derive(Debug, thiserror::Error)]
#[error("timings {}: {reason}", path.display())]
pub struct TimingError {
    /// The file.
    pub path: PathBuf,
    /// The reason.
    pub reason: String,
}

/// Writes the parts of this thread to the file named by [`FILE_VARIABLE`], if set.
///
/// # Errors
/// An error of the file system.
pub fn write_if_requested() -> Result<(), TimingError> {
    match std::env::var_os(FILE_VARIABLE) {
        Some(path) => profile().save(Path::new(&path)),
        None => Ok(()),
    }
}

impl Profile {
    /// Writes JSON; creates missing folders.
    ///
    /// # Errors
    /// An error of the file system.
    pub fn save(&self, path: &Path) -> Result<(), TimingError> {
        let bad = |reason: String| TimingError { path: path.into(), reason };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|e| bad(e.to_string()))?;
        }
        let text = serde_json::to_vec(self).map_err(|e| bad(e.to_string()))?;
        std::fs::write(path, text).map_err(|e| bad(e.to_string()))
    }

    /// Reads a file written by [`Profile::save`].
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn load(path: &Path) -> Result<Self, TimingError> {
        let bad = |reason: String| TimingError { path: path.into(), reason };
        let bytes = std::fs::read(path).map_err(|e| bad(e.to_string()))?;
        let read: Self = serde_json::from_slice(&bytes).map_err(|e| bad(e.to_string()))?;
        match read.parts.iter().find(|p| p.path.is_empty() || !(p.seconds >= 0.0 && p.seconds.is_finite())) {
            None => Ok(read),
            Some(part) => Err(bad(format!("{part:?} is not a part with valid seconds"))),
        }
    }

    /// Seconds of the outermost parts.
    pub fn seconds(&self) -> f64 {
        self.parts.iter().filter(|p| p.path.len() == 1).map(|p| p.seconds).sum()
    }

    /// Adds the calls and seconds of another profile, part by part.
    pub fn add(&mut self, other: &Profile) {
        for part in &other.parts {
            if let Some(own) = self.parts.iter_mut().find(|p| p.path == part.path) {
                own.calls += part.calls;
                own.seconds += part.seconds;
                continue;
            }
            // After the last part with the same parent.
            let within = &part.path[..part.path.len() - 1];
            let behind = self.parts.iter().rposition(|p| p.path.starts_with(within) && !within.is_empty());
            let at = behind.map_or(self.parts.len(), |i| i + 1);
            self.parts.insert(at, part.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(profile: &Profile) -> Vec<(String, u64)> {
        profile.parts.iter().map(|p| (p.path.join("/"), p.calls)).collect()
    }

    #[test]
    fn parts_nest_and_are_counted() {
        take();
        for _ in 0..3 {
            let _step = part("step");
            for _ in 0..2 {
                let _solve = part("solve");
                timed("product", || ());
            }
            drop(part("accept"));
        }
        drop(part("save"));
        let running = part("running");
        let found = profile();
        let expected =
            [("step", 3), ("step/solve", 6), ("step/solve/product", 6), ("step/accept", 3), ("save", 1)];
        let expected: Vec<_> = expected.map(|(n, c)| (n.to_owned(), c)).into();
        assert_eq!(names(&found)[..5], expected[..]);
        let inner: f64 = found.parts.iter().filter(|p| p.path.len() == 2).map(|p| p.seconds).sum();
        assert!(found.parts[0].seconds >= inner && found.seconds() >= found.parts[0].seconds);
        assert_eq!(names(&take()), expected, "without parts in progress");
        drop(running);
        assert!(profile().parts.is_empty());
    }

    #[test]
    fn profiles_are_restored_and_sums_keep_the_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.json");
        let of = |rows: &[(&[&str], u64, f64)]| Profile {
            parts: rows
                .iter()
                .map(|(path, calls, seconds)| Part {
                    path: path.iter().map(|n| (*n).to_owned()).collect(),
                    calls: *calls,
                    seconds: *seconds,
                })
                .collect(),
        };
        let mut first = of(&[(&["step"], 2, 1.5), (&["step", "solve"], 4, 1.0), (&["save"], 1, 0.5)]);
        first.save(&path).unwrap();
        assert_eq!(Profile::load(&path).unwrap(), first);
        first.add(&of(&[(&["step"], 1, 0.5), (&["step", "accept"], 1, 0.25)]));
        let sum = of(&[
            (&["step"], 3, 2.0),
            (&["step", "solve"], 4, 1.0),
            (&["step", "accept"], 1, 0.25),
            (&["save"], 1, 0.5),
        ]);
        assert_eq!(first, sum);
        std::fs::write(&path, r#"{"parts":[{"path":["a"],"calls":1,"seconds":-1.0}]}"#).unwrap();
        assert!(Profile::load(&path).unwrap_err().to_string().contains("not a part with valid seconds"));
    }
}
