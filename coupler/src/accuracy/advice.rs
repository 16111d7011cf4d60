//! The cheapest settings for an accuracy, the most accurate ones for a time.

use std::path::{Path, PathBuf};

use super::judge::Outcome;
use super::page::percent;
use super::study::Study;
use crate::error::RunError;
use crate::progress::clock;

/// What a person asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// An error of at most this share.
    Want(f64),
    /// At most this cost, s.
    Budget(f64),
}

/// `1%`, or a share as `0.01`.
///
/// # Errors
/// What is no share.
pub fn share(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let value = match text.strip_suffix('%') {
        Some(number) => number.trim().parse::<f64>().map(|x| x / 100.0),
        None => text.parse(),
    };
    value
        .ok()
        .filter(|x| *x > 0.0 && *x < 10.0)
        .ok_or_else(|| "a share above 0, such as `1%` or `0.01`".into())
}

/// `90`, `90s`, `10min`, `2h`.
///
/// # Errors
/// What is no time.
pub fn time(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let units = [("min", 60.0), ("h", 3600.0), ("m", 60.0), ("s", 1.0), ("", 1.0)];
    units
        .iter()
        .find_map(|(unit, factor)| text.strip_suffix(unit)?.trim().parse::<f64>().ok().map(|x| x * factor))
        .filter(|x| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "a time above 0, such as `90s`, `10min` or `2h`".into())
}

/// The member that grants a wish.
///
/// # Errors
/// A wish that no member grants, with what is nearest.
pub fn choose(study: &Study, outcome: &Outcome, wish: Wish) -> Result<usize, RunError> {
    let name = |m: usize| &study.members[m].label;
    let cost = |m: usize| outcome.members[m].cost.0;
    let bound = |m: usize| outcome.bound(m).unwrap_or(f64::INFINITY);
    let (Some(&cheapest), Some(&best)) = (outcome.front.first(), outcome.front.last()) else {
        return Err(RunError::Input(
            "no member of the study has all values: there is nothing to advise".into(),
        ));
    };
    match wish {
        Wish::Want(share) => outcome.front.iter().copied().find(|&m| bound(m) <= share).ok_or_else(|| {
            RunError::Input(format!(
                "no member is within {}: the nearest is `{}` with an error of up to {} at {}; add finer values to its \
                 dials, or want less",
                percent(share),
                name(best),
                percent(bound(best)),
                clock(cost(best))
            ))
        }),
        Wish::Budget(seconds) => outcome.front.iter().copied().rev().find(|&m| cost(m) <= seconds).ok_or_else(|| {
            RunError::Input(format!(
                "a budget of {} is below one run: the cheapest member, `{}`, takes {}",
                clock(seconds),
                name(cheapest),
                clock(cost(cheapest))
            ))
        }),
    }
}

/// What is advised, in words, and the scene in `out`, ready to run.
///
/// # Errors
/// A wish that cannot be granted, trouble with the file.
pub fn advise(
    study: &Study,
    outcome: &Outcome,
    wish: Wish,
    output: &case::Output,
    out: &Path,
) -> Result<(String, PathBuf), RunError> {
    let m = choose(study, outcome, wish)?;
    let s = &outcome.members[m];
    let (error, band) = s.worst.unwrap_or((f64::NAN, f64::NAN));
    let (asked, file) = match wish {
        Wish::Want(share) => (format!("within {}", percent(share)), "want.toml"),
        Wish::Budget(seconds) => (format!("within {}", clock(seconds)), "budget.toml"),
    };
    let settings: Vec<String> = study
        .dials
        .iter()
        .zip(&study.members[m].settings)
        .map(|(d, v)| format!("{} {v}", d.dial.name))
        .collect();
    let words = format!(
        "{asked}: `{}` ({}), expected error {} ± {}, cost {} ± {} ({})",
        study.members[m].label,
        settings.join(", "),
        percent(error),
        percent(band),
        clock(s.cost.0),
        clock(s.cost.1),
        outcome.measure.label()
    );
    let mut scene = study.members[m].scene.clone();
    scene.output = output.clone();
    let text = toml::to_string(&scene)
        .map_err(|e| RunError::Input(format!("the scene cannot be written down again: {e}")))?;
    let path = out.join(file);
    std::fs::write(&path, format!("# Written by `ripstop accuracy`: {words}\n\n{text}"))
        .map_err(RunError::file("write", &path))?;
    Ok((format!("{words}; the scene: {}", path.display()), path))
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
        assert!(share("-1%").is_err() && share("x").is_err() && time("0s").is_err() && time("min").is_err());
    }

    #[test]
    fn advice_is_the_cheapest_that_is_good_enough() {
        let (study, values, records) = made();
        let o = judge(&study, &values, &records, Measure::Wall);
        let out = tempfile::tempdir().unwrap();
        let best = o.bound(*o.front.last().unwrap()).unwrap();
        let wanted = 1.5 * best;
        let m = choose(&study, &o, Wish::Want(wanted)).unwrap();
        for (k, s) in o.members.iter().enumerate() {
            assert!(o.bound(k).unwrap() > wanted || s.cost.0 >= o.members[m].cost.0);
        }
        let output = case::Output::default();
        let (words, file) = advise(&study, &o, Wish::Want(wanted), &output, out.path()).unwrap();
        assert!(words.contains("grid") && case::load(&file).is_ok(), "{words}");
        let none = choose(&study, &o, Wish::Want(1e-6)).unwrap_err().to_string();
        assert!(none.contains("nearest"), "{none}");
        let poor = choose(&study, &o, Wish::Budget(1e-6)).unwrap_err().to_string();
        assert!(poor.contains("below one run"), "{poor}");
        let rich = choose(&study, &o, Wish::Budget(1e9)).unwrap();
        assert_eq!(rich, *o.front.last().unwrap());
    }
}
