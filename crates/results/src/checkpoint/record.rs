//! `resume.json`: which run the states in a folder belong to, and the scene that it began with.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use archive::hash::checksum;
use case::Scene;
use coupling::error::RunError;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::changes::{changes, harmless};
use super::find::Point;

const FILE: &str = "resume.json";
const FORMAT: u32 = 1;

/// A run as it began.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    format: u32,
    /// Identity of the run.
    pub run: u64,
    /// Stage that it began with.
    pub first: usize,
    /// The scene with its defaults and what the command line changed.
    scene: Value,
    /// Checksums of the files that the scene names.
    files: BTreeMap<String, u64>,
}

impl Record {
    /// Of a run of `scene` that begins now with stage `first`.
    pub fn new(scene: &Scene, file: &Path, first: usize) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let run = checksum(format!("{} {now}", std::process::id()).as_bytes());
        let scene = serde_json::to_value(scene).unwrap_or_default();
        let files = named_files(&scene, file.parent().unwrap_or(Path::new(".")));
        Self { format: FORMAT, run, first, scene, files }
    }

    /// Writes it to the folder of results.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn write(&self, out: &Path) -> Result<(), RunError> {
        let path = out.join(FILE);
        let text = serde_json::to_string_pretty(self).unwrap_or_default();
        archive::write_whole(&path, &[text.as_bytes()]).map_err(RunError::file("write", &path))
    }

    /// The record of the run whose results lie in `out`.
    ///
    /// # Errors
    /// [`RunError::Input`] where there is none.
    pub fn read(out: &Path) -> Result<Self, RunError> {
        let path = out.join(FILE);
        let text = std::fs::read_to_string(&path).map_err(|e| {
            RunError::Input(format!(
                "there is no run to resume in {}: {FILE}: {e}. Without --resume the scene is run from its start",
                out.display()
            ))
        })?;
        let record: Self = serde_json::from_str(&text)
            .map_err(|e| RunError::Input(format!("{} cannot be read: {e}", path.display())))?;
        if record.format == FORMAT {
            Ok(record)
        } else {
            Err(RunError::Input(format!("{} is of another version of ripstop", path.display())))
        }
    }

    /// The same run with the scene as it is now, where what has changed does no harm to what was
    /// computed up to `point`.
    ///
    /// # Errors
    /// [`RunError::Input`] that names the keys that do.
    pub fn renewed(self, scene: &Scene, file: &Path, point: Option<&Point>) -> Result<Self, RunError> {
        let new = Self { run: self.run, ..Self::new(scene, file, self.first) };
        let mut wrong: Vec<String> = changes(&self.scene, &new.scene)
            .into_iter()
            .filter(|key| !harmless(key, self.first, point, scene))
            .collect();
        let changed = self.files.iter().filter(|(name, sum)| new.files.get(*name) != Some(sum));
        wrong.extend(changed.map(|(name, _)| format!("the content of {name}")));
        if wrong.is_empty() {
            return Ok(new);
        }
        Err(RunError::Input(format!(
            "the scene is not the one that the run began with; changed: {}. What was computed so far would not fit: \
             change it back, or run without --resume (a longer last stage, further stages, [output] and [ranks] \
             may change)",
            wrong.join(", ")
        )))
    }
}

/// Files that a text of the scene names, with the checksums of their contents.
fn named_files(scene: &Value, folder: &Path) -> BTreeMap<String, u64> {
    fn texts<'a>(value: &'a Value, all: &mut Vec<&'a str>) {
        match value {
            Value::String(text) => all.push(text),
            Value::Array(list) => list.iter().for_each(|v| texts(v, all)),
            Value::Object(map) => map.values().for_each(|v| texts(v, all)),
            _ => {}
        }
    }
    let mut all = Vec::new();
    // What is run, and where results go, is no part of the scene's physics.
    for (key, value) in scene.as_object().into_iter().flatten() {
        if !["name", "title", "output", "programs", "stage"].contains(&key.as_str()) {
            texts(value, &mut all);
        }
    }
    let file = |name: &&str| {
        let path = folder.join(name);
        let bytes = path.is_file().then(|| std::fs::read(&path).ok()).flatten()?;
        Some(((*name).to_owned(), checksum(&bytes)))
    };
    all.iter().filter_map(file).collect()
}
