//! Kept errors and counts of a study: a change that raises the cost of the same error shows.

use std::path::Path;

use coupling::error::RunError;
use serde::{Deserialize, Serialize};

use super::cost::COUNTS;
use super::judge::Outcome;
use super::runs::Record;
use super::study::Study;

/// Counts may grow by this share.
const DEARER: f64 = 0.10;
/// And by so many, for counts of a few.
const FEW: f64 = 2.0;
/// Errors may grow by this share of theirs,
const WORSE: f64 = 0.05;
/// and by this share of the answer: the reach of the solvers' own tolerances.
const NOISE: f64 = 2e-4;

/// What is kept of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Answers that errors are against, with their scales.
    pub answers: Vec<Kept>,
    /// Samples.
    pub samples: Vec<KeptMember>,
}

/// The answer of a quantity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// Name of the quantity.
    pub quantity: String,
    /// Its answer.
    pub value: f64,
    /// What errors are shares of.
    pub scale: f64,
}

/// Errors and counts of a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KeptMember {
    /// Its name.
    pub label: String,
    /// Errors in the order of the answers, as shares.
    pub errors: Vec<f64>,
    /// Counts in the order of [`COUNTS`].
    pub counts: [f64; 5],
}

/// From a study; samples with gaps are an error.
///
/// # Errors
/// A sample without values.
pub fn keep(study: &Study, outcome: &Outcome, records: &[Record]) -> Result<Reference, RunError> {
    let answers = study.quantities.iter().zip(&outcome.answers);
    let answers = answers
        .map(|(q, a)| a.map(|a| Kept { quantity: q.name.clone(), value: a.value, scale: a.scale }))
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| {
            RunError::Input("a quantity has no answer: no reference is kept of such a study".into())
        })?;
    let mut samples = Vec::new();
    for (m, s) in outcome.samples.iter().enumerate() {
        let label = study.samples[m].label.clone();
        let errors: Option<Vec<f64>> = s.distances.iter().copied().collect();
        let (Some(errors), None, Some(run)) = (errors, &s.gap, records[m].runs.first()) else {
            let why = s.gap.as_deref().unwrap_or("no value");
            return Err(RunError::Input(format!(
                "sample `{label}`: {why}; no reference is kept of such a study"
            )));
        };
        samples.push(KeptMember { label, errors, counts: run.counts().array() });
    }
    Ok(Reference { answers, samples })
}

/// Where the study is less accurate or costs more than its reference; empty: nowhere.
pub fn compare(study: &Study, outcome: &Outcome, records: &[Record], reference: &Reference) -> Vec<String> {
    let mut found = Vec::new();
    for old in &reference.samples {
        let Some(m) = study.samples.iter().position(|m| m.label == old.label) else {
            found.push(format!("sample `{}` of the reference is not in the study", old.label));
            continue;
        };
        let s = &outcome.samples[m];
        if let Some(why) = &s.gap {
            found.push(format!("sample `{}`: {why}", old.label));
            continue;
        }
        for (kept, error) in reference.answers.iter().zip(&old.errors) {
            let value =
                study.quantities.iter().position(|q| q.name == kept.quantity).and_then(|q| s.values[q]);
            let Some(value) = value else {
                found.push(format!("sample `{}` has no `{}`", old.label, kept.quantity));
                continue;
            };
            let now = (value - kept.value).abs() / kept.scale;
            if now > error * (1.0 + WORSE) + NOISE {
                found.push(format!(
                    "sample `{}`: the error of `{}` was {:.3} %, and is {:.3} %",
                    old.label,
                    kept.quantity,
                    100.0 * error,
                    100.0 * now
                ));
            }
        }
        let counts = records[m].runs.first().map(super::cost::Cost::counts).unwrap_or_default().array();
        for ((name, before), now) in COUNTS.iter().zip(old.counts).zip(counts) {
            if now > before * (1.0 + DEARER) + FEW {
                found.push(format!(
                    "sample `{}`: {name} were {before:.0}, and are {now:.0} ({:+.1} %)",
                    old.label,
                    100.0 * (now / before.max(1.0) - 1.0)
                ));
            }
        }
    }
    found
}

/// Reads a kept reference.
///
/// # Errors
/// [`RunError::Input`] for a file that is none.
pub fn load(path: &Path) -> Result<Reference, RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::file("read", path))?;
    serde_json::from_str(&text)
        .map_err(|e| RunError::Input(format!("{}: {e}; make it again with --keep-reference", path.display())))
}

/// Writes one.
///
/// # Errors
/// Trouble with the file.
pub fn save(path: &Path, reference: &Reference) -> Result<(), RunError> {
    let text = serde_json::to_string_pretty(reference).unwrap_or_default();
    std::fs::write(path, text + "\n").map_err(RunError::file("write", path))
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn dearer_or_worse_shows_and_cheaper_or_better_does_not() {
        let (study, values, records) = made();
        let outcome = judge(&study, &values, &records, Measure::Work);
        let reference = keep(&study, &outcome, &records).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("r.json");
        save(&file, &reference).unwrap();
        let back = load(&file).unwrap();
        assert!(
            back.samples.len() == reference.samples.len()
                && compare(&study, &outcome, &records, &back).is_empty()
        );
        let judged = |values: &[Vec<super::super::judge::Value>], records: &[Record]| {
            compare(&study, &judge(&study, values, records, Measure::Work), records, &reference)
        };
        assert!(judged(&values, &records).is_empty());
        let times = |factor: f64| {
            let mut changed = records.clone();
            changed[3].runs[0].stages[0].counts.cell_updates *= factor;
            changed
        };
        assert!(judged(&values, &times(1.08)).is_empty() && judged(&values, &times(0.5)).is_empty());
        let dearer = judged(&values, &times(1.12));
        assert!(
            dearer.len() == 1 && dearer[0].contains("cell_updates") && dearer[0].contains("+12.0 %"),
            "{dearer:?}"
        );
        let mut worse = values.clone();
        worse[2][0] = Ok(values[2][0].clone().unwrap() + 0.1);
        let found = judged(&worse, &records);
        assert!(found.len() == 1 && found[0].contains("error of `speed`"), "{found:?}");
        let mut lost = records.clone();
        lost[1].failure = Some("diverged".into());
        assert!(judged(&values, &lost)[0].contains("diverged"));
        assert!(keep(&study, &judge(&study, &values, &lost, Measure::Work), &lost).is_err());
    }
}
