//! The result of a study as text for a terminal.

use terminal::clock;

use super::convergence::Behaviour;
use super::coverage::{self, NotAssessed};
use super::judge::{Judged, Outcome};
use super::page::percent;
use super::study::Study;
use super::verify::Verified;

/// Error and uncertainty of the finest sample of a line, %, or the reason why there is none.
pub fn finest(judged: &Judged) -> String {
    match (&judged.convergence, judged.errors.iter().flatten().last()) {
        _ if judged.unassessed.is_some() => "not assessed".into(),
        (Some(c), _) if c.behaviour == Behaviour::Equal => "no change".into(),
        (Some(_), Some((error, band))) => format!("{} ± {}", percent(*error), percent(*band)),
        _ => "-".into(),
    }
}

/// Extrapolated values, Pareto front, cheaper samples, failed samples and errors that are not assessed.
pub fn words(study: &Study, outcome: &Outcome, not_assessed: &[NotAssessed]) -> String {
    let mut text = String::new();
    for (index, (q, a)) in study.quantities.iter().zip(&outcome.answers).enumerate() {
        text += &match a {
            Some(a) if a.exact => format!("{}: {:.6} (exact)\n", q.name, a.value),
            Some(a) => format!(
                "{}: {:.6} +- {:.2e} ({})\n",
                q.name,
                a.value,
                a.uncertainty,
                percent(a.uncertainty / a.scale)
            ),
            None => format!("{}: not assessed ({})\n", q.name, outcome.why_not(study, index)),
        };
    }
    text += &pareto(study, outcome);
    for (_, sentence) in cheaper(study, outcome) {
        text += &format!("{sentence}\n");
    }
    for (m, s) in outcome.samples.iter().enumerate() {
        if let Some(why) = &s.gap {
            text += &format!(
                "failed: `{}`: {}\n",
                study.samples[m].label,
                why.lines().next().unwrap_or_default()
            );
        }
    }
    let (held, all) = outcome.held();
    if all > 0 {
        text += &format!("check samples: {held} of {all} values within the stated uncertainty\n");
    }
    coverage::line(not_assessed).map_or(text.clone(), |line| text + &line + "\n")
}

fn pareto(study: &Study, outcome: &Outcome) -> String {
    let mut text = String::from("Pareto front (largest error over all quantities):\n");
    if outcome.front.is_empty() {
        return text + "  empty: no sample has an error estimate for all quantities\n";
    }
    for &m in &outcome.front {
        let s = &outcome.samples[m];
        let Some(l) = s.largest else { continue };
        text += &format!(
            "  {:<28} {:>10}  error {} +- {} ({})\n",
            study.samples[m].label,
            clock(s.cost.0),
            percent(l.estimate.error),
            percent(l.estimate.band),
            study.quantities[l.quantity].name
        );
    }
    text
}

/// Sentences on samples that are as accurate as the base and cheaper: one for all quantities (index `None`) if a single
/// sample qualifies for all, else one per quantity with its index.
pub fn cheaper(study: &Study, outcome: &Outcome) -> Vec<(Option<usize>, String)> {
    let every: Vec<usize> = (0..study.quantities.len()).collect();
    let name = |m: usize| &study.samples[m].label;
    if let Some((m, share)) = outcome.cheaper(&every) {
        let all = if every.len() > 1 { "all quantities" } else { "the quantity" };
        return vec![(
            None,
            format!("`{}` is as accurate as the base for {all}, at {} of its cost", name(m), percent(share)),
        )];
    }
    every
        .iter()
        .filter_map(|&q| {
            let (m, share) = outcome.cheaper(&[q])?;
            let error = |m: usize| outcome.samples[m].estimates[q].map_or(f64::NAN, |e| e.error);
            Some((
                Some(q),
                format!(
                    "for {} only, `{}` is as accurate as the base ({}, base {}), at {} of its cost",
                    study.quantities[q].name,
                    name(m),
                    percent(error(m)),
                    percent(error(0)),
                    percent(share)
                ),
            ))
        })
        .collect()
}

/// The comparison with the reference, a line for each quantity.
pub fn verified(all: &[Verified]) -> String {
    let line = |v: &Verified| {
        format!(
            "\nverified: {}: true error {}, estimated error {} ± {}: {}",
            v.quantity,
            percent(v.true_error),
            percent(v.error),
            percent(v.band),
            if v.held { "within bound" } else { "ABOVE BOUND" }
        )
    };
    all.iter().map(line).collect()
}
