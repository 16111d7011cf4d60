//! What a check found in a scene or a run, as summary and report repeat it.

use serde::{Deserialize, Serialize};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// A figure for the reader.
    Note,
    /// Outside the range of real parachutes, or of what the method resolves: the run starts.
    Warning,
    /// Cannot be right: the run does not start, or ends.
    Error,
}

impl Severity {
    /// The word in messages.
    pub fn name(self) -> &'static str {
        match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        }
    }
}

/// A finding with all that a reader needs; `summary.json` holds those above a note.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// How bad.
    pub severity: Severity,
    /// Identifier of the check in the table.
    pub check: String,
    /// Dotted key of the scene; empty if none.
    pub key: String,
    /// File, line and column of the key as `FILE:LINE:COLUMN`; empty if the file does not hold it.
    pub place: String,
    /// The figure.
    pub figure: String,
    /// The range that it is compared with.
    pub range: String,
    /// What to do; empty for a note.
    pub remedy: String,
}

impl Finding {
    /// What was found, without the severity: for a console that prints it itself.
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

    /// One line for tables: severity, figure and check.
    pub fn line(&self) -> String {
        format!("{}: {} [{}]", self.severity.name(), self.figure, self.check)
    }
}
