//! The smallest coupled descent with all programs on three ranks, for runs in hundreds.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::{changed_scene, ripstop_run, succeed};

/// Windows of the last stage; faults occur in the third.
pub const WINDOWS: usize = 4;
/// Ranks of each run.
pub const RANKS: &str = "structure=3,mesh=3,flow=3";

/// Changes that reduce `square-drop` to this size.
pub const SMALLER: [(&str, &str); 8] = [
    ("duration_s = 0.1\n", "duration_s = 0.02\n"),
    ("cells_across = 12", "cells_across = 4"),
    ("line_count = 24", "line_count = 8"),
    ("layers_inside = 5", "layers_inside = 2"),
    ("layers_outside = 10", "layers_outside = 4"),
    ("first_layer_m = 0.1", "first_layer_m = 0.2"),
    ("duration_s = 1.0", "duration_s = 0.1"),
    ("duration_s = 0.2", "duration_s = 0.08"),
];

/// A run without fault, from whose states all others start.
pub struct Base {
    /// Folder of the run.
    pub folder: tempfile::TempDir,
    /// Scene file.
    pub scene: PathBuf,
}

impl Base {
    /// Runs the scene.
    #[allow(clippy::new_without_default, reason = "it runs programs")]
    pub fn new() -> Self {
        Self::on(RANKS)
    }

    /// As [`Base::new`], on other ranks.
    pub fn on(ranks: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let scene = changed_scene("square-drop", folder.path(), &SMALLER);
        let base = Self { folder, scene };
        succeed(ripstop_run(&base.scene, &base.out(), &["--ranks", ranks, "--quiet"]));
        base
    }

    /// Results folder.
    pub fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// A copy of the states that the last stage starts from.
    pub fn copy(&self, to: &Path) {
        for stage in ["pre-inflation", "developed-flow"] {
            let (from, to) = (self.out().join(stage).join("state"), to.join(stage).join("state"));
            fs::create_dir_all(&to).expect("a folder");
            for file in fs::read_dir(from).expect("a state").flatten() {
                fs::copy(file.path(), to.join(file.file_name())).expect("a copy");
            }
        }
    }
}

/// Bytes of all files below a folder.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut stack = vec![folder.to_path_buf()];
    while let Some(dir) = stack.pop() {
        for entry in fs::read_dir(&dir).into_iter().flatten().flatten() {
            if entry.path().is_dir() {
                stack.push(entry.path());
            } else {
                let name = entry.path().strip_prefix(folder).expect("below").to_path_buf();
                all.insert(name, fs::read(entry.path()).expect("a file"));
            }
        }
    }
    all
}
