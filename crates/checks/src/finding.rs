//! Results of a check.

pub use results::finding::{Finding, Severity};

/// Result of a check before the run: severity, key of the scene, value.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Severity.
    pub severity: Severity,
    /// Dotted key of the scene, such as `fabric.thickness_m` or `stage[1].window_s`; empty if none.
    pub key: String,
    /// The value with its context, a sentence without full stop.
    pub figure: String,
    /// Remedy for this value instead of that in the table.
    pub remedy: Option<String>,
}

impl Judged {
    /// A result with the remedy of the table.
    pub fn new(severity: Severity, key: impl Into<String>, figure: impl Into<String>) -> Self {
        Self { severity, key: key.into(), figure: figure.into(), remedy: None }
    }

    /// Replaces the remedy of the table.
    pub fn remedy(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }
}
