//! Reference of a study: stored errors and counts, to detect a loss of accuracy or a higher cost.

use std::path::Path;

use coupling::error::RunError;
use serde::{Deserialize, Serialize};

use super::cost::COUNTS;
use super::judge::Outcome;
use super::runs::Record;
use super::study::Study;

/// Relative tolerance of counts.
const COUNT_RELATIVE: f64 = 0.10;
/// Absolute tolerance of counts.
const COUNT_ABSOLUTE: f64 = 2.0;
/// Relative tolerance of errors.
const ERROR_RELATIVE: f64 = 0.05;
/// Absolute tolerance of errors, relative to the scale of the quantity: effect of the solver tolerances.
const ERROR_ABSOLUTE: f64 = 2e-4;

/// Stored results of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Extrapolated values, to which the errors refer, with their scales.
    pub answers: Vec<ReferenceValue>,
    /// Samples.
    #[serde(alias = "members")]
    pub samples: Vec<ReferenceSample>,
}

/// Extrapolated value of a quantity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceValue {
    /// Name of the quantity.
    pub quantity: String,
    /// Extrapolated value.
    pub value: f64,
    /// Scale of relative errors.
    pub scale: f64,
}

/// Errors and counts of a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceSample {
    /// Name of the sample.
    pub label: String,
    /// Relative errors, in the order of `answers`.
    pub errors: Vec<f64>,
    /// Counts, in the order of [`COUNTS`].
    pub counts: [f64; 5],
}

/// The reference of a study.
///
/// # Errors
/// A quantity without extrapolated value, or a failed sample.
pub fn keep(study: &Study, outcome: &Outcome, records: &[Record]) -> Result<Reference, RunError> {
    let answers = study.quantities.iter().zip(&outcome.answers);
    let answers = answers
        .map(|(q, a)| a.map(|a| ReferenceValue { quantity: q.name.clone(), value: a.value, scale: a.scale }))
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| {
            RunError::Input("a quantity has no extrapolated value, so no reference is written".into())
        })?;
    let mut samples = Vec::new();
    for (m, s) in outcome.samples.iter().enumerate() {
        let label = study.samples[m].label.clone();
        let errors: Option<Vec<f64>> = s.distances.iter().copied().collect();
        let (Some(errors), None, Some(run)) = (errors, &s.gap, records[m].runs.first()) else {
            let why = s.gap.as_deref().unwrap_or("no value");
            return Err(RunError::Input(format!(
                "sample `{label}` failed ({why}), so no reference is written"
            )));
        };
        samples.push(ReferenceSample { label, errors, counts: run.counts().array() });
    }
    Ok(Reference { answers, samples })
}

/// Findings where the study is less accurate or costs more than its reference.
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
            if now > error * (1.0 + ERROR_RELATIVE) + ERROR_ABSOLUTE {
                found.push(format!(
                    "sample `{}`: the error of `{}` is {:.3} %, above {:.3} % of the reference",
                    old.label,
                    kept.quantity,
                    100.0 * now,
                    100.0 * error
                ));
            }
        }
        let counts = records[m].runs.first().map(super::cost::Cost::counts).unwrap_or_default().array();
        for ((name, before), now) in COUNTS.iter().zip(old.counts).zip(counts) {
            if now > before * (1.0 + COUNT_RELATIVE) + COUNT_ABSOLUTE {
                found.push(format!(
                    "sample `{}`: {name} are {now:.0}, above {before:.0} of the reference ({:+.1} %)",
                    old.label,
                    100.0 * (now / before.max(1.0) - 1.0)
                ));
            }
        }
    }
    found
}

/// Reads a reference.
///
/// # Errors
/// [`RunError::Input`] for an invalid file.
pub fn load(path: &Path) -> Result<Reference, RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::file("read", path))?;
    serde_json::from_str(&text).map_err(|e| {
        RunError::Input(format!("{}: {e}. Write it again with --keep-reference", path.display()))
    })
}

/// Writes a reference.
///
/// # Errors
/// The file cannot be written.
pub fn save(path: &Path, reference: &Reference) -> Result<(), RunError> {
    let text = serde_json::to_string_pretty(reference).unwrap_or_default();
    std::fs::write(path, text + "\n").map_err(RunError::file("write", path))
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn only_larger_errors_and_counts_are_findings() {
        let (study, values, records) = made();
        let outcome = judge(&study, &values, &records, Measure::Work);
        let reference = keep(&study, &outcome, &records).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("r.json");
        save(&file, &reference).unwrap();
        let back = load(&file).unwrap();
        // Files of earlier versions have the key `members`.
        let text = std::fs::read_to_string(&file).unwrap().replace("\"samples\"", "\"members\"");
        std::fs::write(&file, text).unwrap();
        assert_eq!(load(&file).unwrap(), back);
        assert!(
            back.samples.len() == reference.samples.len()
                && compare(&study, &outcome, &records, &back).is_empty()
        );
        let findings = |values: &[Vec<super::super::judge::Value>], records: &[Record]| {
            compare(&study, &judge(&study, values, records, Measure::Work), records, &reference)
        };
        assert!(findings(&values, &records).is_empty());
        let times = |factor: f64| {
            let mut changed = records.clone();
            changed[3].runs[0].stages[0].counts.cell_updates *= factor;
            changed
        };
        assert!(findings(&values, &times(1.08)).is_empty() && findings(&values, &times(0.5)).is_empty());
        let costlier = findings(&values, &times(1.12));
        assert!(
            costlier.len() == 1 && costlier[0].contains("cell_updates") && costlier[0].contains("+12.0 %"),
            "{costlier:?}"
        );
        let mut worse = values.clone();
        worse[2][0] = Ok(values[2][0].clone().unwrap() + 0.1);
        let found = findings(&worse, &records);
        assert!(found.len() == 1 && found[0].contains("error of `speed`"), "{found:?}");
        let mut lost = records.clone();
        lost[1].failure = Some("diverged".into());
        assert!(findings(&values, &lost)[0].contains("diverged"));
        assert!(keep(&study, &judge(&study, &values, &lost, Measure::Work), &lost).is_err());
    }
}
