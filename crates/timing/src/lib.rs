//! Where the time of a program goes: named parts of a step, nested as they are called.
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
//! Each thread counts for itself. A part costs two looks at the clock (some 50 ns): enough for a solve, too much for a
//! face. Nothing is allocated but where a part is met for the first time at its place.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

/// Names the file into which a program writes its [`Profile`] when it ends; unset: none.
pub const FILE_VARIABLE: &str = "RIPSTOP_TIMINGS";

/// A part of a program's work, over all its calls.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Names from the outermost part to this one.
    pub path: Vec<String>,
    /// How often it ran.
    pub calls: u64,
    /// Seconds by the clock, those of the parts in it included.
    pub seconds: f64,
}

/// The parts of a program's work, each behind the one it lies in, in the order in which they first ran.
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

/// The parts of this thread; the first node stands for the thread itself.
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
        // A tree that was taken in between knows nothing of it.
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

/// Ends the part that it was made for when it is dropped.
#[must_use = "the part ends where this is dropped: bind it to a name"]
pub struct Running {
    node: usize,
    since: Instant,
    // Belongs to its thread.
    _here: std::marker::PhantomData<*const ()>,
}

/// Begins the part `name` of the part that runs now.
pub fn part(name: &'static str) -> Running {
    let node = TREE.with_borrow_mut(|tree| tree.enter(name));
    Running { node, since: Instant::now(), _here: std::marker::PhantomData }
}

/// What `work` returns, as the part `name`.
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

/// The finished calls of all parts of this thread so far.
pub fn profile() -> Profile {
    TREE.with_borrow(|tree| Profile { parts: tree.parts() })
}

/// The same, and counts from zero again. Parts that run now are left out.
pub fn take() -> Profile {
    let tree = TREE.replace(Tree::new());
    Profile { parts: tree.parts().into_iter().filter(|p| p.calls > 0).collect() }
}

/// Why a profile could not be written or read.
#[derive(Debug, thiserror::Error)]
#[error("timings {}: {reason}", path.display())]
pub struct TimingError {
    /// The file.
    pub path: PathBuf,
    /// What went wrong.
    pub reason: String,
}

/// Writes the parts of this thread into the file that [`FILE_VARIABLE`] names, if it names one.
///
/// # Errors
/// Trouble with the file.
pub fn write_where_asked() -> Result<(), TimingError> {
    match std::env::var_os(FILE_VARIABLE) {
        Some(path) => profile().save(Path::new(&path)),
        None => Ok(()),
    }
}

impl Profile {
    /// Writes JSON; folders are made.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn save(&self, path: &Path) -> Result<(), TimingError> {
        let bad = |reason: String| TimingError { path: path.into(), reason };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|e| bad(e.to_string()))?;
        }
        let text = serde_json::to_vec(self).map_err(|e| bad(e.to_string()))?;
        std::fs::write(path, text).map_err(|e| bad(e.to_string()))
    }

    /// Reads what [`Profile::save`] wrote.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn load(path: &Path) -> Result<Self, TimingError> {
        let bad = |reason: String| TimingError { path: path.into(), reason };
        let bytes = std::fs::read(path).map_err(|e| bad(e.to_string()))?;
        let read: Self = serde_json::from_slice(&bytes).map_err(|e| bad(e.to_string()))?;
        match read.parts.iter().find(|p| p.path.is_empty() || !(p.seconds >= 0.0 && p.seconds.is_finite())) {
            None => Ok(read),
            Some(part) => Err(bad(format!("{part:?} is no part with seconds"))),
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
            // Behind the last part that lies in the same one.
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
    fn parts_nest_and_count() {
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
        assert_eq!(names(&take()), expected, "without what runs");
        drop(running);
        assert!(profile().parts.is_empty());
    }

    #[test]
    fn files_come_back_and_sums_keep_the_order() {
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
        assert!(Profile::load(&path).unwrap_err().to_string().contains("no part with seconds"));
    }
}
