//! What a check says of a scene.

pub use results::finding::{Finding, Severity};

/// What a check before the run found: its figure and the key of the scene that it concerns.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// How bad.
    pub severity: Severity,
    /// Dotted key of the scene, such as `fabric.thickness_m` or `stage[1].window_s`; empty if none.
    pub key: String,
    /// The figure, in a sentence without full stop.
    pub figure: String,
    /// A remedy for this figure instead of the one in the table.
    pub remedy: Option<String>,
}

impl Judged {
    /// A finding whose remedy is that of the table.
    pub fn new(severity: Severity, key: impl Into<String>, figure: impl Into<String>) -> Self {
        Self { severity, key: key.into(), figure: figure.into(), remedy: None }
    }

    /// The same with its own remedy.
    pub fn remedy(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }
}
