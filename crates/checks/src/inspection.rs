//! The inspection of a scene before it runs.

use std::path::Path;

use case::Scene;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use terminal::{Console, counted};

use super::facts::{Facts, Machine};
use super::finding::{Finding, Judged, Severity};
use super::names;
use super::table::{Check, When, all};

/// All findings, errors first.
///
/// # Examples
///
/// ```
/// # use std::path::Path;
/// use checks::Inspection;
/// use checks::facts::Machine;
/// use coupling::interface::CanopyInterface;
///
/// let file = Path::new("../../cases/square-drop/scene.toml");
/// let scene = case::load(file)?;
/// let canopy = CanopyInterface::new(&scene)?;
/// let machine = Machine { cores: 64, memory: Some(1e12), disk: Some(1e12), hosts: false };
/// let inspection = Inspection::of(&scene, &canopy, 0, machine, file, &[])?;
/// assert_eq!(inspection.of_severity(checks::Severity::Error).count(), 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Inspection {
    /// In the order of severity, then of the table.
    pub findings: Vec<Finding>,
}

impl Inspection {
    /// Runs all checks before the run.
    pub fn new(facts: &Facts<'_>, place: impl Fn(&str) -> String) -> Self {
        let mut findings = Vec::new();
        for check in all() {
            if let When::Before(judge) = check.when
                && facts.has_subject(check.id)
            {
                findings.extend(judge(facts).into_iter().map(|j| complete(check, j, &place)));
            }
        }
        // Stable: the order of the table within a severity.
        findings.sort_by_key(|f| std::cmp::Reverse(f.severity));
        Self { findings }
    }

    /// Inspects a scene whose stages from `first` on run on `machine`, for each of its flow methods. `file` is the scene file, `settings` are the values of
    /// `--set` as written; both locate findings.
    ///
    /// # Errors
    /// Parameters from which no canopy mesh can be built.
    pub fn of(
        scene: &Scene,
        interface: &CanopyInterface,
        first: usize,
        machine: Machine,
        file: &Path,
        settings: &[String],
    ) -> Result<Self, RunError> {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
        let mut all = Self { findings: Vec::new() };
        for view in scene.views(first) {
            let facts = Facts::new(&view, interface, machine, first);
            let mut facts = facts.map_err(|e| RunError::Input(e.to_string()))?;
            facts.former_names = names::former(&text, settings);
            let own = Self::new(&facts, |key| place(file, &text, settings, &names, key)).findings;
            let new: Vec<Finding> = own.into_iter().filter(|f| !all.findings.contains(f)).collect();
            all.findings.extend(new);
        }
        all.findings.sort_by_key(|f| std::cmp::Reverse(f.severity));
        Ok(all)
    }

    /// Findings of a severity.
    pub fn of_severity(&self, severity: Severity) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(move |f| f.severity == severity)
    }

    /// Errors and warnings.
    pub fn above_notes(&self) -> Vec<Finding> {
        self.findings.iter().filter(|f| f.severity > Severity::Note).cloned().collect()
    }

    /// Prints the warnings of a run that starts.
    ///
    /// # Errors
    /// [`RunError::Input`] with all errors: the run does not start.
    pub fn announce(&self, console: &Console) -> Result<(), RunError> {
        self.of_severity(Severity::Warning).for_each(|f| console.caution(&f.text()));
        let errors: Vec<String> = self.of_severity(Severity::Error).map(Finding::text).collect();
        if errors.is_empty() { Ok(()) } else { Err(RunError::Input(errors.join("\n"))) }
    }

    /// The result of `ripstop check`, which has printed the findings.
    ///
    /// # Errors
    /// [`RunError::Input`] where there are errors.
    pub fn verdict(&self) -> Result<(), RunError> {
        match self.of_severity(Severity::Error).count() {
            0 => Ok(()),
            n => Err(RunError::Input(format!(
                "the inspection found {} (see above): the scene cannot run",
                counted(n as u64, "error")
            ))),
        }
    }

    /// The findings as text for `ripstop check`.
    pub fn text(&self) -> String {
        let count = |s: Severity| self.of_severity(s).count() as u64;
        let mut lines = vec![format!(
            "inspection: {}, {}, {} (docs/reference/checks.md)",
            counted(count(Severity::Error), "error"),
            counted(count(Severity::Warning), "warning"),
            counted(count(Severity::Note), "note")
        )];
        for f in &self.findings {
            lines.push(format!("  {}: {}", f.severity.name(), f.text().replace('\n', "\n  ")));
        }
        lines.join("\n")
    }
}

fn complete(check: &Check, judged: Judged, place: impl Fn(&str) -> String) -> Finding {
    debug_assert!(judged.severity <= check.severity, "{} exceeds the severity of its row", check.id);
    let remedy = judged.remedy.unwrap_or_else(|| check.remedy.to_owned());
    Finding {
        severity: judged.severity,
        check: check.id.into(),
        place: place(&judged.key),
        key: judged.key,
        figure: judged.figure,
        range: check.range.into(),
        remedy,
    }
}

/// The location of the value of `key`: an option, or a line of the file.
fn place(file: &Path, text: &str, settings: &[String], stages: &[&str], key: &str) -> String {
    let current = |s: &&String| s.split_once('=').is_some_and(|(k, _)| case::current_path(k.trim()) == key);
    let stage = key.strip_prefix("stage[").and_then(|rest| rest.split_once(']'));
    let named = match stage.and_then(|(i, rest)| Some((stages.get(i.parse::<usize>().ok()?)?, rest))) {
        Some((name, rest)) => format!("stage.{name}{rest}"),
        None => key.to_owned(),
    };
    let set = settings.iter().find(|s| s.starts_with(&format!("{named}=")));
    if let Some(setting) = set.or_else(|| settings.iter().find(current)) {
        return format!("--set {setting}");
    }
    case::place_of(text, key)
        .map_or_else(String::new, |(line, column)| format!("{}:{line}:{column}", file.display()))
}
