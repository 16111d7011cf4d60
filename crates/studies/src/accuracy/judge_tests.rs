//! Synthetic studies with known exact values.

use std::path::Path;

use super::super::convergence::Behaviour;
use super::super::cost::{Counts, StageCost};
use super::super::study::Choice;
use super::*;

type Made = (Study, Vec<Vec<Value>>, Vec<Record>);

const SPEED: &str = "[[accuracy.quantity]]\nname = \"speed\"\nof = \"descent-speed\"\n";
const DRAG: &str = "[[accuracy.quantity]]\nname = \"drag\"\nof = \"drag\"\n";
const GRID: &str = "[[accuracy.parameter]]\nname = \"grid\"\nvalues = [0.5, 1.0, 2.0]\ncheck = 4.0\n";
const WINDOW: &str = "[[accuracy.parameter]]\nname = \"window\"\nvalues = [0.5, 1.0, 2.0]\n";

/// A study of `square-drop` with the given section and values by `formula` from the sizes of the parameters;
/// cost 1/(h^3 t) with `h` the first size and `t` the second (1 where there is none).
fn study(section: &str, choice: &Choice, formula: impl Fn(&[f64]) -> Vec<f64>) -> Made {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("scene.toml");
    std::fs::write(&copy, std::fs::read_to_string(file).unwrap() + section).unwrap();
    let study = Study::new(&copy, choice).unwrap();
    let (mut values, mut records) = (Vec::new(), Vec::new());
    for m in &study.samples {
        let sizes: Vec<f64> =
            study.parameters.iter().zip(&m.settings).filter_map(|(d, s)| d.parameter.size(s)).collect();
        let (h, t) = (sizes[0], sizes.get(1).copied().unwrap_or(1.0));
        values.push(formula(&sizes).into_iter().map(Ok).collect());
        let counts = Counts { cell_updates: 1e6 / (h * h * h * t), ..Counts::default() };
        let stage = StageCost {
            name: "descent".into(),
            counts,
            parts_s: [1.0, 3.0, 0.5, 0.1, 0.2],
            ..StageCost::default()
        };
        let wall_s = 1.0 / (h * h * h * t);
        records.push(Record {
            runs: vec![Cost { wall_s, cpu_s: 2.0 * wall_s, peak_bytes: 1e8, stages: vec![stage] }],
            ..Record::default()
        });
    }
    (study, values, records)
}

fn checked() -> Choice {
    Choice { check: true, ..Choice::default() }
}

/// One quantity, 10 + 0.4 h^2 + 0.1 t, `h` of the grid, `t` of the window.
pub fn made() -> Made {
    let section = format!(
        "[accuracy]\nsweep = [\"grid\", \"window\"]\nsweep_check = [4.0, 4.0]\n{SPEED}{GRID}{WINDOW}\
         [[accuracy.parameter]]\nname = \"scheme\"\nchoices = [\"default\", \"implicit:aitken\"]\n"
    );
    study(&section, &checked(), |s| vec![10.0 + 0.4 * s[0] * s[0] + 0.1 * s[1]])
}

/// Index of the sample with this label.
fn sample(study: &Study, label: &str) -> usize {
    study.samples.iter().position(|m| m.label == label).unwrap_or_else(|| panic!("no sample {label}"))
}

#[test]
fn synthetic_study_gives_exact_value_orders_and_front() {
    let (study, values, records) = made();
    let o = judge(&study, &values, &records, Measure::Work);
    let a = o.answers[0].unwrap();
    assert!((a.value - 10.0).abs() <= a.uncertainty && a.uncertainty < 0.4, "{a:?}");
    let grid = o.lines[0][0].convergence.as_ref().unwrap();
    assert!((grid.order.unwrap() - 2.0).abs() < 1e-3);
    let window = o.lines[1][0].convergence.as_ref().unwrap();
    assert!((window.order.unwrap() - 1.0).abs() < 1e-3);
    // The choices have no effect here.
    assert!(o.lines[2][0].errors.iter().all(|e| e.unwrap().0 < 1e-12));
    let (held, all) = o.held();
    assert_eq!((held, all), (2, 2), "{:?}", o.lines);
    // The true error of every sample is within its bound.
    for (m, v) in values.iter().enumerate() {
        let error = (v[0].clone().unwrap() - 10.0) / 10.0;
        assert!(error <= o.bound(m).unwrap().1, "{}: {error}", study.samples[m].label);
    }
    assert_decreasing(&o, &o.front, |s| s.largest.unwrap().estimate);
    assert!(o.front.len() >= 2, "{:?}", o.front);
}

/// Asserts that along a front the cost increases and the error decreases by more than the uncertainty.
fn assert_decreasing(o: &Outcome, front: &[usize], of: impl Fn(&Standing) -> Estimate) {
    for w in front.windows(2) {
        let (a, b) = (of(&o.samples[w[0]]), of(&o.samples[w[1]]));
        assert!(a.error - b.error > a.band.max(b.band), "{a:?} {b:?}");
        assert!(o.samples[w[0]].cost.0 <= o.samples[w[1]].cost.0);
    }
}

#[test]
fn largest_error_has_the_uncertainty_of_its_quantity() {
    // The speed oscillates about the value of the base: error 0 and a large uncertainty. The drag has a large error of
    // known order and a smaller uncertainty.
    let formula = |s: &[f64]| {
        let speed = match s[0] {
            2.0 => 9.0,
            1.0 => 10.0,
            _ => 9.5,
        };
        vec![speed, 100.0 * (1.0 + 0.1 * s[0])]
    };
    let section = format!(
        "{SPEED}{DRAG}[[accuracy.parameter]]\nname = \"grid\"\nvalues = [0.5, 1.0, 2.0]\nbase = 2.0\n"
    );
    let (study, values, records) = study(&section, &checked(), formula);
    let o = judge(&study, &values, &records, Measure::Wall);
    let (speed, drag) = (o.samples[0].estimates[0].unwrap(), o.samples[0].estimates[1].unwrap());
    assert!(speed.error < 1e-12 && speed.band > 0.25, "{speed:?}");
    assert!((drag.error - 0.05).abs() < 1e-3 && drag.band < 0.1, "{drag:?}");
    // Ranked by error plus uncertainty, the speed would be the largest with an error of 0 %.
    assert!(speed.bound() > drag.bound());
    let largest = o.samples[0].largest.unwrap();
    assert_eq!((largest.quantity, largest.estimate), (1, drag));
    // The bound of the sample is the largest sum.
    assert_eq!(o.bound(0).unwrap().0, 0);
}

#[test]
fn fronts_of_an_oscillating_study_decrease() {
    let formula = |s: &[f64]| {
        let (h, t) = (s[0], s[1]);
        let noise = |k: f64| 0.3 * (7.0 * k * h + 13.0 * t).sin();
        vec![10.0 + 0.4 * h * h + 0.1 * t + noise(1.0), 50.0 + 4.0 * h + 0.2 * t * t - 3.0 * noise(2.0)]
    };
    let section = format!(
        "[accuracy]\nsweep = [\"grid\", \"window\"]\nsweep_check = [4.0, 4.0]\n{SPEED}{DRAG}{GRID}{WINDOW}"
    );
    let (study, values, records) = study(&section, &checked(), formula);
    let o = judge(&study, &values, &records, Measure::Work);
    assert_decreasing(&o, &o.front, |s| s.largest.unwrap().estimate);
    for (q, front) in o.fronts.iter().enumerate() {
        assert!(!front.is_empty());
        assert_decreasing(&o, front, |s| s.estimates[q].unwrap());
    }
}

#[test]
fn cheaper_sample_is_as_accurate_in_every_quantity() {
    // A coarser window halves the cost. It changes the drag, but not the speed.
    let formula = |s: &[f64]| vec![10.0 + 0.4 * s[0], 100.0 + 5.3 * s[0] + 6.5 * (s[1] - 1.0)];
    let section = format!("{SPEED}{DRAG}{GRID}{WINDOW}");
    let (study, values, records) = study(&section, &checked(), formula);
    let o = judge(&study, &values, &records, Measure::Wall);
    let coarse = sample(&study, "window 0.5");
    assert!(o.as_accurate(coarse, 0) && !o.as_accurate(coarse, 1), "{:?}", o.samples[coarse]);
    let (m, share) = o.cheaper(&[0]).unwrap();
    assert!(m == coarse && (share - 0.5).abs() < 1e-12);
    assert_eq!(o.cheaper(&[0, 1]), None);
}

#[test]
fn errors_of_opposite_sign_are_not_equally_accurate() {
    // Both have errors of about 5.3 %, of opposite sign: which is closer depends on the exact value.
    let formula = |s: &[f64]| vec![10.0 + 0.53 * s[0] - 1.06 * (s[1] - 1.0)];
    let (study, values, records) = study(&format!("{SPEED}{GRID}{WINDOW}"), &checked(), formula);
    let mut o = judge(&study, &values, &records, Measure::Wall);
    let coarse = sample(&study, "window 0.5");
    let base = o.samples[0].estimates[0].unwrap();
    o.samples[coarse].estimates[0] = Some(base);
    assert!(!o.as_accurate(coarse, 0));
}

#[test]
fn failed_sample_has_no_error() {
    let (study, mut values, mut records) = made();
    let lost = study.lines[0].samples[0].0;
    values[lost][0] = Err("no result".into());
    records[lost].failure = Some("diverged".into());
    let o = judge(&study, &values, &records, Measure::Wall);
    assert_eq!(o.samples[lost].gap.as_deref(), Some("diverged"));
    assert!(o.samples[lost].largest.is_none() && !o.front.contains(&lost));
    assert!(o.lines[0][0].errors[0].is_none() && o.lines[0][0].errors[1].is_some());
    assert_eq!(o.lines[0][0].convergence.as_ref().unwrap().behaviour, Behaviour::TooFew);
}

#[test]
fn too_few_samples_are_not_assessed() {
    let (study, mut values, mut records) = made();
    // All but the base fail.
    for m in 1..study.samples.len() {
        values[m][0] = Err("no result".into());
        records[m].failure = Some("diverged".into());
    }
    let o = judge(&study, &values, &records, Measure::Wall);
    assert!(o.answers[0].is_none() && o.samples[0].estimates[0].is_none() && o.front.is_empty());
    for line in &o.lines {
        let why = line[0].unassessed.as_deref().unwrap();
        assert!(why.contains("1 of") && line[0].errors.iter().all(Option::is_none), "{why}");
    }
}

#[test]
fn parameter_without_estimate_is_reported_separately() {
    let section = format!("{SPEED}{GRID}{WINDOW}");
    let (study, mut values, mut records) = study(&section, &Choice::default(), |s| vec![10.0 + s[0] + s[1]]);
    for label in ["window 0.5", "window 2"] {
        let m = sample(&study, label);
        values[m][0] = Err("no result".into());
        records[m].failure = Some("diverged".into());
    }
    let o = judge(&study, &values, &records, Measure::Wall);
    assert!(o.lines[1][0].unassessed.is_some() && o.lines[0][0].unassessed.is_none());
    // The base has the error of the grid alone; the window is listed as not assessed.
    assert!(o.answers[0].is_some() && o.samples[0].largest.is_some());
    // The error of a sample with another window is unknown.
    let mut study = study;
    let grid = sample(&study, "grid 0.5");
    let moved = study.samples[sample(&study, "window 0.5")].settings[1].clone();
    study.samples[grid].settings[1] = moved;
    assert!(judge(&study, &values, &records, Measure::Wall).samples[grid].largest.is_none());
}

#[test]
fn reference_is_finer_than_all_samples_and_tests_the_bound() {
    use super::super::advice::{Target, choose};
    use super::super::parameter::Setting;
    use super::super::verify::verify;
    let section = format!("{SPEED}{GRID}{WINDOW}");
    let choice = Choice { verify: true, ..Choice::default() };
    let made = |limit: f64| {
        study(&section, &choice, move |s| {
            let smooth = 10.0 + 0.4 * s[0] * s[0] + 0.1 * s[1];
            vec![if s[0] < 0.3 { limit } else { smooth }]
        })
    };
    let (study, values, records) = made(10.0 + 0.4 / 16.0 + 0.025);
    let at = study.reference.unwrap();
    // The grid's `check`, and twice the finest window.
    assert_eq!(study.samples[at].settings, [Setting::Number(4.0), Setting::Number(4.0)]);
    let o = judge(&study, &values, &records, Measure::Wall);
    assert!(!o.front.contains(&at) && o.fronts.iter().all(|f| !f.contains(&at)));
    assert_ne!(choose(&study, &o, Target::Budget(1e9)).unwrap(), at);
    let v = verify(&study, &o, 0).unwrap().unwrap();
    let far = (10.5 - 10.05) / o.answers[0].unwrap().scale;
    assert!((v[0].true_error - far).abs() < 1e-12 && v[0].held, "{v:?}");
    // The samples do not show this value: the bound is exceeded and reported.
    let (study, values, records) = made(20.0);
    let o = judge(&study, &values, &records, Measure::Wall);
    assert!(!verify(&study, &o, 0).unwrap().unwrap()[0].held);
    // Without the option there is no reference.
    let (study, values, records) = self::made();
    assert!(verify(&study, &judge(&study, &values, &records, Measure::Wall), 0).is_none());
}

#[test]
fn diverging_quantity_is_not_assessed_and_nothing_is_recommended() {
    use super::super::advice::{Target, choose};
    let formula = |s: &[f64]| vec![10.0 + 0.4 * s[0], 100.0 / s[1].sqrt()];
    let (study, values, records) = study(&format!("{SPEED}{DRAG}{GRID}{WINDOW}"), &checked(), formula);
    let o = judge(&study, &values, &records, Measure::Wall);
    assert!(
        o.answers[0].is_some() && o.answers[1].is_none() && o.front.is_empty() && !o.fronts[0].is_empty()
    );
    let why = choose(&study, &o, Target::Error(0.5)).unwrap_err().to_string();
    assert!(why.contains("`drag` is not assessed") && why.contains("`window`: its changes grow"), "{why}");
}
