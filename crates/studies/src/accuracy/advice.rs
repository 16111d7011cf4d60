//! The cheapest settings for an accuracy, the most accurate ones for a time.

use std::path::{Path, PathBuf};

use coupling::error::RunError;
use serde::Serialize;
use terminal::clock;

use super::coverage::{self, NotAssessed};
use super::judge::Outcome;
use super::page::percent;
use super::study::Study;
use super::verify::{Verified, verify};

/// What the user asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// An error of at most this share.
    Error(f64),
    /// At most this cost, s.
    Budget(f64),
}

/// `1%`, or a share below 1 as `0.01`.
///
/// # Errors
/// Text that is neither, and numbers of 1 and more without a percent sign: 5 may mean 5 % or 500 %.
pub fn share(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let help = "a relative error above 0, such as `1%` or `0.01`";
    let (number, factor) = match text.strip_suffix('%') {
        Some(number) => (number.trim(), 0.01),
        None => (text, 1.0),
    };
    let value = number.parse::<f64>().ok().filter(|x| *x > 0.0 && x.is_finite()).ok_or(help)?;
    if factor == 1.0 && value >= 1.0 {
        return Err(format!(
            "is {number} % meant? Write `{number}%`; without a percent sign the number is a share below 1 (0.05 is 5 %)"
        ));
    }
    let share = factor * value;
    if share < 10.0 { Ok(share) } else { Err(help.into()) }
}

/// `90`, `90s`, `10min`, `2h`.
///
/// # Errors
/// Text that is no time.
pub fn time(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let units = [("min", 60.0), ("h", 3600.0), ("m", 60.0), ("s", 1.0), ("", 1.0)];
    units
        .iter()
        .find_map(|(unit, factor)| text.strip_suffix(unit)?.trim().parse::<f64>().ok().map(|x| x * factor))
        .filter(|x| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "a time above 0, such as `90s`, `10min` or `2h`".into())
}

/// The sample that fulfils a wish, of all whose errors are known for every quantity.
///
/// # Errors
/// A study that does not assess a quantity; a wish that no sample fulfils, with the nearest.
pub fn choose(study: &Study, outcome: &Outcome, wish: Wish) -> Result<usize, RunError> {
    if let Some(q) = outcome.answers.iter().position(Option::is_none) {
        return Err(RunError::Study(format!(
            "`{}` is not assessed, so nothing is advised: {}",
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
        return Err(RunError::Study("no sample has an error for all quantities: nothing is advised".into()));
    };
    let found = match wish {
        Wish::Error(share) => known.iter().filter(|k| k.1 <= share).min_by(by_cost),
        Wish::Budget(seconds) => known.iter().filter(|k| cost(k.0) <= seconds).min_by(by_bound),
    };
    found.map(|k| k.0).ok_or_else(|| {
        RunError::Input(match wish {
            Wish::Error(share) => format!(
                "no sample is within {}: the nearest is `{}` with an error of up to {} ({}) at {}; add finer values to \
                 the parameters with the largest uncertainty, or raise the target",
                percent(share),
                name(best.0),
                percent(best.1),
                outcome.bound(best.0).map_or("", |b| &study.quantities[b.0].name),
                clock(cost(best.0))
            ),
            Wish::Budget(seconds) => format!(
                "a budget of {} is below one run: the cheapest sample, `{}`, takes {}",
                clock(seconds),
                name(cheapest.0),
                clock(cost(cheapest.0))
            ),
        })
    })
}

/// Advice: a sample with its errors.
#[derive(Clone, Debug, Serialize)]
pub struct Advice {
    /// What was asked for.
    pub asked: String,
    /// The sample.
    pub sample: String,
    /// Values of its parameters.
    pub settings: Vec<(String, String)>,
    /// Its cost, s, by this measure.
    pub cost_s: f64,
    /// Half the range of repeated runs; `None` for one run.
    pub cost_spread_s: Option<f64>,
    /// Measure of cost.
    pub measure: &'static str,
    /// Errors by quantity.
    pub errors: Vec<QuantityError>,
    /// What the errors do not contain.
    pub not_assessed: Vec<NotAssessed>,
    /// What is to be known of the run.
    pub note: Option<String>,
    /// Comparison with the reference.
    pub verified: Option<Vec<Verified>>,
    /// The scene.
    pub scene: PathBuf,
    /// Commit and build of the programs.
    pub build: String,
}

/// Error of a quantity with its band, relative to `scale`.
#[derive(Clone, Debug, Serialize)]
pub struct QuantityError {
    /// Quantity.
    pub quantity: String,
    /// Value of the sample.
    pub value: f64,
    /// Converged answer.
    pub answer: f64,
    /// Reference value of relative errors.
    pub scale: f64,
    /// Estimated error.
    pub error: f64,
    /// Half width of its band.
    pub band: f64,
}

/// What advice is made from, beside the study.
pub struct Context<'a> {
    /// Output section of the user's scene.
    pub output: &'a case::Output,
    /// Folder of the results.
    pub out: &'a Path,
    /// What the errors do not contain.
    pub not_assessed: &'a [NotAssessed],
    /// Notes of the samples.
    pub notes: &'a [Option<String>],
    /// Commit and build of the programs.
    pub build: &'a str,
}

/// The advice for a wish; its scene and itself are written into the folder of the results as `<name>.toml`
/// and `<name>.json`.
///
/// # Errors
/// A wish that cannot be fulfilled, trouble with the files.
pub fn advise(
    study: &Study,
    outcome: &Outcome,
    (wish, name): (Wish, &str),
    context: &Context<'_>,
) -> Result<Advice, RunError> {
    let m = choose(study, outcome, wish)?;
    let s = &outcome.samples[m];
    let asked = match wish {
        Wish::Error(share) => format!("within {}", percent(share)),
        Wish::Budget(seconds) => format!("within {}", clock(seconds)),
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
        .map_err(|e| RunError::Input(format!("the scene cannot be written down again: {e}")))?;
    std::fs::write(&advice.scene, advice.header() + &text).map_err(RunError::file("write", &advice.scene))?;
    let json = advice.scene.with_extension("json");
    let text = serde_json::to_string_pretty(&advice).unwrap_or_default();
    std::fs::write(&json, text + "\n").map_err(RunError::file("write", &json))?;
    Ok(advice)
}

impl Advice {
    /// For a terminal and the report: a line each.
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
        lines.extend(self.note.iter().map(|n| format!("  caution: {n}")));
        if let Some(all) = &self.verified {
            let held = all.iter().filter(|v| v.held).count();
            lines.push(format!(
                "  verified: {held} of {} true errors (against `reference`) are within what is promised",
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
    fn shares_and_times() {
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
    fn a_number_that_may_be_percent_is_asked_about() {
        for (text, meant) in [("5", "`5%`"), ("1", "`1%`"), ("1.5", "`1.5%`")] {
            let why = share(text).unwrap_err();
            assert!(why.contains(meant) && why.contains("meant?"), "{why}");
        }
    }

    fn context<'a>(output: &'a case::Output, out: &'a Path, notes: &'a [Option<String>]) -> Context<'a> {
        Context { output, out, not_assessed: &[], notes, build: "build" }
    }

    #[test]
    fn advice_is_the_cheapest_that_is_good_enough() {
        let (study, values, records) = made();
        let o = judge(&study, &values, &records, Measure::Wall);
        let best = (0..study.samples.len()).filter_map(|m| o.bound(m)).map(|b| b.1).fold(f64::MAX, f64::min);
        let wanted = 1.5 * best;
        let m = choose(&study, &o, Wish::Error(wanted)).unwrap();
        assert!(o.bound(m).unwrap().1 <= wanted);
        for (k, s) in o.samples.iter().enumerate() {
            assert!(o.bound(k).unwrap().1 > wanted || s.cost.0 >= o.samples[m].cost.0);
        }
        let (out, output, notes) =
            (tempfile::tempdir().unwrap(), case::Output::default(), vec![None; study.samples.len()]);
        let all = coverage::not_assessed(&study, &o);
        let context = Context { not_assessed: &all, ..context(&output, out.path(), &notes) };
        let advice = advise(&study, &o, (Wish::Error(wanted), "target-error"), &context).unwrap();
        let text = std::fs::read_to_string(&advice.scene).unwrap();
        assert!(case::load(&advice.scene).is_ok() && text.contains("# within"), "{text}");
        // What was not varied stands in the written scene, in the advice and in its JSON.
        assert!(text.contains("not assessed") && text.contains("substeps: not varied"), "{text}");
        assert!(advice.lines().iter().any(|l| l.contains("not assessed") && l.contains("substeps")));
        let json = std::fs::read_to_string(out.path().join("target-error.json")).unwrap();
        assert!(json.contains("\"substeps\"") && json.contains("\"band\""));
        let none = choose(&study, &o, Wish::Error(1e-6)).unwrap_err().to_string();
        assert!(none.contains("nearest"), "{none}");
        let poor = choose(&study, &o, Wish::Budget(1e-6)).unwrap_err().to_string();
        assert!(poor.contains("below one run"), "{poor}");
        let rich = choose(&study, &o, Wish::Budget(1e9)).unwrap();
        assert!((o.bound(rich).unwrap().1 - best).abs() < 1e-15);
    }

    #[test]
    fn a_study_without_answer_advises_nothing() {
        let (study, mut values, mut records) = made();
        for m in 1..study.samples.len() {
            values[m][0] = Err("no result".into());
            records[m].failure = Some("diverged".into());
        }
        let o = judge(&study, &values, &records, Measure::Wall);
        let (out, output, notes) =
            (tempfile::tempdir().unwrap(), case::Output::default(), vec![None; study.samples.len()]);
        for wish in [Wish::Error(0.6), Wish::Budget(1e9)] {
            let why = advise(&study, &o, (wish, "x"), &context(&output, out.path(), &notes)).unwrap_err();
            assert!(why.exit_code() == 1 && why.to_string().contains("not assessed"), "{why}");
            assert!(!out.path().join("x.toml").exists());
        }
    }
}
