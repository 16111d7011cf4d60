//! Where a reference comes from.

use std::path::Path;

use serde::{Deserialize, Serialize};

/// Provenance of a recording and its cost, in `origin.toml` of a reference.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(default)]
pub(super) struct Origin {
    /// Version of `ripstop`.
    version: String,
    /// Commit of the sources.
    commit: String,
    /// Model of the processor.
    processor: String,
    /// Processor time of the three programs, s.
    processor_s: f64,
    /// Command line of the run.
    command: String,
}

impl Origin {
    /// The origin of the run whose results are in `out`.
    pub(super) fn of_run(out: &Path, command: String) -> Self {
        let text = std::fs::read_to_string(out.join("summary.json")).unwrap_or_default();
        let summary: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        let times = summary["stages"].as_array().into_iter().flatten();
        let times = times.filter_map(|stage| stage["cpu_s"].as_array()).flatten();
        Self {
            version: summary["version"].as_str().unwrap_or_default().into(),
            commit: results::provenance::commit(),
            processor: summary["machine"]["processor"].as_str().unwrap_or_default().into(),
            processor_s: times.filter_map(serde_json::Value::as_f64).sum(),
            command,
        }
    }

    /// The origin of a reference, if its file can be read.
    pub(super) fn of_reference(folder: &Path) -> Option<Self> {
        let text = std::fs::read_to_string(folder.join("origin.toml")).ok()?;
        toml::from_str(&text).ok()
    }

    /// The content of `origin.toml`.
    pub(super) fn text(&self) -> String {
        let rounded = Self { processor_s: (100.0 * self.processor_s).round() / 100.0, ..self.clone() };
        toml::to_string(&rounded).unwrap_or_default()
    }

    /// Processor time, s.
    pub(super) fn processor_s(&self) -> f64 {
        self.processor_s
    }

    /// Processor time as a ratio to that of `reference`; `None` on another processor, or where it is unknown.
    pub(super) fn ratio(&self, reference: &Self) -> Option<f64> {
        let known = reference.processor_s > 0.0 && !self.processor.is_empty();
        (known && self.processor == reference.processor).then(|| self.processor_s / reference.processor_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origin_is_that_of_the_summary() {
        let folder = tempfile::tempdir().unwrap();
        let summary = r#"{"version": "1.2.3", "machine": {"processor": "A"}, "stages": [{"cpu_s": [1.0, 2.0, 0.5]}, {"cpu_s": [0.25, 0, 0]}]}"#;
        std::fs::write(folder.path().join("summary.json"), summary).unwrap();
        let run = Origin::of_run(folder.path(), "ripstop run scene.toml".into());
        assert_eq!((run.version.as_str(), run.processor_s()), ("1.2.3", 3.75));
        std::fs::write(folder.path().join("origin.toml"), run.text()).unwrap();
        let reference = Origin::of_reference(folder.path()).expect("an origin");
        assert_eq!(reference, run);
        let twice = Origin { processor_s: 7.5, ..run.clone() };
        assert_eq!(twice.ratio(&reference), Some(2.0));
        let elsewhere = Origin { processor: "B".into(), ..twice };
        assert_eq!(elsewhere.ratio(&reference), None);
        assert_eq!(run.ratio(&Origin::default()), None);
    }
}
