//! Recommendation: the cheapest settings for a target error, or the most accurate settings for a budget.

use std::path::{Path, PathBuf};

use coupling::error::RunError;
use serde::Serialize;
use terminal::clock;

use super::coverage::{self, NotAssessed};
use super::judge::Outcome;
use super::page::percent;
use super::study::Study;
use super::verify::{Verified, verify};

/// Target of a recommendation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Maximum relative error.
    Error(f64),
    /// Maximum cost, s.
    Budget(f64),
}

/// Parses a relative error: `1%`, or a number below 1 such as `0.01`.
///
/// # Errors
/// Invalid text, or a number of at least 1 without a percent sign: 5 may mean 5 % or 500 %.
pub fn share(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let help = "expected a relative error above 0, such as `1%` or `0.01`";
    let (number, factor) = match text.strip_suffix('%') {
        Some(number) => (number.trim(), 0.01),
        None => (text, 1.0),
    };
    let value = number.parse::<f64>().ok().filter(|x| *x > 0.0 && x.is_finite()).ok_or(help)?;
    if factor == 1.0 && value >= 1.0 {
        return Err(format!(
            "is {number} % meant? Write `{number}%`. A number without a percent sign must be below 1 (0.05 is 5 %)"
        ));
    }
    let share = factor * value;
    if share < 10.0 { Ok(share) } else { Err(help.into()) }
}

/// Parses a time, s: `90`, `90s`, `10min`, `2h`.
///
/// # Errors
/// Invalid text.
pub fn time(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let units = [("min", 60.0), ("h", 3600.0), ("m", 60.0), ("s", 1.0), ("", 1.0)];
    units
        .iter()
        .find_map(|(unit, factor)| text.strip_suffix(unit)?.trim().parse::<f64>().ok().map(|x| x * factor))
        .filter(|x| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "expected a time above 0, such as `90s`, `10min` or `2h`".into())
}

/// The best sample for a target, among all with an error estimate for every quantity.
///
/// # Errors
/// A quantity is not assessed, or no sample meets the target (the message names the nearest).
pub fn choose(study: &Study, outcome: &Outcome, target: Target) -> Result<usize, RunError> {
    if let Some(q) = outcome.answers.iter().position(Option::is_none) {
        return Err(RunError::Study(format!(
            "`{}` is not assessed, so no settings can be recommended: {}",
            study.quantities[q].name,
            outcome.why_not(study, q)
        )));
    }
    let cost = |m: usize| outcome.samples[m].cost.0;
    let known: Vec<(usize, f64)> = (0..study.samples.len())
        .filter(|&m| study.reference != Some(m) && cost(m).is_finite())
        .filter_map(|m| Some((m, outcome.bound(m)?.1)))
        .collect();
    let name = |m: usize| &study.samples[m].label;
    let by_cost = |a: &&(usize, f64), b: &&(usize, f64)| cost(a.0).total_cmp(&cost(b.0));
    let by_bound = |a: &&(usize, f64), b: &&(usize, f64)| a.1.total_cmp(&b.1).then(by_cost(a, b));
    let (Some(cheapest), Some(best)) = (known.iter().min_by(by_cost), known.iter().min_by(by_bound)) else {
        return Err(RunError::Study(
            "no sample has an error estimate for all quantities, so no settings can be recommended".into(),
        ));
    };
    let found = match target {
        Target::Error(share) => known.iter().filter(|k| k.1 <= share).min_by(by_cost),
        Target::Budget(seconds) => known.iter().filter(|k| cost(k.0) <= seconds).min_by(by_bound),
    };
    found.map(|k| k.0).ok_or_else(|| {
        RunError::Input(match target {
            Target::Error(share) => format!(
                "no sample meets the target error {}: the nearest is `{}` with an error bound of {} ({}) at {}. Add finer \
                 values to the parameters with the largest uncertainty, or raise the target",
                percent(share),
                name(best.0),
                percent(best.1),
                outcome.bound(best.0).map_or("", |b| &study.quantities[b.0].name),
                clock(cost(best.0))
            ),
            Target::Budget(seconds) => format!(
                "the budget of {} is below one run: the cheapest sample, `{}`, costs {}. Raise the budget",
                clock(seconds),
                name(cheapest.0),
                clock(cost(cheapest.0))
            ),
        })
    })
}

/// A recommended sample with its errors.
#[derive(Clone, Debug, Serialize)]
pub struct Advice {
    /// The target, in words.
    pub asked: String,
    /// The sample.
    pub sample: String,
    /// Parameters and their values.
    pub settings: Vec<(String, String)>,
    /// Cost by `measure`, s.
    pub cost_s: f64,
    /// Half range of the cost of repeated runs, s; `None` for one run.
    pub cost_spread_s: Option<f64>,
    /// Measure of cost.
    pub measure: &'static str,
    /// Errors of the quantities.
    pub errors: Vec<QuantityError>,
    /// Sources of error without an estimate.
    pub not_assessed: Vec<NotAssessed>,
    /// Note on the run, if any.
    pub note: Option<String>,
    /// Comparison with the reference.
    pub verified: Option<Vec<Verified>>,
    /// Scene file with the recommended settings.
    pub scene: PathBuf,
    /// Commit and build of the programs.
    pub build: String,
}

/// Estimated error of a quantity with its uncertainty, relative to `scale`.
#[derive(Clone, Debug, Serialize)]
pub struct QuantityError {
    /// Quantity.
    pub quantity: String,
    /// Value of the sample.
    pub value: f64,
    /// Extrapolated value.
    pub answer: f64,
    /// Reference value of relative errors.
    pub scale: f64,
    /// Estimated error.
    pub error: f64,
    /// Uncertainty of the error (half width).
    pub band: f64,
}

/// Further input of a recommendation.
pub struct Context<'a> {
    /// Section `[output]` of the user's scene.
    pub output: &'a case::Output,
    /// Results folder.
    pub out: &'a Path,
    /// Sources of error without an estimate.
    pub not_assessed: &'a [NotAssessed],
    /// Notes of the samples.
    pub notes: &'a [Option<String>],
    /// Commit and build of the programs.
    pub build: &'a str,
}

/// Recommends a sample for a target. Writes its scene as `<name>.toml` and the recommendation as `<name>.json` to the
/// results folder.
///
/// # Errors
/// No sample meets the target, or a file cannot be written.
pub fn advise(
    study: &Study,
    outcome: &Outcome,
    (target, name): (Target, &str),
    context: &Context<'_>,
) -> Result<Advice, RunError> {
    let m = choose(study, outcome, target)?;
    let s = &outcome.samples[m];
    let asked = match target {
        Target::Error(share) => format!("error within {}", percent(share)),
        Target::Budget(seconds) => format!("cost within {}", clock(seconds)),
    };
    let settings = study.parameters.iter().zip(&study.samples[m].settings);
    let error = |q: usize| {
        let (a, e) = (outcome.answers[q]?, s.estimates[q]?);
        let quantity = study.quantities[q].name.clone();
        let value = s.values[q]?;
        Some(QuantityError { quantity, value, answer: a.value, scale: a.scale, error: e.error, band: e.band })
    };
    let advice = Advice {
        asked,
        sample: study.samples[m].label.clone(),
        settings: settings.map(|(d, v)| (d.parameter.name.clone(), v.to_string())).collect(),
        cost_s: s.cost.0,
        cost_spread_s: (s.cost.1 > 0.0).then_some(s.cost.1),
        measure: outcome.measure.label(),
        errors: (0..study.quantities.len()).filter_map(error).collect(),
        not_assessed: context.not_assessed.to_vec(),
        note: context.notes[m].clone(),
        verified: verify(study, outcome, m).transpose().map_err(RunError::Study)?,
        scene: context.out.join(format!("{name}.toml")),
        build: context.build.to_owned(),
    };
    let mut scene = study.samples[m].scene.clone();
    scene.output = context.output.clone();
    let text = toml::to_string(&scene)
        .map_err(|e| RunError::Input(format!("the scene cannot be written as TOML: {e}")))?;
    std::fs::write(&advice.scene, advice.header() + &text).map_err(RunError::file("write", &advice.scene))?;
    let json = advice.scene.with_extension("json");
    let text = serde_json::to_string_pretty(&advice).unwrap_or_default();
    std::fs::write(&json, text + "\n").map_err(RunError::file("write", &json))?;
    Ok(advice)
}

impl Advice {
    /// Lines for the terminal and the report.
    pub fn lines(&self) -> Vec<String> {
        let settings: Vec<String> = self.settings.iter().map(|(name, v)| format!("{name} {v}")).collect();
        let spread = self.cost_spread_s.map_or_else(String::new, |s| format!(" ± {}", clock(s)));
        let mut lines = vec![format!(
            "{}: `{}` ({}), cost {}{spread} ({})",
            self.asked,
            self.sample,
            settings.join(", "),
            clock(self.cost_s),
            self.measure
        )];
        for e in &self.errors {
            lines.push(format!(
                "  {}: expected error {} ± {}",
                e.quantity,
                percent(e.error),
                percent(e.band)
            ));
        }
        lines.extend(coverage::line(&self.not_assessed).map(|l| format!("  {l}")));
        lines.extend(self.note.iter().map(|n| format!("  note: {n}")));
        if let Some(all) = &self.verified {
            let held = all.iter().filter(|v| v.held).count();
            lines.push(format!(
                "  verified: {held} of {} true errors (relative to sample `reference`) are within their bounds",
                all.len()
            ));
        }
        lines
    }

    /// Comment lines above the written scene.
    fn header(&self) -> String {
        let mut text = format!("# Written by `ripstop accuracy`, {}.\n", self.build);
        for line in self.lines() {
            text += &format!("# {line}\n");
        }
        for n in &self.not_assessed {
            text += &format!("#   {}: {}\n", n.name, n.why.lines().next().unwrap_or_default());
        }
        text + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn errors_and_times_are_parsed() {
        assert_eq!((share("1%"), share("0.5 %"), share("0.02")), (Ok(0.01), Ok(0.005), Ok(0.02)));
        assert_eq!(
            (time("90"), time("10min"), time("2 h"), time("3s")),
            (Ok(90.0), Ok(600.0), Ok(7200.0), Ok(3.0))
        );
        for wrong in ["-1%", "x", "0", "%", "inf", "1000%", "nan"] {
            assert!(share(wrong).is_err(), "{wrong}");
        }
        assert!(time("0s").is_err() && time("min").is_err());
    }

    #[test]
    fn number_that_may_be_percent_is_refused_with_the_correction() {
        for (text, meant) in [("5", "`5%`"), ("1", "`1%`"), ("1.5", "`1.5%`")] {
            let why = share(text).unwrap_err();
            assert!(why.contains(meant) && why.contains("meant?"), "{why}");
        }
    }

    fn context<'a>(output: &'a case::Output, out: &'a Path, notes: &'a [Option<String>]) -> Context<'a> {
        Context { output, out, not_assessed: &[], notes, build: "build" }
    }

    #[test]
    fn recommendation_is_the_cheapest_sample_within_the_target() {
        let (study, values, records) = made();
        let o = judge(&study, &values, &records, Measure::Wall);
        let best = (0..study.samples.len()).filter_map(|m| o.bound(m)).map(|b| b.1).fold(f64::MAX, f64::min);
        let wanted = 1.5 * best;
        let m = choose(&study, &o, Target::Error(wanted)).unwrap();
        assert!(o.bound(m).unwrap().1 <= wanted);
        for (k, s) in o.samples.iter().enumerate() {
            assert!(o.bound(k).unwrap().1 > wanted || s.cost.0 >= o.samples[m].cost.0);
        }
        let (out, output, notes) =
            (tempfile::tempdir().unwrap(), case::Output::default(), vec![None; study.samples.len()]);
        let all = coverage::not_assessed(&study, &o);
        let context = Context { not_assessed: &all, ..context(&output, out.path(), &notes) };
        let advice = advise(&study, &o, (Target::Error(wanted), "target-error"), &context).unwrap();
        let text = std::fs::read_to_string(&advice.scene).unwrap();
        assert!(case::load(&advice.scene).is_ok() && text.contains("# error within"), "{text}");
        // Parameters that were not varied are listed in the written scene, the text and the JSON.
        assert!(text.contains("not assessed") && text.contains("substeps: not varied"), "{text}");
        assert!(advice.lines().iter().any(|l| l.contains("not assessed") && l.contains("substeps")));
        let json = std::fs::read_to_string(out.path().join("target-error.json")).unwrap();
        assert!(json.contains("\"substeps\"") && json.contains("\"band\""));
        let none = choose(&study, &o, Target::Error(1e-6)).unwrap_err().to_string();
        assert!(none.contains("nearest"), "{none}");
        let poor = choose(&study, &o, Target::Budget(1e-6)).unwrap_err().to_string();
        assert!(poor.contains("below one run"), "{poor}");
        let rich = choose(&study, &o, Target::Budget(1e9)).unwrap();
        assert!((o.bound(rich).unwrap().1 - best).abs() < 1e-15);
    }

    #[test]
    fn study_without_estimates_recommends_nothing() {
        let (study, mut values, mut records) = made();
        for m in 1..study.samples.len() {
            values[m][0] = Err("no result".into());
            records[m].failure = Some("diverged".into());
        }
        let o = judge(&study, &values, &records, Measure::Wall);
        let (out, output, notes) =
            (tempfile::tempdir().unwrap(), case::Output::default(), vec![None; study.samples.len()]);
        for target in [Target::Error(0.6), Target::Budget(1e9)] {
            let why = advise(&study, &o, (target, "x"), &context(&output, out.path(), &notes)).unwrap_err();
            assert!(why.exit_code() == 1 && why.to_string().contains("not assessed"), "{why}");
            assert!(!out.path().join("x.toml").exists());
        }
    }
}
