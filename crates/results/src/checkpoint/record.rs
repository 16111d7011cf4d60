//! `resume.json`: identity and initial scene of the run to which the saved states belong.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use archive::hash::checksum;
use case::Scene;
use coupling::error::RunError;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::changes::{changes, may_change};
use super::find::Point;

const FILE: &str = "resume.json";
const FORMAT: u32 = 1;

/// A run at its start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    format: u32,
    /// Identity of the run.
    pub run: u64,
    /// Index of the first stage.
    pub first: usize,
    /// Scene with defaults and changes of the command line.
    scene: Value,
    /// Checksums of the files named in the scene.
    files: BTreeMap<String, u64>,
}

impl Record {
    /// Record of a run of `scene` that starts now with stage `first`.
    pub fn new(scene: &Scene, file: &Path, first: usize) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        let run = checksum(format!("{} {now}", std::process::id()).as_bytes());
        let scene = serde_json::to_value(scene).unwrap_or_default();
        let files = named_files(&scene, file.parent().unwrap_or(Path::new(".")));
        Self { format: FORMAT, run, first, scene, files }
    }

    /// Writes the record to the results folder.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), RunError> {
        let path = out.join(FILE);
        let text = serde_json::to_string_pretty(self).unwrap_or_default();
        archive::write_whole(&path, &[text.as_bytes()]).map_err(RunError::file("write", &path))
    }

    /// Reads the record of the run in the results folder `out`.
    ///
    /// # Errors
    /// [`RunError::Input`] without a valid record.
    pub fn read(out: &Path) -> Result<Self, RunError> {
        let path = out.join(FILE);
        let text = std::fs::read_to_string(&path).map_err(|e| {
            RunError::Input(format!(
                "there is no run to resume in {}: {FILE}: {e}. Omit --resume to start the scene from its beginning",
                out.display()
            ))
        })?;
        let record: Self = serde_json::from_str(&text)
            .map_err(|e| RunError::Input(format!("{} cannot be read: {e}", path.display())))?;
        if record.format == FORMAT {
            Ok(record)
        } else {
            Err(RunError::Input(format!(
                "{} was written by another version of ripstop, so the run cannot be resumed. Omit --resume to start again",
                path.display()
            )))
        }
    }

    /// The record with the present scene, if the changes of the scene do not affect the results up to `point`.
    ///
    /// # Errors
    /// [`RunError::Input`] with the changed keys that affect them.
    pub fn renewed(self, scene: &Scene, file: &Path, point: Option<&Point>) -> Result<Self, RunError> {
        let new = Self { run: self.run, ..Self::new(scene, file, self.first) };
        let mut wrong: Vec<String> = changes(&self.scene, &new.scene)
            .into_iter()
            .filter(|key| !may_change(key, self.first, point, scene))
            .collect();
        let changed = self.files.iter().filter(|(name, sum)| new.files.get(*name) != Some(sum));
        wrong.extend(changed.map(|(name, _)| format!("the content of {name}")));
        if wrong.is_empty() {
            return Ok(new);
        }
        Err(RunError::Input(format!(
            "the scene has changed since the start of the run: {}. The saved state is not valid for the changed scene. Undo \
             the changes, or run without --resume. (The duration of the last stage, further stages, [output], [ranks] and \
             [mesh.regrid] may change)",
            wrong.join(", ")
        )))
    }
}

/// Existing files named by strings of the scene, with the checksums of their contents.
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
    // Names, output and programs do not affect the results.
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
