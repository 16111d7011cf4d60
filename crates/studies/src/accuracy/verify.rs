//! Comparison of a sample with the reference, which is finer in all parameters.

use serde::Serialize;

use super::judge::{Outcome, within};
use super::study::Study;

/// One quantity of the verified sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verified {
    /// Quantity.
    pub quantity: String,
    /// Value of the verified sample.
    pub value: f64,
    /// Value of the reference.
    pub reference: f64,
    /// Difference of the two, relative to the scale of the extrapolated value.
    pub true_error: f64,
    /// Estimated error.
    pub error: f64,
    /// Uncertainty of the estimated error (half width).
    pub band: f64,
    /// Whether the true error is at most `error + band`.
    pub held: bool,
}

/// Compares `sample` with the reference of the study; `None` without a reference.
///
/// # Errors
/// The reference or the sample has no value or no estimate.
pub fn verify(study: &Study, outcome: &Outcome, sample: usize) -> Option<Result<Vec<Verified>, String>> {
    let reference = &outcome.samples[study.reference?];
    let own = &outcome.samples[sample];
    let one = |q: usize| {
        let name = &study.quantities[q].name;
        let missing =
            |s: &super::judge::Standing| s.gap.clone().unwrap_or_else(|| format!("no value of `{name}`"));
        let to =
            reference.values[q].ok_or_else(|| format!("the reference failed: {}", missing(reference)))?;
        let value = own.values[q].ok_or_else(|| missing(own))?;
        let (Some(a), Some(e)) = (outcome.answers[q], own.estimates[q]) else {
            return Err(format!("`{name}` is not assessed ({})", outcome.why_not(study, q)));
        };
        let true_error = (value - to).abs() / a.scale;
        Ok(Verified {
            quantity: name.clone(),
            value,
            reference: to,
            true_error,
            error: e.error,
            band: e.band,
            held: within(true_error, e.bound()),
        })
    };
    Some((0..study.quantities.len()).map(one).collect())
}
