//! Findings of the checks of a scene or a run, for the summary and the report.

use serde::{Deserialize, Serialize};

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Information.
    Note,
    /// Outside the range of real parachutes or of the method. The run starts.
    Warning,
    /// Invalid. The run does not start, or ends.
    Error,
}

impl Severity {
    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        }
    }
}

/// A finding. `summary.json` contains warnings and errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Severity.
    pub severity: Severity,
    /// Identifier of the check in the table.
    pub check: String,
    /// Dotted key of the scene; empty if none.
    pub key: String,
    /// File, line and column of the key as `FILE:LINE:COLUMN`; empty if the file does not contain it.
    pub place: String,
    /// Value found, in words.
    pub figure: String,
    /// Valid range.
    pub range: String,
    /// Remedy; empty for a note.
    pub remedy: String,
}

impl Finding {
    /// Text without the severity, which the console adds.
    pub fn text(&self) -> String {
        let key = if self.key.is_empty() { String::new() } else { format!("{}: ", self.key) };
        let place = if self.place.is_empty() { String::new() } else { format!("{}: ", self.place) };
        if self.severity == Severity::Note {
            return format!("{key}{} [{}]", self.figure, self.check);
        }
        format!(
            "{place}{key}{} [{}]\n  range:  {}\n  remedy: {}",
            self.figure, self.check, self.range, self.remedy
        )
    }

    /// One line: severity, value and check.
    pub fn line(&self) -> String {
        format!("{}: {} [{}]", self.severity.name(), self.figure, self.check)
    }
}
